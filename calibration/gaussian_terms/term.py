"""A term: columns of the observations with one Gaussian size, and what it is."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.effects import Effect
from kinematics.transforms import Array


@dataclass(frozen=True, eq=False)
class Along:
    """Makes the columns of functions that act along one arm."""

    name: Hashable
    """Of the arm: its number among the errors of the machine, or the reading of the instrument."""
    arm: Array
    """Change of the observations `(n, d)`, mm or rad, by 1 mm or rad."""
    functions: Callable[[], Array]
    """Makes the functions `(n, width)`, mm or rad."""

    def __call__(self) -> Array:
        """The columns `(n, d, width)`."""
        return np.asarray(self.arm[:, :, None] * self._kept[:, None, :])

    @cached_property
    def _kept(self) -> Array:
        return self.functions()


@dataclass(frozen=True, eq=False)
class Term:
    """A part of the observations that may be there or not."""

    name: str
    kind: str
    """Kind of the cause in a diagnosis; of a function without a name `smooth`, `swing`, `walk` or `fine`."""
    family: Hashable
    """Members of a family are forms of one cause; at most one of them is present."""
    make: Callable[[], Array]
    """Makes the columns."""
    width: int
    """Number of columns."""
    effects: tuple[Effect, ...] = ()
    """The effects that it adds to a calibration, with their linear parameters at zero; empty where it adds none."""
    parameters: Array | None = None
    """Linear parameters of the effects, one after the other, by the coefficients of the columns `(P, width)`."""
    where: str | None = None
    """Axis, direction of the tool, or part of the instrument."""
    variables: tuple[str, ...] = ()
    """Variables of a function without a name."""
    log_prior: float = 0.0
    """Log odds of its presence before the data."""
    finer: Callable[[], Sequence[Term]] | None = None
    """Members of its family between its neighbours: other time constants, moments, periods; None where it has none."""
    parts: tuple[Term, ...] = ()
    """Terms that are present in its place: one cause in several places, found together; empty for most."""

    @property
    def columns(self) -> Array:
        """`(n, d, width)`, in units of its prior sizes, mm and rad."""
        return self.make() if isinstance(self.make, Along) else self._columns

    @cached_property
    def _columns(self) -> Array:
        return self.make()

    def values(self, coefficients: Array) -> Array:
        """Parameters `(P,)` of its effects by its coefficients `(width,)`; nonlinear ones as they are."""
        values = np.array([value for effect in self.effects for value in effect.parameters], float)
        linear = np.array([each for effect in self.effects for each in effect.linear], bool)
        values[linear] = 0.0 if self.parameters is None else self.parameters @ coefficients
        return values

    @property
    def named(self) -> bool:
        """True for a cause, false for a function without a name."""
        return self.kind not in NAMELESS


NAMELESS = ("smooth", "swing", "walk", "fine")
"""Kinds of functions without a name."""
