"""Circles of arc moves: their centre from the programmed words, and the check that start and end lie on them."""

from __future__ import annotations

import math

Point = tuple[float, float]

# The end-point check of LinuxCNC, the tightest published one: the larger of 28.3 um and 0.1 % of the radius.
RADIUS_TOLERANCE_MM = 0.0283
RADIUS_TOLERANCE_RATIO = 1e-3
RADIUS_DIFFERENCE_MM = 5e-4
"""Increase of the radius difference between the ends of a corrected arc that is left uncorrected, mm."""
OUT_OF_ROUND = 5e-3
"""Radius difference between the ends of an arc at which the strictest controls stop, mm."""
SHORT_ARC = 0.1
"""1 - cos of half the sweep; arcs with a smaller value, of less than 52 deg, are short."""
SAME_POINT_MM = 1e-6
"""Distance below which two points are equal, mm: finer than any control, coarser than rounding of increments."""


def same(a: Point, b: Point) -> bool:
    """True for points that every control treats as equal: an arc between them is a full circle."""
    return math.dist(a, b) < SAME_POINT_MM


def radius_fault(start: Point, end: Point, centre: Point) -> str | None:
    """Reason why no control runs this circle; None if the end points lie on it."""
    first, last = math.dist(start, centre), math.dist(end, centre)
    if max(first, last) == 0.0:
        return "the arc has the radius 0: write a centre away from its ends"
    difference = abs(first - last)
    if difference > max(RADIUS_TOLERANCE_MM, RADIUS_TOLERANCE_RATIO * first):
        return (
            f"the arc is no circle: its radius is {first:.4f} mm at its start and {last:.4f} mm at its end: correct "
            "its end or its centre"
        )
    return None


def short_by(start: Point, end: Point, radius: float) -> float:
    """Length, mm, by which a radius is too short for half of the chord; 0 or less for a radius that is not."""
    return math.dist(start, end) / 2 - abs(radius)


def centre_from_radius(start: Point, end: Point, radius: float, sense: int) -> Point | None:
    """Centre of the arc with this radius (negative: the longer arc), sense +1 counter-clockwise.

    None if the radius is 0, the end points coincide, or their distance exceeds the diameter by more than rounding.
    """
    chord = math.dist(start, end)
    if radius == 0.0 or chord < SAME_POINT_MM or chord / 2 > abs(radius) + RADIUS_TOLERANCE_MM:
        return None
    height = math.sqrt(max(0.0, radius * radius - chord * chord / 4))
    return _beside_chord(start, end, height * sense * math.copysign(1.0, radius))


def moved_centre(ends: tuple[Point, Point], centre: Point, turned: float, shifts: tuple[Point, Point, Point]) -> Point:
    """The centre of a circle on which start, middle and end of an arc lie after their shifts.

    `turned` is the sweep of the arc, rad; its middle is at `middle_share`. Across its chord the centre is shifted such
    that the middle is corrected; on short arcs less, because the shift would be large without an improvement. Along its
    chord it is shifted by the mean of the shifts if the two radii then differ no more than before, up to
    `RADIUS_DIFFERENCE_MM`; otherwise such that their difference is unchanged, in a second step if the first leaves more
    than `RADIUS_DIFFERENCE_MM`. On nearly full circles, whose ends are close together, that shift would be large too,
    and the radii may differ; also where it would exceed the radius, because the ends lie in nearly one direction from
    the centre.
    """
    start, end = ends
    first, last = math.dist(start, centre), math.dist(end, centre)
    turned = math.copysign(min(abs(turned), 2 * math.pi), turned)
    mean = [(a + b) / 4 + m / 2 for a, m, b in zip(*shifts, strict=True)]
    if first == 0.0 or last == 0.0:
        return centre[0] + mean[0], centre[1] + mean[1]
    u = ((start[0] - centre[0]) / first, (start[1] - centre[1]) / first)
    v = ((end[0] - centre[0]) / last, (end[1] - centre[1]) / last)
    w = point_at(u, (0.0, 0.0), turned / 2)
    out = [d[0] * (s[0] - mean[0]) + d[1] * (s[1] - mean[1]) for d, s in zip((u, w, v), shifts, strict=True)]
    across = (out[1] - (out[0] + out[2]) / 2) / max(1.0 - math.cos(turned / 2), SHORT_ARC)
    n = (u[0] - v[0], u[1] - v[1])
    excess = across * (n[0] * w[0] + n[1] * w[1]) - out[0] + out[2]
    square = n[0] ** 2 + n[1] ** 2
    if abs(turned) > math.pi:
        square = max(square, 1.0)
    along = excess / square if RADIUS_DIFFERENCE_MM < abs(excess) < math.sqrt(square) * min(first, last) else 0.0
    x, y = centre[0] + mean[0] + across * w[0] - along * n[0], centre[1] + mean[1] + across * w[1] - along * n[1]
    (a, _, b), largest = shifts, max(math.hypot(*shift) for shift in shifts)
    left = math.dist((start[0] + a[0], start[1] + a[1]), (x, y)) - math.dist((end[0] + b[0], end[1] + b[1]), (x, y))
    left -= first - last
    again = left / square if RADIUS_DIFFERENCE_MM < abs(left) < math.sqrt(square) * largest else 0.0
    return x + again * n[0], y + again * n[1]


def middle_share(turned: float) -> float:
    """Share of an arc, `turned` rad, at its middle; for several turns, at the point opposite its start."""
    if abs(turned) <= 2 * math.pi:
        return 0.5
    return (2 * math.floor(abs(turned) / (4 * math.pi)) + 1) * math.pi / abs(turned)


def tangent_circle(start: Point, end: Point, heading: Point) -> tuple[Point, int] | None:
    """Centre and sense of the arc that leaves its start along the unit vector `heading`; None for a straight line."""
    way = (end[0] - start[0], end[1] - start[1])
    across, chord = heading[0] * way[1] - heading[1] * way[0], math.hypot(*way)
    if chord < SAME_POINT_MM or abs(across) < SAME_POINT_MM * chord:
        return None
    radius = chord * chord / (2.0 * across)
    return (start[0] - radius * heading[1], start[1] + radius * heading[0]), 1 if across > 0.0 else -1


def circle_through(start: Point, middle: Point, end: Point) -> tuple[Point, int] | None:
    """Centre and sense of the arc from start to end through a third point; None if the points lie on a line."""
    (x1, y1), (x2, y2) = ((p[0] - start[0], p[1] - start[1]) for p in (middle, end))
    twice = 2.0 * (x1 * y2 - y1 * x2)
    if abs(twice) < SAME_POINT_MM * max(math.hypot(x1, y1), math.hypot(x2, y2), SAME_POINT_MM):
        return None
    a, b = x1 * x1 + y1 * y1, x2 * x2 + y2 * y2
    centre = (start[0] + (y2 * a - y1 * b) / twice, start[1] + (x1 * b - x2 * a) / twice)
    return centre, 1 if twice > 0.0 else -1


def between(start: Point, end: Point, centre: Point, turned: float) -> Point:
    """The centre moved along the chord to equal distances from start and end, for an arc of `turned` rad.

    Over up to half a turn no point of the arc moves by more than its ends do. Over more, the points around its middle
    move by as much as the centre: it stays where the chord is below a radius, because that is more than the ends miss.
    """
    chord = math.dist(start, end)
    if chord < SAME_POINT_MM or (chord < math.dist(start, centre) and abs(turned) > math.pi):
        return centre
    u = ((end[0] - start[0]) / chord, (end[1] - start[1]) / chord)
    along = ((start[0] + end[0]) / 2 - centre[0]) * u[0] + ((start[1] + end[1]) / 2 - centre[1]) * u[1]
    return centre[0] + along * u[0], centre[1] + along * u[1]


def sweep(start: Point, end: Point, centre: Point, sense: int, full: bool, turns: int = 0) -> float:
    """Sweep of an arc, rad, positive counter-clockwise; 2 pi for a full circle; plus `turns` whole turns."""
    besides = sense * turns * 2 * math.pi
    if full:
        return sense * 2 * math.pi + besides
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    last = math.atan2(end[1] - centre[1], end[0] - centre[0])
    return sense * ((sense * (last - first)) % (2 * math.pi)) + besides


def crossings(start: Point, centre: Point, turned: float, phase: float) -> list[float]:
    """Shares of an arc, within 0..1, in order, at which it crosses the line through its centre in direction `phase`.

    `turned`: its sweep, rad; `phase` in rad. The coordinate along that line reverses there.
    """
    if turned == 0.0:
        return []
    sense = math.copysign(1.0, turned)
    first = sense * (math.atan2(start[1] - centre[1], start[0] - centre[0]) - phase)
    crossed = range(math.floor(first / math.pi) + 1, math.ceil((first + abs(turned)) / math.pi))
    return [(k * math.pi - first) / abs(turned) for k in crossed]


def point_around(pole: Point, radius: float, degrees: float) -> Point:
    """The point at polar coordinates about a pole: radius in mm, angle in degrees from the first axis."""
    angle = math.radians(degrees)
    return pole[0] + radius * math.cos(angle), pole[1] + radius * math.sin(angle)


def point_at(start: Point, centre: Point, angle: float) -> Point:
    """The start rotated about the centre by `angle`, rad."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = start[0] - centre[0], start[1] - centre[1]
    return centre[0] + c * x - s * y, centre[1] + s * x + c * y


def height_over_chord(start: Point, end: Point, centre: Point) -> float:
    """Distance of the centre from the line through start and end."""
    chord = math.dist(start, end)
    across = (end[0] - start[0]) * (centre[1] - start[1]) - (end[1] - start[1]) * (centre[0] - start[0])
    return abs(across) / chord


def _beside_chord(start: Point, end: Point, height: float) -> Point:
    """The point at a distance `height` to the left of the middle of the chord, seen from start to end."""
    chord = math.dist(start, end)
    mx, my = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    return mx - height * (end[1] - start[1]) / chord, my + height * (end[0] - start[0]) / chord
