"""The course of a thermal effect: with time, or behind a temperature with its lag."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from kinematics.effects.base import (
    HOUR,
    EffectBase,
)
from kinematics.state import State
from kinematics.transforms import Array

MINUTES_30 = 1800.0
"""s: time constant of a spindle or a column, in order of magnitude."""


class Filtered(NamedTuple):
    """A first-order filter at one instant."""

    time: float
    """s"""
    temperature: float
    late: float
    """Its output, K."""
    slope: float
    """The derivative of the output with respect to the lag, K/s."""


class Course(EffectBase, frozen=True, kw_only=True):
    """rate t + sum of amplitude (1 - exp(-t / time constant))."""

    NEEDS: ClassVar[tuple[str, ...]] = ("time",)

    rate: float | None = None
    amplitudes: tuple[float, ...] = ()
    time_constants_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.amplitudes) != len(self.time_constants_s) or len(self.amplitudes) > 2:
            raise ValueError(f"{self.name}: up to two amplitudes, each with its time constant")
        if self.rate is None and not self.amplitudes:
            raise ValueError(f"{self.name}: neither a rate nor an amplitude")
        super().__post_init__()

    def _course(self, state: State) -> Array:
        """Derivatives `(n, parameters)` of the course."""
        time = state.need("time", self.name)[:, None]
        share = time / np.array(self.time_constants_s)
        slopes = -np.array(self.amplitudes) * np.exp(-share) * share / np.array(self.time_constants_s)
        linear = [] if self.rate is None else [time / HOUR]
        return np.concatenate([*linear, -np.expm1(-share), slopes], axis=1)


class CourseOfSensor(EffectBase, frozen=True, kw_only=True):
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

    @property
    def needs(self) -> tuple[str, ...]:
        """Time only with a lag."""
        return self.NEEDS[:1] if self.lag_s is None else self.NEEDS

    def _course(self, state: State) -> Array:
        """Derivatives `(n, parameters)` of the course."""
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
