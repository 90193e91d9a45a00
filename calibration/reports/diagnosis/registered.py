"""The rows of a diagnosis with the registration that its calibration gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.diagnosis.conclusion.guard import in_units
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.gaussian_terms.observations import registered
from calibration.measurement.measurement import Measurement
from calibration.registration.registration import Registration
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array


class RegisteredRows(NamedTuple):
    """Rows, their registration and their residuals."""

    measurement: Measurement
    model: ErrorModel
    registration: Registration
    residual: Array
    """`(n, d)`, mm and rad."""
    kept: np.ndarray
    """Mask `(n,)` of the rows that are not left out."""


def registered_rows(answer: Diagnosis) -> RegisteredRows:
    """The rows of an answer, registered to the machine of its calibration."""
    structure = answer.structure
    residual = in_units(structure, structure.left)
    registration = registered(answer.measurement, answer.model)
    return RegisteredRows(answer.measurement, answer.model, registration, residual, ~structure.noise.left_out)
