"""Execution of a program in its dialect: from lines to blocks and moves, and back to lines in their order.

A program whose blocks follow one another is read chunk by chunk, and every chunk can be written at once. A program with
jumps, loops or calls is stored: it is interpreted once, and corrected when all contexts of its blocks are known.
"""

from __future__ import annotations

import dataclasses
import itertools
import pickle
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np
from msgspec.structs import replace

from kinematics.user_error import UserError
from postproc.control.block_skip import decided
from postproc.control.codes import AXES
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.dialects import Dialect
from postproc.motion.axis_words import AxisWords
from postproc.motion.motions import Motions, merged
from postproc.program_lines import irregular_lines, read_blocks
from postproc.program_set import CalledFile, ProgramSet, called_files, names_in_text
from postproc.text.block import Block, Refusal
from postproc.text.block_values import straight
from postproc.text.blocks import Blocks, PlainRun
from postproc.text.flow import Flow
from postproc.text.source import CHUNK_BLOCKS, ENCODING, Source
from postproc.write.plain_texts import PlainText

KEPT_CHUNKS = 16
"""Number of chunks of a stored program that are kept in memory; later ones are kept in a temporary file."""
CALL = "program_call"
"""Kind of a block with CALL PGM."""


class Part(msgspec.Struct, frozen=True):
    """A chunk of blocks in the order of execution."""

    motions: Motions
    size: int
    """Number of characters that were read for it."""
    indices: Sequence[int] | None = None
    """Index in the program of every block that ran; None if every block runs once."""
    varied: frozenset[int] = frozenset()
    """Indices of blocks of the chunk that run several times with different moves."""
    repeated: bool = False
    """True if blocks of the chunk may run several times."""


def joined_before_rotary_moves(parts: Iterable[Part]) -> Iterator[Part]:
    """The parts, joined if one of them decides how the last move before it is written.

    Such a part begins with a feed move of rotary axes alone (`postproc/correct/rotary/moves.py`), or has no moves.
    """
    held: list[Part] = []
    refused = None
    try:
        for part in parts:
            if held and len(part.motions) and not part.motions.rotary_only[0]:
                yield _joined(held)
                held = []
            held.append(part)
    except UserError as refusal:
        refused = refusal  # a refusal of a move before it comes first
    if held:
        yield _joined(held)
    if refused is not None:
        raise refused


def _joined(parts: list[Part]) -> Part:
    if len(parts) == 1:
        return parts[0]
    indices = [index for part in parts for index in part.indices or ()]
    firsts = itertools.accumulate((len(part.motions.blocks) for part in parts), initial=0)
    return Part(
        merged([part.motions for part in parts]),
        sum(part.size for part in parts),
        None if parts[0].indices is None else indices,
        frozenset(first + i for first, part in zip(firsts, parts, strict=False) for i in part.varied),
        any(part.repeated for part in parts),
    )


def turns(source: Source, dialect: Dialect, setup: Setup) -> bool:
    """True for a program with a jump, a loop or a call."""
    files = called_files(source, dialect, setup)
    by_name = names_in_text(dialect, files)
    for line, text in irregular_lines(source, dialect):
        if dialect.flow.search(text) or (by_name is not None and by_name.search(text)):
            try:
                (block,) = dialect.link([dialect.read_block(line, text)], files.names, False, source.folder)
            except Refusal:
                continue
            if block.code is not None and block.code.turns:
                return True
    return False


class Different(Refusal):
    """A block that runs more than once and needs another text in each run."""


class Turns(Exception):
    """A program that was taken for one without jumps, loops and calls has one."""


@dataclass
class StreamedProgram:
    """A program whose blocks run once: it is run, and its corrected blocks are put into the order of the text."""

    source: Source
    dialect: Dialect
    interpreter: Interpreter
    ahead: bool = field(default=False, kw_only=True)
    """True if another process reads plain lines ahead."""

    def parts(self) -> Iterator[Part]:
        """The chunks in the order of execution; UserError, located in the program, for a block that is refused.

        Turns for a block that jumps, loops or calls.
        """
        try:
            chunks = _Chunks(read_blocks(self.source, self.dialect, self._axes, ahead=self.ahead), self.dialect.leads)
            while True:
                items = straight(_without_turns(self._decided(chunks.next()), self._calls), self.interpreter.scope)
                motions, refusal = self.interpreter.read_to_refusal(items)
                if motions.blocks:
                    yield Part(motions, motions.blocks.size)
                if refusal is not None:
                    raise refusal
                if not motions.blocks:
                    return
        except Refusal as refusal:
            raise refusal.located(self.source.name, self.dialect.evidence) from None

    def _calls(self, block: Block) -> bool:
        """True for a call of a file that is there, in a block that a control may also take for one without effect."""
        if block.kind != CALL:
            return False
        files = called_files(self.source, self.dialect, self.interpreter.control_state.setup)
        (linked,) = self.dialect.link([block], files.names, False, self.source.folder)
        return linked.code is not None and linked.code.turns

    def _decided(self, items: Iterable[Block | PlainRun]) -> Iterator[Block | PlainRun]:
        """The blocks as the block-skip switch lets them run."""
        return decided(items, self.interpreter.control_state.setup.block_skip, self.interpreter.notes)

    @property
    def _axes(self) -> str:
        """Letters of the axes, if each has one: the addresses of plain lines."""
        names = self.interpreter.recorder.machine.names
        return "".join(names) if set(names) <= set(AXES) else ""

    def in_context(self) -> Iterator[Part]:
        """The chunks of `parts` with their blocks that run several times with different moves."""
        return self.parts()

    def finished(self, part: Part, texts: list[str | PlainText]) -> tuple[Sequence[Block], list[str | PlainText]]:
        """Blocks and texts, in the order of the program, that are final once a part has the corrected `texts`."""
        return part.motions.blocks, texts

    def rest(self) -> tuple[Sequence[Block], list[str | PlainText]]:
        """Remaining blocks and texts at the end."""
        return [], []

    @property
    def called_files(self) -> list[CalledFile]:
        """The files that it has called so far."""
        return []

    def called(self) -> Iterator[tuple[CalledFile, Sequence[Block], list[str | PlainText]]]:
        """The called files, each with its blocks and their texts."""
        return iter(())


@dataclass
class StoredProgram(StreamedProgram):
    """A program with jumps, loops or calls, stored as a whole and run in the order of execution."""

    program_set: ProgramSet = field(init=False)
    """The program and the files that it has called so far."""
    texts: dict[int, str] = field(init=False, default_factory=dict)
    """Corrected texts of the blocks that ran."""
    bulk: bool = field(default=False, kw_only=True)
    """True if plain lines are read together."""

    def parts(self) -> Iterator[Part]:
        """Chunks of blocks in the order of execution."""
        try:
            axes = self._axes if self.bulk else ""
            self.program_set = files = ProgramSet(self.source, self.dialect, self.interpreter, axes=axes)
            flow = Flow(files.blocks, self.interpreter.scope, self.dialect.labels, self.dialect.begins, files)
            runs = flow.run(self.interpreter)
            size = sum(len(block.text) for block in files.blocks)
            more = True
            while more:
                indices: list[int] = []
                chunk = _chunk(runs, self.dialect.leads)
                motions = self.interpreter.read(_noting(chunk, indices))
                more = len(indices) >= CHUNK_BLOCKS
                yield Part(motions, size, indices)
                size = 0
        except Refusal as refusal:
            raise refusal.located(self.source.name, self.dialect.evidence) from None

    def in_context(self) -> Iterator[Part]:
        """The chunks, once all blocks have run."""
        kept: list[Part] = []
        contexts = _Contexts()
        with tempfile.TemporaryFile() as file:
            stored = 0
            for part in self.parts():
                contexts.add(part)
                if len(kept) < KEPT_CHUNKS:
                    kept.append(part)
                else:
                    pickle.dump(_read_singly(part), file)
                    stored += 1
            file.seek(0)
            for part in itertools.chain(kept, (pickle.load(file) for _ in range(stored))):
                yield contexts.marked(part)

    def finished(self, part: Part, texts: list[str | PlainText]) -> tuple[Sequence[Block], list[str | PlainText]]:
        """No blocks before the end; Refusal for a block that runs more than once with different texts."""
        for index, text in zip(part.indices or (), _of_blocks(texts), strict=True):
            first = self.texts.setdefault(index, text)
            if first != text:
                shown = " and ".join(repr(part.strip()) for part in (first, text))
                block = self.blocks[index]
                raise Different(
                    block.line,
                    block.text,
                    f"this block runs more than once and needs a different correction each time ({shown}); "
                    "--unroll writes it out",
                )
        return [], []

    def rest(self) -> tuple[Sequence[Block], list[str | PlainText]]:
        """All blocks of the program with their texts; blocks that did not run are unchanged."""
        return self._with_texts(0, self.program_set.main)

    @property
    def called_files(self) -> list[CalledFile]:
        """The files that it has called so far."""
        return self.program_set.called

    def called(self) -> Iterator[tuple[CalledFile, Sequence[Block], list[str | PlainText]]]:
        """The called files, each with its blocks and their texts."""
        for file in self.program_set.called:
            yield file, *self._with_texts(file.first, file.last)

    def _with_texts(self, first: int, last: int) -> tuple[Sequence[Block], list[str | PlainText]]:
        blocks = self.blocks[first:last]
        return blocks, [self.texts.get(i, block.text) for i, block in enumerate(blocks, start=first)]

    @property
    def blocks(self) -> list[Block]:
        """The blocks of the program and, behind them, those of the files that it has called so far."""
        return self.program_set.blocks


def execution(source: Source, dialect: Dialect, interpreter: Interpreter) -> StreamedProgram:
    """The program, stored if it has a jump, a loop or a call, otherwise streamed."""
    kind = StoredProgram if turns(source, dialect, interpreter.control_state.setup) else StreamedProgram
    return kind(source, dialect, interpreter)


def _without_turns(items: Iterator[Block | PlainRun], calls: Callable[[Block], bool]) -> Iterator[Block | PlainRun]:
    """The items of a chunk; Turns, before the first of them, for a block that jumps or loops, or that `calls`."""
    found: list[Block | PlainRun] = []
    refused = None
    try:
        for item in items:
            if isinstance(item, Block) and (calls(item) or (item.code is not None and item.code.turns)):
                raise Turns
            found.append(item)
    except UserError as fault:
        refused = fault
    yield from found
    if refused is not None:
        raise refused


class _Contexts:
    """Compares the runs of each block of a stored program."""

    def __init__(self) -> None:
        self._first: dict[int, bytes] = {}
        """Move of the first run, by block of the program."""
        self._varied: set[int] = set()
        self._runs: Counter[int] = Counter()
        """How often each block runs."""

    def add(self, part: Part) -> None:
        """Add the moves of a chunk."""
        motions, indices = part.motions, part.indices or ()
        self._runs.update(indices)
        columns = (np.round(motions.start, 9), np.round(motions.target, 9), motions.known_start, motions.known)
        moves = np.hstack([motions.machine_target.round(9), *columns]) + 0.0
        for row, block in enumerate(motions.block.tolist()):
            move = moves[row].tobytes()
            if self._first.setdefault(indices[block], move) != move:
                self._varied.add(indices[block])

    def marked(self, part: Part) -> Part:
        """The chunk with its blocks that run several times with different moves."""
        indices = part.indices or ()
        varied = frozenset(i for i, index in enumerate(indices) if index in self._varied)
        return replace(part, varied=varied, repeated=any(self._runs[index] > 1 for index in indices))


class _Chunks(msgspec.Struct):
    """The blocks of a program in chunks of `CHUNK_BLOCKS`; a chunk does not end at a block that `leads` the next."""

    items: Iterator[Block | PlainRun]
    leads: Callable[[Block], bool]
    _rest: PlainRun | None = None
    """Lines of the last run that belong to the next chunk."""

    def next(self) -> Iterator[Block | PlainRun]:
        """The next chunk; empty at the end."""
        count = 0
        while (item := self._rest or next(self.items, None)) is not None:
            self._rest = None
            if isinstance(item, PlainRun) and len(item) > (room := max(CHUNK_BLOCKS - count, 1)):
                self._rest, item = item.part(room, len(item)), item.part(0, room)
            yield item
            count += len(item) if isinstance(item, PlainRun) else 1
            if count >= CHUNK_BLOCKS and (isinstance(item, PlainRun) or not self.leads(item)):
                return


def _chunk(
    steps: Iterator[tuple[int, Block | PlainRun]], leads: Callable[[Block], bool]
) -> Iterator[tuple[int, Block | PlainRun]]:
    """The next steps of a chunk; it does not end at a block that `leads` the next."""
    count = 0
    for step in steps:
        yield step
        item = step[1]
        count += len(item) if isinstance(item, PlainRun) else 1
        if count >= CHUNK_BLOCKS and (isinstance(item, PlainRun) or not leads(item)):
            return


def _noting(steps: Iterator[tuple[int, Block | PlainRun]], noted: list[int]) -> Iterator[Block | PlainRun]:
    """The items of steps; `noted` becomes the indices of their blocks."""
    for index, item in steps:
        noted.extend(range(index, index + (len(item) if isinstance(item, PlainRun) else 1)))
        yield item


def _of_blocks(texts: Iterable[str | PlainText]) -> Iterator[str]:
    """The text of each block."""
    for text in texts:
        if isinstance(text, PlainText):
            yield from text.data.decode(ENCODING).splitlines(keepends=True)
        else:
            yield text


def _read_singly(part: Part) -> Part:
    """The part without runs of plain lines, which cannot be stored in a file."""
    motions = part.motions
    words = AxisWords([list(motions.words)])
    return replace(part, motions=dataclasses.replace(motions, blocks=Blocks(list(motions.blocks)), words=words))
