"""Misfit of a measurement to the nominal machine: its residuals, with the machine registered to the points."""

from __future__ import annotations

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import residuals
from calibration.registration.derived import derived
from calibration.registration.registration import Registration
from kinematics.transforms import Array

TRIMMED = 50
"""One row of so many, at least one, is ignored as a possible outlier."""


@derived
def misfit(measurement: Measurement) -> tuple[Array, Registration]:
    """Residuals `(n, d)`, mm and rad, of the nominal machine, and its registration, robust to gross errors."""
    registration, _ = measurement.first_registration
    return residuals(measurement, measurement.nominal_model, registration), registration


def usual_rms(measurement: Measurement) -> float:
    """RMS length, mm, of the residuals of all rows but the largest ones."""
    return trimmed_rms(np.linalg.norm(misfit(measurement)[0], axis=1))


def worst_rms(measurement: Measurement) -> float:
    """Largest RMS length, mm, of the residuals: of all rows, and of each target and station with several rows."""
    lengths = np.linalg.norm(misfit(measurement)[0], axis=1)
    parts = [np.ones(len(lengths), bool)]
    for names in (measurement.target_number, measurement.groups):
        parts += [names == name for name in np.unique(names).tolist()]
    return max(trimmed_rms(lengths[part]) for part in parts if part.sum() > 3 or part.all())


def trimmed_rms(lengths: Array) -> float:
    """RMS of lengths `(n,)` without the largest ones."""
    spared = max(len(lengths) // TRIMMED, 1) if len(lengths) > 3 else 0
    return float(np.sqrt(np.mean(np.sort(lengths)[: len(lengths) - spared] ** 2)))


def centred(measurement: Measurement, values: Array) -> Array:
    """Values `(n, d)` minus the mean of their registration group."""
    _, group = np.unique(measurement.groups, return_inverse=True)
    sums = np.zeros((group.max() + 1, values.shape[1]))
    np.add.at(sums, group, values)
    return np.asarray(values - (sums / np.bincount(group)[:, None])[group])
