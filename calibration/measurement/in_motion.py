"""Rows in motion: their velocity by order and feed, and the components of their observations that count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array

STANDSTILL_DISPLACEMENT = 1e-9
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
    steps[np.abs(steps) < STANDSTILL_DISPLACEMENT] = 0.0
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


@dataclass(frozen=True)
class AcrossPath:
    """Observations in motion: only components across the path count, and each row is the mean of several readings."""

    directions: Array
    """Directions `(n, 2, 3)`, orthonormal and perpendicular to the path, in the instrument's frame."""
    readings: Array
    """Number of independent readings in the mean of each row `(n,)`."""
    ends: Array
    """Smallest and largest axis positions of the path `(2, axes)`, mm and rad."""
    distances: Array
    """Distance along the path `(n,)`, mm."""

    def rows(self, index: slice | np.ndarray) -> AcrossPath:
        """Some of the rows; the path stays the same."""
        return AcrossPath(self.directions[index], self.readings[index], self.ends, self.distances[index])

    def of(self, vectors: Array) -> Array:
        """Components across the path `(n, 2, ...)` of vectors or matrices `(n, 3, ...)` in the instrument's frame."""
        if vectors.ndim == 2:
            return np.asarray((self.directions @ vectors[:, :, None])[:, :, 0])
        return np.asarray(self.directions @ vectors)
