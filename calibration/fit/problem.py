"""One least squares problem: the constants of a fit, and one step of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError

from calibration.fit.linear import Posterior, effective_parameters, pseudo_inverse
from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import (
    Derivatives,
    NormalEquations,
    assemble,
    derivatives,
    residuals,
    whitened,
)
from calibration.observation.outliers import refuse_lines
from calibration.registration.registration import Registration
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array
from kinematics.user_error import UserError

UNSEEN_EIGENVALUE = 1e-10
"""Eigenvalues below this share of the largest count as zero."""

FIXED = 1e-9
"""Prior standard deviation of a parameter that is held."""
KEPT_DERIVATIVES = 8_000_000
"""Most numbers of derivatives of all rows that are kept."""
REWEIGHTINGS = 3
"""Most changes of the weights for one step."""
SETTLED_WEIGHT = 1e-3
"""Largest change of a weight that is left aside."""
OVER_RELAXATION = 1.9
"""Over-relaxation of every other step: with Huber weights a Gauss-Newton step is too short. Below 2 the objective
cannot rise by it."""
MOST_STEP_HALVINGS = 12
"""Largest number of halvings of a step that raises the objective."""
ROUNDING_OF_OBJECTIVE = 1e-9
"""Rise of the objective that is rounding."""


@dataclass(frozen=True)
class Point:
    """Parameters and registration in an iteration, with the residuals."""

    parameters: Array
    """Parameters `(p,)` of the model, in their units."""
    registration: Registration
    residual: Array
    """Observed minus expected `(n, d)`, mm and rad, of the rows of the problem."""

    @property
    def registered(self) -> int:
        """Number of parameters of the registration."""
        return len(self.registration.names)


class Solved(NamedTuple):
    """One solution of the normal equations."""

    step: Array
    """Step of the registration, then of the parameters."""
    length: float
    """RMS length of the parameters' step in standard uncertainties."""
    information: Array
    """Information of the data on the parameters `(p, p)`, in units of their priors, registration eliminated."""
    machine_information: Array
    """The same for an instrument whose position is known."""
    registered: int
    """Rank of the registration."""
    reduction: float
    """Reduction of the sum of squares by the step, to first order."""
    log_determinant: float
    """Log determinant of the normal matrix with its priors."""

    @property
    def parameters(self) -> int:
        """Number of parameters of the model, plus the rank of the registration: an upper limit of `rank`."""
        return len(self.information) + self.registered

    @property
    def effective_parameters(self) -> float:
        """Degrees of freedom that the data determine: a direction counts as far as the data outweigh the prior."""
        return effective_parameters(self.information) + self.registered

    @property
    def rank(self) -> int:
        """Degrees of freedom that the data would determine without noise."""
        values = np.linalg.eigvalsh(self.information)
        return (
            int(np.count_nonzero(values > UNSEEN_EIGENVALUE * max(float(values.max(initial=0.0)), 1.0)))
            + self.registered
        )


class Reweighted(NamedTuple):
    """A solution with the weights of the rows after its step."""

    solved: Solved
    weights: Array
    """`(n,)`"""
    normal: NormalEquations
    """With these weights."""


@dataclass(frozen=True)
class Problem:
    """Measurement, model and priors."""

    measurement: Measurement
    model: ErrorModel
    """The model with its parameters at the start."""
    white: Array
    """Matrices `(n, d, d)` of `calibration.observation.normal_equations.whiteners`."""
    stop: np.ndarray
    """Number `(n,)` of the stop of each row in the whole measurement."""
    prior: Array
    """Standard deviations `(p,)` about the start, infinite for none; or a root L `(p, p)` of their covariance L L'."""

    @classmethod
    def of(cls, measurement: Measurement, model: ErrorModel, prior: Array) -> Problem:
        """The problem, whitened by the covariance of the measurement.

        UserError where the points of a station lie on one line, about which its rotation is undetermined.
        """
        found = cls(measurement, model, measurement.whiteners, measurement.stops, prior)
        refuse_lines(measurement)
        return found

    def rows(self, index: np.ndarray) -> Problem:
        """The problem with some of its rows."""
        rows = self.measurement.rows(index)
        return replace(self, measurement=rows, white=self.white[index], stop=self.stop[index])

    def shapes_fixed(self) -> Problem:
        """The problem with its periods and time constants held."""
        linear = self.linear
        if self.prior.ndim == 1:
            return replace(self, prior=np.where(linear, self.prior, FIXED))
        return replace(self, prior=self.prior * np.outer(linear, linear) + np.diag(np.where(linear, 0.0, FIXED)))

    def at(self, parameters: Array) -> ErrorModel:
        """The model with these parameters."""
        return self.model.with_parameters(parameters)

    def point(self, parameters: Array, registration: Registration) -> Point:
        """A point, with the residuals of the rows of this problem."""
        return Point(parameters, registration, residuals(self.measurement, self.at(parameters), registration))

    def whitened(self, residual: Array) -> Array:
        """The residuals `(n, d)`, in standard uncertainties."""
        return whitened(self.white, residual)

    def distances(self, point: Point) -> Array:
        """Squared Mahalanobis distances `(n,)` of the residuals."""
        return np.asarray(np.sum(self.whitened(point.residual) ** 2, axis=1))

    def decorrelation(self, weights: Array) -> Decorrelation:
        """The transform that makes rows of one stop independent, with weights `(n,)` of the rows."""
        return Decorrelation.of(self.measurement.noise, self.white, weights)

    def squares(self, point: Point, weights: Array, decorrelation: Decorrelation | None = None) -> float:
        """Sum of squares of the white residuals, with weights `(n,)` of the rows; decorrelation: the one of these."""
        decorrelation = decorrelation or self.decorrelation(weights)
        return float(np.sum(decorrelation.apply(self.whitened(point.residual) * np.sqrt(weights)[:, None]) ** 2))

    def variance_factor(self, point: Point, kept: np.ndarray, solved: Solved) -> float:
        """Variance factor at which chi2 of the kept rows equals its expectation."""
        scalars = int(np.count_nonzero(kept)) * self.measurement.components
        return self.squares(point, kept.astype(float)) / max(scalars - solved.effective_parameters, 1.0)

    def moved(self, point: Point, step: Array) -> Point:
        """The point after a step; a parameter that would cross its bound goes half-way to it instead."""
        size = point.registered
        return self.point(self._inside(point.parameters, step[size:]), point.registration.moved(step[:size]))

    def descended(
        self, point: Point, step: Array, weights: Array, factor: float, decorrelation: Decorrelation
    ) -> tuple[Point, int]:
        """The point after a step, halved until the objective does not rise, and the number of halvings.

        The same point if every halving fails. The objective: with weights `(n,)` of the rows, their decorrelation, and
        the instrument's variances times `factor`.
        """

        def objective(at: Point) -> float:
            away = self.away(at.parameters)
            distances = self.measurement.instrument.stated_residuals(self.measurement, at.registration)
            squares = self.squares(at, weights, decorrelation) / factor
            return squares + float(distances @ distances) + float(away @ away)

        limit = objective(point) * (1.0 + ROUNDING_OF_OBJECTIVE) + ROUNDING_OF_OBJECTIVE
        shortened = ((self.moved(point, 0.5**k * step), k) for k in range(MOST_STEP_HALVINGS))
        return next((found for found in shortened if objective(found[0]) <= limit), (point, MOST_STEP_HALVINGS))

    def derivatives(self, point: Point) -> Derivatives:
        """Derivatives of the observations at a point, not whitened."""
        found = derivatives(self.measurement, self.at(point.parameters), point.registration)
        assert found is not None
        return found

    def few_derivatives(self, point: Point) -> Derivatives | None:
        """The same; None where they are too many to be kept."""
        return derivatives(self.measurement, self.at(point.parameters), point.registration, KEPT_DERIVATIVES)

    def solve(
        self,
        point: Point,
        weights: Array,
        factor: float,
        derivatives: Derivatives | None = None,
    ) -> Solved:
        """The Gauss-Newton step at a point; weights `(n,)` of the rows; the instrument's variances times `factor`.

        derivatives: those of a point near by, as `Problem.derivatives`; at the point itself when None.
        """
        normal = self._assembled(point, weights, factor, derivatives)
        normal.add_stated(self.measurement, point.registration)
        return self.solution(normal, point)

    def solve_reweighted(
        self, point: Point, weights_of: Callable[[Array], Array], factor: float, derivatives: Derivatives
    ) -> Reweighted:
        """The step at a point with the weights that the rows have after it, to first order.

        weights_of: weights of rows by their squared distances `(n,)`; the others as in `solve`.
        """
        weights = weights_of(self.distances(point))
        normal = self._assembled(point, weights, factor, derivatives)
        normal.add_stated(self.measurement, point.registration)
        solved = self.solution(normal, point)
        aim = np.zeros(len(solved.step))
        for k in range(REWEIGHTINGS):
            aim = aim + (solved.step - aim) * (OVER_RELAXATION if k % 2 else 1.0)
            residual = point.residual - derivatives.times(aim)
            after = weights_of(np.sum(self.whitened(residual) ** 2, axis=1))
            rows = self._with_their_stops(np.abs(after - weights) > SETTLED_WEIGHT)
            if not len(rows):
                break
            some, there = self.rows(rows), replace(point, residual=point.residual[rows])
            assembled = partial(some._assembled, there, factor=factor, derivatives=derivatives.rows(rows))
            normal.replace(assembled(weights[rows]), assembled(after[rows]))
            weights[rows] = after[rows]
            solved = self.solution(normal, point)
        return Reweighted(solved, weights, normal)

    def shapes_of(self, step: Array, point: Point) -> Array:
        """The part of a step that moves periods and time constants, in their units."""
        return np.asarray(step[point.registered :][~self.linear])

    def step_with_shapes(self, shapes: Array, point: Point, normal: NormalEquations) -> Array:
        """The step `(size,)` that moves periods and time constants as given, and all else as well as possible then."""
        fixed = self.shapes_fixed()
        away = fixed.away(np.where(self.linear, point.parameters, self.model.parameters))
        away[~self.linear] = -shapes / FIXED
        return solution(normal, point.registration, fixed.prior, away).step

    def _assembled(
        self,
        point: Point,
        weights: Array,
        factor: float,
        derivatives: Derivatives | None,
    ) -> NormalEquations:
        """The normal equations of the rows, without the stated values of the registration; arguments as in `solve`."""
        root = np.sqrt(weights / factor)
        decorrelation = self.decorrelation(weights)
        residual = decorrelation.apply(self.whitened(point.residual) * root[:, None])
        white = self.white * root[:, None, None]
        if derivatives is None:
            model = self.at(point.parameters)
            return assemble(self.measurement, model, point.registration, white, residual, decorrelation)
        return derivatives.whitened(white, decorrelation).normal(residual)

    def _with_their_stops(self, rows: np.ndarray) -> np.ndarray:
        """Indices of the rows marked `(n,)`, and of those whose noise is shared with theirs."""
        noise = self.measurement.noise
        shared = rows if noise is None else np.isin(noise.stop, noise.stop[rows])
        return np.flatnonzero(shared)

    def covariance(self, solved: Solved, widened: float = 1.0) -> Array:
        """Covariance `(p, p)` of the parameters, in their units, with the data's variances times `widened`."""
        root, limited = _root(self.prior)
        values, vectors = np.linalg.eigh(solved.information / widened + np.diag(limited))
        # each direction is known at least as well as by its prior, also after rounding
        least = 1.0 if limited.all() else np.finfo(float).eps * values[-1]
        half = _times((vectors / np.sqrt(np.maximum(values, least))).T, root.T).T
        return np.asarray(half @ half.T)

    def solution(self, normal: NormalEquations, point: Point) -> Solved:
        """The solution of normal equations that were assembled at a point, priors included."""
        return solution(normal, point.registration, self.prior, self.away(point.parameters))

    def away(self, parameters: Array) -> Array:
        """Distances `(p,)` of parameters from their start, in units of their priors; 0 without a prior."""
        root, limited = _root(self.prior)
        moved = parameters - self.model.parameters
        return np.asarray((moved / root if root.ndim == 1 else np.linalg.solve(root, moved)) * limited)

    def _inside(self, parameters: Array, step: Array) -> Array:
        moved, bounds = parameters + step, self._bounds
        return np.where(moved <= bounds, (parameters + np.where(np.isfinite(bounds), bounds, 0.0)) / 2, moved)

    @cached_property
    def linear(self) -> np.ndarray:
        """True `(p,)` for parameters on which the observations depend linearly."""
        return np.array([flag for effect in self.model.effects for flag in effect.linear], bool)

    @cached_property
    def _bounds(self) -> Array:
        return np.array([q.lower for effect in self.model.effects for q in effect.parameter_table])


def solution(normal: NormalEquations, registration: Registration, prior: Array, away: Array) -> Solved:
    """The solution of normal equations with priors; UserError where there is none.

    prior: as `Problem.prior`; away `(p,)`: as `Problem.away`.
    """
    size = len(registration.names)
    root, limited = _root(prior)
    scales = _registration_scale(normal, registration)
    own = normal.matrix[:size, :size] * np.outer(scales, scales)
    mixed = _times(normal.matrix[:size, size:], root) * scales[:, None]
    machine = _between(normal.matrix[size:, size:], root)
    right = np.concatenate([normal.right[:size] * scales, _times(normal.right[size:], root)])
    half, _, spread = registered = pseudo_inverse(own, UNSEEN_EIGENVALUE, 1.0)
    eliminated = mixed.T @ half
    information = machine - eliminated @ eliminated.T
    eliminated_right = right[size:] - eliminated @ (half.T @ right[:size]) - away
    try:
        # parameters that neither the data nor a prior determines do not move
        posterior = Posterior(information + np.diag(limited), UNSEEN_EIGENVALUE * (1.0 + np.diag(information)))
    except LinAlgError:
        raise UserError(
            "the equations of the fit have no solution: positions or readings of the data differ by so many orders of "
            "magnitude that one of them must have a wrong unit or number"
        ) from None
    parameters = posterior.solve(eliminated_right)
    step_of_own = half @ (half.T @ (right[:size] - mixed @ parameters))
    length = float(np.sqrt(max(parameters @ eliminated_right, 0.0) / max(len(parameters), 1)))
    log_determinant = posterior.log_determinant + spread - 2.0 * float(np.sum(np.log(scales)))
    reduction = float(right @ np.concatenate([step_of_own, parameters]))
    step = np.concatenate([step_of_own * scales, _times(parameters, root.T)])
    return Solved(step, length, information, machine, registered.rank, reduction, log_determinant)


def _root(prior: Array) -> tuple[Array, Array]:
    """Factor from units of the priors to the units of the parameters: `(p,)`, or `(p, p)` from the left.

    With it: 1 `(p,)` for parameters with a prior, 0 for others.
    """
    if prior.ndim == 2:
        return prior, np.ones(len(prior))
    limited = np.isfinite(prior)
    return np.where(limited, prior, 1.0), limited.astype(float)


def _registration_scale(normal: NormalEquations, registration: Registration) -> Array:
    """Units that make the diagonal of the registration's part 1, but smaller for rotations with an arm below 1 mm.

    A station that observed one position is shifted, not rotated: over an arm of um no rotation can replace a shift.
    """
    diagonal = np.diag(normal.matrix)[: len(registration.names)].copy()
    moves = len(registration.moves)
    poses = diagonal[: moves * len(registration.poses)].reshape(-1, moves)
    turns = [k for k, move in enumerate(registration.moves) if move in "ABC"]
    shifts = np.delete(poses, turns, axis=1)
    poses[:, turns] = np.maximum(poses[:, turns], shifts.max(axis=1, keepdims=True))
    return np.asarray(1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)))


def _times(block: Array, root: Array) -> Array:
    """The block times the root; a root `(p,)` is the diagonal of one."""
    return np.asarray(block * root if root.ndim == 1 else block @ root)


def _between(block: Array, root: Array) -> Array:
    """L' A L of a symmetric block A and a root L; a root `(p,)` is the diagonal of one."""
    if root.ndim == 1:
        return np.asarray(block * np.outer(root, root))
    between = root.T @ block @ root
    return np.asarray((between + between.T) / 2)
