"""Distortion by heat: squareness, straightness, roll and axis lines that change with time or with a temperature."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

import msgspec

from kinematics.basis import Basis, Interval, Legendre
from kinematics.effects.base import (
    BY_DIRECTION,
    COMPONENTS,
    Columns,
    Component,
    Parameter,
    unit_of,
)
from kinematics.effects.thermal_course import MINUTES_30, Course, CourseOfSensor
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

Degree = Annotated[int, msgspec.Meta(ge=0, le=3)]
SMALL = 10.0
"""um or urad, per hour or in all: distortion of a machine in a workshop."""


class _Shape:
    """The change of an error motion along its axis: the Legendre polynomial of a degree over the interval."""

    __slots__ = ()

    component: Component
    axis: str
    interval: Interval
    degree: int

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.interval}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: Legendre(self.interval, self.degree).feature_length} if self.degree > 1 else {}

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: Legendre(self.interval, self.degree)}

    def _columns(self, machine: Machine, state: State, course: Array) -> Columns:
        shape = state.basis_columns(machine, self.axis, Legendre(self.interval, self.degree))[:, -1:]
        component = COMPONENTS.index(self.component)
        return Columns(machine.index(self.axis), component, course * shape * unit_of(self.component)[1])


class DistortionWithTime(_Shape, Course, frozen=True, kw_only=True, tag="thermal-distortion"):
    """An error motion of an axis changes with time: a guide that bends, a column that leans, a table that moves.

    Legendre polynomial of the degree over the interval (1 at its end) times rate t + sum of
    amplitude (1 - exp(-t / time constant)). Degree 0 shifts or turns the axis line; degree 1 of a straightness changes
    a squareness, degree 2 bends the guide. ISO 230-3:2020; Mayr et al., Thermal issues in machine tools, CIRP
    Annals 61/2 (2012).
    """

    TITLE: ClassVar[str] = "squareness, straightness, roll or line of an axis that changes with time"
    LABEL: ClassVar[tuple[str, ...]] = ("degree",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "um/h or urad/h", SMALL),
        Parameter("amplitudes", BY_DIRECTION, SMALL),
        Parameter("time_constants_s", "s", MINUTES_30, linear=False, lower=0.0),
    )

    component: Component
    axis: str
    interval: Interval
    degree: Degree

    def __post_init__(self) -> None:
        Legendre(self.interval, self.degree)
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield self._columns(machine, state, self._course(state))


class DistortionWithSensor(_Shape, CourseOfSensor, frozen=True, kw_only=True, tag="thermal-distortion-sensor"):
    """An error motion of an axis follows a temperature, with or without lag: a guide bends, a column leans.

    Legendre polynomial of the degree over the interval (1 at its end) times coefficient T; degrees as in
    `thermal-distortion`. ISO 230-3:2020 (environmental temperature variation error).
    """

    TITLE: ClassVar[str] = "squareness, straightness, roll or line of an axis that follows a temperature"
    LABEL: ClassVar[tuple[str, ...]] = ("degree", "sensor")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "um/K or urad/K", SMALL / 4),
        Parameter("lag_s", "s", MINUTES_30, linear=False, lower=0.0, closed=True),
    )

    component: Component
    axis: str
    interval: Interval
    degree: Degree

    def __post_init__(self) -> None:
        Legendre(self.interval, self.degree)
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield self._columns(machine, state, self._course(state))
