"""A program through its dialect: lines to blocks, blocks as they run, what runs to moves; and back to lines in order.

A program in which one block follows the other is read chunk by chunk, and every chunk can be written at once. One with
jumps, loops or calls is held as a whole: its chunks are of blocks as they run, so that a block may come in several.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import numpy as np

from kinematics.user_error import UserError
from postproc.dialects import Dialect, Interpreter
from postproc.motion.motions import Motions, merged
from postproc.text.block import Block, Refusal
from postproc.text.block_values import straight
from postproc.text.flow import Flow
from postproc.text.source import CHUNK, Source

Item = TypeVar("Item")


@dataclass(frozen=True)
class Part:
    """A chunk of blocks as they ran."""

    motions: Motions
    places: Sequence[int]
    """Of every block that ran: its index in the program."""
    size: int
    """Characters of text that were read for it."""
    varied: frozenset[int] = frozenset()
    """Blocks of the chunk that run several times, and move from or to different places."""
    held: bool = False
    """The program is held as a whole: blocks may run several times."""


def settled(parts: Iterable[Part]) -> Iterator[Part]:
    """The parts, joined where the moves of one decide how the last move before it is written.

    That is one which begins with a turn of rotary axes alone (`postproc/correct/rotary_moves.py`), or makes no move.
    """
    held: list[Part] = []
    for part in parts:
        if held and len(part.motions) and not part.motions.turning[0]:
            yield _joined(held)
            held = []
        held.append(part)
    if held:
        yield _joined(held)


def _joined(parts: list[Part]) -> Part:
    if len(parts) == 1:
        return parts[0]
    firsts = itertools.accumulate((len(part.places) for part in parts), initial=0)
    return Part(
        merged([part.motions for part in parts]),
        [place for part in parts for place in part.places],
        sum(part.size for part in parts),
        frozenset(first + i for first, part in zip(firsts, parts, strict=False) for i in part.varied),
        parts[0].held,
    )


class Execution(Protocol):
    """Runs a program once, and puts what is made of its blocks in the order in which they stand."""

    def parts(self) -> Iterator[Part]:
        """The chunks as they run; UserError, located in the program, for what can't be used."""

    def finished(self, part: Part, texts: list[str]) -> tuple[Sequence[Block], list[str]]:
        """Blocks, in the order of the program, whose texts are known when the blocks of a part have become `texts`."""

    def rest(self) -> tuple[Sequence[Block], list[str]]:
        """Those that are left at the end."""


def execution(
    source: Source, dialect: Dialect, interpreter: Interpreter, rehearsal: Interpreter | None = None
) -> Execution:
    """How a program has to be run; where a `rehearsal` finds out which blocks run several times, in different ways."""
    if turns(source, dialect):
        varied = frozenset[int]() if rehearsal is None else _varied(Walk(source, dialect, rehearsal))
        return Walk(source, dialect, interpreter, varied)
    return Straight(source, dialect, interpreter)


def turns(source: Source, dialect: Dialect) -> bool:
    """True for a program that holds a jump, a loop or a call."""
    for line, text in dialect.join_lines(source.lines()):
        if dialect.flow.search(text):
            try:
                block = dialect.read_block(line, text)
            except Refusal:
                continue
            if block.code is not None and block.code.turns:
                return True
    return False


@dataclass
class Straight:
    """A program whose blocks run one after the other."""

    source: Source
    dialect: Dialect
    interpreter: Interpreter

    def parts(self) -> Iterator[Part]:
        """Chunk by chunk."""
        try:
            lines = self.dialect.join_lines(self.source.lines())
            read = (self.dialect.read_block(line, text) for line, text in lines)
            while (motions := self._next(read)).blocks:
                yield Part(motions, range(len(motions.blocks)), sum(len(block.text) for block in motions.blocks))
        except Refusal as refusal:
            raise refusal.located(self.source.name, self.dialect.evidence) from None

    def _next(self, read: Iterator[Block]) -> Motions:
        """The next chunk; of several blocks that can't be used, the first one is refused."""
        return self.interpreter.read(straight(_chunk(read, self.dialect.leads), self.interpreter.scope))

    def finished(self, part: Part, texts: list[str]) -> tuple[Sequence[Block], list[str]]:
        """All of them."""
        return part.motions.blocks, texts

    def rest(self) -> tuple[Sequence[Block], list[str]]:
        """Nothing."""
        return [], []


@dataclass
class Walk:
    """A program that is held as a whole and walked through."""

    source: Source
    dialect: Dialect
    interpreter: Interpreter
    varied: frozenset[int] = frozenset()
    """Indices in the program of blocks that run several times, not alike."""
    blocks: list[Block] = field(init=False, default_factory=list)
    texts: dict[int, str] = field(init=False, default_factory=dict)
    """What became of the blocks that ran."""

    def parts(self) -> Iterator[Part]:
        """Chunks of blocks as they run."""
        try:
            lines = self.dialect.join_lines(self.source.lines())
            self.blocks = self.dialect.link([self.dialect.read_block(line, text) for line, text in lines])
            flow = Flow(self.blocks, self.interpreter.scope, self.dialect.labels, self.dialect.begins)
            steps = flow.run(self.interpreter)
            size = sum(len(block.text) for block in self.blocks)
            more = True
            while more:
                places: list[int] = []
                chunk = _chunk(steps, lambda step: self.dialect.leads(step[1]))
                motions = self.interpreter.read(_noting(chunk, places.append))
                more = len(places) >= CHUNK
                varied = frozenset(i for i, place in enumerate(places) if place in self.varied)
                yield Part(motions, places, size, varied, held=True)
                size = 0
        except Refusal as refusal:
            raise refusal.located(self.source.name, self.dialect.evidence) from None

    def finished(self, part: Part, texts: list[str]) -> tuple[Sequence[Block], list[str]]:
        """None before the end; a block that runs more than once has to become the same every time."""
        for place, text in zip(part.places, texts, strict=True):
            first = self.texts.setdefault(place, text)
            if first != text:
                block = self.blocks[place]
                shown = " and ".join(repr(part.strip()) for part in (first, text))
                raise block.refuse(
                    f"runs at several places, where it wants different corrections: {shown}; --unroll writes it out"
                )
        return [], []

    def rest(self) -> tuple[Sequence[Block], list[str]]:
        """All of them; those that did not run as they were."""
        return self.blocks, [self.texts.get(i, block.text) for i, block in enumerate(self.blocks)]


def _varied(walk: Walk) -> frozenset[int]:
    """Blocks whose moves are not the same whenever they run; nothing of a program that is refused, which says it."""
    first: dict[int, bytes] = {}
    varied = set()
    try:
        for part in walk.parts():
            motions = part.motions
            columns = (np.round(motions.start, 9), np.round(motions.target, 9), motions.known_start, motions.known)
            moves = np.hstack([motions.machine_target.round(9), *columns]) + 0.0
            for row, block in enumerate(motions.block.tolist()):
                place, move = part.places[block], moves[row].tobytes()
                if first.setdefault(place, move) != move:
                    varied.add(place)
    except UserError:
        return frozenset()
    return frozenset(varied)


def _chunk(items: Iterator[Item], leads: Callable[[Item], bool]) -> Iterator[Item]:
    """The next items, which are worked on together: none that is written with the one behind it is the last."""
    for count, item in enumerate(items, start=1):
        yield item
        if count >= CHUNK and not leads(item):
            return


def _noting(steps: Iterator[tuple[int, Block]], note: Callable[[int], None]) -> Iterator[Block]:
    for place, block in steps:
        note(place)
        yield block
