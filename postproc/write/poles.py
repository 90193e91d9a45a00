"""Written Klartext moves about poles: poles before arcs, ends by angles, tangential arcs as circles."""

from __future__ import annotations

import math
from typing import NamedTuple

from kinematics.machine import Machine
from postproc.motion.circles import Point, same
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc
from postproc.motion.segments import arc_turned
from postproc.text.editing import WordEditor
from postproc.write.added_blocks import AddedBlock
from postproc.write.decimals import decimals_of_axis
from postproc.write.polar_words import (
    add_helix_end,
    write_arc_end,
    write_circle_as_helix,
    write_line_end,
    write_tangent_as_circle,
)

Ends = tuple[list[float], list[float]]
"""Positions of all axes on the control before and after a move, mm and degrees."""


class Held(NamedTuple):
    """The pole on the control."""

    number: int
    """Of the pole of the program in whose place it is."""
    plane: tuple[int, int]
    at: Point
    """mm."""


class PoleWriter:
    """Writes moves about poles; keeps track of the pole on the control."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._held: Held | None = None

    def write_line(self, motions: Motions, row: int, ends: Ends, programmed: list[bool], editor: WordEditor) -> None:
        """Write the end of an LP relative to the pole on the control; `ends` becomes the written end."""
        polar, unit = motions.polar_ends[int(motions.block[row])], float(motions.unit[row])
        (start, held), (i, j, _) = ends, polar.plane
        if not (programmed[i] and programmed[j]):
            return
        pole = polar.pole
        if self._held is not None and self._held[:2] == (polar.number, (i, j)):
            pole = self._held.at
        else:
            pole = pole if polar.sure else self._add_pole(polar.plane, pole, unit, editor)
            self._held = Held(polar.number, (i, j), pole)
        points, resolution = ((start[i], start[j]), (held[i], held[j])), self.machine.axes[i].resolution
        held[i], held[j] = write_line_end(editor, polar, pole, points, unit, resolution)

    def write_arc(
        self,
        motions: Motions,
        row: int,
        arc: Arc,
        ends: Ends,
        pole_editor: WordEditor | None,
        editor: WordEditor | AddedBlock,
        dropped: list[int] | None = None,
    ) -> Point:
        """Write an arc about its corrected centre; returns the written centre; `ends` becomes the written end.

        `pole_editor`: of the CC directly before it; None if there is none. `dropped`: indices of the words that an
        angle replaces if the arc becomes a helix.
        """
        if arc.form == "tangent" and not dropped and isinstance(editor, WordEditor) and _is_nominal(motions, row, ends):
            return motions.arcs[row].centre
        unit = float(motions.unit[row])
        if pole_editor is not None:
            centre = self._write_pole(pole_editor, arc, unit)
        elif self._pole_is_there(arc, unit, editor):
            assert self._held is not None
            centre = self._held.at
        else:
            centre = self._add_pole(arc.plane, arc.centre, unit, editor)
        self._held = Held(arc.pole, arc.plane[:2], centre)
        self._write_end(motions, row, arc._replace(centre=centre), ends, editor, dropped)
        return centre

    def _pole_is_there(self, arc: Arc, unit: float, editor: WordEditor | AddedBlock) -> bool:
        """True if the pole on the control has the numbers that the centre of an arc would get."""
        decimals = decimals_of_axis(self.machine, arc.plane[0], unit)
        there = (
            self._held is not None
            and self._held[:2] == (arc.pole, arc.plane[:2])
            and same(self._held.at, _rounded(arc.centre, decimals, unit))
        )
        return there and (editor.iterations is None or editor.iterations.chosen("pole is there", there))

    def _write_pole(self, editor: WordEditor, arc: Arc, unit: float) -> Point:
        """Write the pole into a CC of the program; returns the written pole, mm."""
        programmed = []
        for axis, index, coordinate in zip(arc.plane, arc.words, arc.centre, strict=False):
            assert index is not None
            programmed.append(editor.set(index, coordinate / unit, decimals_of_axis(self.machine, axis, unit)) * unit)
        return programmed[0], programmed[1]

    def _add_pole(
        self, plane: tuple[int, int, int], pole: Point, unit: float, editor: WordEditor | AddedBlock
    ) -> Point:
        """Add a pole before a block; returns the written pole, mm."""
        names = [self.machine.names[axis] for axis in plane[:2]]
        decimals = decimals_of_axis(self.machine, plane[0], unit)
        values = [
            editor.agreed(f"pole {name}", round(coordinate / unit, decimals), decimals)
            for name, coordinate in zip(names, pole, strict=True)
        ]
        editor.centre_before(list(zip(names, values, strict=True)), decimals)
        return values[0] * unit, values[1] * unit

    def _write_end(
        self,
        motions: Motions,
        row: int,
        arc: Arc,
        ends: Ends,
        editor: WordEditor | AddedBlock,
        dropped: list[int] | None,
    ) -> None:
        """Write the end of an arc if axes do not give it; `ends` becomes the written end."""
        (start, held), (i, j, normal) = ends, arc.plane
        points, resolution = ((start[i], start[j]), (held[i], held[j])), self.machine.axes[i].resolution
        names, unit = [self.machine.names[axis] for axis in (i, j)], float(motions.unit[row])
        polar = motions.polar_ends.get(int(motions.block[row]))
        if isinstance(editor, AddedBlock):
            if editor.names(self.machine.names[normal]):
                held[i], held[j] = add_helix_end(editor, names, arc, points, resolution)
        elif dropped:
            turned = math.degrees(arc_turned(motions, row))
            held[i], held[j] = write_circle_as_helix(editor, dropped, arc, points, turned, resolution)
        elif arc.form == "tangent":
            decimals = decimals_of_axis(self.machine, i, unit)
            end = [(name, round(held[axis] / unit, decimals)) for name, axis in zip(names, (i, j), strict=True)]
            write_tangent_as_circle(editor, polar, end, decimals, arc.sense)
            if polar is not None:
                held[i], held[j] = (value * unit for _, value in end)
        elif arc.form == "polar" and not arc.full:
            assert polar is not None
            turned = math.degrees(arc_turned(motions, row))
            held[i], held[j] = write_arc_end(editor, polar, arc.centre, points, turned, resolution)


def _rounded(point: Point, decimals: int, unit: float) -> Point:
    """A point, mm, by its rounded words; unit: mm per unit of the words."""
    x, y = (round(coordinate / unit, decimals) * unit for coordinate in point)
    return x, y


def _is_nominal(motions: Motions, row: int, ends: Ends) -> bool:
    """True if an arc has its nominal start and end in its plane."""
    plane = list(motions.arcs[row].plane[:2])
    nominal = motions.start[row, plane].tolist(), motions.target[row, plane].tolist()
    return nominal == tuple([at[axis] for axis in plane] for at in ends)
