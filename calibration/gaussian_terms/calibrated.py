"""The calibration that a structure gives: its geometry with the covariance of all parameters, in the datum."""

from __future__ import annotations

import msgspec
import numpy as np

from calibration.fit.datum import to_datum
from calibration.fit.location_errors import split_locations, transformed
from calibration.gaussian_terms.structure import Structure
from calibration.observation.mean_lines import about_own_points, arms_of
from kinematics.error_model.model import ErrorModel, no_errors


def calibrated(structure: Structure) -> ErrorModel:
    """The model of the machine by the error motions of a structure."""
    geometry, posterior = structure.data.geometry, structure.posterior
    measurement = structure.data.observations.measurement
    machine = measurement.machine
    ends = np.cumsum([0, *(len(effect.parameters) for effect in geometry.effects)])
    effects, columns = [], []
    for effect, start, end in zip(geometry.effects, ends, ends[1:], strict=False):
        if effect.ACTS_ON == "instrument":
            continue
        own = np.arange(start, end)
        effects.append(effect.with_parameters((posterior.mean[own] * geometry.scales[own]).tolist()))
        columns.append(own)
    chosen = np.concatenate(columns)
    scales = geometry.scales[chosen]
    covariance = posterior.covariance[np.ix_(chosen, chosen)] * scales[:, None] * scales
    model = msgspec.structs.replace(
        no_errors(machine), effects=tuple(effects), covariance=tuple(map(tuple, covariance.tolist()))
    )
    prior, arms = structure.sizes[chosen] * scales, arms_of(measurement)
    moved = transformed(model, model.effects, to_datum(machine, model, prior, arms))
    moved = transformed(moved, *about_own_points(moved))
    return transformed(moved, *split_locations(machine, moved, arms))
