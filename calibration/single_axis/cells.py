"""Readings of an axis at repeated targets: their number, mean and scatter for each target and direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array

FORWARD, BACKWARD = 0, 1
DIRECTIONS = ("forward", "backward")
"""Rows of the cells."""


class Cells(NamedTuple):
    """Values `(2, m)` of the readings by direction, forward (0) or backward (1), and by target, in their unit."""

    positions: Array
    """Target positions `(m,)`, ascending, mm or degrees."""
    counts: np.ndarray
    """Number of readings."""
    mean: Array
    """Mean of the readings; NaN without any."""
    spread: Array
    """Estimator s of their standard deviation; NaN for fewer than two."""


def cells_of(target: Array, direction: np.ndarray, readings: Array) -> Cells:
    """Means and estimators s of readings `(n,)` at targets `(n,)`, mm or degrees, in directions `(n,)`, 0 or 1."""
    positions, number = np.unique(target, return_inverse=True)
    cell, shape = (direction, number), (2, len(positions))
    count, total, squares = np.zeros(shape, int), np.zeros(shape), np.zeros(shape)
    np.add.at(count, cell, 1)
    np.add.at(total, cell, readings)
    mean = np.divide(total, count, out=np.full(shape, np.nan), where=count > 0)
    np.add.at(squares, cell, (readings - mean[cell]) ** 2)
    spread = np.sqrt(np.divide(squares, count - 1, out=np.full(shape, np.nan), where=count > 1))
    return Cells(positions, count, mean, spread)
