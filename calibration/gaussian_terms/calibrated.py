"""The calibration that a structure gives: effects with the covariance of all parameters, in the datum."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from calibration.fit.location_errors import model_in_datum
from calibration.gaussian_terms.structure import Structure
from calibration.measurement.measurement import Measurement
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.transforms import Array


def calibrated(structure: Structure) -> ErrorModel:
    """The model of the machine by the error motions of a structure."""
    geometry, count = structure.data.geometry, len(structure.data.geometry.scales)
    mean, scales = structure.posterior.mean[:count] * geometry.scales, geometry.scales
    covariance = structure.posterior.covariance[:count, :count] * scales[:, None] * scales
    return machine_model(
        structure.data.observations.measurement, geometry.effects, mean, covariance, structure.sizes[:count] * scales
    )


def machine_model(
    measurement: Measurement, effects: Sequence[Effect], parameters: Array, covariance: Array, prior: Array
) -> ErrorModel:
    """The model in the datum by those of some effects that are the machine's.

    parameters `(p,)`, their covariance `(p, p)` and their prior sizes `(p,)` are those of all effects, one after the
    other, in their units.
    """
    whole = msgspec.structs.replace(no_errors(measurement.machine), effects=tuple(effects))
    whole = whole.with_parameters(parameters, covariance)
    machine = whole.part(lambda effect: effect.ACTS_ON != "instrument")
    own = np.repeat([effect.ACTS_ON != "instrument" for effect in effects], [len(e.parameters) for e in effects])
    return model_in_datum(machine, measurement, prior[own])
