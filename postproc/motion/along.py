"""Positions along moves, as the control runs them: straight in programmed coordinates, arcs round their circles."""

from __future__ import annotations

import math

import numpy as np

from kinematics.transforms import Array
from postproc.motion.circles import SAME_POINT_MM, sweep
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc

INNER = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
"""Shares of the path of a move at which it is evaluated between its ends."""
ALONG = 1e-6
"""Cosine of the angle between a line and an axis, below which a coordinate of that axis does not give its end."""
CLOSELY = tuple(i / 37 for i in range(1, 38))
"""Shares for moves whose error may change quickly: a prime number of them, which few whole periods coincide with."""


def positions_along(motions: Motions, rows: np.ndarray, shares: Array) -> Array:
    """Programmed positions `(k, axes)` at shares `(k,)` of the paths of rows `(k,)`.

    If the radii at the two ends of an arc differ, the radius changes linearly between them.
    """
    start, target = motions.start[rows], motions.target[rows]
    program = np.asarray(start + shares[:, None] * (target - start))
    if motions.arcs:
        motions.circles.put_some(program, rows, shares)
    return program


def round_the_circle(arc: Arc, ends: tuple[complex, complex], shares: Array) -> np.ndarray:
    """Complex points `(k,)` in the plane of an arc, mm, at shares `(k,)` of it; `ends`: its start and end."""
    start, end = ends
    centre = complex(*arc.centre)
    turned = sweep((start.real, start.imag), (end.real, end.imag), arc.centre, arc.sense, arc.full, arc.turns)
    grown = abs(end - centre) / abs(start - centre) if start != centre else 1.0
    return np.asarray(centre + (start - centre) * np.exp(1j * turned * shares) * (1.0 + shares * (grown - 1.0)))


def heading(
    start: tuple[float, ...], end: tuple[float, ...], arc: Arc | None, plane: tuple[int, int, int]
) -> tuple[float, float] | None:
    """Unit direction in a plane at the end of a move, programmed coordinates; None if there is none."""
    i, j, _ = plane
    if arc is None:
        x, y = end[i] - start[i], end[j] - start[j]
    elif arc.plane == plane:
        x, y = -arc.sense * (end[j] - arc.centre[1]), arc.sense * (end[i] - arc.centre[0])
    else:
        return None
    length = math.hypot(x, y)
    return (x / length, y / length) if length > SAME_POINT_MM else None


def other_coordinate(start: tuple[float, float], value: float, angle: float, *, second_given: bool) -> float | None:
    """The other coordinate of the end of a line by its angle, rad, from the first axis towards the second.

    value: the given coordinate, of the first axis or of the second. None where the line leads elsewhere.
    """
    along, across = (math.sin(angle), math.cos(angle)) if second_given else (math.cos(angle), math.sin(angle))
    way = value - start[second_given]
    if abs(along) < ALONG or way * along < 0.0:
        return None
    return start[not second_given] + way * across / along
