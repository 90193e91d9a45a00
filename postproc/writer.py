"""Corrected moves back into the text: only coordinate words change, each in the style it was written in.

A block that does not name an axis leaves it where the control holds it; where the correction of that axis has changed
by then, a word is inserted. The writer keeps what the control will hold after rounding, so increments never drift.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.circles import Point, height_over_chord, moved_centre
from postproc.compensate import Correction
from postproc.frames import Frame, to_machine, to_program
from postproc.motions import Arc, Kind, Known, Motions
from postproc.numbers import decimals_for
from postproc.program import edited
from postproc.words import Layout, WordEditor

FLAT_ARC = 0.1
"""An arc by radius whose centre lies nearer to its chord than this share of the radius is rewritten by its centre:
next to a half circle, rounding the radius moves the path by many times as much."""


class Written(NamedTuple):
    """A chunk as it was written; positions `(rows, axes)` in programmed coordinates, mm and degrees."""

    texts: list[str]
    """Of all blocks, edited."""
    starts: Array
    """Where the control stands before each move."""
    ends: Array
    """Where each move takes it, after rounding."""


class Writer:
    """Turns corrections into text, chunk after chunk."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._layout = Layout()
        self._held: list[float] | None = None
        self._frame: Frame | None = None
        self._editors: dict[int, WordEditor] = {}

    def write(self, motions: Motions, correction: Correction) -> Written:
        """Edit the blocks of a chunk."""
        self._editors = {}
        starts, ends = np.empty_like(motions.target), np.empty_like(motions.target)
        for row in range(len(motions)):
            held = self._before(motions, row)
            starts[row] = held
            if motions.kind[row] == Kind.MACHINE:
                for word in motions.words[row]:
                    held[word.axis] = float(motions.target[row, word.axis])
            else:
                self._write_row(motions, correction, row, held)
            ends[row] = self._held = held
        editors = self._editors
        texts = [edited(b.text, editors[i].edits) if i in editors else b.text for i, b in enumerate(motions.blocks)]
        return Written(texts, starts, ends)

    def _before(self, motions: Motions, row: int) -> list[float]:
        """Programmed position that the control holds before the row, in the row's frame.

        That is what has been written, for axes that carry a correction; for all others the nominal start.
        """
        frame = motions.frames[motions.frame[row]]
        start: list[float] = motions.start[row].tolist()
        held = start if self._held is None else self._held
        if self._frame not in (None, frame):
            q = to_machine(self.machine, self._frame, np.array([held]))
            held = to_program(self.machine, frame, q)[0].tolist()
        self._frame = frame
        said = (motions.known[row] == Known.PROGRAM).tolist()
        return [h if program else s for h, s, program in zip(held, start, said, strict=True)]

    def _editor(self, motions: Motions, block: int) -> WordEditor:
        return self._editors.setdefault(block, WordEditor(motions.blocks[block], self._layout))

    def _decimals(self, axis: int, unit: float) -> int:
        return decimals_for(self.machine.axes[axis].resolution / unit)

    def _write_row(self, motions: Motions, correction: Correction, row: int, held: list[float]) -> None:
        """Edit the block of one move; `held` becomes the position after it."""
        block = int(motions.block[row])
        self._layout = self._layout.after(motions.blocks[block])
        editor = self._editor(motions, block)
        start = list(held)
        wanted = correction.target[row].tolist()
        arc = motions.arcs.get(row)
        if arc is not None and arc.full:
            # a full circle must close exactly: a hair too far, and the control runs just that hair
            for axis in arc.plane[:2]:
                wanted[axis] = start[axis]
        unit = float(motions.unit[row])
        named = set()
        for axis, index, incremental in motions.words[row]:
            named.add(axis)
            if axis in self.machine.translators:
                base = start[axis] if incremental else 0.0
                held[axis] = base + editor.set(index, (wanted[axis] - base) / unit, self._decimals(axis, unit)) * unit
            else:
                held[axis] = float(motions.target[row, axis])
        for axis in self.machine.translators:
            if axis not in named and motions.known[row, axis] == Known.PROGRAM:
                held[axis] = self._insert(editor, axis, held[axis], wanted[axis], unit, bool(motions.incremental[row]))
        if arc is not None:
            self._write_circle(motions, row, arc, (start, held), correction.middle_shift[row])

    def _insert(
        self, editor: WordEditor, axis: int, held: float, wanted: float, unit: float, incremental: bool
    ) -> float:
        """Name an axis that the block leaves out, if it has to move; returns where it stands after the block."""
        decimals = self._decimals(axis, unit)
        if round((wanted - held) / unit, decimals) == 0.0:
            return held
        base = held if incremental else 0.0
        number = round((wanted - base) / unit, decimals)
        editor.insert(self.machine.names[axis], number, decimals)
        return base + number * unit

    def _write_circle(
        self, motions: Motions, row: int, arc: Arc, ends: tuple[list[float], list[float]], middle_shift: Array
    ) -> None:
        """Make start, end and centre as written one circle again, moved as the path along the arc is moved."""
        i, j = arc.plane[:2]
        start, end = ((at[i], at[j]) for at in ends)
        before, after = (motions.start[row, [i, j]].tolist(), motions.target[row, [i, j]].tolist())
        start_shift = (start[0] - before[0], start[1] - before[1])
        end_shift = (end[0] - after[0], end[1] - after[1])
        shift = (np.array(start_shift) + np.array(end_shift)) / 4 + middle_shift[[i, j]] / 2
        mean = (float(shift[0]), float(shift[1]))
        centre = moved_centre((before[0], before[1]), (after[0], after[1]), arc.centre, start_shift, end_shift, mean)
        unit = float(motions.unit[row])
        decimals = self._decimals(arc.plane[0], unit)
        block = int(motions.block[row])
        if arc.form == "radius":
            self._write_radius(self._editor(motions, block), arc, (start, end, centre), unit, decimals)
        elif arc.form == "pole":
            self._write_pole(motions, block, arc, (centre[0] / unit, centre[1] / unit), decimals)
        else:
            base = start if arc.form == "incremental" else (0.0, 0.0)
            values = ((centre[0] - base[0]) / unit, (centre[1] - base[1]) / unit)
            self._write_centre(self._editor(motions, block), arc, values, decimals)

    def _centre_letter(self, axis: int) -> str:
        return "IJK"["XYZ".index(self.machine.names[axis][0])]

    def _write_centre(self, editor: WordEditor, arc: Arc, values: Point, decimals: int) -> None:
        for axis, index, value in zip(arc.plane, arc.words, values, strict=False):
            if index is not None:
                editor.set(index, value, decimals)
            elif round(value, decimals) != 0.0:
                editor.insert(self._centre_letter(axis), value, decimals)

    def _write_radius(
        self, editor: WordEditor, arc: Arc, points: tuple[Point, Point, Point], unit: float, decimals: int
    ) -> None:
        start, end, centre = points
        index = arc.words[0]
        assert index is not None
        height = height_over_chord(start, end, centre)
        radius = math.hypot(math.dist(start, end) / 2, height)
        if height > FLAT_ARC * radius:
            signed = math.copysign(radius, editor.block.words[index].value or 0.0)
            editor.set(index, signed / unit, decimals)
        elif editor.block.kind != "words":
            raise editor.block.refuse("a half circle by its radius can't be corrected: give its centre (CC and C)")
        else:
            offsets = [(c - s) / unit for c, s in zip(centre, start, strict=True)]
            letters = [self._centre_letter(axis) for axis in arc.plane[:2]]
            editor.replace(index, sorted(zip(letters, offsets, strict=True)), decimals)

    def _write_pole(self, motions: Motions, block: int, arc: Arc, values: Point, decimals: int) -> None:
        """Klartext: change a CC that stands right before its arc, else put one of our own there."""
        if arc.pole_block == block - 1 and None not in arc.words:
            self._write_centre(self._editor(motions, arc.pole_block), arc, values, decimals)
        else:
            names = [self.machine.names[axis] for axis in arc.plane[:2]]
            self._editor(motions, block).line_before("CC", list(zip(names, values, strict=True)), decimals)
