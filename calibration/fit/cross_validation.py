"""Cross-validation: a fit of all other rows predicts each block of rows.

Blocks are lines and regions of stops, cycles, or positions with all their rows: never single rows, because the rows of
the same stop, and its neighbours, determine a single row.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from calibration.fit.fit import Fit, fit
from calibration.fit.problem import Point, Problem
from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import priors
from calibration.observation.normal_equations import (
    Derivatives,
    NormalEquations,
    assemble,
    residuals,
    whitened,
)
from calibration.observation.outliers import Variance, refuse_lines
from calibration.observation.stops_and_lines import held_out_blocks
from calibration.registration.registration import Registration
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.running.progress import Progress, silent
from kinematics.transforms import Array
from kinematics.user_error import UserError

POSE = 6
"""Smallest number of rows that locates a set-up, or a target of unknown position, well enough to predict other rows."""
OWN_ZERO = 4
"""Smallest number of rows of a run of an interferometer that show its zero and predict one another beside it."""
AGREEING_BLOCK_SHARE = 0.75
"""Share of blocks that agree in sign from which a difference counts although it is within its standard error: a few
blocks may hold most of the squares."""


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

    Beyond it: the sum exceeds its standard error, or a share of `AGREEING_BLOCK_SHARE` of the blocks has its sign.
    """
    n, total = len(gains), float(gains.sum())
    if n < 2 or total == 0.0:
        return 0
    alike = np.count_nonzero(gains * total > 0.0)
    sure = abs(total) > np.sqrt(n * gains.var(ddof=1)) or alike >= AGREEING_BLOCK_SHARE * n
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


class Fitted(Protocol):
    """A model and a registration that were fitted to some rows, as a `Fit` is."""

    @property
    def model(self) -> ErrorModel:
        """The model with fitted parameters."""

    @property
    def registration(self) -> Registration:
        """The fitted registration."""


Refit = Callable[[np.ndarray], Fitted]
"""A fit of the rows in a mask `(n,)`; UserError for rows that cannot be fitted."""


def cross_validate(
    good: Measurement,
    model: ErrorModel,
    prior: Array,
    variance: Variance = "sheet",
    near: Fit | None = None,
    progress: Progress = silent,
) -> CrossValidation | None:
    """Residuals of each block under a fit of the others; None when there are too few rows for blocks.

    good: without outliers and copies. near: a fit of the same model to all of these rows. progress gets the present
    block and the number of blocks.
    """
    refit = _refit(good, model, prior, variance, near)
    return predicted_by_others(good, *held_out_blocks(good), refit, uncorrected(model), progress)


def _is_linear(model: ErrorModel) -> bool:
    """True where the errors of a row are linear in the parameters, and do not depend on other rows."""
    return not any(effect.HAS_MEMORY for effect in model.effects) and all(
        parameter.linear for effect in model.effects for parameter in effect.parameter_table
    )


def _refit(
    good: Measurement, model: ErrorModel, prior: Array, variance: Variance = "sheet", near: Fit | None = None
) -> Refit:
    """Fits of a model to most rows of a measurement: without iterations, where the fit of all leaves no row out.

    near: a fit of which these are the kept rows. An interferometer's runs have zeros that their own rows determine.
    Circles in one plane leave the table ball free across it, where the distance is not linear.
    """
    linear = not good.axis_rows and not good.instrument.ON_CIRCLES and _is_linear(model)
    if variance == "sheet" and linear:
        with suppress(UserError):
            whole = fit(good, model, prior=prior) if near is None else near
            if not whole.suspected.any() and (near is not None or whole.kept.all()):
                problem = Problem.of(good, model, prior)
                return LeavingOut(problem, problem.point(whole.model.parameters, whole.registration))

    def refit(others: np.ndarray) -> Fit:
        return fit(good.rows(np.flatnonzero(others)), model, prior=prior, variance=variance)

    return refit


class _Fitted(NamedTuple):
    model: ErrorModel
    registration: Registration


@dataclass(frozen=True)
class LeavingOut:
    """Fits of a linear model to most rows: the other rows are taken out of the normal equations of all."""

    problem: Problem
    point: Point
    """The fit of all rows."""

    def __call__(self, others: np.ndarray) -> Fitted:
        """The fit of the rows in the mask `(n,)`; UserError for rows that cannot be fitted."""
        refuse_lines(self.problem.measurement.rows(np.flatnonzero(others)))
        left_out = self._normal(np.flatnonzero(~others))
        normal = NormalEquations(self._whole.matrix - left_out.matrix, self._whole.right - left_out.right)
        fitted = self.problem.moved(self.point, self.problem.solution(normal, self.point).step)
        if self._design is not None:  # of few rows the step is large: again, with the exact residuals
            right = self._design.rows(others).along(self._white(fitted)[others])
            again = NormalEquations(normal.matrix - self._distances.matrix, right)
            again.add_stated(self.problem.measurement, fitted.registration)
            solved = self.problem.solution(again, fitted)
            fitted = self.problem.moved(fitted, solved.step)
        return _Fitted(self.problem.at(fitted.parameters), fitted.registration)

    @cached_property
    def _whole(self) -> NormalEquations:
        normal = self._normal(np.arange(len(self.problem.measurement)))
        normal.add_stated(self.problem.measurement, self.point.registration)
        return normal

    @cached_property
    def _distances(self) -> NormalEquations:
        """The normal equations of the calibrated distances between spheres, which no block holds."""
        normal = NormalEquations.zero(self.point.registered + len(self.point.parameters))
        normal.add_stated(self.problem.measurement, self.point.registration)
        return normal

    @cached_property
    def _design(self) -> Derivatives | None:
        """Whitened derivatives; None where they are too many to be kept."""
        derivatives = self.problem.few_derivatives(self.point)
        return None if derivatives is None else derivatives.whitened(self.problem.white, self._decorrelation)

    @cached_property
    def _decorrelation(self) -> Decorrelation:
        return Decorrelation.of(self.problem.measurement.noise, self.problem.white)

    def _white(self, point: Point) -> Array:
        return self._decorrelation.apply(self.problem.whitened(point.residual))

    def _normal(self, rows: np.ndarray) -> NormalEquations:
        """The normal equations of some rows, at the fit of all."""
        part, model = self.problem.rows(rows), self.problem.at(self.point.parameters)
        decorrelation = Decorrelation.of(part.measurement.noise, part.white)
        residual = decorrelation.apply(part.whitened(self.point.residual[rows]))
        return assemble(part.measurement, model, self.point.registration, part.white, residual, decorrelation)


def predicted_by_others(
    good: Measurement,
    labels: np.ndarray,
    name: str,
    refit: Refit,
    other: ErrorModel | None = None,
    progress: Progress = silent,
) -> CrossValidation | None:
    """Residuals of each block of rows under `refit`, and under another model, of the other rows.

    other: by default the nominal machine. labels `(n,)`: numbers of the blocks; negative for rows of no block. Rows
    whose set-up or target hardly occurs in the others depend on the registration, not on the machine, and do not count;
    a run of an interferometer that the others lack has a zero of its own. None if too few rows count.
    """
    unexplained = np.full((2, len(good), good.components), np.nan)
    other = no_errors(good.machine) if other is None else other
    refits = refit, _refit(replace(good, noise=None), other, priors(other))
    blocks = np.unique(labels[labels >= 0])
    for number, label in enumerate(blocks, start=1):
        progress(f"held-out residuals: {number} of {len(blocks)} blocks", (number - 1) / len(blocks))
        others = labels != label
        predicted = ~others & registered(good, others)
        if not predicted.any():
            continue
        for i, each in enumerate(refits):
            try:
                found = each(others)
            except UserError:  # the other rows alone cannot be fitted
                return None
            # effects with memory need the rows in between
            unexplained[i, predicted] = _with_own_zeros(good, ~others, found)[predicted]
    predicted = ~np.isnan(unexplained[0, :, 0])
    if 2 * predicted.sum() < len(good):
        return None
    part = good.rows(predicted)
    return summed_up(unexplained[:, predicted], part.whiteners, part.per_micro, labels[predicted], name)


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


def _with_own_zeros(measurement: Measurement, block: np.ndarray, found: Fitted) -> Array:
    """Residuals `(n, d)` of all rows; runs of the block that the fit lacks have zeros and slopes of their own."""
    if not measurement.axis_rows:
        return residuals(measurement, found.model, found.registration)
    missing = np.flatnonzero(block & ~np.isin(measurement.groups, list(found.registration.zeros)))
    if not len(missing):
        return residuals(measurement, found.model, found.registration)
    some = measurement.rows(missing)
    own = some.instrument.first_registration(some, np.ones(len(some), bool))
    zeros = {**found.registration.zeros, **dict.fromkeys(own.zeros, 0.0)}
    residual = residuals(measurement, found.model, replace(found.registration, zeros=zeros))
    residual[missing] = less_columns(residual[missing], some.instrument.registration_design(some, own)[:, 0])
    return residual


def less_columns(values: Array, columns: Array) -> Array:
    """Values `(n, k)` without their part along columns `(n, p)`, enlarged to the variance that noise had before."""
    if not columns.shape[1]:
        return values
    along = np.linalg.qr(columns)[0]
    return np.asarray(
        (values - along @ (along.T @ values)) * np.sqrt(len(values) / max(len(values) - along.shape[1], 1))
    )


def registered(measurement: Measurement, others: np.ndarray) -> np.ndarray:
    """True `(n,)` for rows whose set-up, zero, and target of unknown position have enough rows among the `others`.

    The zero of a run of an interferometer may also come from its own rows, where it has OWN_ZERO or more.
    """
    predicted = np.ones(len(measurement), bool)
    if measurement.axis_rows:
        _, number = np.unique(measurement.groups, return_inverse=True)
        return np.asarray((np.bincount(number, others)[number] >= 1) | (np.bincount(number)[number] >= OWN_ZERO))
    known = np.array([target.known for target in measurement.targets.values()])
    zeros = measurement.instrument.zero_names(measurement)
    unknown = ~known[measurement.target_number]
    for labels, needed in ((measurement.groups, True), (zeros, True), (measurement.target_number, unknown)):
        _, number = np.unique(labels, return_inverse=True)
        predicted &= (np.bincount(number, others)[number] >= POSE) | ~np.asarray(needed)
    return predicted
