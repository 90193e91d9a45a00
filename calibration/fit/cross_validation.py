"""Cross-validation: a fit of all other rows predicts each block of rows.

Blocks are lines and regions of stops, cycles, or positions with all their rows: never single rows, because the rows of
the same stop, and its neighbours, determine a single row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import Fit, fit
from calibration.measurement.measurement import Measurement
from calibration.observation import equations
from calibration.observation.normal_equations import residuals, whitened, whiteners
from calibration.observation.outliers import Variance
from calibration.observation.stops_and_lines import held_out_blocks, lines
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.transforms import Array
from kinematics.user_error import UserError

POSE = 6
"""Smallest number of rows that locates a set-up, or a target of unknown position, well enough to predict other rows."""
OWN_ZERO = 4
"""Smallest number of rows of a run of an interferometer that show its zero and predict one another beside it."""
MOSTLY = 0.75
"""Share of blocks that agree in sign from which a difference counts although it is within its standard error: a few
blocks may hold most of the squares."""
LEAST_LINES, MOST_LINES = 3, 24
"""Fewer diagonals do not predict each other; more of them fill the volume."""
MOVING = 0.01
"""Least range of an axis that moves in a line, as a share of the largest one."""


class Gains(NamedTuple):
    """Sums of squares of the held-out residuals of another model minus those of this one, by block `(blocks,)`."""

    um: Array
    """um2 (rotary axes of an interferometer: urad2)."""
    noise: Array
    """In units of the instrument's variance."""

    @property
    def better(self) -> bool:
        """True where this model predicts better beyond the spread of the blocks, in one unit or both, in none worse."""
        return {1} <= self._signs <= {0, 1}

    @property
    def worse(self) -> bool:
        """True where it predicts worse beyond the spread of the blocks, in one unit or both, in none better."""
        return {-1} <= self._signs <= {0, -1}

    @property
    def _signs(self) -> set[int]:
        return {_sign(self.um), _sign(self.noise)}


def _sign(gains: Array) -> int:
    """1 for a gain beyond the spread of the blocks, -1 for such a loss, 0 for a difference within it.

    Beyond it: the sum exceeds its standard error, or a share of MOSTLY of the blocks has its sign.
    """
    n, total = len(gains), float(gains.sum())
    if n < 2 or total == 0.0:
        return 0
    alike = np.count_nonzero(gains * total > 0.0)
    sure = abs(total) > np.sqrt(n * gains.var(ddof=1)) or alike >= MOSTLY * n
    return int(np.sign(total)) if sure else 0


class CrossValidation(NamedTuple):
    """Residuals of blocks of rows under fits of the other rows."""

    rms_um: float
    """RMS residual per scalar, um; urad on rotary axes of an interferometer."""
    max_um: float
    """Largest length of the residual of a row, um; urad on rotary axes of an interferometer."""
    blocks: int
    """Number of blocks."""
    name: str
    """Name of the blocks, plural: lines, regions of stops, cycles, ..."""
    other_rms_um: float
    """RMS residual of the same rows under the other model, the nominal machine, registered by the others, um."""
    improvement: float
    """Mean square residual of the other model minus that of the fit, in units of the instrument's variance."""
    gains: Gains
    """Gains of the fit over the other model, by block."""


def cross_validate(
    measurement: Measurement, model: ErrorModel, prior: Array, kept: np.ndarray, variance: Variance = "sheet"
) -> CrossValidation | None:
    """Residuals of each block under a fit of the others; None when there are too few rows for blocks.

    kept: mask `(n,)` of the rows to be used, outliers left out.
    """
    good = measurement.rows(np.flatnonzero(kept))
    refit = partial(fit, model=model, prior=prior, variance=variance)
    return predicted_by_others(good, *held_out_blocks(good), refit, uncorrected(model))


def predicted_by_others(
    good: Measurement,
    labels: np.ndarray,
    name: str,
    refit: Callable[[Measurement], Fit],
    other: ErrorModel | None = None,
) -> CrossValidation | None:
    """Residuals of each block of rows under `refit`, and under another model, of the other rows.

    other: by default the nominal machine. labels `(n,)`: numbers of the blocks; negative for rows of no block. Rows
    whose set-up or target hardly occurs in the others depend on the registration, not on the machine, and do not count;
    a run of an interferometer that the others lack has a zero of its own. None if too few rows count.
    """
    unexplained = np.full((2, len(good), good.components), np.nan)
    other = no_errors(good.machine) if other is None else other
    refits: tuple[Callable[[Measurement], Fit], ...] = (refit, partial(fit, model=other))
    for label in np.unique(labels[labels >= 0]):
        predicted = (labels == label) & registered(good, labels != label)
        if not predicted.any():
            continue
        others = good.rows(np.flatnonzero(labels != label))
        for i, each in enumerate(refits):
            try:
                found = each(others)
            except UserError:  # the other rows alone cannot be fitted
                return None
            # effects with memory need the rows in between
            unexplained[i, predicted] = _with_own_zeros(good, labels == label, found)[predicted]
    predicted = ~np.isnan(unexplained[0, :, 0])
    if 2 * predicted.sum() < len(good):
        return None
    part = good.rows(predicted)
    return summed_up(unexplained[:, predicted], whiteners(part), part.per_micro, labels[predicted], name)


def uncorrected(model: ErrorModel) -> ErrorModel:
    """The nominal machine, measured by an instrument with the effects of the model."""
    return model.part(lambda effect: effect.ACTS_ON == "instrument")


def summed_up(unexplained: Array, whitener: Array, per_micro: Array, labels: np.ndarray, name: str) -> CrossValidation:
    """Statistics of the residuals `(2, n, d)`, mm and rad, of the fit and of the other model; labels: `(n,)`."""
    noise = [np.sum(whitened(whitener, residual) ** 2, axis=1) for residual in unexplained]
    um = [np.sum((residual * per_micro) ** 2, axis=1) for residual in unexplained]
    block = np.unique(labels, return_inverse=True)[1].reshape(-1)
    by_block = [np.asarray(np.bincount(block, other - own), float) for own, other in (um, noise)]
    gains = Gains(by_block[0], by_block[1])
    rms = [float(np.sqrt(squares.sum() / unexplained[0].size)) for squares in um]
    improvement = float((noise[1] - noise[0]).sum() / unexplained[0].size)
    return CrossValidation(rms[0], float(np.sqrt(um[0].max())), len(gains.um), name, rms[1], improvement, gains)


def _with_own_zeros(measurement: Measurement, block: np.ndarray, found: Fit) -> Array:
    """Residuals `(n, d)` of all rows; runs of the block that the fit lacks have zeros and slopes of their own."""
    if measurement.components > 1:
        return residuals(measurement, found.model, found.registration)
    missing = np.flatnonzero(block & ~np.isin(measurement.groups, list(found.registration.zeros)))
    if not len(missing):
        return residuals(measurement, found.model, found.registration)
    some = measurement.rows(missing)
    own = equations.start(some, np.ones(len(some), bool))
    zeros = {**found.registration.zeros, **dict.fromkeys(own.zeros, 0.0)}
    residual = residuals(measurement, found.model, replace(found.registration, zeros=zeros))
    residual[missing] = less_columns(residual[missing], equations.registration_design(some, own)[:, 0])
    return residual


def less_columns(values: Array, columns: Array) -> Array:
    """Values `(n, k)` without their part along columns `(n, p)`, enlarged to the variance that noise had before."""
    if not columns.shape[1]:
        return values
    along = np.linalg.qr(columns)[0]
    return np.asarray(
        (values - along @ (along.T @ values)) * np.sqrt(len(values) / max(len(values) - along.shape[1], 1))
    )


def diagonals(measurement: Measurement) -> np.ndarray | None:
    """Numbers `(n,)` of the lines on which the positions lie; None unless these are a few diagonals.

    On a diagonal two or more linear axes move. A few (LEAST_LINES to MOST_LINES) diagonals determine the errors between
    them poorly.
    """
    if measurement.axis is not None or measurement.across is not None:
        return None
    found, positions = lines(measurement), measurement.state.positions[:, ~measurement.machine.rotary]
    if (found < 0).any() or not LEAST_LINES <= found.max() + 1 <= MOST_LINES:
        return None
    ranges = np.array([np.ptp(positions[found == line], axis=0) for line in range(found.max() + 1)])
    moving = ranges > MOVING * ranges.max(axis=1, keepdims=True)
    return found if (np.count_nonzero(moving, axis=1) > 1).all() else None


def registered(measurement: Measurement, others: np.ndarray) -> np.ndarray:
    """True `(n,)` for rows whose set-up, and target of unknown position, have enough rows among the `others`.

    The zero of a run of an interferometer may also come from its own rows, where it has OWN_ZERO or more.
    """
    predicted = np.ones(len(measurement), bool)
    if measurement.components == 1:
        _, number = np.unique(measurement.groups, return_inverse=True)
        return np.asarray((np.bincount(number, others)[number] >= 1) | (np.bincount(number)[number] >= OWN_ZERO))
    known = np.array([target.known for target in measurement.targets.values()])
    for labels, needed in ((measurement.groups, True), (measurement.target_number, ~known[measurement.target_number])):
        _, number = np.unique(labels, return_inverse=True)
        predicted &= (np.bincount(number, others)[number] >= POSE) | ~np.asarray(needed)
    return predicted
