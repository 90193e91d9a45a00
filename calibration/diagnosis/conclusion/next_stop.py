"""The uncertainty of the next stop, which is at another position.

An axis that does not repeat stops elsewhere, and one with errors finer than its error motions has another one there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from calibration.diagnosis.nameless import TYPICAL_FINE
from calibration.gaussian_terms.structure import Structure
from kinematics.basis import Basis
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

STOP_POSITIONS = 200
"""Positions over the range of an axis at which its stops are uncertain."""


def of_next_stop(structure: Structure, repeats: Mapping[str, float]) -> dict[str, float]:
    """Standard uncertainty of each axis at its next stop, um or urad, that no error motion holds.

    repeats: standard deviation of each axis from stop to stop, where the data show it.
    """
    squares = {axis: size**2 for axis, size in repeats.items()}
    for term, size in zip(structure.terms, structure.term_sizes, strict=True):
        if term.kind == "fine" and not term.effects and term.where is not None:
            squares[term.where] = squares.get(term.where, 0.0) + (size * TYPICAL_FINE) ** 2
    return {axis: math.sqrt(square) for axis, square in squares.items()}


def with_next_stop(model: ErrorModel, uncertain: Mapping[str, float]) -> ErrorModel:
    """A calibration whose positioning errors have further standard uncertainties of some axes, um or urad."""
    if model.covariance is None:
        return model
    covariance = np.array(model.covariance)
    for motion, part in model.error_motions:
        if motion.component == own_component(motion.axis) and motion.axis in uncertain:
            covariance[part, part] += uncertain[motion.axis] ** 2 * _of_stops(motion.basis)
    return model.with_parameters(model.parameters, covariance)


def _of_stops(basis: Basis) -> Array:
    """Covariance `(p, p)` of coefficients that gives a mean variance of 1 over the range, without zero and scale."""
    x = np.linspace(*basis.interval, STOP_POSITIONS)
    columns, line = basis.columns(x), np.stack([np.ones_like(x), x - x.mean()], axis=1)
    fine = columns - line @ np.linalg.lstsq(line, columns)[0]
    back = np.linalg.pinv(columns.T @ columns) * STOP_POSITIONS
    return np.asarray(back @ (fine.T @ fine / STOP_POSITIONS) @ back / max(basis.size - line.shape[1], 1))
