"""The moves of the reference interpreters, their mistakes, and arithmetic that every control has."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

Point = dict[str, float]
"""Coordinates by axis, mm and degrees; nan where the program has not given one."""
PLANES = {"XY": ("X", "Y", "Z"), "ZX": ("Z", "X", "Y"), "YZ": ("Y", "Z", "X")}
"""First, second and normal axis: an arc to the left of the first towards the second is counter-clockwise."""
ROUNDING_MM = 1e-7
"""Difference of two positions that is none."""
LONGEST = 20_000
"""Blocks after which a program is taken for endless."""


class Unclear(Exception):
    """The program has what the manuals leave open, or what the interpreter does not have."""


@dataclass(frozen=True)
class Move:
    """One move of the control."""

    kind: str
    """`rapid`, `line`, `arc`, `hole` (the feed into one), `back` (its return), `above` (its rapids), or `machine`."""
    end: Point
    """X Y Z of the tool tip with the work offset added, mm, and the rotary axes, degrees.

    With `tip`, X Y Z are those on the workpiece, which the rotary axes have turned.
    """
    length: float
    """Length offset in force, mm."""
    tip: bool = False
    feed: tuple[str, float] = ("", 0.0)
    """Word of the feed, mm/min or 1/min, with its mode."""
    middle: Point = field(default_factory=dict)
    """In the middle of an arc: first, second and normal axis of its plane."""
    named: str = ""
    """Axes of a move to machine coordinates."""
    repeated: bool = False
    """One of several holes of a block."""
    continues: bool = False
    """A further part of the move before it."""
    whole_turn: bool = False
    """An arc that ends in its plane where it begins."""


def joined(moves: list[Move]) -> list[Move]:
    """Moves whose parts are one: the end of the last part; an arc of several parts has no middle."""
    found: list[Move] = []
    for move in moves:
        if move.continues:
            first, mode = found[-1].feed, move.feed[0]
            feed = (mode, 1.0 / (1.0 / first[1] + 1.0 / move.feed[1])) if mode == first[0] == "inverse" else move.feed
            found[-1] = replace(move, middle={}, continues=False, feed=feed)
        else:
            found.append(move)
    return found


def arc_middle(start: Point, end: Point, centre: Point, plane: str, left: bool, turns: int = 0) -> Point:
    """The point in the middle of an arc; a full circle where start and end are one."""
    first, second, normal = PLANES[plane]
    begin = math.atan2(start[second] - centre[second], start[first] - centre[first])
    angle = sweep(start, end, centre, plane, left) + turns * math.tau
    radius = (math.dist(*_flat(start, centre, plane)) + math.dist(*_flat(end, centre, plane))) / 2
    half = begin + (angle if left else -angle) / 2
    return {
        first: centre[first] + radius * math.cos(half),
        second: centre[second] + radius * math.sin(half),
        normal: (start[normal] + end[normal]) / 2,
    }


def sweep(start: Point, end: Point, centre: Point, plane: str, left: bool) -> float:
    """Angle of an arc, rad, above 0 and at most one turn."""
    first, second, _ = PLANES[plane]
    a, b = (math.atan2(p[second] - centre[second], p[first] - centre[first]) for p in (start, end))
    angle = (b - a if left else a - b) % math.tau
    return angle if angle > 1e-6 else math.tau


def centre_of(start: Point, end: Point, radius: float, plane: str, left: bool) -> Point:
    """Centre of an arc by its radius, above 0 for an arc of up to half a turn and below it for a longer one."""
    first, second, _ = PLANES[plane]
    u, v = end[first] - start[first], end[second] - start[second]
    chord = math.hypot(u, v)
    if not 0.0 < chord <= 2.0 * abs(radius) + 1e-3:
        raise Unclear("an arc by its radius that does not reach its end")
    height = math.sqrt(max(radius * radius - chord * chord / 4.0, 0.0))
    side = (
        1.0 if left == (radius > 0.0) else -1.0
    )  # of the chord: left of it lies the centre of a short arc to the left
    return {
        first: start[first] + u / 2.0 - side * height * v / chord,
        second: start[second] + v / 2.0 + side * height * u / chord,
    }


def turned(p: Point, plane: str, degrees: float) -> Point:
    """A point or a direction turned about the origin, in a plane."""
    first, second, _ = PLANES[plane]
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return p | {first: cos * p[first] - sin * p[second], second: sin * p[first] + cos * p[second]}


def _flat(a: Point, b: Point, plane: str) -> tuple[tuple[float, float], tuple[float, float]]:
    first, second, _ = PLANES[plane]
    return (a[first], a[second]), (b[first], b[second])
