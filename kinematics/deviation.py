"""Deviation of the tool point: actual minus nominal, tool relative to workpiece, in the workpiece frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.transforms import Array, blocks, rotation_vector


class Deviation(NamedTuple):
    """position `(n, 3)` mm; orientation `(n, 3)` rad, as a rotation vector."""

    position: Array
    orientation: Array


def exact_deviation(machine: Machine, q: ArrayLike, errors: Array, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Deviation:
    """Deviation by the full matrix product; the oracle of every first-order form. Shapes as in `forward`."""

    def exact(q: Array, errors: Array, tool: Array) -> Deviation:
        nominal = forward(machine, q)
        actual = forward(machine, q, errors)
        turned = actual.rotation @ np.swapaxes(nominal.rotation, 1, 2)
        return Deviation(actual.apply(tool) - nominal.apply(tool), rotation_vector(turned))

    return in_blocks(exact, q, errors, tool)


def in_blocks(
    work: Callable[[Array, Array, Array], Deviation], q: ArrayLike, errors: ArrayLike, tool: ArrayLike
) -> Deviation:
    """`work` done a block of rows at a time, which is faster and takes no more memory than the result.

    q `(n, axes)`, errors `(n, places, 6)`, tool `(n, 3)`; of each, one row, with or without its first dimension, serves
    for all. Results have as many rows as the longest.
    """
    given = [np.atleast_2d(np.asarray(q, float)), np.asarray(errors, float), np.atleast_2d(np.asarray(tool, float))]
    given[1] = given[1].reshape(-1, *given[1].shape[-2:])
    n = np.broadcast_shapes(*((len(column),) for column in given))[0]
    result = np.empty((6, n)).T
    for rows in blocks(n):
        part = work(*(column if len(column) == 1 else column[rows] for column in given))
        result[rows, :3], result[rows, 3:] = part
    return Deviation(result[:, :3], result[:, 3:])
