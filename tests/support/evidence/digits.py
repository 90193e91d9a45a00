"""Agreement of a figure of ncomp with a reference, in decimal digits."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

MOST = 15.0
"""Digits of a double."""
MARGIN, FEW = 0.5, 4.0
"""Digits by which another processor may round worse; below the second number other things than rounding limit them."""


class Agreement(NamedTuple):
    """A row of the page."""

    reference: str
    through: str
    """Entrance of ncomp that the data take."""
    figure: str
    digits: float

    @property
    def key(self) -> tuple[str, str, str]:
        """Reference, entrance and figure."""
        return self.reference, self.through, self.figure

    @property
    def shown(self) -> int:
        """Whole digits that every processor reaches."""
        return int(self.digits - (MARGIN if self.digits > FEW else 0.0))


def digits(found: Iterable[float], certified: Iterable[float]) -> float:
    """Least number of digits, -log10 of the relative difference, that all values have in common with their references."""
    one, other = np.array([*found]), np.array([*certified])
    assert len(one) == len(other) > 0
    away = np.abs(one - other) / np.where(other == 0.0, 1.0, np.abs(other))
    return float(min(-np.log10(max(away.max(), 10.0**-MOST)), MOST))
