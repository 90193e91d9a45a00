"""Circles of arc moves: their centre from what the program gives, and the check that it is one."""

from __future__ import annotations

import math

Point = tuple[float, float]

# LinuxCNC's end-point check, the tightest that is published: 28.3 um or 0.1 % of the radius, whichever is more.
RADIUS_TOLERANCE_MM = 0.0283
RADIUS_TOLERANCE_RATIO = 1e-3


def radius_fault(start: Point, end: Point, centre: Point) -> str | None:
    """Why no control runs this circle, None when the end points lie on it."""
    first, last = math.dist(start, centre), math.dist(end, centre)
    if max(first, last) == 0.0:
        return "an arc of radius 0"
    difference = abs(first - last)
    if difference > max(RADIUS_TOLERANCE_MM, RADIUS_TOLERANCE_RATIO * first):
        return f"radius {first:.4f} mm at its start and {last:.4f} mm at its end: this is no circle"
    return None


def centre_from_radius(start: Point, end: Point, radius: float, sense: int) -> Point | None:
    """Centre of the arc with this radius (negative: the longer way round), sense +1 counter-clockwise.

    None when the end points coincide or lie further apart than the diameter, but for rounding.
    """
    chord = math.dist(start, end)
    if chord == 0.0 or chord / 2 > abs(radius) + RADIUS_TOLERANCE_MM:
        return None
    height = math.sqrt(max(0.0, radius * radius - chord * chord / 4))
    return _beside_chord(start, end, height * sense * math.copysign(1.0, radius))


def centre_on_bisector(start: Point, end: Point, near: Point) -> Point:
    """The point nearest to `near` that is as far from start as from end; `near` itself when these coincide."""
    chord = math.dist(start, end)
    if chord == 0.0:
        return near
    ux, uy = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
    mx, my = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    along = (near[0] - mx) * ux + (near[1] - my) * uy
    return near[0] - along * ux, near[1] - along * uy


def sweep(start: Point, end: Point, centre: Point, sense: int, full: bool) -> float:
    """Angle turned through, rad, positive counter-clockwise; 2 pi for a full circle."""
    if full:
        return sense * 2 * math.pi
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    last = math.atan2(end[1] - centre[1], end[0] - centre[0])
    return sense * ((sense * (last - first)) % (2 * math.pi))


def point_at(start: Point, centre: Point, angle: float) -> Point:
    """The start turned about the centre by `angle`, rad."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = start[0] - centre[0], start[1] - centre[1]
    return centre[0] + c * x - s * y, centre[1] + s * x + c * y


def _beside_chord(start: Point, end: Point, height: float) -> Point:
    """The point at `height` to the left of the middle of the chord, looking from start to end."""
    chord = math.dist(start, end)
    mx, my = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    return mx - height * (end[1] - start[1]) / chord, my + height * (end[0] - start[0]) / chord
