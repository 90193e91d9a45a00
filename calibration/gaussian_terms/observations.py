"""A measurement as linear observations about a machine: residuals, and derivatives by every error.

The machine is the nominal one, or one with the errors that a first fit found: observations are no linear functions of
errors of millimetres, of those of a chain of rotary axes, and of lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.gaussian_terms.posterior import ROUNDING
from calibration.gaussian_terms.term import Along
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import residuals
from calibration.registration.registration import Registration
from kinematics.effects import COMPONENTS, Effect
from kinematics.effects.base import own_component
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.priors import Priors
from kinematics.state import State
from kinematics.transforms import Array

MOST_OF_STOP = 20
"""Most rows of a stop with one target; more of them are combined to so many means."""
REGISTRATION_STEPS, LAST_STEP = 4, 1e-7
"""Most steps of a registration beside errors that are given, and the last one, mm and rad."""


@dataclass(frozen=True)
class Observations:
    """Linearised observations of n rows with d scalars each, mm and rad."""

    measurement: Measurement
    residual: Array
    """Observed minus nominal `(n, d)`."""
    transform: Array
    """Derivatives `(n, d, (axes + 1) * 6 + 3)` by the error motions, and by a shift of the observed point."""
    registration: Array
    """Derivatives `(n, d, r)` by the registration."""
    specified: Array
    """Covariances `(n, d, d)` by the specification of the instrument."""
    stated: Array
    """Derivatives `(k, r)` of stated values of the registration, in their standard uncertainties."""
    stated_residual: Array
    """Stated minus present values `(k,)`, in the same unit."""
    averaged: np.ndarray
    """Number `(n,)` of rows of the file of which each row is the mean."""
    given: ErrorModel | None = None
    """The calibration to which errors are relative; None for the nominal machine."""

    @classmethod
    def of(
        cls,
        measurement: Measurement,
        about: ErrorModel | None = None,
        *,
        given: ErrorModel | None = None,
    ) -> Observations:
        """The observations of a measurement, linearised about a model of the machine: by default that of `given`.

        given: a calibration of the machine, to which errors are relative, whatever the model; None for the nominal
        machine.
        """
        measurement, counts = with_short_stops(measurement)
        relative = measurement.nominal_model if given is None else given
        model = relative if about is None else about
        registration = registered(measurement, model)
        instrument = measurement.instrument
        transform = instrument.transform(measurement, registration)
        residual = residuals(measurement, model, registration)
        if model is not relative:
            residual += _linear(measurement, model, transform) - _linear(measurement, relative, transform)
        return cls(
            measurement,
            residual,
            transform,
            instrument.registration_design(measurement, registration),
            measurement.specified_covariances / counts[:, None, None],
            instrument.stated_design(measurement, registration),
            instrument.stated_residuals(measurement, registration),
            counts,
            given,
        )

    def about(self, model: ErrorModel) -> Observations:
        """The same observations, linearised about another model."""
        again = Observations.of(self.measurement, model, given=self.given)
        return replace(again, specified=self.specified, averaged=self.averaged)

    def __len__(self) -> int:
        return len(self.residual)

    @property
    def priors(self) -> Priors:
        """What is known of the machine before any data."""
        return self.measurement.machine.priors

    @property
    def components(self) -> int:
        """Number d of scalars in a row."""
        return int(self.residual.shape[1])

    @cached_property
    def first_state(self) -> State:
        """The state of the machine in the first row."""
        return self.measurement.state.rows(slice(0, 1))

    def own_arm(self, axis: str) -> int:
        """Number of the positioning error of an axis among the errors of the transform."""
        return 6 * self.measurement.machine.index(axis) + COMPONENTS.index(own_component(axis))

    def along(self, number: int, functions: Callable[[], Array]) -> Along:
        """Columns of functions of one error of the transform."""
        return Along(number, self.transform[:, :, number], functions)

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Derivatives `(n, d, k)` by the parameters of effects, one after the other."""
        measurement = self.measurement
        design = Design(effects, measurement.machine, measurement.state, with_instrument=True)
        return design.of(slice(None), self.transform)


def with_short_stops(measurement: Measurement) -> tuple[Measurement, np.ndarray]:
    """The measurement with means of the rows of long stops, and the number `(n,)` of rows of each mean.

    A long standstill contains no more about the motion than a short one, and its rows have one error of position. Rows
    with another target, or another error motion, are not averaged.
    """
    motions = np.unique(measurement.motions, return_inverse=True)[1]
    columns = np.array([measurement.stops, measurement.target_number, measurement.axis_column, motions])
    start = np.flatnonzero(np.append(True, np.any(np.diff(columns, axis=1) != 0, axis=0)))
    count = np.diff(np.append(start, len(measurement)))
    within = np.arange(len(measurement)) - np.repeat(start, count)
    share = np.minimum(1.0, MOST_OF_STOP / count)
    cell = np.repeat(start, count) + np.floor(within * np.repeat(share, count) + ROUNDING)
    first = np.flatnonzero(np.append(True, np.diff(cell) != 0))
    size = np.diff(np.append(first, len(measurement)))
    if size.max(initial=1) == 1:
        return measurement, size
    means = np.add.reduceat(measurement.observed, first) / size[:, None]
    return replace(measurement.rows(first + size // 2), observed=means), size


def registered(measurement: Measurement, model: ErrorModel) -> Registration:
    """The registration of a machine with these errors: least squares, without rows that are far off."""
    registration, trusted = measurement.first_registration
    if not model.effects:
        return registration
    instrument = measurement.instrument
    white = np.linalg.inv(np.linalg.cholesky(measurement.specified_covariances[trusted]))
    for _ in range(REGISTRATION_STEPS):
        rows = white @ instrument.registration_design(measurement, registration)[trusted]
        own = white @ residuals(measurement, model, registration)[trusted][:, :, None]
        matrix = [rows.reshape(-1, rows.shape[2]), instrument.stated_design(measurement, registration)]
        right = [own.reshape(-1), instrument.stated_residuals(measurement, registration)]
        step = np.linalg.lstsq(np.concatenate(matrix), np.concatenate(right))[0]
        registration = registration.moved(step)
        if np.abs(step).max(initial=0.0) < LAST_STEP:
            break
    return registration


def _linear(measurement: Measurement, model: ErrorModel, transform: Array) -> Array:
    """Change of the observations `(n, d)` by the errors of a model, to first order."""
    effects = model.observation(measurement.machine, measurement.state)
    errors = effects.errors.reshape(len(measurement), -1)
    return np.asarray((transform @ np.concatenate([errors, effects.shift], axis=1)[:, :, None])[:, :, 0])
