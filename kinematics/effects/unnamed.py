"""A measured error without a known cause: a smooth function of known variables, as a displacement of the tool."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np

from kinematics.basis import Interval, Legendre
from kinematics.effects.base import COMPONENTS, TOOL, UM, EffectBase
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import TEMPERATURE, TIME, State
from kinematics.transforms import Array

HIGHEST_DEGREE = 24
"""The highest of a polynomial."""


class Unnamed(EffectBase, frozen=True, tag="unnamed"):
    """The tool point is displaced by a smooth function of some variables: a measured dependence without a cause.

    Variables are axes by their names (mm or degrees), `time` (s) and `temperature NAME` (K from 20 degC). The function
    is a sum of products of Legendre polynomials, one for each variable, over its interval in `ranges`; `terms` has
    their degrees, one row for each coefficient. Outside its interval a variable counts as at the nearer end. In the
    tool's own directions. It holds for the measured ranges and the day of the measurement only.
    """

    TITLE: ClassVar[str] = "smooth function that no named cause explains"
    ACTS_ON = "tool"
    NEEDS: ClassVar[tuple[str, ...]] = ("temperatures", "time")
    NAMES_CAUSE = False
    SHOWN_OVER = "variables"
    WORKSHOP = Workshop("Not known: no cause of the library fits.", "Make the proposed measurement before any repair.")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("coefficients", "um", 10.0),)

    component: Literal["X", "Y", "Z"]
    variables: tuple[str, ...]
    ranges: tuple[Interval, ...]
    terms: tuple[tuple[int, ...], ...]
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.variables or len(set(self.variables)) != len(self.variables):
            raise ValueError(f"{self.name}: a function of at least one variable, each named once")
        if len(self.ranges) != len(self.variables):
            raise ValueError(f"{self.name}: {len(self.variables)} variables take as many ranges")
        if not self.terms or any(len(term) != len(self.variables) for term in self.terms):
            raise ValueError(f"{self.name}: at least one term, of as many degrees as there are variables")
        if (
            len(set(self.terms)) != len(self.terms)
            or not 0 <= min(map(min, self.terms)) <= self._highest <= HIGHEST_DEGREE
        ):
            raise ValueError(f"{self.name}: terms differ, and their degrees are 0 to {HIGHEST_DEGREE}")
        if len(self.coefficients) != len(self.terms):
            raise ValueError(
                f"{self.name}: its terms take {len(self.terms)} coefficients, got {len(self.coefficients)}"
            )
        self._bases()
        super().__post_init__()

    @property
    def name(self) -> str:
        """`unnamed X(Y, time)`."""
        return f"unnamed {self.component}({', '.join(self.variables)})"

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes among its variables."""
        return tuple(name for name in self.variables if name != TIME and not name.startswith(TEMPERATURE))

    @property
    def sensors(self) -> tuple[str, ...]:
        """The temperatures among its variables."""
        return tuple(name.removeprefix(TEMPERATURE) for name in self.variables if name.startswith(TEMPERATURE))

    @property
    def needs(self) -> tuple[str, ...]:
        """By its variables."""
        return ("temperatures",) * bool(self.sensors) + ("time",) * (TIME in self.variables)

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """By variable; see `EffectBase.intervals`."""
        return dict(zip(self.variables, self.ranges, strict=True))

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        of = zip(self.variables, self._bases(), strict=True)
        return {variable: basis.feature_length for variable, basis in of if variable in self.axes}

    @property
    def size_summary(self) -> tuple[str, ...]:
        """Its RMS and the number of its terms."""
        return f"{self.rms_um:.2g} um RMS over its ranges", f"{len(self.terms)} terms"

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        degrees = np.array(self.terms)
        values = np.full((len(state), len(self.terms)), UM)
        for i in range(len(self.variables)):
            values *= self._functions(machine, state, i)[:, degrees[:, i]]
        yield Columns(TOOL, COMPONENTS.index(self.component), values)

    def _functions(self, machine: Machine, state: State, number: int) -> Array:
        """The functions `(n, degrees)` of a variable, given by number."""
        name, basis = self.variables[number], self._bases()[number]
        if name in self.axes:
            return state.basis_columns(machine, name, basis)
        return basis.columns(state.variable(machine, name, self.name))

    @property
    def rms_um(self) -> float:
        """RMS over its ranges, um."""
        squares = np.square(self.coefficients) / np.prod(2 * np.array(self.terms) + 1, axis=1)
        return float(np.sqrt(squares.sum()))

    @property
    def _highest(self) -> int:
        return max(map(max, self.terms))

    def _bases(self) -> list[Legendre]:
        degrees = map(max, zip(*self.terms, strict=True))
        return [Legendre(interval, degree) for interval, degree in zip(self.ranges, degrees, strict=True)]
