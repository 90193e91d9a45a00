"""A term: columns of the observations with one Gaussian size, and what it is."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from kinematics.effects import Effect
from kinematics.transforms import Array


@dataclass(frozen=True, eq=False)
class Term:
    """A part of the observations that may be there or not."""

    name: str
    family: Hashable
    """Members of a family are forms of one cause; at most one of them is present."""
    columns: Array
    """`(n, d, k)`, in units of its prior sizes, mm and rad."""
    log_prior: float = 0.0
    """Log odds of its presence before the data."""
    effect: Effect | None = None
    """The effect with its other parameters; None for a function without a name."""

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.columns.shape[2])
