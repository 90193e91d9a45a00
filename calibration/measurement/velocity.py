"""How fast the axes moved at each observation, from the order of rows and the feed."""

from __future__ import annotations

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array

STILL = 1e-9
"""mm or rad: an axis that moves less between two rows stands still."""


def velocities(
    machine: Machine, positions: Array, feed: Array, begins: np.ndarray, told: Array
) -> tuple[Array, np.ndarray]:
    """Velocity `(n, axes)`, mm/s and rad/s, and the rows `(n,)` in motion of which no direction is known: 0 there.

    The way is that from the row before, or to the next one where a row is the first in motion; a feed `(n,)`, mm/min,
    is that of the linear axes together, and where only rotary axes move, deg/min. begins: True `(n,)` where a row does
    not follow the one before (another run). told `(n, axes)`: directions that the file states, 0 where it states none;
    a way that goes against them is turned round.
    """
    moving = feed > 0.0
    steps = np.diff(positions, axis=0, append=positions[-1:])
    steps[np.abs(steps) < STILL] = 0.0
    steps[np.append(begins[1:], True)] = 0.0
    before = np.roll(steps, 1, axis=0)
    goes_on = moving & np.append(moving[1:], False) & steps.any(axis=1)
    first = goes_on & (begins | ~np.append(False, moving[:-1]))
    way = np.where((first | ~before.any(axis=1))[:, None], np.where(goes_on[:, None], steps, before), before)
    way = np.where(told != 0.0, np.copysign(way, told), way)
    length = np.linalg.norm(way[:, ~machine.rotary], axis=1)
    length = np.where(length > 0.0, length, np.degrees(np.linalg.norm(way[:, machine.rotary], axis=1)))
    lost = moving & (length == 0.0)
    share = np.where(moving & ~lost, feed / 60.0, 0.0) / np.where(length > 0.0, length, 1.0)
    return np.asarray(way * share[:, None]), lost
