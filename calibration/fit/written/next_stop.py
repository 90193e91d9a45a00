"""The uncertainty of the next stop, which is at another position.

An axis that does not repeat stops elsewhere, and one with errors finer than its error motions has another one there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinematics.basis import Basis
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

STOP_POSITIONS = 200
"""Positions over the range of an axis at which its stops are uncertain."""
INDEPENDENT_SHARE = 1e-3
"""Share of the largest singular value of a basis below which its functions are combinations of one another."""


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
    shown, values, _ = np.linalg.svd(columns, full_matrices=False)
    shown = shown[:, values > INDEPENDENT_SHARE * values[0]]
    fine = shown - line @ np.linalg.lstsq(line, shown)[0]
    back = np.linalg.pinv(columns, rcond=INDEPENDENT_SHARE) @ fine
    return np.asarray(back @ back.T * STOP_POSITIONS / max(shown.shape[1] - line.shape[1], 1))
