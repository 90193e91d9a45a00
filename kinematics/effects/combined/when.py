"""When: the courses that errors at a place follow: constant, with time, with a temperature, with duty."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import numpy as np

from kinematics.effects.base import HOUR, EffectBase, Remedy
from kinematics.effects.records import Columns, Parameter
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

MINUTES_30 = 1800.0
"""s: time constant of a spindle or a column, in order of magnitude."""


class Course(EffectBase, frozen=True):
    """An error at a place of `where.py` that follows a course: the product of both."""

    def __post_init__(self) -> None:
        if fault := self.fault_of_place() or self.fault_of_course():
            raise ValueError(f"{self.name}: {fault}")
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        return self.at_place(machine, state, self.course(machine, state))

    @abstractmethod
    def course(self, machine: Machine, state: State) -> Array:
        """Derivatives `(n, parameters)` of the course with respect to its parameters."""

    @abstractmethod
    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """The errors at the place, for a course in the unit of its parameters."""

    def fault_of_place(self) -> str:
        """Why there is no such place; empty where it exists."""
        return ""

    def fault_of_course(self) -> str:
        """Why there is no such course; empty where it exists."""
        return ""


class Always(Course, frozen=True):
    """1, always."""

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        return np.ones((len(state), 1))


class FromMoment(Course, frozen=True):
    """1 from the moment `since_s` on, 0 before it; 1 always without a moment."""

    NEEDS: ClassVar[tuple[str, ...]] = ("time",)

    @property
    def needs(self) -> tuple[str, ...]:
        """Time only with a moment."""
        return self.NEEDS if self.moment is not None else tuple(name for name in self.NEEDS if name != "time")

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        moment = self.moment
        return np.ones((len(state), 1)) if moment is None else 1.0 * (state.need("time", self.name) >= moment)[:, None]


class AtRate(Course, frozen=True):
    """The time, h, from time 0."""

    NEEDS: ClassVar[tuple[str, ...]] = ("time",)

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        return np.asarray(state.need("time", self.name)[:, None] / HOUR)


class WithTime(Course, frozen=True, kw_only=True):
    """rate t + sum of amplitude (1 - exp(-t / time constant))."""

    NEEDS: ClassVar[tuple[str, ...]] = ("time",)

    rate: float | None = None
    amplitudes: tuple[float, ...] = ()
    time_constants_s: tuple[float, ...] = ()

    @staticmethod
    def sizes(unit: str, typical: float) -> tuple[Parameter, ...]:
        """`QUANTITIES` of errors with a unit and a typical size, per hour and in all."""
        return (
            Parameter("rate", per(unit, "h"), typical),
            Parameter("amplitudes", unit, typical),
            Parameter("time_constants_s", "s", MINUTES_30, linear=False, lower=0.0),
        )

    def fault_of_course(self) -> str:
        """See `Course.fault_of_course`."""
        if len(self.amplitudes) != len(self.time_constants_s) or len(self.amplitudes) > 2:
            return "up to two amplitudes, each with its time constant"
        return "neither a rate nor an amplitude" if self.rate is None and not self.amplitudes else ""

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        time = state.need("time", self.name)[:, None]
        share = time / np.array(self.time_constants_s)
        slopes = -np.array(self.amplitudes) * np.exp(-share) * share / np.array(self.time_constants_s)
        linear = [] if self.rate is None else [time / HOUR]
        return np.concatenate([*linear, -np.expm1(-share), slopes], axis=1)


class WithSensor(Course, frozen=True, kw_only=True):
    """coefficient x temperature; with a lag, the temperature behind a first-order filter, so that warming and cooling
    differ (hysteresis). The filter has settled at the first row, of the state or of its past, and is exact for a
    temperature that runs straight from one row to the next; a jump is two rows of the same time.
    """

    NEEDS: ClassVar[tuple[str, ...]] = ("temperatures", "time")
    HAS_MEMORY: ClassVar[bool] = True
    LABEL: ClassVar[tuple[str, ...]] = ("sensor",)

    sensor: str
    coefficient: float
    lag_s: float | None = None

    @staticmethod
    def sizes(unit: str, typical: float) -> tuple[Parameter, ...]:
        """`QUANTITIES` of errors with a unit, and a typical size per K."""
        return (
            Parameter("coefficient", per(unit, "K"), typical),
            Parameter("lag_s", "s", MINUTES_30, linear=False, lower=0.0, closed=True),
        )

    @property
    def needs(self) -> tuple[str, ...]:
        """Time only with a lag."""
        return self.NEEDS[:1] if self.lag_s is None else self.NEEDS

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        temperature = state.temperature(self.sensor, self.name)
        if self.lag_s is None:
            return temperature[:, None]
        filtered = state.left_behind((self.sensor, self.lag_s), self._at_end)
        late, slope = lagged(temperature, state.need("time", self.name), self.lag_s, filtered)
        return np.stack([late, self.coefficient * slope], axis=1)

    def _at_end(self, past: State) -> Filtered:
        """The filter after the last row."""
        assert self.lag_s is not None
        temperature, time = past.temperature(self.sensor, self.name), past.need("time", self.name)
        late, slope = lagged(temperature, time, self.lag_s)
        return Filtered(float(time[-1]), float(temperature[-1]), float(late[-1]), float(slope[-1]))


class WithSquareOfSensor(Course, frozen=True):
    """coefficient x temperature + quadratic x its square."""

    NEEDS: ClassVar[tuple[str, ...]] = ("temperatures",)
    LABEL: ClassVar[tuple[str, ...]] = ("sensor",)

    @staticmethod
    def sizes(unit: str, typical: float, curved: float) -> tuple[Parameter, ...]:
        """`QUANTITIES` of errors with a unit, and typical sizes per K and per K2."""
        return Parameter("coefficient", per(unit, "K"), typical), Parameter("quadratic", per(unit, "K2"), curved)

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        (sensor,) = self.sensors
        kelvin = state.temperature(sensor, self.name)
        return np.stack([kelvin, kelvin**2], axis=1)


class WithDuty(Course, frozen=True):
    """The heat of a speed behind a first-order lag, from zero at the first row; parameters growth and time constant."""

    NEEDS: ClassVar[tuple[str, ...]] = ("time",)
    REMEDY: ClassVar[Remedy] = "none"
    HAS_MEMORY: ClassVar[bool] = True

    @staticmethod
    def sizes(unit: str, duty: str, typical: float) -> tuple[Parameter, ...]:
        """`QUANTITIES` of errors with a unit, and a typical size per unit of duty."""
        return (
            Parameter("growth", per(unit, duty), typical),
            Parameter("time_constant_s", "s", MINUTES_30, linear=False, lower=0.0),
        )


def per(unit: str, by: str) -> str:
    """A unit by another one, in each alternative of `um or urad`."""
    return " or ".join(f"{each}/{by}" for each in unit.split(" or "))


class Filtered(NamedTuple):
    """A first-order filter at one instant."""

    time: float
    """s"""
    temperature: float
    late: float
    """Its output, K."""
    slope: float
    """The derivative of the output with respect to the lag, K/s."""


def lagged(temperature: Array, time: Array, lag: float, start: Filtered | None = None) -> tuple[Array, Array]:
    """Output `(n,)` of a first-order filter of time constant `lag`, s, and its derivative with respect to the lag.

    It continues from `start`; without `start` it has settled at the first row.

    lag dy/dt = T - y with T straight from one row to the next, so that over a step h with r = h / lag
    y1 = T1 - (T1 - T0) (1 - exp(-r)) / r + (y0 - T0) exp(-r). Rows with decreasing time count as of the same time.
    """
    if start is not None:
        temperature, time = np.append(start.temperature, temperature), np.append(start.time, time)
    late, slope = _lagged(temperature, time, lag, (start.late, start.slope) if start else None)
    return (late, slope) if start is None else (late[1:], slope[1:])


def _lagged(temperature: Array, time: Array, lag: float, start: tuple[float, float] | None) -> tuple[Array, Array]:
    step, rise = np.maximum(np.diff(time), 0.0), np.diff(temperature)
    if lag == 0:
        slope = np.divide(rise, step, out=np.zeros_like(rise), where=step > 0)
        return temperature.copy(), -np.append(0.0, slope)
    r = step / lag
    keep = np.exp(-r)
    mean = np.divide(-np.expm1(-r), r, out=np.ones_like(r), where=r > 0)
    y, dy = start or (float(temperature[:1].sum()), 0.0)
    if not step.any() and not rise.any():
        return np.full_like(temperature, y), np.full_like(temperature, dy)
    behind = _decaying(keep, -rise * mean, y - float(temperature[0]))
    return temperature + behind, _decaying(keep, (behind[:-1] * keep * r - rise * (mean - keep)) / lag, dy)


def _decaying(kept: Array, added: Array, start: float) -> Array:
    """Values `(n + 1,)` that begin at `start`: each is `kept` `(n,)` times the one before, plus `added` `(n,)`.

    Steps are joined in pairs, then in pairs of pairs, and so on.
    """
    values, kept, width = np.append(start, added), np.append(0.0, kept), 1
    while width < len(values):
        values[width:] += kept[width:] * values[:-width]
        kept[width:] *= kept[:-width].copy()
        width *= 2
    return values


def at_speed(speed: Array, time: Array, lag: float) -> tuple[Array, Array]:
    """`lagged` from zero, for a speed `(n - 1,)` that is constant from one of `n` rows to the next."""
    # a speed that jumps is two rows of the same time
    twice = np.repeat(time, 2)[: 2 * len(time) - 1]
    late, slope = lagged(np.append(0.0, np.repeat(speed, 2))[: len(twice)], twice, lag)
    return late[::2], slope[::2]
