"""Klartext moves with an angle about a pole, or with a tangent, written back into their own words."""

from __future__ import annotations

import math
import re

from postproc.motion.circles import Point, point_around
from postproc.motion.moves import Arc, PolarEnd
from postproc.text.editing import WordEditor
from postproc.text.number_style import MOST_DECIMALS, decimals_for
from postproc.write.added_blocks import AddedBlock

_TANGENT = re.compile(r"CTP?", re.IGNORECASE)
_CIRCLE = re.compile(r"CTP|C[RTP]?", re.IGNORECASE)


def write_line_end(
    editor: WordEditor, polar: PolarEnd, pole: Point, ends: tuple[Point, Point], unit: float, resolution: float
) -> Point:
    """Write the end of an LP, or of its first segment; returns the written end, mm.

    `ends`: start and end, mm. `pole`: the pole on the control, mm. `unit`: mm per unit of the words. `resolution`: mm.
    """
    start, end = (_seen_from(pole, point) for point in ends)
    radius = _set(editor, ("PR", polar.radius), start[0] / unit, end[0] / unit, decimals_for(resolution / unit)) * unit
    angle = _set_angle(
        editor, polar, (start[1], end[1]), _programmed_angle(editor, polar), angle_decimals(resolution, radius)
    )
    return point_around(pole, radius, angle)


def write_arc_end(
    editor: WordEditor, polar: PolarEnd, pole: Point, ends: tuple[Point, Point], turned: float, resolution: float
) -> Point:
    """Write the end of a CP about `pole`; returns the written end, mm.

    `ends`: start and end, mm; the end has the angle of the end and the radius of the start. `turned`: nominal sweep,
    degrees. `resolution`: mm.
    """
    (radius, begun), (_, ended) = (_seen_from(pole, point) for point in ends)
    angle = _set_angle(editor, polar, (begun, ended), turned, angle_decimals(resolution, radius))
    return point_around(pole, radius, angle)


def add_helix_end(added: AddedBlock, axes: list[str], arc: Arc, ends: tuple[Point, Point], resolution: float) -> Point:
    """Write the end of a helix segment by an angle instead of two axes; returns the written end, mm."""
    (radius, begun), (_, ended) = (_seen_from(arc.centre, point) for point in ends)
    decimals = angle_decimals(resolution, radius)
    turned = round(arc.sense * ((arc.sense * (ended - begun)) % 360.0), decimals)
    added.end_by_angle(axes, turned, decimals)
    return point_around(arc.centre, radius, begun + turned)


def write_circle_as_helix(
    editor: WordEditor, dropped: list[int], arc: Arc, ends: tuple[Point, Point], turned: float, resolution: float
) -> Point:
    """Write C, CR, CT, CTP or CP PA as CP IPA about the pole before it, which replaces the words `dropped`.

    `turned`: nominal sweep of the arc, degrees. Returns the end of the written arc.
    """
    block = editor.block
    match = _CIRCLE.search(block.text, 0, block.words[0].at)
    assert match is not None
    editor.put(match.start(), match.end(), "cp" if match[0][0].islower() else "CP")
    (radius, begun), (_, ended) = (_seen_from(arc.centre, point) for point in ends)
    decimals = angle_decimals(resolution, radius)
    angle = round(turned + math.remainder(ended - begun - turned, 360.0), decimals)
    editor.replace(dropped[0], [("IPA", angle)], decimals)
    for index in dropped[1:]:
        editor.remove(index)
    if block.kind in ("tangent", "polar_tangent"):
        _write_sense(editor, arc.sense)
    return point_around(arc.centre, radius, begun + angle)


def write_tangent_as_circle(
    editor: WordEditor, polar: PolarEnd | None, end: list[tuple[str, float]], decimals: int, sense: int
) -> None:
    """Write CT or CTP as C about the pole added before it; a polar end becomes two coordinates.

    `end`: names and values of the axes in its plane, for CTP. `sense`: +1 counter-clockwise.
    """
    block = editor.block
    match = _TANGENT.search(block.text, 0, block.words[0].at)
    assert match is not None
    editor.put(match.start(), match.end(), "c" if match[0].islower() else "C")
    if polar is not None:
        indices = [i for i in (polar.radius, polar.angle) if i is not None]
        if any(block.words[i].formula for i in indices):
            raise block.refuse("CTP with parameters cannot be corrected: program C with X and Y")
        editor.replace(indices[0], end, decimals)
        for i in indices[1:]:
            editor.remove(i)
    _write_sense(editor, sense)


def _write_sense(editor: WordEditor, sense: int) -> None:
    """Add DR after the last coordinate."""
    block = editor.block
    last = max(word.end for word in block.words if word.start < word.end and word.address[-1] in "XYZABCUVWR")
    editor.put(last, last, f" DR{'+' if sense > 0 else '-'}")


def angle_decimals(resolution: float, radius: float) -> int:
    """Decimals of an angle, degrees, for the resolution of the coordinates, mm, at a radius, mm."""
    return min(MOST_DECIMALS, decimals_for(math.degrees(resolution / max(radius, resolution))))


def _seen_from(pole: Point, point: Point) -> tuple[float, float]:
    """Distance, mm, and angle, degrees, of a point from a pole."""
    x, y = point[0] - pole[0], point[1] - pole[1]
    return math.hypot(x, y), math.degrees(math.atan2(y, x))


def _programmed_angle(editor: WordEditor, polar: PolarEnd) -> float:
    return 0.0 if polar.angle is None else editor.block.words[polar.angle].value or 0.0


def _set_angle(editor: WordEditor, polar: PolarEnd, angles: tuple[float, float], turned: float, decimals: int) -> float:
    """Write the angle of the end, degrees, in the turn that the block gives; returns the written angle."""
    begun, ended = angles
    turn = _programmed_angle(editor, polar)
    if polar.angle is None:
        turn = begun
    elif editor.block.words[polar.angle].address.startswith("I"):
        turn = begun + turned
    return _set(editor, ("PA", polar.angle), begun, turn + math.remainder(ended - turn, 360.0), decimals)


def _set(editor: WordEditor, word: tuple[str, int | None], before: float, target: float, decimals: int) -> float:
    """Write a polar coordinate, as an increment if its word is one, or omit it if it stays; returns its value."""
    name, index = word
    if index is None:
        return editor.add(name, target, before, decimals)
    base = before if editor.block.words[index].address.startswith("I") else 0.0
    return base + editor.set(index, target - base, decimals)
