"""Reference straight lines of ISO 230-1: least squares, end point and minimum zone; each in one plane.

A straightness in space has one line in each of the two planes through the axis. Every line is linear in the readings
(the minimum zone's in its three points of contact), so that uncertainties propagate linearly.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError

Kind = Literal["least-squares", "end-point", "minimum-zone"]


@dataclass(frozen=True)
class ReferenceLine:
    """value = offset + slope * position; offset and slope are linear functions of the readings `(n,)`."""

    kind: Kind
    slope_of: Array
    """Weights `(n,)` of the readings in the slope, per unit of position."""
    offset_of: Array
    """Weights `(n,)` of the readings in the value at position 0."""

    def residual_of(self, positions: Array) -> Array:
        """Matrix `(n, n)` from readings to deviations from the line."""
        return np.eye(len(positions)) - self.offset_of - positions[:, None] * self.slope_of


@dataclass(frozen=True)
class Straightness:
    """Deviations from a reference line, and their range, the straightness of ISO 230-1; units of the readings."""

    line: ReferenceLine
    slope: float
    """Slope of the line, per unit of position."""
    u_slope: float
    deviations: Array
    """Deviations `(n,)` from the line."""
    value: float
    u_value: float


def straightness(kind: Kind, positions: Array, values: Array, covariance: Array) -> Straightness:
    """Straightness of readings `(n,)` with covariance `(n, n)` at ascending or descending positions `(n,)`."""
    line = reference_line(kind, positions, values)
    residual = line.residual_of(positions)
    deviations = residual @ values
    range_of = residual[np.argmax(deviations)] - residual[np.argmin(deviations)]
    u = [float(np.sqrt(max(row @ covariance @ row, 0.0))) for row in (line.slope_of, range_of)]
    return Straightness(line, float(line.slope_of @ values), u[0], deviations, float(np.ptp(deviations)), u[1])


def reference_line(kind: Kind, positions: Array, values: Array) -> ReferenceLine:
    """The line of a kind through readings `(n,)` at positions `(n,)`; UserError for fewer than two positions."""
    if len(positions) < 2 or np.ptp(positions) == 0:
        raise UserError("a reference straight line needs readings at two positions or more")
    if kind == "least-squares":
        centred = positions - positions.mean()
        slope = centred / (centred @ centred)
        mean = np.full(len(positions), 1.0 / len(positions))
        return ReferenceLine(kind, slope, mean - positions.mean() * slope)
    if kind == "end-point":
        return _through(kind, positions, int(np.argmin(positions)), int(np.argmax(positions)))
    return _minimum_zone(positions, values)


def _through(kind: Kind, positions: Array, a: int, b: int) -> ReferenceLine:
    """The line through two readings."""
    slope, at = np.zeros(len(positions)), np.zeros(len(positions))
    slope[[a, b]] = np.array([-1.0, 1.0]) / (positions[b] - positions[a])
    at[a] = 1.0
    return ReferenceLine(kind, slope, at - positions[a] * slope)


def _minimum_zone(positions: Array, values: Array) -> ReferenceLine:
    """The middle of the narrowest pair of parallel lines that encloses all readings.

    One of the two lies on an edge of the convex hull, the other on the reading farthest from it (across the axis). Of
    several equally narrow zones the first is used.
    """
    best: tuple[float, ReferenceLine] | None = None
    for side in (1.0, -1.0):
        hull = _hull(positions, side * values)
        for a, b in pairwise(hull):
            edge = _through("minimum-zone", positions, a, b)
            away = values - edge.offset_of @ values - edge.slope_of @ values * positions
            farthest = int(np.argmax(np.abs(away)))
            if best is None or abs(away[farthest]) < best[0]:
                opposite = np.zeros(len(positions))
                opposite[farthest] = 1.0
                shift = opposite - edge.offset_of - positions[farthest] * edge.slope_of
                middle = ReferenceLine("minimum-zone", edge.slope_of, edge.offset_of + 0.5 * shift)
                best = float(abs(away[farthest])), middle
    assert best is not None
    return best[1]


def _hull(positions: Array, values: Array) -> list[int]:
    """Indices of the readings on the lower convex hull, by ascending position (Andrew's monotone chain)."""
    hull: list[int] = []
    for i in np.lexsort((values, positions)).tolist():
        if hull and positions[hull[-1]] == positions[i]:
            continue
        while len(hull) > 1 and _left(positions, values, hull[-2], hull[-1], i) <= 0:
            hull.pop()
        hull.append(i)
    return hull


def _left(x: Array, y: Array, a: int, b: int, c: int) -> float:
    """Positive if c lies to the left of the line from a to b."""
    return float((x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]))
