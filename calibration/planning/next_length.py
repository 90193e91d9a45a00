"""The lengths of a rectangle that a ruler has still to measure, and the one that helps most.

The unknowns are the lean of the second axis, the scales of both axes and of the ruler. The next length is that whose
reading is least known from the others, in its standard uncertainties: the gain of information is greatest there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

LENGTHS = ("AC", "BD", "AD", "AB", "BC", "DC")
"""Diagonals and sides, by their corners: A at the low ends of both axes, D at the high end of the first one."""
UNKNOWN = 0.1
"""Standard deviation of the lean, rad, and of the scales, mm/mm, before any reading: nothing is known."""
RULER = 1e-3
"""Standard uncertainty of the scale of a ruler without a statement, mm/mm."""
SIDE_SHARE_OF_TRAVEL = 0.8
"""Share of the travel that the sides have by default."""


@dataclass(frozen=True)
class Corners:
    """A rectangle in the plane of two axes."""

    plane: str
    """The first and the second axis."""
    low: tuple[float, float]
    """Position of A, mm."""
    size: tuple[float, float]
    """Sides along the two axes, mm."""

    @classmethod
    def within(cls, machine: Machine, plane: str, size: tuple[float, float] | None) -> Corners:
        """The rectangle in the middle of the travel; size: its sides, mm, by default most of the travel.

        UserError for an axis that the machine does not have, and for sides longer than the travel.
        """
        low, sides = [], []
        for k, name in enumerate(plane):
            if name not in machine.names:
                raise UserError(f"--plane {plane}: machine {machine.name} ({machine.chain}) has no axis {name}")
            first, last = machine.axes[machine.index(name)].travel
            side = float(np.floor((last - first) * SIDE_SHARE_OF_TRAVEL)) if size is None else size[k]
            if not 0.0 < side <= last - first:
                raise UserError(f"--size {side:g}: the side along {name} is above 0, and at most {last - first:g} mm")
            low.append(float(round((first + last - side) / 2.0)) if side < last - first else first)
            sides.append(side)
        return cls(plane, (low[0], low[1]), (sides[0], sides[1]))

    @property
    def places(self) -> dict[str, tuple[float, float]]:
        """Positions of the corners, mm, by letter."""
        (x, y), (across, along) = self.low, self.size
        return {"A": (x, y), "B": (x, y + along), "C": (x + across, y + along), "D": (x + across, y)}

    def chord(self, name: str) -> Array:
        """From the first to the second corner of a length `(2,)`, mm."""
        return np.subtract(self.places[name[1]], self.places[name[0]])

    def distance(self, name: str) -> float:
        """Commanded length, mm."""
        return float(np.linalg.norm(self.chord(name)))

    def next_length(self, measured: Iterable[str], left_out: Iterable[str], u: float, ruler: float) -> str | None:
        """The length whose reading helps most; None where all are measured.

        u: standard uncertainty of a length, mm; ruler: of the scale of the ruler, mm/mm.
        """
        information = np.diag([UNKNOWN**-2, UNKNOWN**-2, UNKNOWN**-2, ruler**-2])
        known = list(measured)
        for name in known:
            information += np.outer(self._slopes(name), self._slopes(name)) / u**2
        covariance = np.linalg.inv(information)
        gains = {
            name: float(self._slopes(name) @ covariance @ self._slopes(name))
            for name in LENGTHS
            if name not in known and name not in set(left_out)
        }
        return max(gains, key=lambda name: round(gains[name], 9)) if gains else None

    def _slopes(self, name: str) -> Array:
        """Derivatives `(4,)`, mm, of a length by the lean, the scales of both axes, and that of the ruler."""
        (x, y), length = self.chord(name).tolist(), self.distance(name)
        return np.array([x * y / length, x * x / length, y * y / length, length])
