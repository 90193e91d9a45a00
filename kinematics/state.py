"""State: everything an error may depend on, one row per instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array


@dataclass(frozen=True)
class State:
    """Columns over `n` instants."""

    positions: Array
    """Axis positions `(n, axes)` in chain order, mm and rad."""

    def position(self, machine: Machine, axis: str) -> Array:
        """Positions `(n,)` of one axis in the units of files, mm or degrees."""
        i = machine.index(axis)
        return np.asarray(self.positions[:, i] / machine.scale[i])
