"""The rows of a measurement with their residuals, as figures show them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.diagnosis.conclusion.guard import in_units
from calibration.gaussian_terms.outliers import shifts
from calibration.gaussian_terms.structure import Structure
from calibration.measurement.measurement import Measurement
from kinematics.transforms import Array


class FittedRows(NamedTuple):
    """Rows of a measurement: derivatives and residuals in standard uncertainties of the noise of single rows."""

    measurement: Measurement
    """The n rows, with d scalars each."""
    transform: Array
    """Derivatives `(n, d, width)` by the error motions and the shift of the observed point, as of `Observations`."""
    residual: Array
    """Residuals `(n, d)`; of rows that are left out their difference from what the others predict."""
    good: np.ndarray
    """Mask `(n,)` of the rows that are not left out."""

    @classmethod
    def of(cls, structure: Structure) -> FittedRows:
        """The rows of a structure."""
        observations, left_out = structure.data.observations, structure.noise.left_out
        residual = in_units(structure, structure.left)
        if left_out.any():
            residual[left_out], _ = shifts(structure, np.flatnonzero(left_out))
        white = np.linalg.inv(np.linalg.cholesky(covariance(structure)))
        whitened = (white @ residual[:, :, None])[:, :, 0]
        return cls(observations.measurement, white @ observations.transform, whitened, ~left_out)


def covariance(structure: Structure) -> Array:
    """Covariance `(n, d, d)`, mm and rad, of the noise of each row: of the instrument, and from stop to stop."""
    observations, noise = structure.data.observations, structure.noise
    found = noise.factor * observations.specified
    for stops in structure.data.stops:
        for axis, size in noise.repeats.items():
            arms = size * stops.arms[axis].reshape(*stops.rows.shape, -1)
            found[stops.rows] += arms[:, :, :, None] * arms[:, :, None, :]
    return np.asarray(found)


def in_micro(structure: Structure, values: Array) -> Array:
    """Observed values `(n, d)`, mm and rad, in um or urad; of a tracker in x, y, z of the part on which it stands."""
    measurement = structure.data.observations.measurement
    if measurement.instrument.BY_BEAM:
        registration, _ = measurement.first_registration
        values = np.einsum("nji,nj->ni", registration.rotations(measurement), values)
    return np.asarray(values * measurement.per_micro)


def by_direction(structure: Structure) -> dict[str, float]:
    """RMS residual, um or urad, of the rows that are not left out: in x, y, z, or of an interferometer by axis."""
    measurement = structure.data.observations.measurement
    inside = ~structure.noise.left_out
    squares = in_micro(structure, in_units(structure, structure.left)) ** 2
    parts = measurement.instrument.PARTS
    of_parts = dict(zip(parts, np.sqrt(np.mean(squares[inside], axis=0)).tolist(), strict=False))
    used = {name: rows[inside[rows]] for name, rows in measurement.axis_rows.items()}
    return of_parts | {name: float(np.sqrt(np.mean(squares[rows]))) for name, rows in used.items() if len(rows)}
