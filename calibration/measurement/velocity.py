"""Velocity of the axes at each observation, from the order of rows and the feed."""

from __future__ import annotations

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array

STANDSTILL = 1e-9
"""Displacement between two rows, mm or rad, below which an axis is at standstill."""


def velocities(
    machine: Machine, positions: Array, feed: Array, run_starts: np.ndarray, programmed: Array
) -> tuple[Array, np.ndarray]:
    """Velocity `(n, axes)`, mm/s and rad/s, and a mask `(n,)` of rows in motion without a known direction (velocity 0).

    The direction is that from the row before, or to the next row for the first row in motion. The feed `(n,)`, mm/min,
    refers to the linear axes together, or, if only rotary axes move, to these in deg/min. `run_starts`: True `(n,)` for
    a row that does not follow the one before (another run). `programmed` `(n, axes)`: directions given in the file, 0
    without one; a motion against them is reversed.
    """
    moving = feed > 0.0
    steps = np.diff(positions, axis=0, append=positions[-1:])
    steps[np.abs(steps) < STANDSTILL] = 0.0
    steps[np.append(run_starts[1:], True)] = 0.0
    before = np.roll(steps, 1, axis=0)
    continues = moving & np.append(moving[1:], False) & steps.any(axis=1)
    first = continues & (run_starts | ~np.append(False, moving[:-1]))
    steps_taken = np.where((first | ~before.any(axis=1))[:, None], np.where(continues[:, None], steps, before), before)
    steps_taken = np.where(programmed != 0.0, np.copysign(steps_taken, programmed), steps_taken)
    length = np.linalg.norm(steps_taken[:, ~machine.rotary], axis=1)
    length = np.where(length > 0.0, length, np.degrees(np.linalg.norm(steps_taken[:, machine.rotary], axis=1)))
    lost = moving & (length == 0.0)
    share = np.where(moving & ~lost, feed / 60.0, 0.0) / np.where(length > 0.0, length, 1.0)
    return np.asarray(steps_taken * share[:, None]), lost
