"""Outliers: rows whose odds of an error of their own, against the noise, are above 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.gaussian_terms.gains import log_gains
from kinematics.error_model.priors import OUTLIER_SIZES
from kinematics.transforms import Array

if TYPE_CHECKING:
    from calibration.gaussian_terms.structure import Structure


def outlying(structure: Structure) -> np.ndarray:
    """Mask `(n,)` of the outliers of a structure; rows that are left out come back where they agree with the others."""
    return log_odds(structure) > 0.0


def log_odds(structure: Structure) -> Array:
    """Log odds `(n,)` that a row has a shift of its own."""
    left_out = structure.noise.left_out
    found = _odds_inside(structure)
    if left_out.any():
        shift, covariance = shifts(structure, np.flatnonzero(left_out))
        inverse = np.asarray(np.linalg.inv(covariance), float)
        along = (inverse @ shift[:, :, None])[:, :, 0]
        found[left_out] = log_gains(inverse, along, OUTLIER_SIZES, 1.0) + float(np.log(structure.priors.outlier))
    return found


def _odds_inside(structure: Structure) -> Array:
    """As `log_odds`, for rows that are not left out."""
    data, white, factor = structure.data, structure.whitener, structure.noise.factor
    n, d = data.observations.residual.shape
    left = structure.left[: n * d].reshape(n, d)
    odds = np.empty(n)
    for stops, matrices, uncertain, registered in zip(
        data.stops, white.matrices, structure.uncertain, white.registered, strict=True
    ):
        stop_left = left[stops.rows].reshape(len(stops.rows), -1, 1)
        free = np.eye(stop_left.shape[1]) - uncertain / factor - registered
        for i in range(stops.rows.shape[1]):
            shift = np.swapaxes(matrices[:, :, i * d : (i + 1) * d], 1, 2)
            block = shift @ free @ np.swapaxes(shift, 1, 2)
            odds[stops.rows[:, i]] = log_gains(block, (shift @ stop_left)[:, :, 0], OUTLIER_SIZES, factor)
    return odds + float(np.log(structure.priors.outlier))


def shifts(structure: Structure, rows: np.ndarray) -> tuple[Array, Array]:
    """Difference `(k, d)`, mm and rad, of rows that are left out from what the others predict, and its covariance."""
    observations, white, posterior = structure.data.observations, structure.whitener, structure.posterior
    rows_of = np.linalg.pinv(np.concatenate([white.rows(observations.registration), observations.stated])).T
    placed = white.through(observations.residual[:, :, None], rows_of).T
    moved = structure.through(rows_of).T
    own = np.concatenate([part[rows] for part in structure.columns], axis=2) - observations.registration[rows] @ moved
    left = observations.residual[rows][:, :, None] - observations.registration[rows] @ placed
    left = left - own @ posterior.mean[:, None]
    spread = (own * posterior.sizes) @ posterior.root.T
    covariance = structure.noise.factor * observations.specified[rows] + spread @ np.swapaxes(spread, 1, 2)
    for stops in structure.data.stops:
        for axis, size in structure.noise.repeats.items():
            arms = stops.arms[axis].reshape(*stops.rows.shape, -1)
            for i, row in enumerate(rows.tolist()):
                at = np.argwhere(stops.rows == row)
                if len(at):
                    arm = arms[at[0, 0], at[0, 1]]
                    covariance[i] += size**2 * np.outer(arm, arm)
    return left[:, :, 0], covariance
