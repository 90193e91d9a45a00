"""The first registration of an instrument, on the nominal machine: where each fit begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.registration.registration import Registration
from kinematics.error_model.model import Observation

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

ASTRAY_MEDIANS = 10.0
"""Multiple of the median deviation from the nominal machine, and at least 1 mm, above which a row is left out of the
first registration."""


def first_registration(measurement: Measurement) -> tuple[Registration, np.ndarray]:
    """A registration on the nominal machine without rows with gross errors, and a mask `(n,)` of the rows in it."""
    n = len(measurement)
    nominal = Observation(np.zeros((n, len(measurement.machine.axes) + 1, 6)), np.zeros((n, 3)))
    trusted = np.ones(n, bool)
    for _ in range(10):
        registration = measurement.instrument.first_registration(measurement, trusted)
        residual = np.linalg.norm(
            measurement.counted - measurement.instrument.expected(measurement, registration, nominal), axis=1
        )
        closer = residual <= max(1.0, ASTRAY_MEDIANS * float(np.median(residual)))
        if measurement.instrument.MAY_BE_FEW:  # errors of millimetres, and checked already: no row is astray
            closer = trusted
        if np.array_equal(closer, trusted):
            break
        trusted = closer
    return registration, trusted
