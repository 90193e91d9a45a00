"""The calibration that a structure gives: effects with the covariance of all parameters, in the datum."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from calibration.fit.datum import model_in_datum
from calibration.fit.written.merged import merged
from calibration.gaussian_terms.structure import Structure
from calibration.measurement.measurement import Measurement
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array


def calibrated(structure: Structure) -> ErrorModel:
    """The model of the machine by the error motions of a structure."""
    geometry = structure.data.geometry
    count, matrix = geometry.width, geometry.parameters
    values, covariance = geometry.values(structure.posterior.mean[:count]), structure.posterior.covariance
    measurement, prior = structure.data.observations.measurement, prior_sizes(structure)
    return machine_model(measurement, geometry.effects, values, matrix @ covariance[:count, :count] @ matrix.T, prior)


def prior_sizes(structure: Structure) -> Array:
    """Prior sizes `(P,)` of the parameters of the geometry, in their units."""
    geometry = structure.data.geometry
    return np.asarray(np.linalg.norm(geometry.parameters * structure.sizes[: geometry.width], axis=1))


def machine_model(
    measurement: Measurement,
    effects: Sequence[Effect],
    parameters: Array,
    covariance: Array,
    prior: Array,
    given: ErrorModel | None = None,
) -> ErrorModel:
    """The model in the datum by those of some effects that are the machine's.

    parameters `(p,)`, their covariance `(p, p)` and their prior sizes `(p,)` are those of all effects, one after the
    other, in their units. given: a calibration whose effects are the first ones, and keep their datum; the others
    become part of them where these contain them.
    """
    whole = msgspec.structs.replace(measurement.nominal_model, effects=tuple(effects))
    whole = whole.with_parameters(parameters, covariance)
    machine = whole.part(lambda effect: effect.ACTS_ON != "instrument")
    if given is not None:
        return merged(measurement.machine, machine, len(given.effects), measurement.arms)
    own = np.repeat([effect.ACTS_ON != "instrument" for effect in effects], [len(e.parameters) for e in effects])
    return model_in_datum(machine, measurement, prior[own])
