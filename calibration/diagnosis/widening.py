"""Uncertainties of a calibration beside a residual that no cause explains.

A fit propagates noise. A dependence of the residuals on recorded variables is none: it may be an error of the machine,
which the calibration lacks at every pose, or one of the measurement, of which the calibration has learned a part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.fit.acceptance import usual_states
from calibration.fit.fit import Fit
from calibration.fit.prediction import MM, deviation_design, evenly_spread
from kinematics.error_model.covariance import root_of
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

SEEN = 1e-3
"""Share of the largest uncertainty below which a direction does not show a combination of parameters."""


class Widened(NamedTuple):
    """A model with uncertainties that hold an unexplained error too."""

    model: ErrorModel
    factor: float
    """Uncertainties of predicted deviations in RMS, as a multiple of those that follow from the noise."""


def widened(model: ErrorModel, found: Fit, unexplained: Array) -> Widened:
    """The model of a fit with larger uncertainties.

    unexplained: mean squares of the error `(3,)`, um^2, in x, y, z; of other observations their mean counts for each.

    The variance of each combination of parameters that moves the tool in a direction is multiplied (Birge 1932), such
    that those of the predicted deviations at the measured states, relative to their mean, grow by this mean square.
    """
    if model.covariance is None or not np.any(unexplained > 0.0):
        return Widened(model, 1.0)
    measurement = found.measurement
    design = MM * deviation_design(model, measurement.machine, *evenly_spread(*usual_states(measurement)))
    design -= design.mean(axis=0)
    squares = unexplained if len(unexplained) == 3 else np.full(3, unexplained.mean())
    root = root_of(np.array(model.covariance))
    parts = np.moveaxis(design @ root, 1, 0)
    variance = np.mean(np.sum(parts**2, axis=2), axis=1)
    more = np.zeros_like(root)
    for k in np.flatnonzero(variance):
        _, sizes, directions = np.linalg.svd(parts[k], full_matrices=False)
        own = root @ directions[sizes > SEEN * sizes[0]].T
        more += max(squares[k], 0.0) / variance[k] * own @ own.T
    larger = model.with_parameters(model.parameters, np.array(model.covariance) + more)
    after = np.mean(larger.propagated(design) ** 2, axis=0)
    return Widened(larger, float(np.sqrt(after.mean() / variance.mean())))
