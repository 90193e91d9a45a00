"""Whitened derivatives of observations by the registration, the model of a fit, and effects beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import Fit
from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement
from calibration.registration.registration import Registration
from kinematics.effects import Effect
from kinematics.error_model.effect_sums import Design
from kinematics.transforms import Array

TOGETHER = 16
"""Effects whose columns are computed at once."""
NO_SIGNAL = 1e-12
"""Sum of squares below which a column of typical size, in standard deviations of the noise, is rounding alone."""


class Derivatives(NamedTuple):
    """Whitened derivatives at some rows of a measurement."""

    transform: Array
    """`(n, d, width)`, by the error motions and the shift of the observed point."""
    own: Array
    """`(n * d, registration)`"""
    by_model: Array
    """`(n * d, parameters)`, in units of their priors."""


def derivatives(
    fit: Fit,
    measurement: Measurement,
    rows: np.ndarray,
    registration: Registration,
    white: Array,
    decorrelation: Decorrelation | None = None,
) -> Derivatives:
    """White derivatives by registration and model of a fit, at rows of its data or others; `white` `(n, d, d)`."""
    some = measurement.rows(rows)
    transform = white @ some.instrument.transform(some, registration)
    own = white @ some.instrument.registration_design(some, registration)
    effects, machine, state = fit.model.effects, measurement.machine, measurement.state
    of_model = Design(effects, machine, state, with_instrument=True).of(rows, transform)
    n = len(rows) * some.components
    by_model = of_model.reshape(n, -1)
    finite = np.isfinite(fit.prior)
    by_model = by_model * np.where(finite, fit.prior, 1.0) if fit.prior.ndim == 1 else by_model @ fit.prior
    if decorrelation is not None:
        own, by_model = decorrelation.apply(own), decorrelation.apply(by_model.reshape(*own.shape[:2], -1))
    return Derivatives(transform, own.reshape(n, -1), by_model.reshape(n, -1))


def signals(measurement: Measurement, rows: np.ndarray, effects: Sequence[Effect], transform: Array) -> Array:
    """Derivatives `(n * d, k)` by the linear parameters of effects, one after the other, in units of typical sizes."""
    linear = np.array([flag for effect in effects for flag in effect.linear], bool)
    typical = np.array([size for effect in effects for size in effect.typical])[linear]
    made = Design(effects, measurement.machine, measurement.state, with_instrument=True).of(rows, transform)
    columns = made.reshape(made.shape[0] * made.shape[1], made.shape[2])
    columns = columns if linear.all() else columns[:, linear]
    columns *= np.where(np.isfinite(typical), typical, 1.0)
    return columns


@dataclass(frozen=True)
class Signals:
    """White derivatives of observations by effects beside a fit, in units of their typical sizes."""

    measurement: Measurement
    rows: np.ndarray
    """Rows of the measurement `(n,)`."""
    transform: Array
    """`(n, d, width)`, as `Derivatives.transform`."""
    decorrelation: Decorrelation
    """Transform of the whitened rows of each stop."""

    def of(self, effects: Sequence[Effect], measurement: Measurement | None = None) -> Array:
        """White derivatives `(N, k)` by the linear parameters of effects; measurement: with other states."""
        columns = signals(measurement or self.measurement, self.rows, effects, self.transform)
        return self.decorrelation.apply(columns.reshape(len(self.rows), -1, columns.shape[1])).reshape(columns.shape)

    def changing(self, effects: Sequence[Effect]) -> Array:
        """Columns `(N, k)` of effects, less their values at the mean time and temperatures; 0 without a signal."""
        columns = self.of(effects)
        moving = [bool({"time", "temperatures"} & set(effect.needs)) for effect in effects]
        some = [effect for effect, moves in zip(effects, moving, strict=True) if moves]
        if some:
            state = self.measurement.state
            mean = replace(
                state,
                time=None if state.time is None else np.full_like(state.time, state.time[self.rows].mean()),
                temperatures={
                    n: np.full_like(kelvin, kelvin[self.rows].mean()) for n, kelvin in state.temperatures.items()
                },
            )
            steady = self.of(some, replace(self.measurement, state=mean))
            columns[:, np.repeat(moving, widths(effects))] -= steady
        columns[:, np.einsum("ij,ij->j", columns, columns) < NO_SIGNAL] = 0.0
        return columns


def widths(effects: Sequence[Effect]) -> list[int]:
    """Number of linear parameters of each effect."""
    return [sum(effect.linear) for effect in effects]


def together(effects: Sequence[Effect]) -> list[Sequence[Effect]]:
    """The effects in parts whose columns are computed at once."""
    return [effects[start : start + TOGETHER] for start in range(0, len(effects), TOGETHER)]
