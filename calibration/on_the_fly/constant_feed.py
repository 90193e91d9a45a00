"""Which readings count: those on feed moves, away from corners, at constant speed.

The rule: a reading is left out within `corner_mm` of a corner (the path turns by more than 1 degree, stops, or goes on
in rapid), and where the speed along the program differs by more than 5 % from that of its stretch between two corners.
The speed is counted as the feed is, by what the program says, so that a target swung by a rotary axis is no faster than
the axis turns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.nominal_path import TargetPath
from kinematics.transforms import Array

STEADY = 0.05
"""Share by which the speed may differ from that of the stretch."""
PLATEAU = 0.7
"""Quantile of the speeds on a stretch that its speed is: above what is lost in speeding up and slowing down."""


class Steadiness(NamedTuple):
    """Of readings `n`."""

    corner: np.ndarray
    """True `(n,)` close to a corner, or in rapid."""
    unsteady: np.ndarray
    """True `(n,)` where the speed is not constant."""
    speed: Array
    """`(n,)`, mm/s along the way of the target."""
    feed: Array
    """`(n,)`, mm/min, or deg/min where rotary axes move alone."""


def steadiness(path: TargetPath, time: Array, way: Array, corner_mm: float, cell_mm: float) -> Steadiness:
    """How readings at `time` `(n,)`, s, and `way` `(n,)`, mm, count."""
    stretch = path.stretch(way)
    distance = np.minimum(way - path.corners[stretch], path.corners[stretch + 1] - way)
    corner = (distance < corner_mm) | ~path.usable[stretch]
    # over so many readings that noise is no speed
    span = max(1, round(len(way) * cell_mm / path.length / 2.0))
    after, before = np.minimum(np.arange(len(way)) + span, len(way) - 1), np.maximum(np.arange(len(way)) - span, 0)
    lasted = time[after] - time[before]
    fed = path.way_at(way)
    speed, feed = (way[after] - way[before]) / lasted, (fed[after] - fed[before]) / lasted
    plateau = np.full(len(path.usable), np.inf)
    inside = np.flatnonzero(~corner)
    order = inside[np.argsort(stretch[inside], kind="stable")]
    numbers, first = np.unique(stretch[order], return_index=True)
    for number, rows in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        plateau[number] = np.quantile(feed[rows], PLATEAU)
    with np.errstate(invalid="ignore"):
        unsteady = ~(np.abs(feed / plateau[stretch] - 1.0) <= STEADY) & ~corner
    return Steadiness(corner, unsteady, speed, feed * 60.0)
