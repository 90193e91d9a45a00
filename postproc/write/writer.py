"""Writes corrected moves into the text: only coordinate words change, each in its own style.

An axis that a block does not name keeps its position on the control; if its correction has changed, a word is inserted.
The writer keeps the positions on the control after rounding, so that increments never drift.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.correction import Correction
from postproc.motion.cutter_compensation import check_turned
from postproc.motion.frames import Frame, cartesian, to_machine, to_program
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind, Known
from postproc.text.block import Block, edited
from postproc.text.blocks import Blocks, PlainRun
from postproc.text.editing import ORDER, Iterations, Layout, WordEditor
from postproc.text.number_style import decimals_for, decimals_holding
from postproc.write.added_blocks import (
    TURN_WORDS,
    AddedBlock,
    Tag,
    end_words,
    feed_words,
    lacks_motion,
    mode_words,
    part,
)
from postproc.write.arcs import ABOUT_POLES, CircleWriter, NominalArc, round_off
from postproc.write.drilling import Depth, HoleWriter
from postproc.write.helices import axes_across, replaced_by_angle
from postproc.write.inverse_time import add_inverse_time, write_inverse_time
from postproc.write.plain_arcs import writable_arcs
from postproc.write.plain_rows import (
    PlainRows,
    PlainText,
    PlainWords,
    WrittenAxis,
    WrittenRows,
    joined,
    plain_stretches,
    plain_texts,
)
from postproc.write.polar import PolarWriter
from postproc.write.poles import PoleWriter

MOST_APART_UM = 1.0
"""Twice the largest difference, um, between the corrections of iterations of a block that share its text."""


class Written(NamedTuple):
    """A written chunk; positions `(rows, axes)` in programmed coordinates, mm and degrees."""

    texts: list[str | PlainText]
    """Texts of all blocks, edited, with the added blocks beside them; consecutive plain lines have one."""
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


class Writer:
    """Writes corrections into the text, chunk after chunk."""

    def __init__(
        self, machine: Machine, *, orientation: bool = False, comment: str = "({})", tolerance_um: float = 1.0
    ) -> None:
        self.machine, self.comment, self.tolerance_um = machine, comment, tolerance_um
        corrected = [
            i for i in range(len(machine.axes)) if i in machine.translators or (orientation and machine.rotary[i])
        ]
        self._by_letter = sorted(corrected, key=self._letter)
        self._turns = orientation
        """Rotary axes are corrected too."""
        self._all_by_letter = sorted(range(len(machine.axes)), key=self._letter)
        self._turned_by_vector = np.flatnonzero(machine.rotary).tolist()
        """Axes that a block may turn without a word for them, by a tool vector."""
        self._layout = Layout()
        self._held: list[float] | None = None
        self._frame: Frame | None = None
        self._editors: dict[int, WordEditor] = {}
        self._indices: Sequence[int] | None = None
        self._iterations: dict[int, Iterations] = {}
        """Iterations by block of the program, if blocks may run several times."""
        self._programmed: NDArrayBool = np.empty((0, 0), bool)
        self._ours: NDArrayBool = np.empty(0, bool)
        self._inner: NDArrayBool = np.empty(0, bool)
        self._at_end: dict[int, list[str]] = {}
        """Words that go to the last segment of the move, by block of the chunk."""
        self._begun: set[int] = set()
        """Blocks of the chunk whose own move has been written."""
        self._straight = False
        """True if the last written move is a backlash take-up: its G1 ends a G2 or G3 that was in force."""
        self._arcs: dict[int, Arc] = {}
        self._added = 0
        self._polar = PolarWriter()
        self._poles = PoleWriter(machine)
        self._circles = CircleWriter(machine, self._poles)
        self._holes = HoleWriter()
        self._bottom = 0.0
        """Written bottom of the last hole, mm."""

    def _letter(self, axis: int) -> int:
        return ORDER.index(self.machine.names[axis][0])

    def write(self, motions: Motions, correction: Correction, indices: Sequence[int] | None = None) -> Written:
        """Edit the blocks of a chunk; indices: theirs in a program if blocks may run several times."""
        self._indices = indices
        self._editors, self._begun, self._arcs, self._at_end, self._added = {}, set(), {}, {}, 0
        starts, ends = np.empty_like(motions.target), np.empty_like(motions.target)
        rotary_only = motions.rotary_only
        assumed = motions.known_start == Known.ASSUMED
        self._programmed, self._ours, self._inner = motions.correctable, motions.added, motions.intermediate
        together = not self._turns and indices is None
        plain_arcs = writable_arcs(motions, correction.middle_shift) if together else {}
        stretches = plain_stretches(motions, plain_arcs) if together else {}
        plain: list[tuple[int, PlainRun, PlainWords]] = []
        behind = 0
        while (row := behind) < len(motions):
            behind = row + 1
            held = self._before(motions, row, assumed[row].tolist())
            starts[row] = held
            if row in stretches:
                run = stretches[row]
                written = self._write_plain(motions, correction, row, run, plain_arcs, held)
                lines = 0 if written is None else len(written.ends)
                if lines + 1 < len(run):
                    stretches[row + lines + 1] = run.part(lines + 1, len(run))
                if written is not None:
                    behind = row + lines
                    ends[row:behind] = written.ends
                    starts[row + 1 : behind] = ends[row : behind - 1]
                    self._held = ends[behind - 1].tolist()
                    plain.append((int(motions.block[row]), run.part(0, lines), written.words))
                    continue
            if motions.kind[row] == Kind.MACHINE:
                self._go_to_machine_position(motions, row, held)
            elif motions.kind[row] == Kind.PRESET:
                self._preset(motions, row, held)
            elif motions.kind[row] == Kind.PATTERN:
                self._follow(motions, correction, row, held, ends[row - 1] - motions.target[row - 1])
            else:
                self._write_row(motions, correction, row, held, bool(rotary_only[row]))
            ends[row] = self._held = held
            if row in motions.cycles:
                ends[row, motions.cycles[row].axis] = self._bottom
        texts = list(self._texts(motions.blocks, _plain_texts(plain)))
        return Written(texts, starts, ends, self._arcs, self._added)

    def _texts(self, blocks: Blocks, plain: Mapping[int, PlainText]) -> Iterator[str | PlainText]:
        """The texts of all blocks; `plain`: those of consecutive plain lines, by the index of the first."""
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
                    yield self._text(index, some.block(index - first))
                    index += 1

    def _text(self, index: int, block: Block) -> str:
        return edited(block.text, self._editors[index].edits) if index in self._editors else block.text

    def _write_plain(
        self,
        motions: Motions,
        correction: Correction,
        row: int,
        run: PlainRun,
        arcs: Mapping[int, NominalArc],
        held: list[float],
    ) -> WrittenRows | None:
        """Write a run of plain lines from a row on, up to the first line that has to be written by itself.

        None if this is the first line of the run.
        """
        if self._straight and row in arcs:
            return None
        unit, rows = float(motions.unit[row]), slice(row, row + len(run))
        names, columns = self.machine.names, self._by_letter
        axes = [WrittenAxis(axis, names[axis], self._decimals(axis, unit), unit) for axis in columns]
        moves = PlainRows(
            run,
            correction.target[rows],
            motions.target[rows],
            motions.correctable[rows],
            motions.rotary_only[rows],
            {line: arcs[row + line] for line in range(len(run)) if row + line in arcs} if arcs else {},
        )
        written = moves.write(axes, held, self._layout)
        if written is not None:
            self._layout, self._straight = written.layout, False
            self._arcs.update((row + line, arc) for line, arc in written.arcs.items())
        return written

    def _before(self, motions: Motions, row: int, assumed: list[bool]) -> list[float]:
        """Programmed position on the control before the row, in the frame of the row.

        It is the written position; for axes with an assumed position, the start of the row.
        """
        frame = motions.frames[motions.frame[row]]
        start: list[float] = motions.start[row].tolist()
        held = start if self._held is None else self._held
        if self._frame not in (None, frame):
            q = to_machine(self.machine, self._frame, np.array([held]))
            held = to_program(self.machine, frame, q)[0].tolist()
        self._frame = frame
        return [s if not_programmed else h for h, s, not_programmed in zip(held, start, assumed, strict=True)]

    def _go_to_machine_position(self, motions: Motions, row: int, held: list[float]) -> None:
        """A move in machine coordinates: named axes move to its coordinates, all others keep their positions."""
        frame, moved = motions.frames[motions.frame[row]], [word.axis for word in motions.words[row]]
        q = to_machine(self.machine, frame, np.array([held]))
        q[0, moved] = motions.machine_target[row, moved]
        held[:] = to_program(self.machine, frame, q)[0].tolist()

    def _preset(self, motions: Motions, row: int, held: list[float]) -> None:
        """G92: the preset is shifted by the correction in force."""
        editor = self._editor(motions, int(motions.block[row]))
        for axis, index, _ in motions.words[row]:
            unit = 1.0 if self.machine.rotary[axis] else float(motions.unit[row])
            decimals = max(self._decimals(axis, unit), decimals_holding(held[axis] / unit))
            held[axis] = editor.set(index, held[axis] / unit, decimals) * unit

    def _follow(self, motions: Motions, correction: Correction, row: int, held: list[float], shift: Array) -> None:
        """A hole of a pattern gets the `shift` `(axes,)` of the first one; Refusal if its own correction differs."""
        own = (correction.target - motions.target)[row]
        named = [axis for axis in cartesian(self.machine)[:2] if self._programmed[row, axis]]
        apart = max((abs(float(own[axis] - shift[axis])) for axis in named), default=0.0) * 1e3
        if apart > self.tolerance_um:
            raise motions.blocks[motions.block[row]].refuse(
                f"the holes of this pattern need corrections that differ by {apart:.1f} um, more than --tolerance-um, "
                "and the pattern has one position only: program the holes one by one"
            )
        for axis in cartesian(self.machine)[:2]:
            held[axis] = float(motions.target[row, axis] + shift[axis])

    def _editor(self, motions: Motions, block: int) -> WordEditor:
        if block not in self._editors:
            self._editors[block] = self._new_editor(motions, block)
        return self._editors[block]

    def _new_editor(self, motions: Motions, block: int) -> WordEditor:
        iterations = self._iterations_of(motions, block)
        layout = self._layout if iterations is None else iterations.layout
        return WordEditor(motions.blocks[block], layout, iterations)

    def _iterations_of(self, motions: Motions, block: int) -> Iterations | None:
        """Numbers of the first iteration of a block of the chunk; None in a program whose blocks all run once."""
        if self._indices is None:
            return None
        if self._indices[block] not in self._iterations:
            # half of the tolerance, at most half of MOST_APART_UM, in units of the last decimal of a coordinate
            unit = float(motions.unit[np.searchsorted(motions.block, block)])  # for a CC, that of its arc
            counts = (
                0.5e-3
                * min(self.tolerance_um, MOST_APART_UM)
                / unit
                * 10.0 ** self._decimals(self.machine.translators[0], unit)
            )
            self._iterations[self._indices[block]] = Iterations(self._layout, counts)
        return self._iterations[self._indices[block]]

    def _decimals(self, axis: int, unit: float) -> int:
        return decimals_for(self.machine.axes[axis].resolution / unit)

    def _write_row(
        self, motions: Motions, correction: Correction, row: int, held: list[float], rotary_only: bool
    ) -> None:
        """Edit the block of one move, or write an added block; `held` becomes the position after it."""
        block = int(motions.block[row])
        if self._ours[row]:
            added, start = self._added_block(motions, row), list(held)
            self._write_words(motions, correction, row, held, rotary_only, added)
            self._put_beside(motions, row, added, math.dist(start, held))
            return
        self._layout = self._layout.after(motions.blocks[block])
        again = block in self._begun and row in motions.cycles
        editor = self._new_editor(motions, block) if again else self._editor(motions, block)
        if self._straight and row in motions.arcs and lacks_motion(motions.blocks[block]):
            editor.insert_motion_code("G3" if motions.arcs[row].sense > 0 else "G2")
        self._write_words(motions, correction, row, held, rotary_only, editor)
        if row in motions.cycles:
            self._write_depth(motions, correction, row, held, editor)
        if again and sorted(editor.edits) != sorted(self._editor(motions, block).edits):
            raise motions.blocks[block].refuse(
                "the block drills several holes that need different corrections: program them one by one"
            )
        if self._inner[row]:
            self._at_end[block] = [editor.cut(word) for word in end_words(editor.block)]
            for word in editor.block.words if row in motions.arcs else ():
                if word.address in TURN_WORDS:
                    editor.cut(word)
            if motions.timed[row]:
                write_inverse_time(motions, row, editor)
        self._begun.add(block)
        self._straight = False

    def _write_words(
        self,
        motions: Motions,
        correction: Correction,
        row: int,
        held: list[float],
        rotary_only: bool,
        editor: WordEditor | AddedBlock,
    ) -> None:
        start = list(held)
        arc = motions.arcs.get(row)
        kept = self._kept(motions, row, rotary_only)
        corrected = _corrected_end(motions, correction, row, start, kept)
        linear_unit = float(motions.unit[row])
        programmed = self._programmed[row]
        named = set()
        # a segment ends at a position without words in the program: all moving axes are written
        written = self._all_by_letter if self._inner[row] or self._ours[row] else self._by_letter
        exact = {*written} - {*self._by_letter} | {*kept}
        dropped = self._keep_in_plane(motions, row, editor, corrected, start)
        for axis, index, incremental in motions.words[row]:
            named.add(axis)
            if not programmed[axis]:
                held[axis] += float(motions.target[row, axis] - motions.start[row, axis])
            elif index < 0:
                held[axis] = corrected[axis]
            elif axis in written and index not in dropped:
                unit = 1.0 if self.machine.rotary[axis] else linear_unit
                base = start[axis] if incremental else 0.0
                number = (corrected[axis] - base) / unit
                decimals = max(self._decimals(axis, unit), decimals_holding(number) if axis in exact else 0)
                assert isinstance(editor, WordEditor)  # an added block has no axis words yet
                held[axis] = base + editor.set(index, number, decimals) * unit
            else:
                held[axis] = float(motions.target[row, axis])
        for axis in motions.arcs[row].plane[:2] if dropped else ():
            named.add(axis)
            held[axis] = corrected[axis]
        for axis in (axis for axis in self._turned_by_vector if axis not in named and not programmed[axis]):
            held[axis] += float(motions.target[row, axis] - motions.start[row, axis])
        if row in motions.polars:
            named.update(self._write_polar(motions, row, corrected, held, editor))
        elif arc is None and isinstance(editor, WordEditor) and int(motions.block[row]) in motions.polar_ends:
            self._poles.write_line(motions, row, (start, held), programmed, editor)
        for axis in (axis for axis in written if axis not in named and programmed[axis]):
            unit = 1.0 if self.machine.rotary[axis] else linear_unit
            base = held[axis] if motions.incremental[row] else 0.0
            number = (corrected[axis] - base) / unit
            decimals = max(self._decimals(axis, unit), decimals_holding(number) if axis in exact else 0)
            held[axis] = self._insert(editor, axis, held[axis], base, number, unit, decimals)
        if arc is not None:
            self._arcs[row] = self._circles.write(
                motions,
                row,
                (start, held),
                correction.middle_shift[row],
                editor,
                self._pole_editor(motions, row),
                dropped,
            )
        if row in motions.cutter_compensated:
            i, j = motions.cutter_compensated[row]
            nominal = motions.start[row].tolist(), motions.target[row].tolist()
            before, after = (((a[i], a[j]), (b[i], b[j])) for a, b in (nominal, (start, held)))
            check_turned(motions.blocks[motions.block[row]], before, after)

    def _keep_in_plane(
        self, motions: Motions, row: int, editor: WordEditor | AddedBlock, corrected: list[float], start: list[float]
    ) -> list[int]:
        """Klartext arcs: axes across the plane keep their positions if the block cannot name them.

        If it can, the result is the indices of the words that an angle must replace.
        """
        if row not in motions.arcs:
            return []
        programmed, inner = self._programmed[row], self._inner[row] or self._ours[row]
        moved = [
            axis
            for axis in (self._all_by_letter if inner else self._by_letter)
            if programmed[axis] and abs(corrected[axis] - start[axis]) >= 0.5 * 10.0 ** -self._decimals(axis, 1.0)
        ]
        across = axes_across(motions, row, moved)
        dropped = replaced_by_angle(motions, row, across, editor) if across else []
        for axis in across if dropped is None else ():
            corrected[axis] = start[axis]
        return dropped or []

    def _kept(self, motions: Motions, row: int, rotary_only: bool) -> tuple[int, ...]:
        """Columns of the axes whose end must equal their start to the last digit."""
        arc, locked = motions.arcs.get(row), motions.locked_axes.get(row, ())
        if rotary_only:
            return (*self.machine.translators, *locked)
        if arc is not None and arc.full:
            return (*arc.plane[:2], *locked)
        return (motions.cycles[row].axis, *locked) if row in motions.cycles else locked

    def _write_polar(
        self, motions: Motions, row: int, corrected: list[float], held: list[float], editor: WordEditor | AddedBlock
    ) -> tuple[int, int]:
        """Write a position by radius and angle; returns the columns of the two axes."""
        assert isinstance(editor, WordEditor)  # no block is added beside polar coordinates
        polar = motions.polars[row]
        i, j = polar.axes
        position = (
            (corrected[i], corrected[j])
            if self._programmed[row, i] and self._programmed[row, j]
            else motions.target[row, [i, j]]
        )
        names = self.machine.names[i], self.machine.names[j]
        resolution = self.machine.axes[i].resolution
        unit = float(motions.unit[row])
        held[i], held[j] = self._polar.write(editor, polar, names, (position[0], position[1]), unit, resolution)
        return i, j

    def _write_depth(
        self, motions: Motions, correction: Correction, row: int, held: list[float], editor: WordEditor
    ) -> None:
        """Write depth and R of a hole if they differ from those in force; `held` becomes the level after the cycle."""
        cycle, unit = motions.cycles[row], float(motions.unit[row])
        z = cycle.axis
        depth = Depth(float(correction.target[row, z]), float(motions.target[row, z]), bool(self._programmed[row, z]))
        decimals, name = self._decimals(z, unit), self.machine.names[z]
        self._bottom, held[z] = self._holes.write(editor, cycle, name, depth, held[z], unit, decimals)

    def _insert(
        self,
        editor: WordEditor | AddedBlock,
        axis: int,
        held: float,
        base: float,
        number: float,
        unit: float,
        decimals: int,
    ) -> float:
        """Add a word for an axis that the block omits, if it has to move; returns its position after the block."""
        before = (held - base) / unit
        after = editor.add(self.machine.names[axis], number, before, decimals)
        return held if after == before else base + after * unit

    def _pole_editor(self, motions: Motions, row: int) -> WordEditor | None:
        """Klartext: editor of the CC directly before an arc; None if there is no CC that may be changed."""
        arc = motions.arcs[row]
        own = arc.form in ABOUT_POLES and arc.pole_block == motions.block[row] - 1 and None not in arc.words
        return self._editor(motions, arc.pole_block) if own else None

    # ---- added blocks

    def _added_block(self, motions: Motions, row: int) -> AddedBlock:
        arc, start_fraction = motions.arcs.get(row), float(motions.start_fraction[row])
        takes_up = motions.kind[row] == Kind.TAKE_UP
        tag = Tag.TAKE_UP if takes_up else Tag.PIECE if math.isnan(start_fraction) else part(start_fraction)
        block = motions.blocks[motions.block[row]]
        iterations = self._iterations_of(motions, int(motions.block[row]))
        layout = (self._layout if iterations is None else iterations.layout).after(block)
        number = int(np.count_nonzero(motions.added[:row] & (motions.block[:row] == motions.block[row])))
        return AddedBlock(block, layout, tag, 0 if arc is None else arc.sense, iterations=iterations, number=number)

    def _put_beside(self, motions: Motions, row: int, added: AddedBlock, moved: float) -> None:
        """Put an added block before or after the block of its move; a backlash take-up without words is dropped."""
        if added.empty and added.tag is Tag.TAKE_UP:
            return
        block = int(motions.block[row])
        begun = block in self._begun
        if not begun:
            added.modes += mode_words(added.beside)
        if motions.timed[row]:
            add_inverse_time(motions, row, added, moved)
        elif not begun:
            added.feed += feed_words(added.beside)
        editor = self._editor(motions, block)
        if not self._inner[row]:
            added.functions += self._at_end.pop(block, ())
        lines = added.lines(self.comment)
        (editor.lines_after if begun else editor.lines_before)(lines)
        self._added += len(lines)
        self._straight = added.tag is Tag.TAKE_UP


def _plain_texts(written: Iterable[tuple[int, PlainRun, PlainWords]]) -> dict[int, PlainText]:
    """The texts of runs of plain lines, by the indices of their first blocks."""
    texts: dict[int, PlainText] = {}
    for lines, group in itertools.groupby(written, lambda item: item[1].lines):
        indices, runs, words = zip(*group, strict=True)
        texts |= zip(indices, plain_texts(lines, runs, joined(words)), strict=True)
    return texts


def _corrected_end(
    motions: Motions, correction: Correction, row: int, start: list[float], kept: tuple[int, ...]
) -> list[float]:
    """Corrected end of a move, mm and degrees, with `kept` axes at its start; for an arc, after `round_off`."""
    corrected: list[float] = correction.target[row].tolist()
    for axis in kept:
        # exactly: a full circle with the smallest gap would be, for the control, an arc across this gap
        corrected[axis] = start[axis]
    if row in motions.arcs and not motions.arcs[row].full:
        round_off(motions, row, start, corrected, correction.middle_shift[row])
    return corrected
