"""Cross-validation of a three-point identification: prediction of positions left out, against the nominal machine.

Positions between the ends of each axis are left out in turn, in all rounds and with all targets, and predicted by an
identification from the others. Neighbours on either side remain, as between the positions of the whole measurement. For
both models, the stations and the positions of all targets on their carriers are registered on the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.acceptance import nominal_residuals, refuse_worse
from calibration.fit.cross_validation import CrossValidation, predicted_by_others
from calibration.fit.fit import Fit, fit
from calibration.fit.problem import FIXED
from calibration.measurement.measurement import Measurement
from calibration.single_axis.series import LEAST_SERIES_POSITIONS, all_series, physical_points
from calibration.single_axis.three_points import Choice, ThreePoints, identified
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

POSITION_BLOCKS = 4
"""Number of blocks into which the positions of an axis are divided in turn, so that neighbours of each one remain."""


@dataclass(frozen=True)
class Check:
    """Residuals of the readings with the model and with the nominal machine."""

    fit: Fit
    """The unchanged model, registered on all readings."""
    before: Array
    """Residuals `(kept, 3)`, mm, of the nominal machine, registered on its own."""
    cross_validation: CrossValidation | None
    """Result of the cross-validation; None if too few positions lie between others."""

    @property
    def before_rms_um(self) -> float:
        """RMS residual of the nominal machine, um, per scalar."""
        return float(np.sqrt(np.mean((1e3 * self.before) ** 2)))

    @property
    def before_max_um(self) -> float:
        """Largest residual of the nominal machine, um."""
        return 1e3 * float(np.linalg.norm(self.before, axis=1).max())


def check(measurement: Measurement, found: ThreePoints, choice: Choice) -> Check:
    """The check of an identification of a measurement with this choice; UserError if it is no improvement."""
    free = replace(measurement, targets={name: replace(t, free=True) for name, t in measurement.targets.items()})
    same = replace(choice, arcs={name: axis.arc for name, axis in found.axes.items()})

    def refit(others: np.ndarray) -> Fit:
        rows = free.rows(np.flatnonzero(others))
        return _registered(rows, identified(rows, same).model)

    whole = _registered(free, found.model)
    before = nominal_residuals(whole)
    held_out = predicted_by_others(free, _blocks(measurement), "positions", refit)
    refuse_worse(whole, before, held_out)
    return Check(whole, before, held_out)


def _registered(measurement: Measurement, model: ErrorModel) -> Fit:
    """Fit of stations and targets with the model unchanged."""
    return fit(measurement, model, prior=np.full(len(model.parameters), FIXED))


def _blocks(measurement: Measurement) -> np.ndarray:
    """Number `(rows,)` of the block of each position: every fourth one of an axis; -1 for the ends, which stay."""
    point_numbers, number = physical_points(measurement)
    block, observed = np.full(len(point_numbers), -1), np.zeros(len(point_numbers), int)
    for series in all_series(measurement, point_numbers, number):
        observed[series.numbers] += 1
        if len(series.positions) > LEAST_SERIES_POSITIONS:
            block[series.numbers[1:-1]] = np.arange(len(series.positions) - 2)[:, None] % POSITION_BLOCKS
    # a point that belongs to the series of two axes always stays
    return np.asarray(np.where(observed > 1, -1, block)[number])
