"""What continuous and quasi-static measurements of one axis are, whatever files they come from; mm, s, um."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.transforms import Array

WAYS = {1: "forward", -1: "backward"}
"""Directions, by the sign of the motion along the axis."""


@dataclass(frozen=True)
class Record:
    """One traverse of the axis: what a laser showed, sample by sample."""

    name: str
    """Of the run with its direction, for messages."""
    direction: int
    """1 or -1: the sign of the motion along the axis."""
    time: Array
    """`(n,)`, s, ascending."""
    displacement: Array
    """`(n,)`, mm, from any zero; ascending in the axis' positive direction."""
    start: float
    """Commanded position where the traverse begins, mm."""
    end: float
    feed: float
    """Programmed, mm/min."""
    source: str = ""
    """File, and line of the first sample."""

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class QuasiStatic:
    """Readings at targets where the axis stood, in the order of acquisition."""

    target: Array
    """`(n,)`, mm."""
    deviation: Array
    """`(n,)`, um: measured minus target."""
    direction: np.ndarray
    """`(n,)`, 1 or -1."""
    run: np.ndarray
    """Name of the cycle `(n,)`: a way there and its way back share one."""
    u: float | None = None
    """Standard uncertainty of a reading by the instrument's sheet, um (k = 1); None where no file says it."""
    u_per_m: float = 0.0
    """Of the scale, um per m (k = 1)."""
    source: str = ""

    def __len__(self) -> int:
        return len(self.target)

    @property
    def runs(self) -> list[str]:
        """Names of the cycles, in the order in which they begin."""
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
        """Targets `(m,)`, ascending, and mean deviations there `(m,)`, um, of one direction.

        A direction without readings is stood in for by the other one.
        """
        rows = self.direction == direction
        rows = rows if rows.any() else ~rows
        targets, which = np.unique(self.target[rows], return_inverse=True)
        return targets, np.bincount(which, self.deviation[rows]) / np.bincount(which)
