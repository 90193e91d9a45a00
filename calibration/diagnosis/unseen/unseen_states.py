"""Random states within the measured ranges, which no row has measured, and errors of models there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.fit.acceptance import usual_states, without_clamp
from calibration.fit.prediction import MM, deviation_design
from calibration.measurement.measurement import Measurement
from kinematics.deviation import exact_deviation
from kinematics.effects import UM, Effect
from kinematics.effects.base import unit_of
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

MOMENTS, POSES = 5, 100
"""Moments of the measurement, and states at each of them, at which errors are predicted."""
SEED = 1


class Moment(NamedTuple):
    """Unseen states at one moment."""

    machine: Machine
    state: State
    tool: Array
    """Tool vectors `(n, 3)`, mm."""
    less: Array
    """Matrix `(3n, 3n)` that removes a common shift and rotation from displacements."""
    mean: State
    """The same states at the mean time and temperatures of the measurement."""

    def deviations(self, model: ErrorModel) -> Array:
        """Deviations `(n, 3)` by a model, um."""
        errors = model.errors(self.machine, self.state)
        return self._apart(exact_deviation(self.machine, self.state.positions, errors, self.tool).position)

    def design(self, model: ErrorModel) -> Array:
        """Derivatives `(n, 3, p)` of the deviations by the parameters, um."""
        return self._apart(deviation_design(model, self.machine, self.state, self.tool))

    def along(self, axis: str) -> Array:
        """Displacements `(n, 3)` of the tool by 1 um or urad along an axis, um, in the frame of the workpiece."""
        moved = self.state.positions.copy()
        moved[:, self.machine.index(axis)] += unit_of(axis)[1]
        start, end = (forward(self.machine, q).apply(self.tool) for q in (self.state.positions, moved))
        return np.asarray(end - start) / UM

    @property
    def at_mean(self) -> Moment:
        """The same positions at the mean time and temperatures."""
        return self._replace(state=self.mean)

    def deviations_of(self, effect: Effect) -> Array:
        """Deviations `(n, 3)` by a single effect, um."""
        return self.deviations(msgspec.structs.replace(no_errors(self.machine), effects=(effect,)))

    def _apart(self, values: Array) -> Array:
        return MM * np.asarray(self.less @ values.reshape(len(self.less), -1)).reshape(values.shape)


def moments(measurement: Measurement, count: int = MOMENTS) -> Iterator[Moment]:
    """Random states within the measured ranges, at several moments of the measurement, which are `count`."""
    state, tool = usual_states(measurement)
    low, high = state.positions.min(axis=0), state.positions.max(axis=0)
    rng = np.random.default_rng(SEED)
    for row in np.linspace(0, len(state) - 1, count + 2).astype(int)[1:-1].tolist():
        q = rng.uniform(low, high, (POSES, len(low)))
        approach = None if state.approach is None else _approaches(state.approach, rng)
        here = replace(state.rows(np.full(POSES, row)), positions=q, approach=approach)
        tools, machine = np.tile(tool[row], (POSES, 1)), measurement.machine
        mean = replace(
            here,
            time=None if state.time is None else np.full(POSES, state.time.mean()),
            temperatures={name: np.full(POSES, kelvin.mean()) for name, kelvin in state.temperatures.items()},
        )
        yield Moment(machine, here, tools, without_clamp(forward(machine, q).apply(tools)), mean)


def _approaches(approach: Array, rng: np.random.Generator) -> Array:
    """Random directions `(POSES, axes)` of approach, as often as measured; before its first move an axis has none."""
    known = [column[column != 0.0] if column.any() else column for column in approach.T]
    return np.stack([rng.choice(column, POSES) for column in known], axis=1)


def rms_correction(model: ErrorModel, measurement: Measurement) -> float:
    """RMS length, um, of the deviations that a model predicts at unseen states, a common shift and rotation apart."""
    squares = [np.sum(moment.deviations(model) ** 2) / POSES for moment in moments(measurement)]
    return float(np.sqrt(np.mean(squares)))


def mean_squares(errors: Array) -> Array:
    """Mean squares `(3,)`, um^2, of the sum of independent errors `(k, m, 3)`, um, at unseen states."""
    return np.asarray(np.sum(np.mean(errors**2, axis=1), axis=0))


def squares_along(measurement: Measurement, variances: Mapping[str, float]) -> Array:
    """Mean squares `(3,)`, um^2, of errors along axes that are independent from state to state.

    variances: by axis, um^2 or urad^2.
    """
    squares = np.zeros(3)
    for count, moment in enumerate(moments(measurement) if variances else (), start=1):
        errors = np.sum([variance * moment.along(axis) ** 2 for axis, variance in variances.items()], axis=0)
        squares += (errors.mean(axis=0) - squares) / count
    return squares
