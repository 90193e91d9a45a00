"""Selection of the readings that count: on feed moves, away from corners, at constant speed.

A reading is left out within `corner_mm` of a corner (the path turns by more than 1 degree, stops, or continues in
rapid), and where the feed differs by more than 5 % from that of its segment between two corners. The feed is evaluated
as the control programs it: a rotary axis that moves a target in a circle at constant rate counts as constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.nominal_path import TargetPath
from kinematics.transforms import Array

STEADY_FEED = 0.05
"""Largest relative difference of the feed from that of the segment."""
PLATEAU = 0.7
"""Quantile of the feeds on a segment that is taken for its constant feed: acceleration and braking lie below it."""


class Steadiness(NamedTuple):
    """Evaluation of readings `n`."""

    corner: np.ndarray
    """Mask `(n,)` of readings close to a corner or in rapid."""
    unsteady: np.ndarray
    """Mask `(n,)` of readings at changing speed."""
    speed: Array
    """Speed along the path of the target `(n,)`, mm/s."""
    feed: Array
    """Feed `(n,)`, mm/min, or deg/min where only rotary axes move."""


def steadiness(path: TargetPath, time: Array, distances: Array, corner_mm: float, cell_mm: float) -> Steadiness:
    """Evaluation of readings at times `(n,)`, s, and distances along the path `(n,)`, mm."""
    segment = path.segment_at(distances)
    to_corner = np.minimum(distances - path.corners[segment], path.corners[segment + 1] - distances)
    corner = (to_corner < corner_mm) | ~path.usable[segment]
    # the speed is taken over enough readings to suppress noise
    span = max(1, round(len(distances) * cell_mm / path.length / 2.0))
    after, before = (
        np.minimum(np.arange(len(distances)) + span, len(distances) - 1),
        np.maximum(np.arange(len(distances)) - span, 0),
    )
    lasted = time[after] - time[before]
    fed = path.feed_distance_at(distances)
    speed, feed = (distances[after] - distances[before]) / lasted, (fed[after] - fed[before]) / lasted
    plateau = np.full(len(path.usable), np.inf)
    inside = np.flatnonzero(~corner)
    order = inside[np.argsort(segment[inside], kind="stable")]
    numbers, first = np.unique(segment[order], return_index=True)
    for number, rows in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        plateau[number] = np.quantile(feed[rows], PLATEAU)
    with np.errstate(invalid="ignore"):
        unsteady = ~(np.abs(feed / plateau[segment] - 1.0) <= STEADY_FEED) & ~corner
    return Steadiness(corner, unsteady, speed, feed * 60.0)
