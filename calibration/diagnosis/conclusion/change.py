"""What has changed of the machine since the calibration that was given.

The new calibration less the given one is the sum of what is better known of the same machine, t1 - t0, and of the
changes that the terms are, d. Means by the data do not correlate with their errors, thus the difference has the
covariance (V0 - V1) + Vd: before the data less after them, and that of the changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.linalg import block_diag

from calibration.diagnosis.conclusion.mixture import Parameters
from calibration.evaluation.machine_change import MachineChange, machine_change
from calibration.gaussian_terms.geometry import root_of
from calibration.gaussian_terms.structure import Structure
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

ROWS_OF_A_VOLUME = 10
"""Rows from which both calibrations are compared: fewer are no volume."""


def change_since(structure: Structure, found: Parameters) -> MachineChange | None:
    """The change to the parameters that were found; None without a given calibration, or with too few rows.

    found: those of the geometry first, in its order.
    """
    observations, inside = structure.data.observations, ~structure.noise.left_out
    if observations.given is None or np.count_nonzero(inside) < ROWS_OF_A_VOLUME:
        return None
    measurement = observations.measurement
    difference = _difference(observations.given, found, len(structure.data.geometry.effects))
    return machine_change(measurement, inside, measurement.nominal_model, difference)


def _difference(given: ErrorModel, found: Parameters, of_geometry: int) -> ErrorModel:
    """The given calibration's effects with what the data add to them, and those of the terms."""
    effects = (*given.effects, *found.effects[of_geometry:])
    known, always = _count(given.effects), _count(found.effects[:of_geometry])
    values = np.concatenate([found.values[:known] - given.parameters, found.values[always:]])
    linear = np.concatenate([np.zeros(0, bool), *(effect.linear for effect in effects)])
    fixed = np.concatenate([given.parameters, found.values[always:]])
    root = root_of(given)
    learned = _positive(root @ root.T - found.covariance[:known, :known])
    covariance = block_diag(learned, found.covariance[always:, always:])
    whole = msgspec.structs.replace(given, effects=effects, covariance=None)
    whole = whole.with_parameters(np.where(linear, values, fixed), np.where(np.outer(linear, linear), covariance, 0.0))
    return whole.part(lambda effect: effect.ACTS_ON != "instrument")


def _count(effects: Sequence[Effect]) -> int:
    """Number of parameters."""
    return sum(len(effect.parameters) for effect in effects)


def _positive(covariance: Array) -> Array:
    """The nearest covariance without negative variances, which rounding and averages leave."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)


def size_in(given: ErrorModel | None, effect: Effect) -> Effect | None:
    """The effect of a calibration of which a cause is a change; None where it has none of the kind and place."""
    known = () if given is None else given.effects
    return next((each for each in known if type(each) is type(effect) and each.name == effect.name), None)
