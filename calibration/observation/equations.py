"""Covariances of the observations: by the noise that was estimated from the data, else by the specification."""

from __future__ import annotations

from calibration.measurement.measurement import Measurement
from kinematics.transforms import Array


def covariance(measurement: Measurement) -> Array:
    """Covariances `(n, d, d)`, mm2 or rad2, of the components that count, each row by itself.

    By the estimated noise of the measurement, else by the specification.
    """
    specified = specified_covariance(measurement)
    return specified if measurement.noise is None else measurement.noise.covariance(specified)


def specified_covariance(measurement: Measurement) -> Array:
    """Covariances `(n, d, d)`, mm2 or rad2, by the instrument's specification; rows in motion are means.

    Specification and scatter describe the same readings (GUM 4.3.10): scatter counts as far as it exceeds the
    specification of the instrument.
    """
    return measurement.instrument.row_covariances(measurement)
