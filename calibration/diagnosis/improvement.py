"""Improvement by the new model: by direction, in the volume, and the share that no rigid chain can explain."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Stage
from calibration.fit.fit import Fit
from calibration.fit.linear import pseudo_inverse
from calibration.observation.normal_equations import whitened, whiteners
from kinematics.basis import BSpline
from kinematics.effects import ErrorMotion
from kinematics.transforms import Array

FINEST = 48
"""Parameters of an error motion of the finest rigid chain."""
SHARE = 3
"""Scalars per parameter of the finest rigid chain that `closure` needs."""


class Figures(NamedTuple):
    """Residuals of a model at some rows; um, urad on rotary axes of an interferometer."""

    rms_um: float
    """RMS per scalar."""
    max_um: float
    """Largest length of the residual of a row."""
    chi2_reduced: float
    """chi2 by the instrument specification, per degree of freedom."""
    heldout_rms_um: float
    """RMS per scalar in fits of the other blocks; NaN where too few rows can be held out."""


def held_out_rows(stage: Stage) -> np.ndarray:
    """Mask `(n,)` of the rows that a stage predicts by fits of the other blocks: of long measurements only a part."""
    rows = np.zeros(len(stage.fit.measurement), bool)
    rows[stage.linearised.rows] = stage.linearised.cross_validation.counted
    return rows


def figures(stage: Stage, kept: np.ndarray, held_out: np.ndarray) -> Figures:
    """Residuals of a stage at the rows of a mask `(n,)`; of held-out blocks at those of a second one."""
    fit, held, rows = stage.fit, stage.linearised.cross_validation, stage.linearised.rows
    some = replace(fit.measurement, noise=None).rows(np.flatnonzero(kept))
    micro = fit.residual[kept] * some.per_micro
    chi2 = float(np.sum(whitened(whiteners(some), fit.residual[kept]) ** 2))
    predicted = held.residual_um[held.counted & (kept & held_out)[rows]]
    return Figures(
        float(np.sqrt(np.mean(micro**2))),
        float(np.linalg.norm(micro, axis=1).max()),
        chi2 / max(micro.size - fit.effective_parameters, 1.0),
        float(np.sqrt(np.mean(predicted**2))) if predicted.size else float("nan"),
    )


def by_direction(stage: Stage, kept: np.ndarray) -> dict[str, float]:
    """RMS residual, um, in x, y, z of the part that carries the tracker; of an interferometer by axis.

    kept: mask `(n,)` of the rows that count.
    """
    fit = stage.fit
    measurement = fit.measurement
    micro = in_micro(fit, fit.residual)[kept]
    if measurement.axis is None:
        return dict(zip("xyz", np.sqrt(np.mean(micro**2, axis=0)).tolist(), strict=False))
    names = measurement.axis[kept]
    return {name: float(np.sqrt(np.mean(micro[names == name] ** 2))) for name in np.unique(names).tolist()}


def in_micro(fit: Fit, values: Array) -> Array:
    """Observed values `(n, d)` of all rows, um (rotary axes: urad).

    A tracker's are in x, y, z of the part on which it is set up.
    """
    measurement = fit.measurement
    if measurement.instrument.BY_BEAM:
        values = np.einsum("nji,nj->ni", fit.registration.rotations(measurement), values)
    return np.asarray(values * measurement.per_micro)


def closure(linearised: LinearisedFit) -> float | None:
    """Share of the residual beyond the noise that the finest rigid chain cannot explain; None where data are too few.

    1: no part of it is an error motion of an axis, of any course. 0: also where the residual does not exceed the noise.
    """
    measurement = linearised.measurement
    beyond = linearised.squares - linearised.degrees_of_freedom
    if beyond <= 3.0 * np.sqrt(2.0 * linearised.degrees_of_freedom):
        return 0.0
    columns = []
    for axis, interval in measurement.moving.items():
        size = max(2, min(FINEST, measurement.distinct_positions[axis] // 2))
        basis = BSpline(tuple(np.linspace(*interval, size).tolist()), 1)
        motions = {e.component for e, _ in linearised.fit.model.error_motions if e.axis == axis}
        columns += [
            linearised.columns(ErrorMotion(c, axis, basis, (0.0,) * size, u=(0.0,) * size)) for c in sorted(motions)
        ]
    finest = np.concatenate(columns, axis=1)
    if finest.shape[1] * SHARE > linearised.scalars:
        return None
    projected = linearised.projected(finest)
    inverse = pseudo_inverse((projected.schur + projected.schur.T) / 2, 1e-6)
    explained = inverse.explained(finest.T @ linearised.residual) - inverse.rank
    return float(np.clip(1.0 - explained / beyond, 0.0, 1.0))
