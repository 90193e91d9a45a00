"""Deviation of the tool point: actual minus nominal, tool relative to workpiece, in the workpiece frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.transforms import Array, blocks, rotation_vector

UM_PER_MM = 1e3
"""Deviations are calculated in mm and stated in um."""


class Deviation(NamedTuple):
    """position `(n, 3)` mm; orientation `(n, 3)` rad, as a rotation vector."""

    position: Array
    orientation: Array


def exact_deviation(machine: Machine, q: ArrayLike, errors: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Deviation:
    """Deviation by the full matrix product; the oracle of every first-order form. Shapes as in `forward`.

    q, errors and tool: one row of each serves for all. A block of rows at a time is faster and needs no more memory
    than the result.
    """
    given = [np.atleast_2d(np.asarray(q, float)), np.asarray(errors, float), np.atleast_2d(np.asarray(tool, float))]
    given[1] = given[1].reshape(-1, *given[1].shape[-2:])
    n = np.broadcast_shapes(*((len(column),) for column in given))[0]
    result = np.empty((6, n)).T
    for rows in blocks(n):
        positions, motions, tips = (column if len(column) == 1 else column[rows] for column in given)
        nominal, actual = forward(machine, positions), forward(machine, positions, motions)
        result[rows, :3] = actual.apply(tips) - nominal.apply(tips)
        result[rows, 3:] = rotation_vector(actual.rotation @ np.swapaxes(nominal.rotation, 1, 2))
    return Deviation(result[:, :3], result[:, 3:])
