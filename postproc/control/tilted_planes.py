"""Tilted planes: the positions of the rotary axes at which the tool is perpendicular to a plane."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinematics.forward import forward
from kinematics.inverse import rotary_solutions
from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.motion.frames import Placement

WITHIN_TRAVEL = 1e-6
"""Degrees: a position that is no farther outside travel is taken."""
TILT_DECIMALS = 9
"""Decimals of a position in degrees; later ones are rounding."""


def normal_of(plane: Placement) -> tuple[float, float, float]:
    """The unit Z of a plane, in the coordinates that it is placed in."""
    x, y, z = plane.turn[2::3]
    return x, y, z


def lean(machine: Machine, degrees: Array, normal: tuple[float, float, float]) -> float:
    """Angle, rad, for small ones, between the tool and the normal of a plane in the workpiece frame.

    degrees `(axes,)`: positions of the rotary axes; those of the linear axes do not count.
    """
    axis = forward(machine, np.deg2rad(degrees)[None]).rotation[0, :, 2]
    return float(np.linalg.norm(axis - normal))


def perpendicular(
    machine: Machine, normal: tuple[float, float, float], here: Mapping[int, float]
) -> tuple[list[dict[int, float]], bool]:
    """All positions of the rotary axes with the tool along a normal, and whether the first of these axes is free.

    normal: in the workpiece frame. here: present positions of the rotary axes, degrees by column. Positions in degrees
    by column, each inside travel and with the whole turns that bring it nearest to `here`; a free axis is at 0.
    """
    start = np.zeros(len(machine.axes))
    start[list(here)] = np.deg2rad(list(here.values()))
    branches, free = rotary_solutions(machine, normal, start)
    found: list[dict[int, float]] = []
    for branch in branches:
        angles = np.rad2deg(branch)
        if free:
            angles[0] = 0.0
        wound = {i: _wound(machine, i, float(angle), at) for (i, at), angle in zip(here.items(), angles, strict=True)}
        inside = {i: angle for i, angle in wound.items() if angle is not None}
        if len(inside) == len(here) and not any(_same(inside, other) for other in found):
            found.append(inside)
    return found, free


def _wound(machine: Machine, axis: int, angle: float, here: float) -> float | None:
    """The angle with the whole turns, degrees, nearest to `here` inside travel; None where none is inside."""
    low, high = machine.axes[axis].travel
    near = angle + 360.0 * round((here - angle) / 360.0)
    wound = [round(near + turns, TILT_DECIMALS) + 0.0 for turns in (0.0, -360.0, 360.0)]
    return next((at for at in wound if low - WITHIN_TRAVEL <= at <= high + WITHIN_TRAVEL), None)


def _same(a: Mapping[int, float], b: Mapping[int, float]) -> bool:
    return all(abs((a[i] - b[i] + 180.0) % 360.0 - 180.0) < WITHIN_TRAVEL for i in a)
