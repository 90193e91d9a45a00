"""Continuous and quasi-static measurements of one axis, independent of their file formats; mm, s, um."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.transforms import Array

DIRECTION_NAMES = {1: "forward", -1: "backward"}
"""Directions, by the sign of the motion along the axis."""


@dataclass(frozen=True)
class Record:
    """One traverse of the axis: the samples of a laser."""

    name: str
    """Name of the run with its direction, for messages."""
    direction: int
    """Sign of the motion along the axis, 1 or -1."""
    time: Array
    """Time `(n,)`, s, ascending."""
    displacement: Array
    """Displacement `(n,)`, mm, from any zero; ascending in the positive direction of the axis."""
    start: float
    """Commanded position at the start of the traverse, mm; `end`: at its end."""
    end: float
    feed: float
    """Programmed feed, mm/min."""
    source: str = ""
    """File and line of the first sample."""

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class QuasiStatic:
    """Readings at targets with the axis at standstill, in the order of acquisition."""

    target: Array
    """Target position `(n,)`, mm."""
    deviation: Array
    """Deviation `(n,)`, um: measured minus target."""
    direction: np.ndarray
    """Direction `(n,)`, 1 or -1."""
    run: np.ndarray
    """Name of the cycle `(n,)`: a forward traverse and its return share one."""
    u: float | None = None
    """Standard uncertainty of a reading by the instrument specification, um (k = 1); None if no file gives it."""
    u_per_m: float = 0.0
    """Standard uncertainty of the instrument's scale, um per m (k = 1)."""
    source: str = ""

    def __len__(self) -> int:
        return len(self.target)

    @property
    def runs(self) -> list[str]:
        """Names of the cycles, in the order of their first readings."""
        return list(dict.fromkeys(self.run.tolist()))

    def rows(self, index: np.ndarray) -> QuasiStatic:
        """Some of the readings."""
        return QuasiStatic(
            self.target[index],
            self.deviation[index],
            self.direction[index],
            self.run[index],
            self.u,
            self.u_per_m,
            self.source,
        )

    def curve(self, direction: int) -> tuple[Array, Array]:
        """Targets `(m,)`, mm, ascending, and mean deviations there `(m,)`, um, of one direction.

        For a direction without readings: those of the other direction.
        """
        rows = self.direction == direction
        rows = rows if rows.any() else ~rows
        targets, which = np.unique(self.target[rows], return_inverse=True)
        return targets, np.bincount(which, self.deviation[rows]) / np.bincount(which)
