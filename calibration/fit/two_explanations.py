"""A calibration whose data have a second explanation, as probable within a factor as the first: U contains both.

The estimate stays the likelier one. With the probability p of the other, whose parameters differ by d, the mean square
of its errors is (1 - p) C + p (C' + d d'): the covariances C and C' of both, and the difference (Hoeting et al. 1999,
Bayesian model averaging, equation 4, about the likelier one instead of the mean).
"""

from __future__ import annotations

import numpy as np

from kinematics.basis import Basis
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

CURVE_POSITIONS = 400
"""Number of positions at which the curves of both explanations are compared."""


def with_other(model: ErrorModel, other: ErrorModel, probability: float) -> ErrorModel:
    """A model whose covariance contains another one of the same machine, of this probability."""
    into = _into(model, other)
    away = into @ np.array(other.parameters) - np.array(model.parameters)
    own, theirs = np.array(model.covariance), into @ np.array(other.covariance) @ into.T
    # what the other model does not have is as uncertain as in this one
    lacking = np.flatnonzero(~into.any(axis=1))
    away[lacking] = 0.0
    theirs[np.ix_(lacking, lacking)] = own[np.ix_(lacking, lacking)]
    mixed = (1.0 - probability) * own + probability * (theirs + np.outer(away, away))
    return model.with_parameters(np.array(model.parameters), mixed)


def _into(model: ErrorModel, other: ErrorModel) -> Array:
    """Matrix `(p, q)` from the parameters of another model to those of a model, effect by effect."""
    parts = {effect.name: part for effect, part in zip(other.effects, other.slices, strict=True)}
    bases = {motion.name: motion.basis for motion, _ in model.error_motions}
    theirs = {motion.name: motion.basis for motion, _ in other.error_motions}
    matrix = np.zeros((len(model.parameters), len(other.parameters)))
    for effect, part in zip(model.effects, model.slices, strict=True):
        name = effect.name
        if name in parts:
            same = name not in bases or name not in theirs or bases[name] == theirs[name]
            matrix[part, parts[name]] = np.eye(len(effect.parameters)) if same else _from(bases[name], theirs[name])
    return matrix


def _from(basis: Basis, other: Basis) -> Array:
    """Matrix from the parameters of a curve in another basis: by least squares over the interval."""
    x = np.linspace(*basis.interval, CURVE_POSITIONS)
    return np.asarray(np.linalg.lstsq(basis.columns(x), other.columns(x))[0])
