"""Heat: drift of the tool point, growth of axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from kinematics.effects.base import COMPONENTS, HOUR, TOOL, UM, Cause, Columns, Component, Parameter, unit_of
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array


class _OverTime(Cause, frozen=True, kw_only=True):
    """rate t + sum of amplitude (1 - exp(-t / time constant)), t in s from the start of the data."""

    rate: float = 0.0
    """Per hour."""
    amplitudes: tuple[float, ...] = ()
    time_constants_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.amplitudes) != len(self.time_constants_s) or len(self.amplitudes) > 2:
            raise ValueError(f"{self.name}: up to two amplitudes, each with its time constant")
        if min(self.time_constants_s, default=1.0) <= 0:
            raise ValueError(f"{self.name}: time constants must be positive")
        super().__post_init__()

    def _quantities(self, unit: str, typical: float) -> tuple[Parameter, ...]:
        return (
            Parameter("rate", f"{unit}/h", typical),
            Parameter("amplitudes", unit, typical),
            Parameter("time_constants_s", "s", 1800.0, linear=False),
        )

    def _course(self, time: Array) -> Array:
        """Value at each time `(n,)`, in the unit of the amplitudes."""
        course = self.rate * time / HOUR
        for amplitude, constant in zip(self.amplitudes, self.time_constants_s, strict=True):
            course = course - amplitude * np.expm1(-time / constant)
        return np.asarray(course)

    def _derivatives(self, time: Array) -> Array:
        """Derivatives `(n, parameters)` of the course."""
        constants, amplitudes = np.array(self.time_constants_s), np.array(self.amplitudes)
        share = time[:, None] / constants
        slopes = -amplitudes * np.exp(-share) * share / constants
        return np.concatenate([time[:, None] / HOUR, -np.expm1(-share), slopes], axis=1)


class ThermalDrift(_OverTime, frozen=True, tag="thermal-drift"):
    """The tool point drifts with time: spindle growth, a column that bends. In the tool's own directions."""

    TITLE: ClassVar[str] = "thermal drift of the tool point with time (linear, exponential, two time constants)"
    ACTS_ON = "tool"
    NEEDS: ClassVar[tuple[str, ...]] = ("time",)

    component: Component

    def quantities(self) -> tuple[Parameter, ...]:
        """Rate, amplitudes, time constants."""
        return self._quantities(unit_of(self.component)[0], 20.0)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002  the same on any machine
        """See `Cause.columns`."""
        values = self._derivatives(state.need("time", self.name)) * unit_of(self.component)[1]
        yield Columns(TOOL, COMPONENTS.index(self.component), values)

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:  # noqa: ARG002
        """See `Cause.contributions`."""
        values = self._course(state.need("time", self.name)) * unit_of(self.component)[1]
        yield TOOL, COMPONENTS.index(self.component), values


class GrowthWithTime(_OverTime, frozen=True, tag="thermal-scale"):
    """An axis' scale grows with time, from a fixed point: um per m."""

    TITLE: ClassVar[str] = "thermal growth of an axis with time"
    NEEDS: ClassVar[tuple[str, ...]] = ("time",)

    axis: str
    fixed_point: float = 0.0
    """Position that stays, mm or degrees."""

    def quantities(self) -> tuple[Parameter, ...]:
        """Rate, amplitudes, time constants."""
        return self._quantities("um/m", 20.0)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        values = self._derivatives(state.need("time", self.name))
        yield Columns(*_own(machine, self.axis), values * _length(machine, state, self.axis, self.fixed_point)[:, None])

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """See `Cause.contributions`."""
        course = self._course(state.need("time", self.name))
        yield *_own(machine, self.axis), course * _length(machine, state, self.axis, self.fixed_point)


class GrowthWithSensor(Cause, frozen=True, tag="thermal-scale-sensor"):
    """An axis' scale follows a temperature, late by a first-order lag: um per m and K."""

    TITLE: ClassVar[str] = "thermal growth of an axis with a temperature, with lag"
    NEEDS: ClassVar[tuple[str, ...]] = ("temperatures",)
    HAS_MEMORY: ClassVar[bool] = True
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "um/m/K", 12.0),
        Parameter("lag_s", "s", 1800.0, linear=False),
    )

    axis: str
    sensor: str
    coefficient: float
    lag_s: float = 0.0
    fixed_point: float = 0.0
    """Position that stays, mm or degrees."""

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        late, slope = self._late(state)
        length = _length(machine, state, self.axis, self.fixed_point)
        values = np.stack([late, self.coefficient * slope], axis=1) * length[:, None]
        yield Columns(*_own(machine, self.axis), values)

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """See `Cause.contributions`."""
        length = _length(machine, state, self.axis, self.fixed_point)
        yield *_own(machine, self.axis), self.coefficient * self._late(state)[0] * length

    def _late(self, state: State) -> tuple[Array, Array]:
        """The temperature behind its lag `(n,)`, and its derivative with respect to the lag.

        Exact for a temperature that stays constant from one row to the next.
        """
        temperature = state.temperature(self.sensor, self.name)
        if self.lag_s <= 0:
            return temperature, np.zeros_like(temperature)
        time = state.need("time", self.name)
        late, slope = temperature.copy(), np.zeros_like(temperature)
        for i in range(1, len(temperature)):
            step = max(float(time[i] - time[i - 1]), 0.0)
            keep = np.exp(-step / self.lag_s)
            apart = late[i - 1] - temperature[i]
            late[i] = temperature[i] + keep * apart
            slope[i] = keep * slope[i - 1] + keep * step / self.lag_s**2 * apart
        return late, slope


def _own(machine: Machine, axis: str) -> tuple[int, int]:
    """Column of the axis and its positioning error."""
    return machine.index(axis), COMPONENTS.index(axis[0])


def _length(machine: Machine, state: State, axis: str, fixed_point: float) -> Array:
    """mm of error per um/m of growth `(n,)`."""
    return np.asarray((state.position(machine, axis) - fixed_point) * 1e-3 * UM)
