"""Held-out residuals: every block of rows is predicted by a fit of all the others.

Blocks are runs, or cells of space: never single rows, whose neighbours would give the answer away.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.fit import Variance, fit
from calibration.measurement import Measurement
from calibration.normal import residuals
from kinematics.model import ErrorModel
from kinematics.transforms import Array

CELLS = 8
"""Cells of space."""


class HeldOut(NamedTuple):
    """What fits leave of rows that they have not seen."""

    rms_um: float
    """Per scalar."""
    max_um: float
    blocks: int
    what: str
    """What the blocks are."""


def held_out(
    measurement: Measurement, model: ErrorModel, prior: Array, kept: np.ndarray, variance: Variance = "sheet"
) -> HeldOut | None:
    """Residuals of each block under a fit of the others; None when there are too few rows for blocks.

    kept: mask `(n,)` of the rows to be used, outliers left out.
    """
    good = measurement.rows(np.flatnonzero(kept))
    labels, what = blocks_of(good)
    missed = np.zeros_like(good.observed)
    for label in np.unique(labels):
        held = labels == label
        rest = good.rows(np.flatnonzero(~held))
        if not set(good.groups[held]) <= set(rest.groups) or np.count_nonzero(~held) < 8:
            return None
        found = fit(rest, model, prior=prior, variance=variance)
        own = good.rows(np.flatnonzero(held))
        missed[held] = residuals(own, found.model, found.registration)
    rms, largest = np.sqrt(np.mean(missed**2)), np.linalg.norm(missed, axis=1).max()
    return HeldOut(float(rms * 1e3), float(largest * 1e3), len(np.unique(labels)), what)


def blocks_of(measurement: Measurement) -> tuple[np.ndarray, str]:
    """Labels `(n,)` of blocks, and what they are: runs where there are three or more within each set-up, else cells."""
    if measurement.run is not None and measurement.instrument.components > 1 and len(np.unique(measurement.run)) > 2:
        return np.unique(measurement.run, return_inverse=True)[1], "runs"
    labels = np.zeros(len(measurement), int)
    positions = measurement.state.positions / np.maximum(np.ptp(measurement.state.positions, axis=0), 1e-9)
    while labels.max() + 1 < CELLS:
        for label in range(labels.max() + 1):
            rows = np.flatnonzero(labels == label)
            widest = int(np.argmax(np.ptp(positions[rows], axis=0)))
            upper = rows[positions[rows, widest] > np.median(positions[rows, widest])]
            labels[upper] = labels.max() + 1
    return labels, "cells of space"
