"""Editors of the blocks of a chunk, and the texts that they make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc
from postproc.text.block import Block, Edit, edited
from postproc.text.blocks import Blocks
from postproc.text.editing import Iterations, Layout, WordEditor, end_of
from postproc.write.decimals import decimals_of_axis
from postproc.write.plain_texts import PlainText

MOST_APART_UM = 1.0
"""Twice the largest difference, um, between the corrections of iterations of a block that share its text."""


class Rewrite(msgspec.Struct):
    """Changes by index of the block in the chunk."""

    edits: dict[int, list[Edit]] = msgspec.field(default_factory=dict)
    """Changes of the text of a block; they touch no coordinate."""
    before: dict[int, list[str]] = msgspec.field(default_factory=dict)
    """Lines before a block."""
    cut: dict[int, list[int]] = msgspec.field(default_factory=dict)
    """Indices of words that a block loses."""
    spelled: set[int] = msgspec.field(default_factory=set)
    """Blocks that get words for rotary axes which a tool vector has turned."""
    whole: set[int] = msgspec.field(default_factory=set)
    """Blocks that get X Y Z also where these do not move."""

    def prepared(self, index: int, block: Block) -> Block:
        """The block, beside which others may be added if its tool vector is replaced."""
        return block._replace(no_insertion=False) if index in self.spelled else block

    def write(self, block: int, editor: WordEditor) -> None:
        """Make the changes of a block."""
        for index in self.cut.get(block, ()):
            editor.cut(editor.block.words[index])
        editor.edits += self.edits.get(block, [])
        if lines := self.before.get(block):
            end = end_of(editor.block.text) or editor.layout.end
            editor.edits.insert(0, Edit(0, 0, "".join(line + end for line in lines)))

    straight: set[int] = msgspec.field(default_factory=set)
    """Blocks whose arcs are written as straight lines: G1 is in force behind them."""

    @property
    def blocks(self) -> list[int]:
        """All blocks with changes of their text."""
        return sorted({*self.edits, *self.before, *self.cut})

    @property
    def special(self) -> set[int]:
        """All blocks that are not written by their moves alone."""
        return {*self.blocks, *self.spelled, *self.whole, *self.straight}


class Written(NamedTuple):
    """A written chunk; positions `(rows, axes)` in programmed coordinates, mm and degrees."""

    texts: list[str | PlainText]
    """Texts of all blocks, edited, with the added blocks next to them; consecutive plain lines have one."""
    starts: Array
    """Positions on the control before each move."""
    ends: Array
    """Positions on the control after each move, after rounding."""
    arcs: dict[int, Arc]
    """Arcs by row, about the centres that the control uses."""
    added: int
    """Number of added blocks."""

    def moves(self, motions: Motions) -> Motions:
        """The rows with starts, ends and arcs as written."""
        return replace(motions, start=self.starts, target=self.ends, arcs=self.arcs)


class WrittenBlock(NamedTuple):
    """A block that may run several times, as it was written last."""

    move: bytes
    """Its programmed move, and the corrected end."""
    before: list[float]
    after: list[float]
    """Positions on the control."""
    editor: WordEditor
    layout: Layout
    """Layout behind it."""


class Editors:
    """Editors of the blocks of a chunk; keeps the layout of the program and the iterations of its blocks."""

    def __init__(self, machine: Machine, tolerance_um: float) -> None:
        self.machine, self.tolerance_um = machine, tolerance_um
        self.layout = Layout()
        self._editors: dict[int, WordEditor] = {}
        self._indices: Sequence[int] | None = None
        self.rewrite = Rewrite()
        """What a conversion of the program changes in the chunk."""
        self._iterations: dict[int, Iterations] = {}
        """Iterations by block of the program, if blocks may run several times."""
        self._extended: tuple[Layout, Block, Layout] | None = None
        """A layout, a block, and the layout after it."""
        self._last: dict[int, WrittenBlock] = {}
        """Simple moves of these blocks."""

    def start(self, indices: Sequence[int] | None, rewrite: Rewrite | None) -> None:
        """Begin a chunk; indices: of its blocks in the program if blocks may run several times."""
        self._editors, self._indices, self.rewrite = {}, indices, rewrite or Rewrite()

    def of(self, motions: Motions, block: int) -> WordEditor:
        """The editor of a block of the chunk."""
        if block not in self._editors:
            self._editors[block] = self.new(motions, block)
        return self._editors[block]

    def new(self, motions: Motions, block: int) -> WordEditor:
        """A further editor of a block, whose edits are not written."""
        own = self.rewrite.prepared(block, motions.blocks[block])
        return WordEditor(own, self.layout_of(motions, block), self.iterations_of(motions, block))

    def layout_of(self, motions: Motions, block: int) -> Layout:
        """The layout of the program; of a block that may run several times, when it ran first."""
        iterations = self.iterations_of(motions, block)
        return self.layout if iterations is None else iterations.layout

    def layout_after(self, layout: Layout, block: Block) -> Layout:
        """The layout after one more block, which is known for the segments of its move."""
        known = self._extended
        if known is None or known[1] is not block or layout not in (known[0], known[2]):
            known = self._extended = layout, block, layout.after(block)
        return known[2]

    def iterations_of(self, motions: Motions, block: int) -> Iterations | None:
        """Numbers of the first iteration of a block of the chunk; None in a program whose blocks all run once."""
        if self._indices is None:
            return None
        if self._indices[block] not in self._iterations:
            # half of the tolerance, at most half of MOST_APART_UM, in units of the last decimal of a coordinate
            unit = float(motions.unit[np.searchsorted(motions.block, block)])  # for a CC, that of its arc
            decimals = decimals_of_axis(self.machine, self.machine.translators[0], unit)
            counts = 0.5e-3 * min(self.tolerance_um, MOST_APART_UM) / unit * 10.0**decimals
            self._iterations[self._indices[block]] = Iterations(self.layout, counts)
        return self._iterations[self._indices[block]]

    def again(self, block: int, move: bytes, held: list[float]) -> list[float] | None:
        """The position after a block of the chunk that moves as before; None for another move.

        move: as of `WrittenBlock`. held: position on the control before it.
        """
        found = self._last.get(self._indices[block]) if self._indices is not None else None
        if found is None or found.move != move or found.before != held:
            return None
        self._editors[block], self.layout = found.editor, found.layout
        return list(found.after)

    def keep(self, block: int, move: bytes, before: list[float], after: list[float]) -> None:
        """Keep a block of the chunk with one simple move, for `again`."""
        if self._indices is not None:
            written = WrittenBlock(move, list(before), list(after), self._editors[block], self.layout)
            self._last[self._indices[block]] = written

    def texts(self, motions: Motions, plain: Mapping[int, PlainText]) -> Iterator[str | PlainText]:
        """The texts of all blocks; `plain`: those of consecutive plain lines, by the index of the first."""
        blocks: Blocks = motions.blocks
        for block in self.rewrite.blocks:
            self.rewrite.write(block, self.of(motions, block))
        for some, first in zip(blocks.parts, blocks.firsts, strict=False):
            if isinstance(some, list):
                yield from (self._text(first + i, block) for i, block in enumerate(some))
                continue
            index = first
            while index < first + len(some):
                if index in plain:
                    yield plain[index]
                    index += plain[index].lines
                else:
                    yield self._text(index, some.kept_block(index - first))
                    index += 1

    def _text(self, index: int, block: Block) -> str:
        return edited(block.text, self._editors[index].edits) if index in self._editors else block.text
