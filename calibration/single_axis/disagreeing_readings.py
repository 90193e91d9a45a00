"""Readings of repeated runs that disagree with the others of their target and direction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import outlying, robust_factor, too_many
from kinematics.machine import NDArrayBool
from kinematics.transforms import Array


class Astray(NamedTuple):
    """A reading that disagrees with the others of its target and direction by more than noise allows."""

    where: str
    """File and line."""
    run: str
    """Name of its run; empty where the runs have no names."""
    deviation: float
    """Deviation from the median of its target and direction, um or urad."""


def from_the_others(target: Array, direction: np.ndarray, readings: Array) -> Array:
    """Deviations `(n,)` of readings from the median of those at the same target in the same direction."""
    _, cell = np.unique(np.stack([target, direction], axis=1), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    medians = np.array([np.median(readings[cell == k]) for k in range(int(cell.max()) + 1)])
    return np.asarray(readings - medians[cell])


def disagreeing(away: Array, u: float, medians: int) -> NDArrayBool:
    """Mask `(n,)` of the outliers, by the rule of a fit, among deviations `(n,)` from so many medians.

    u: standard uncertainty of a reading. No reading is marked where more of them disagree than may be outliers.
    """
    rows = len(away)
    if rows <= medians:
        return np.zeros(rows, bool)
    distances = (away / u if u > 0.0 else away) ** 2
    factor = robust_factor(distances, 1, medians, 1.0 if u > 0.0 else 0.0, np.arange(rows))
    found = outlying(distances, 1, factor)
    return np.zeros(rows, bool) if too_many(int(found.sum()), rows) else found


def named(measurement: Measurement, rows: np.ndarray, away: Array) -> Iterator[Astray]:
    """The readings in these rows, with their deviations."""
    runs = np.full(len(measurement), "") if measurement.run is None else measurement.run.astype(str)
    for row, deviation in zip(rows.tolist(), away.tolist(), strict=True):
        yield Astray(measurement.where(row), str(runs[row]), deviation)
