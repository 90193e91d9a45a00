"""Written arcs: one circle through the corrected ends, by its centre, radius or pole."""

from __future__ import annotations

import math
from typing import NamedTuple

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.motion.circles import (
    OUT_OF_ROUND,
    SAME_POINT_MM,
    Point,
    between,
    centre_from_radius,
    height_over_chord,
    moved_centre,
    point_at,
    same,
    sweep,
)
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Known
from postproc.motion.segments import arc_ends, arc_turned
from postproc.siemens.codes import CALCULATED_ARCS
from postproc.text.editing import WordEditor
from postproc.text.number_style import decimals_for
from postproc.write.added_blocks import AddedBlock
from postproc.write.poles import Ends, PoleWriter

LARGEST_DEVIATION = 5e-4
"""Deviation, mm, of the middle of an arc above which a radius is replaced by the centre.

Near a half circle the rounding of the radius, and near a full circle the rounding of the end points, moves the path
by many times the rounding."""
HALF = 1e-6
"""Difference from half a turn, rad, below which an arc is a half circle: both signs of the radius then give it."""
DOT = 0.01
"""Radius of an arc, mm, below which its direction does not matter."""
ROUNDING_STEPS = 50
"""Largest number of steps in which the end of an arc is moved radially."""
ABOUT_POLES = frozenset(("pole", "polar", "tangent"))
"""Forms of arcs whose centre is a pole or is written as a pole."""


class CircleWriter:
    """Writes arcs with corrected ends as circles."""

    def __init__(self, machine: Machine, poles: PoleWriter) -> None:
        self.machine, self._poles = machine, poles

    def write(
        self,
        motions: Motions,
        row: int,
        ends: Ends,
        middle_shift: Array,
        editor: WordEditor | AddedBlock,
        pole_editor: WordEditor | None,
        dropped: list[int] | None = None,
    ) -> Arc:
        """Write one circle through start and end, with the correction of the path along the arc.

        `middle_shift` `(axes,)`: correction in the middle of the arc. `ends`, `pole_editor`, `dropped`: as for
        `PoleWriter.write_arc`. Returns the arc about the centre that the control uses. Refusal if the written text
        would be another arc.
        """
        circle, block = NominalArc.of(motions, row, middle_shift), motions.blocks[motions.block[row]]
        arc, turned = circle.arc, circle.turned
        i, j = arc.plane[:2]
        if (motions.known_start[row, [i, j]] != Known.PROGRAM).any():
            raise block.refuse(
                "no block gives the start of the arc in this frame, and --start is not enough: write G0, G1 or L to it"
            )
        start, end = ((at[i], at[j]) for at in ends)
        if same(start, end) != arc.full:
            raise block.refuse("rounding would exchange this arc and a full circle: its end points are too close")
        centre = circle.centre(start, end)
        unit = float(motions.unit[row])
        by_angle = self._ends_by_angle(arc, editor, dropped)
        if arc.form in ABOUT_POLES or by_angle:
            about = arc._replace(centre=between(start, end, centre, turned) if by_angle else centre)
            centre = self._poles.write_arc(motions, row, about, ends, pole_editor, editor, dropped)
            end = (ends[1][i], ends[1][j])
        elif arc.form.startswith("radius") and not (isinstance(editor, AddedBlock) and not editor.klartext):
            centre = self._write_radius(editor, circle, (start, end, centre), unit)
        else:
            # a Siemens block marks its centre as absolute (I=AC), an added block does not
            absolute = arc.form.endswith("absolute") and not (
                isinstance(editor, AddedBlock) and editor.beside_absolute_centre
            )
            centre = self._write_centre(editor, arc, (0.0, 0.0) if absolute else start, centre, unit)
            if arc.form == "calculated" and isinstance(editor, WordEditor):
                write_motion_code(editor, arc.sense)
        if (
            abs(sweep(start, end, centre, arc.sense, arc.full, arc.turns) - turned) > 1.0
            and math.dist(start, centre) > DOT
        ):
            raise block.refuse(f"rounding would reverse this arc of {math.degrees(turned):.4f} deg: it is too short")
        if math.dist(start, centre) < SAME_POINT_MM or math.dist(end, centre) < SAME_POINT_MM:
            raise block.refuse("rounding would leave this arc without a radius: it is too small")
        return arc._replace(centre=centre)

    def _ends_by_angle(self, arc: Arc, editor: WordEditor | AddedBlock, dropped: list[int] | None) -> bool:
        """True if an angle gives the end of the written arc, whose radius is then that of its start."""
        own = arc.form == "polar" and isinstance(editor, WordEditor)
        return own or bool(dropped) or self._helix_beside(arc, editor)

    def _helix_beside(self, arc: Arc, editor: WordEditor | AddedBlock) -> bool:
        """True for an added Klartext segment that moves across the plane of its arc, which CR cannot."""
        return isinstance(editor, AddedBlock) and editor.klartext and editor.names(self.machine.names[arc.plane[2]])

    def _centre_letter(self, axis: int) -> str:
        return "IJK"["XYZ".index(self.machine.names[axis][0])]

    def _write_centre(
        self, editor: WordEditor | AddedBlock, arc: Arc, base: Point, centre: Point, unit: float
    ) -> Point:
        """Write the centre relative to `base`; returns the written centre."""
        written = []
        for axis, index, origin, coordinate in zip(arc.plane, arc.words, base, centre, strict=False):
            decimals = decimals_for(self.machine.axes[axis].resolution / unit)
            value = round((coordinate - origin) / unit, decimals)
            if isinstance(editor, WordEditor) and index is not None:
                value = editor.set(index, (coordinate - origin) / unit, decimals)
            elif isinstance(editor, AddedBlock):
                value = editor.agreed(self._centre_letter(axis), value, decimals)
                editor.insert(self._centre_letter(axis), value, decimals)
            else:
                value = editor.add(self._centre_letter(axis), (coordinate - origin) / unit, 0.0, decimals)
            written.append(origin + value * unit)
        return written[0], written[1]

    def _write_radius(
        self,
        editor: WordEditor | AddedBlock,
        circle: NominalArc,
        points: tuple[Point, Point, Point],
        unit: float,
    ) -> Point:
        """Write the radius, or the centre if the radius moves the path too far; returns the centre on the control."""
        arc, (start, end, centre) = circle.arc, points
        decimals = decimals_for(self.machine.axes[arc.plane[0]].resolution / unit)
        if isinstance(editor, AddedBlock):
            radius = radius_of(circle, (start, end), centre, 1.0, unit)
            radius = editor.agreed("R", round(radius, decimals), decimals)
            by_radius = centre_from_radius(start, end, radius * unit, arc.sense)
            if by_radius is None or middle_deviation(start, end, centre, by_radius, arc.sense) >= LARGEST_DEVIATION:
                raise editor.beside.refuse(
                    "rounding the radius would move the segments of this arc: give its centre (CC and C)"
                )
            editor.insert("R", radius, decimals)
            return by_radius
        index = arc.words[0]
        assert index is not None
        signed = radius_of(circle, (start, end), centre, editor.block.words[index].value or 0.0, unit)
        by_radius = centre_from_radius(start, end, editor.rounded(index, signed, decimals) * unit, arc.sense)
        if by_radius is not None and middle_deviation(start, end, centre, by_radius, arc.sense) < LARGEST_DEVIATION:
            editor.set(index, signed, decimals)
            return by_radius
        if editor.block.kind != "words":
            raise editor.block.refuse("rounding the radius would move this arc: give its centre (CC and C)")
        base = (0.0, 0.0) if arc.form == "radius-absolute" else start
        letters = [self._centre_letter(axis) for axis in arc.plane[:2]]
        offsets = [round((c - b) / unit, decimals) for c, b in zip(centre, base, strict=True)]
        values = [editor.agreed(letter, value, decimals) for letter, value in zip(letters, offsets, strict=True)]
        editor.replace(index, sorted(zip(letters, values, strict=True)), decimals)
        return base[0] + values[0] * unit, base[1] + values[1] * unit


def round_off(motions: Motions, row: int, start: list[float], end: list[float], shift: Array) -> None:
    """Move the end of an arc radially if the difference of its radii would change by more than OUT_OF_ROUND / 2.

    This occurs on nearly full circles: their ends are close together, but may have different corrections.
    """
    i, j, _ = motions.arcs[row].plane
    moved = NominalArc.of(motions, row, shift).round_off((start[i], start[j]), (end[i], end[j]))
    if moved is not None:
        end[i] += moved[0]
        end[j] += moved[1]


class NominalArc(NamedTuple):
    """An arc before its correction; points in its plane, mm."""

    arc: Arc
    ends: tuple[Point, Point]
    turned: float
    """Sweep, rad, positive counter-clockwise."""
    middle_shift: Point
    """Correction of its middle, mm."""

    @classmethod
    def of(cls, motions: Motions, row: int, middle_shift: Array) -> NominalArc:
        """The arc of a row; middle_shift `(axes,)`, mm."""
        arc = motions.arcs[row]
        x, y = middle_shift[list(arc.plane[:2])].tolist()
        return cls(arc, arc_ends(motions, row), arc_turned(motions, row), (x, y))

    def centre(self, start: Point, end: Point) -> Point:
        """Its centre with new ends and its middle corrected."""
        before, after = self.ends
        start_shift = (start[0] - before[0], start[1] - before[1])
        end_shift = (end[0] - after[0], end[1] - after[1])
        return moved_centre(self.ends, self.arc.centre, self.turned, (start_shift, self.middle_shift, end_shift))

    def round_off(self, start: Point, end: Point) -> Point | None:
        """Shift of a new end, mm, for the function of this name; None for an end that stays.

        In steps, because the centre moves with the end; no further than the first difference and a half.
        """
        before, after = self.ends
        programmed = math.dist(before, self.arc.centre) - math.dist(after, self.arc.centre)
        moved, furthest = end, 0.0
        for _ in range(ROUNDING_STEPS):
            centre = self.centre(start, moved)
            radius = math.dist(moved, centre)
            fault = math.dist(start, centre) - radius - programmed
            excess, furthest = abs(fault) - OUT_OF_ROUND / 2, furthest or 1.5 * abs(fault)
            if excess <= SAME_POINT_MM or radius < SAME_POINT_MM:
                break
            share = math.copysign(excess, fault) / radius
            following = moved[0] + share * (moved[0] - centre[0]), moved[1] + share * (moved[1] - centre[1])
            if math.dist(following, end) > furthest:
                break
            moved = following
        return None if moved == end else (moved[0] - end[0], moved[1] - end[1])


def radius_of(circle: NominalArc, ends: tuple[Point, Point], centre: Point, programmed: float, unit: float) -> float:
    """Radius of an arc with new ends and centre, in units of its words, with the sign for its sweep.

    programmed: the radius of the program. A segment of an arc of more than half a turn may itself be below half a turn.
    """
    radius = math.hypot(math.dist(*ends) / 2, height_over_chord(*ends, centre)) / unit
    return math.copysign(radius, programmed if abs(circle.turned) > math.pi - HALF else 1.0)


def middle_deviation(start: Point, end: Point, centre: Point, other: Point, sense: int) -> float:
    """Distance of the middles of two arcs with the same ends, mm."""
    middles = [point_at(start, c, sweep(start, end, c, sense, False) / 2) for c in (centre, other)]
    return math.dist(*middles)


def write_motion_code(editor: WordEditor, sense: int) -> None:
    """Siemens: G2 or G3 instead of CIP or CT, without the intermediate point."""
    for index, word in enumerate(editor.block.words):
        if word.address in CALCULATED_ARCS:
            editor.put(word.at, word.end, "G3" if sense > 0 else "G2")
        elif word.address in ("I1", "J1", "K1"):
            editor.remove(index)
