"""Writes corrected moves into the text: only coordinate words change, each in its own style.

The writer keeps the positions on the control after rounding, so that increments never drift.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.correction import Correction
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.frames import Frame, cartesian, to_machine, to_program
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind, Known
from postproc.motion.segments import numbers_of_added
from postproc.text.blocks import PlainRun
from postproc.text.editing import ORDER, WordEditor
from postproc.text.number_style import decimals_holding
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
from postproc.write.arcs import ABOUT_POLES, CircleWriter
from postproc.write.decimals import decimals_of_axis
from postproc.write.drilling import HoleWriter, apart, corrected_holes, write_hole
from postproc.write.editors import Editors, Rewrite, Written
from postproc.write.inverse_time import add_inverse_time, write_inverse_time
from postproc.write.plain_arcs import WritableArcs
from postproc.write.plain_rows import PlainRows, WrittenAxis, WrittenRows, plain_stretches, simple_moves
from postproc.write.plain_texts import PlainWords, texts_of_runs
from postproc.write.polar import PolarWriter
from postproc.write.poles import PoleWriter
from postproc.write.rotary_feed import feeds_of_moves, restored_feed, takes_up_in_time, write_feed, write_feed_mode
from postproc.write.row_words import RowWords, corrected_end, kept_axes

MACHINE, PRESET, PATTERN, TAKE_UP, RAPID = map(int, (Kind.MACHINE, Kind.PRESET, Kind.PATTERN, Kind.TAKE_UP, Kind.RAPID))
"""Kinds of rows as numbers of `_kinds`."""


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
        self._editors = Editors(machine, tolerance_um)
        self._converts = False
        self._held: list[float] | None = None
        self._frame: Frame | None = None
        self._programmed: NDArrayBool = np.empty((0, 0), bool)
        self._ours: NDArrayBool = np.empty(0, bool)
        self._inner: NDArrayBool = np.empty(0, bool)
        self._kinds: list[int] = []
        self._numbers: list[int] = []
        """Number of each row among the added ones of its block."""
        self._at_end: dict[int, list[str]] = {}
        """Words that go to the last segment of the move, by block of the chunk."""
        self._begun: set[int] = set()
        """Blocks of the chunk whose own move has been written."""
        self._straight = False
        """True if the last written move is a take-up, or a line in place of an arc: its G1 ends a G2 or G3 in force."""
        self._arcs: dict[int, Arc] = {}
        self._added = 0
        self._polar = PolarWriter()
        self._poles = PoleWriter(machine)
        self._circles = CircleWriter(machine, self._poles)
        self._holes = HoleWriter(machine)

    def _letter(self, axis: int) -> int:
        return ORDER.index(self.machine.names[axis][0])

    def write(
        self, motions: Motions, correction: Correction, indices: Sequence[int] | None, rewrite: Rewrite | None
    ) -> Written:
        """Edit the blocks of a chunk; indices: theirs in a program if blocks may run several times.

        rewrite: what a conversion changes besides the coordinates; None for no conversion.
        """
        self._editors.start(indices, rewrite)
        self._converts = rewrite is not None
        self._begun, self._arcs, self._at_end, self._added = set(), {}, {}, 0
        starts, ends = np.empty_like(motions.target), np.empty_like(motions.target)
        elsewhere = ((motions.known_start == Known.ASSUMED) | motions.left_elsewhere).tolist()
        self._programmed, self._ours, self._inner = motions.correctable, motions.added, motions.intermediate
        together = not self._turns and indices is None
        arcs = WritableArcs.of(motions, {} if self._converts or not together else correction.middle_shift)
        stretches = self._stretches(motions, arcs) if together else {}
        simple = simple_moves(motions) if indices is not None and not self._converts else np.zeros(len(motions), bool)
        plain: list[tuple[int, PlainRun, PlainWords]] = []
        self._kinds, self._numbers, behind = motions.kind.tolist(), numbers_of_added(motions), 0
        while (row := behind) < len(motions):
            behind = row + 1
            held = self._before(motions, row, elsewhere[row])
            starts[row] = held
            if row in stretches:
                run = stretches[row]
                written = self._write_plain(motions, correction, row, run, arcs, held)
                lines = 0 if written is None else len(written.ends)
                if lines + 1 < len(run):
                    stretches[row + lines + 1] = run.part(lines + 1, len(run))
                if written is not None:
                    behind = row + lines
                    ends[row:behind] = written.ends
                    starts[row + 1 : behind] = written.behind[:-1]
                    self._held = written.behind[-1].tolist()
                    plain.append((int(motions.block[row]), run.part(0, lines), written.words))
                    continue
            self._write_move(motions, correction, row, held, ends, simple=bool(simple[row]))
            ends[row] = self._held = held
            if row in motions.cycles:
                ends[row, motions.cycles[row].axis] = self._holes.bottom
        texts = list(self._editors.texts(motions, texts_of_runs(plain)))
        return Written(texts, starts, ends, self._arcs, self._added)

    def _stretches(self, motions: Motions, arcs: WritableArcs) -> dict[int, PlainRun]:
        """Runs of plain lines that are written together, by their first rows."""
        holes = [] if self._converts else corrected_holes(motions)
        return plain_stretches(motions, [*arcs.rows.tolist(), *holes], self._editors.rewrite.special)

    def _write_move(
        self, motions: Motions, correction: Correction, row: int, held: list[float], ends: Array, *, simple: bool
    ) -> None:
        """Write one move; `held` becomes the position after it. ends `(rows, axes)`: those of the rows before.

        simple: the block may run several times, and its text then follows from its move alone.
        """
        kind = self._kinds[row]
        if kind == MACHINE:
            self._go_to_machine_position(motions, row, held)
        elif kind == PRESET:
            self._preset(motions, row, held)
        elif kind == PATTERN:
            self._follow(motions, correction, row, held, ends[row - 1] - motions.target[row - 1])
        elif not simple:
            self._write_row(motions, correction, row, held, bool(motions.rotary_only[row]))
        else:
            block, before = int(motions.block[row]), list(held)
            columns = correction.target, motions.start, motions.target, self._programmed
            move = b"".join(column[row].tobytes() for column in columns)
            after = self._editors.again(block, move, before)
            if after is None:
                self._write_row(motions, correction, row, held, bool(motions.rotary_only[row]))
                self._editors.keep(block, move, before, held)
            else:
                held[:], self._straight = after, False

    def _write_plain(
        self,
        motions: Motions,
        correction: Correction,
        row: int,
        run: PlainRun,
        arcs: WritableArcs,
        held: list[float],
    ) -> WrittenRows | None:
        """Write a run of plain lines from a row on, up to the first line that has to be written by itself.

        None if this is the first line of the run.
        """
        if self._straight and row in motions.arcs:
            return None
        names, columns, rotary = self.machine.names, self._by_letter, self._turned_by_vector
        if self._converts and np.abs(np.subtract(held, motions.start[row])[rotary]).max(initial=0.0) > SAME_POINT_MM:
            return None
        unit, rows = float(motions.unit[row]), slice(row, row + len(run))
        axes = [WrittenAxis(axis, names[axis], decimals_of_axis(self.machine, axis, unit), unit) for axis in columns]
        of_lines = arcs.of_lines(row, len(run))
        moves = PlainRows(
            run,
            correction.target[rows],
            motions.target[rows],
            motions.correctable[rows],
            motions.rotary_only[rows],
            of_lines,
            motions.start[rows],
            tuple(rotary) if run.no_insertion else (),
            partial(feeds_of_moves, motions, row) if motions.paced else None,
            self._holes.write_rows(motions, correction, rows, held) if row in motions.cycles else None,
        )
        written = moves.write(axes, held, self._editors.layout)
        if written is not None:
            self._editors.layout, self._straight = written.layout, False
            self._arcs.update((row + line, arc) for line, arc in written.arcs.items())
        return written

    def _before(self, motions: Motions, row: int, elsewhere: list[bool]) -> list[float]:
        """Programmed position on the control before the row, in the frame of the row.

        It is the written position; for axes that are `elsewhere`, the start of the row.
        """
        frame = motions.frames[motions.frame[row]]
        start: list[float] = motions.start[row].tolist()
        held = start if self._held is None else self._held
        if self._frame not in (None, frame):
            q = to_machine(self.machine, self._frame, np.array([held]))
            held = to_program(self.machine, frame, q)[0].tolist()
        self._frame = frame
        return [s if other else h for h, s, other in zip(held, start, elsewhere, strict=True)]

    def _go_to_machine_position(self, motions: Motions, row: int, held: list[float]) -> None:
        """A move in machine coordinates: named axes move to its coordinates, all others keep their positions."""
        frame, moved = motions.frames[motions.frame[row]], [word.axis for word in motions.words[row]]
        q = to_machine(self.machine, frame, np.array([held]))
        q[0, moved] = motions.machine_target[row, moved]
        held[:] = to_program(self.machine, frame, q)[0].tolist()

    def _preset(self, motions: Motions, row: int, held: list[float]) -> None:
        """G92: the preset is shifted by the correction in force."""
        editor = self._editors.of(motions, int(motions.block[row]))
        for axis, index, _ in motions.words[row]:
            unit = 1.0 if self.machine.rotary[axis] else float(motions.unit[row])
            decimals = max(decimals_of_axis(self.machine, axis, unit), decimals_holding(held[axis] / unit))
            held[axis] = editor.set(index, held[axis] / unit, decimals) * unit

    def _follow(self, motions: Motions, correction: Correction, row: int, held: list[float], shift: Array) -> None:
        """A hole of a pattern gets the `shift` `(axes,)` of the first one, or its own where these differ."""
        editor = self._editors.of(motions, int(motions.block[row]))
        plane = [
            (axis, decimals_of_axis(self.machine, axis, motions.unit[row])) for axis in cartesian(self.machine)[:2]
        ]
        if 1e3 * apart(motions, correction, row, self._programmed[row]) > self.tolerance_um:
            write_hole(motions, correction, row, editor, held, plane)
            return
        for axis, _ in plane:
            held[axis] = float(motions.target[row, axis] + shift[axis])

    def _write_row(
        self, motions: Motions, correction: Correction, row: int, held: list[float], rotary_only: bool
    ) -> None:
        """Edit the block of one move, or write an added block; `held` becomes the position after it."""
        block, start = int(motions.block[row]), list(held)
        if self._ours[row]:
            added = self._added_block(motions, row)
            self._write_words(motions, correction, row, held, rotary_only, added)
            self._put_beside(motions, row, added, self._path(start, held))
            return
        self._editors.layout = self._editors.layout_after(self._editors.layout, motions.blocks[block])
        again = block in self._begun and row in motions.cycles
        editor = self._editors.new(motions, block) if again else self._editors.of(motions, block)
        arc, straight = motions.arcs.get(row), block in self._editors.rewrite.straight
        if (straight or (self._straight and arc)) and lacks_motion(motions.blocks[block]):
            editor.insert_motion_code("G1" if arc is None else "G3" if arc.sense > 0 else "G2")
        if row in motions.paced:
            write_feed_mode(motions, row, editor)
        self._write_words(motions, correction, row, held, rotary_only, editor)
        if row in motions.cycles:
            self._holes.write_row(motions, correction, row, held, editor)
        if row in motions.paced:
            self._write_feed(motions, row, editor, self._path(start, held))
        if again and sorted(editor.edits) != sorted(self._editors.of(motions, block).edits):
            raise motions.blocks[block].refuse(
                "the block drills several holes that need different corrections: program them one by one"
            )
        if self._inner[row]:
            self._at_end[block] = [editor.cut(word) for word in end_words(editor.block)]
            for word in editor.block.words if row in motions.arcs else ():
                if word.address in TURN_WORDS:
                    editor.cut(word)
            if motions.timed[row] and row not in motions.paced:
                write_inverse_time(motions, row, editor)
        self._begun.add(block)
        self._straight = straight

    def _write_words(
        self,
        motions: Motions,
        correction: Correction,
        row: int,
        held: list[float],
        rotary_only: bool,
        editor: WordEditor | AddedBlock,
    ) -> None:
        kept = kept_axes(self.machine, motions, row, rotary_only=rotary_only)
        words = self._row_words(motions, row, held, editor, corrected_end(motions, correction, row, held, kept), kept)
        words.write_named()
        words.turn_by_vector(self._turned_by_vector)
        ends = (words.start, held)
        if row in motions.polars:
            words.write_polar(self._polar)
        elif (
            row not in motions.arcs and isinstance(editor, WordEditor) and int(motions.block[row]) in motions.polar_ends
        ):
            self._poles.write_line(motions, row, ends, self._programmed[row], editor)
        words.write_omitted()
        if row in motions.arcs:
            shift, pole = correction.middle_shift[row], self._pole_editor(motions, row)
            self._arcs[row] = self._circles.write(motions, row, ends, shift, editor, pole, words.dropped)
        if row in motions.cutter_compensated:
            words.check_cutter_compensation()

    def _row_words(
        self,
        motions: Motions,
        row: int,
        held: list[float],
        editor: WordEditor | AddedBlock,
        corrected: list[float],
        kept: tuple[int, ...],
    ) -> RowWords:
        """The words of a move to its corrected end, with `kept` axes at its start."""
        # a segment ends at a position without words in the program: all moving axes are written
        everything = self._inner[row] or self._ours[row] or self._converts
        written = self._all_by_letter if everything else self._by_letter
        exact = {*written} - {*self._by_letter} | {*kept}
        block, rewrite = int(motions.block[row]), self._editors.rewrite
        programmed = self._programmed[row].tolist()
        words = RowWords(self.machine, motions, row, editor, programmed, held, corrected, written, exact)
        words.spelled = block in rewrite.spelled
        words.whole = block in rewrite.whole and not self._ours[row]
        return words

    def _path(self, start: list[float], end: list[float]) -> float:
        """Length of a straight path of X Y Z, mm."""
        return math.dist(*([at[axis] for axis in self.machine.translators] for at in (start, end)))

    def _write_feed(self, motions: Motions, row: int, editor: WordEditor, moved: float) -> None:
        """Write the F of a corrected move of rotary axes alone, and the line behind it unless segments follow."""
        write_feed(motions, row, editor, moved)
        if not self._inner[row]:
            lines = restored_feed(motions, row, editor.layout.numbers, self.comment)
            editor.lines_after(lines)
            self._added += len(lines)

    def _pole_editor(self, motions: Motions, row: int) -> WordEditor | None:
        """Klartext: editor of the CC directly before an arc; None if there is no CC that may be changed."""
        arc = motions.arcs[row]
        own = arc.form in ABOUT_POLES and arc.pole_block == motions.block[row] - 1 and None not in arc.words
        return self._editors.of(motions, arc.pole_block) if own else None

    # ---- added blocks

    def _added_block(self, motions: Motions, row: int) -> AddedBlock:
        arc, start_fraction = motions.arcs.get(row), float(motions.start_fraction[row])
        takes_up = self._kinds[row] == TAKE_UP
        tag = Tag.TAKE_UP if takes_up else Tag.PIECE if math.isnan(start_fraction) else part(start_fraction)
        block = motions.blocks[motions.block[row]]
        iterations = self._editors.iterations_of(motions, int(motions.block[row]))
        layout = self._editors.layout_after(self._editors.layout_of(motions, int(motions.block[row])), block)
        number = self._numbers[row]
        sense, rapid = 0 if arc is None else arc.sense, self._kinds[row] == RAPID
        return AddedBlock(block, layout, tag, sense, rapid=rapid, iterations=iterations, number=number)

    def _put_beside(self, motions: Motions, row: int, added: AddedBlock, moved: float) -> None:
        """Put an added block before or after the block of its move; a backlash take-up without words is dropped."""
        if added.empty and added.tag is Tag.TAKE_UP:
            return
        block = int(motions.block[row])
        begun = block in self._begun
        if not begun:
            added.modes += mode_words(added.beside)
        paced = row in motions.paced and begun
        if motions.timed[row] and row not in motions.paced:
            add_inverse_time(motions, row, added, moved)
        elif paced:
            write_feed(motions, row, added, moved)
        elif takes_up_in_time(motions, row):
            added.feed_of(motions.paced[row + 1].feed / max(moved, SAME_POINT_MM))
        elif not begun:
            added.feed += feed_words(added.beside)
        editor = self._editors.of(motions, block)
        if not self._inner[row]:
            added.functions += self._at_end.pop(block, ())
        lines = added.lines(self.comment)
        if paced and not self._inner[row]:
            lines += restored_feed(motions, row, added.layout.numbers, self.comment)
        (editor.lines_after if begun else editor.lines_before)(lines)
        self._added += len(lines)
        self._straight = added.tag is Tag.TAKE_UP or block in self._editors.rewrite.straight
