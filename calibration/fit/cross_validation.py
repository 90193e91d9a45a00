"""Cross-validation: a fit of all other rows predicts each block of rows.

Blocks are runs, lines, cells of space, or positions with all their rows: never single rows, because the neighbours of a
single row determine it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import Fit, fit
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import residuals, whitened, whiteners
from calibration.observation.outliers import Variance
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.transforms import Array
from kinematics.user_error import UserError

CELLS = 8
"""Number of cells of space, or of sets of positions."""
POSE = 6
"""Smallest number of rows that locates a set-up, or a target on table or bed, well enough to predict other rows."""


LINE_MM = 1.0
"""Distance from a line within which positions lie on it."""
LEAST_OF_LINE = 4
"""Smallest number of rows of a line."""
LEAST_LINES, MOST_LINES = 3, 24
"""Fewer lines do not predict each other; more of them fill the volume."""
FINE = 1e3
"""Directions that differ by less than 1 / FINE count as one."""


class CrossValidation(NamedTuple):
    """Residuals of blocks of rows under fits of the other rows."""

    rms_um: float
    """RMS residual per scalar, um; urad on rotary axes of an interferometer."""
    max_um: float
    """Largest length of the residual of a row, um; urad on rotary axes of an interferometer."""
    blocks: int
    """Number of blocks."""
    name: str
    """Name of the blocks, plural: runs, lines, cells of space, ..."""
    nominal_rms_um: float
    """RMS residual of the same rows on the nominal machine, registered by the others, um."""
    improvement: float
    """Mean square residual of the nominal machine minus that of the fit, in units of the instrument's variance; below
    zero if the fit predicts worse."""


def cross_validate(
    measurement: Measurement, model: ErrorModel, prior: Array, kept: np.ndarray, variance: Variance = "sheet"
) -> CrossValidation | None:
    """Residuals of each block under a fit of the others; None when there are too few rows for blocks.

    kept: mask `(n,)` of the rows to be used, outliers left out.
    """
    good = measurement.rows(np.flatnonzero(kept))
    return predicted_by_others(good, *blocks_of(good), partial(fit, model=model, prior=prior, variance=variance))


def predicted_by_others(
    good: Measurement, labels: np.ndarray, name: str, refit: Callable[[Measurement], Fit]
) -> CrossValidation | None:
    """Residuals of each block of rows under `refit`, and under the nominal machine, of the other rows.

    labels `(n,)`: numbers of the blocks; negative for rows of no block. Rows whose set-up or target hardly occurs in
    the others depend on the registration, not on the machine, and do not count. None if too few rows count.
    """
    unexplained = np.full((2, len(good), good.components), np.nan)
    for label in np.unique(labels[labels >= 0]):
        predicted = (labels == label) & registered(good, labels != label)
        if not predicted.any():
            continue
        others = good.rows(np.flatnonzero(labels != label))
        for i, each in enumerate((refit, _nominal)):
            try:
                found = each(others)
            except UserError:  # the other rows alone cannot be fitted
                return None
            # effects with memory need the rows in between
            unexplained[i, predicted] = residuals(good, found.model, found.registration)[predicted]
    predicted = ~np.isnan(unexplained[0, :, 0])
    if 2 * predicted.sum() < len(good):
        return None
    part = good.rows(predicted)
    return summed_up(
        unexplained[:, predicted], whiteners(part), part.per_micro, len(np.unique(labels[labels >= 0])), name
    )


def _nominal(measurement: Measurement) -> Fit:
    """The fit of the registration alone, with the nominal machine."""
    return fit(measurement, no_errors(measurement.machine), prior=np.zeros(0))


def summed_up(unexplained: Array, whitener: Array, per_micro: Array, blocks: int, name: str) -> CrossValidation:
    """Statistics of the residuals `(2, n, d)`, mm and rad, of the fit and of the nominal machine."""
    squares = [float(np.mean(whitened(whitener, residual) ** 2)) for residual in unexplained]
    rms = [float(np.sqrt(np.mean((part * per_micro) ** 2))) for part in unexplained]
    largest = float(np.linalg.norm(unexplained[0] * per_micro, axis=1).max())
    return CrossValidation(rms[0], largest, blocks, name, rms[1], squares[1] - squares[0])


def blocks_of(measurement: Measurement) -> tuple[np.ndarray, str]:
    """Labels `(n,)` of blocks, and the name of the blocks.

    Runs where there are three or more; for an interferometer every eighth position, so that the neighbours of a gap
    are known; lines for a measurement on diagonals; else cells of space.
    """
    if measurement.run is not None and measurement.instrument.components > 1 and len(np.unique(measurement.run)) > 2:
        return np.unique(measurement.run, return_inverse=True)[1], "runs"
    diagonals = lines(measurement)
    return cells(measurement) if diagonals is None else (diagonals, "lines")


def lines(measurement: Measurement) -> np.ndarray | None:
    """Numbers `(n,)` of the lines on which successive positions lie; None unless these are a few diagonals.

    On a diagonal two or more linear axes move. A few (LEAST_LINES to MOST_LINES) diagonals determine the errors between
    them poorly.
    """
    linear = np.flatnonzero(~measurement.machine.rotary)
    positions = measurement.state.positions[:, linear]
    if measurement.axis is not None or measurement.across is not None or len(positions) < LEAST_OF_LINE:
        return None
    keys = np.empty((len(positions), 2 * len(linear)))
    start = 0
    while start < len(positions):
        end, key = _line(positions, start)
        if end - start < LEAST_OF_LINE or np.count_nonzero(np.abs(key[: len(linear)]) > 0.01 * FINE) < 2:
            return None
        keys[start:end], start = key, end
    numbers = np.unique(np.round(keys / LINE_MM), axis=0, return_inverse=True)[1].reshape(-1)
    return np.asarray(numbers) if LEAST_LINES <= numbers.max() + 1 <= MOST_LINES else None


def _line(positions: Array, start: int) -> tuple[int, Array]:
    """End of the line of positions `(n, d)` that begins at `start`; its direction, times FINE, and foot `(2 d,)`."""
    away = np.linalg.norm(positions[start:] - positions[start], axis=1)
    second = start + int(np.argmax(away > LINE_MM))
    along = positions[second] - positions[start]
    direction = along / max(float(np.linalg.norm(along)), LINE_MM)
    direction = direction * (1.0 if direction[np.argmax(np.abs(direction))] > 0 else -1.0)
    apart = positions[start:] - positions[start]
    off = np.linalg.norm(apart - np.outer(apart @ direction, direction), axis=1) > LINE_MM
    end = start + int(np.argmax(off)) if off.any() else len(positions)
    foot = positions[start] - (positions[start] @ direction) * direction
    return end, np.concatenate([direction * FINE, foot])


def cells(measurement: Measurement) -> tuple[np.ndarray, str]:
    """Labels `(n,)` of cells of space, or of sets of positions for an interferometer, and their name."""
    if measurement.axis is not None:
        return _every_eighth(measurement), "sets of positions"
    labels = np.zeros(len(measurement), int)
    positions = measurement.state.positions / np.maximum(np.ptp(measurement.state.positions, axis=0), 1e-9)
    while labels.max() + 1 < CELLS:
        before = labels.max() + 1
        for label in range(before):
            rows = np.flatnonzero(labels == label)
            widest = int(np.argmax(np.ptp(positions[rows], axis=0)))
            middle = np.median(np.unique(positions[rows, widest]))
            upper = rows[positions[rows, widest] > middle]
            if len(upper):
                labels[upper] = labels.max() + 1
        if labels.max() + 1 == before:  # fewer positions than cells
            break
    return labels, "cells of space"


def _every_eighth(measurement: Measurement) -> np.ndarray:
    """Labels `(n,)`: numbers of the positions along the measured axis, modulo CELLS."""
    assert measurement.axis is not None
    labels = np.zeros(len(measurement), int)
    for name in np.unique(measurement.axis).tolist():
        rows = np.flatnonzero(measurement.axis == name)
        position = np.round(measurement.state.positions[rows, measurement.machine.index(name)], 6)
        labels[rows] = np.unique(position, return_inverse=True)[1] % CELLS
    return labels


def registered(measurement: Measurement, others: np.ndarray) -> np.ndarray:
    """True `(n,)` for rows whose set-up, and target on table or bed, have enough rows among the `others`."""
    few = POSE if measurement.instrument.components > 1 else 1
    predicted = np.ones(len(measurement), bool)
    known = np.array([target.known for target in measurement.targets.values()])
    for labels, needed in ((measurement.groups, True), (measurement.target_number, ~known[measurement.target_number])):
        _, number = np.unique(labels, return_inverse=True)
        predicted &= (np.bincount(number, others)[number] >= few) | ~np.asarray(needed)
    return predicted
