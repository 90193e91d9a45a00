"""Deviation of the tool point: actual minus nominal, tool relative to workpiece, in the workpiece frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.transforms import Array, rotation_vector


class Deviation(NamedTuple):
    """position `(n, 3)` mm; orientation `(n, 3)` rad, as a rotation vector."""

    position: Array
    orientation: Array


def exact_deviation(machine: Machine, q: ArrayLike, errors: Array, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Deviation:
    """Deviation by the full matrix product; the oracle of every first-order form. Shapes as in `forward`."""
    nominal = forward(machine, q)
    actual = forward(machine, q, errors)
    turned = actual.rotation @ np.swapaxes(nominal.rotation, 1, 2)
    return Deviation(actual.apply(tool) - nominal.apply(tool), rotation_vector(turned))
