"""Normal equations, assembled a block of rows at a time: memory does not grow with the number of observations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement
from calibration.measurement.registration import Registration
from calibration.observation import equations
from kinematics.error_model.model import Design, ErrorModel, Observation
from kinematics.transforms import Array, blocks
from kinematics.user_error import UserError

CERTAIN = 1e-6
"""Share of the largest standard uncertainty of a row below which another counts as zero."""


@dataclass
class NormalEquations:
    """Normal equations over whitened rows; the parameters of the registration first, then those of the model."""

    matrix: Array
    """J'J `(size, size)`."""
    right: Array
    """J'r `(size,)`."""

    @classmethod
    def zero(cls, size: int) -> NormalEquations:
        """The equations of `size` parameters without any rows."""
        return cls(np.zeros((size, size)), np.zeros(size))

    def add(self, design: Array, residual: Array) -> None:
        """Add whitened rows: design `(rows, parameters)`, residual `(rows,)`."""
        self.matrix += design.T @ design
        self.right += design.T @ residual


def whiteners(measurement: Measurement) -> Array:
    """Matrices W `(n, d, d)` that make the noise of each row white: W C W' = 1; Montavon et al., weights by Cholesky.

    UserError for an instrument without uncertainty in some direction.
    """
    try:
        root = np.linalg.cholesky(equations.covariance(measurement))
        sizes = np.diagonal(root, axis1=1, axis2=2)
        certain = np.flatnonzero(sizes.min(axis=1) < CERTAIN * sizes.max(axis=1))
    except np.linalg.LinAlgError:
        certain = np.zeros(1, int)
    if len(certain):
        keys = [field for field in measurement.instrument.__struct_fields__ if field.startswith("u_")]
        raise UserError(
            f"{measurement.source}: the uncertainty of the instrument is zero in some direction, so that the weight of "
            f"its rows has no limit: state {', '.join(keys)} (k=1)"
        )
    return np.asarray(np.linalg.inv(root))


def whitened(whitener: Array, residual: Array) -> Array:
    """W r `(n, d)`."""
    return np.asarray((whitener @ residual[:, :, None])[:, :, 0])


def assemble(
    measurement: Measurement,
    model: ErrorModel,
    registration: Registration,
    whitener: Array,
    residual: Array,
    decorrelation: Decorrelation,
) -> NormalEquations:
    """The normal equations of all rows; `residual` `(n, d)` is whitened and decorrelated already."""
    normal = NormalEquations.zero(len(registration.names) + len(model.parameters))
    for rows, design in designs(measurement, model, registration, whitener, decorrelation):
        normal.add(design, residual[rows].reshape(-1))
    return normal


def designs(
    measurement: Measurement,
    model: ErrorModel,
    registration: Registration,
    whitener: Array,
    decorrelation: Decorrelation,
) -> Iterator[tuple[slice, Array]]:
    """Blocks of rows with their whitened design `(rows * d, registration + parameters)`; one where rows correlate."""
    of_model = Design(model, measurement.machine, measurement.state, with_instrument=True)
    for rows in [slice(0, len(measurement))] if decorrelation.stops else blocks(len(measurement)):
        part, white = measurement.rows(rows), whitener[rows]
        design = white @ equations.registration_design(part, registration)
        if model.effects:
            of_effects = of_model.of(rows, white @ equations.transform(part, registration))
            design = np.concatenate([design, of_effects], axis=2)
        design = decorrelation.apply(design)
        yield rows, design.reshape(-1, design.shape[2])


def derivatives(measurement: Measurement, model: ErrorModel, registration: Registration) -> Array:
    """Derivatives `(n, d, registration + parameters)` of the observations of all rows, not whitened."""
    own = equations.registration_design(measurement, registration)
    if not model.effects:
        return own
    of_model = Design(model, measurement.machine, measurement.state, with_instrument=True)
    return np.concatenate([own, of_model.of(slice(None), equations.transform(measurement, registration))], axis=2)


def residuals(measurement: Measurement, model: ErrorModel, registration: Registration) -> Array:
    """Observed minus expected `(n, d)`, mm and rad, by the exact kinematics."""
    effects = model.observation(measurement.machine, measurement.state)
    result = np.empty((len(measurement), measurement.components))
    for rows in blocks(len(measurement)):
        part = measurement.rows(rows)
        own = Observation(effects.errors[rows], effects.shift[rows])
        result[rows] = part.counted - equations.expected(part, registration, own)
    return result
