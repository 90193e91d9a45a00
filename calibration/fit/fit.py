"""The fit: errors of the machine and registration of the instrument, jointly, with uncertainties.

Whitened least squares with priors: minimise |W (observed - expected)|2 + |(parameters - start) / typical size|2. The
expected observations are exact, the steps use the first-order transform (Gauss-Newton). Parameters that the data do not
determine stay at the prior, with its uncertainty (design decision 5). Montavon et al. (6)-(22) take the pseudo-inverse
instead, whose finite uncertainties of such parameters have no meaning.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy import special

from calibration.fit.problem import Point, Problem, Solved
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import priors
from calibration.observation.normal_equations import decorrelation_of, whitened
from calibration.observation.outliers import (
    LeftOut,
    Variance,
    huber_weights,
    largest_distance,
    outlying,
    robust_factor,
)
from calibration.registration.registration import Registration
from kinematics.error_model.model import ErrorModel
from kinematics.running.progress import Progress, silent
from kinematics.transforms import Array
from kinematics.user_error import UserError

LEAST_VARIANCE_FACTOR = 1e-8
"""Smallest variance factor that is estimated, for exact data."""
EXCESS_SHARE = 0.2
"""Share of the observations that must exceed the parameters for a noise estimate below the instrument specification."""
ENOUGH_ROWS = 20_000
"""Largest number of rows in the iterations; the last step uses all rows."""
MOST_FIT_STEPS = 30
STEPS_OF_OUTLIERS = 10
"""Largest number of steps with all rows, each with the outliers that the last one showed."""
LAST_STEP_U = 1e-3
"""Length of a step, in standard uncertainties, below which the iteration ends."""
LARGEST_STEP_FACTOR = 8.0
"""Largest multiple, and smallest share, of a Gauss-Newton step that is tried."""
DOUBTFUL_P = 1e-3
"""p of chi2 below which the uncertainties of the instrument specification are widened to the residuals (Birge)."""


@dataclass(frozen=True)
class Fit:
    """The fitted model and registration; parameters in the units of the model, residuals in mm and rad."""

    measurement: Measurement
    """The measurement that was fitted."""
    start: ErrorModel
    """The model before the fit, about which its priors are."""
    model: ErrorModel
    """The model with fitted parameters, their standard uncertainties and their covariance."""
    registration: Registration
    """Position and orientation of the instrument at each station, mm and rad."""
    residual: Array
    """Observed minus expected `(n, d)`, of all rows."""
    kept: np.ndarray
    """False `(n,)` for outliers, failed stations and copies of rows."""
    copies: np.ndarray
    """True `(n,)` for rows that repeat an earlier one to the last digit."""
    suspected: np.ndarray
    """True `(n,)` for rows that disagree with the others but are kept, because they are too many for outliers."""
    failed: tuple[str, ...]
    """Stations left out as a whole."""
    away: Array
    """Distances `(p,)` of the parameters from their start, in units of their priors; 0 without a prior."""
    prior: Array
    """Prior standard deviations `(p,)`, infinite for none; or a root `(p, p)` of their covariance."""
    solved: Solved
    """Parameters with their covariance."""
    chi2: float
    """Sum of squares of the white residuals of the kept rows, by the noise of the measurement."""
    variance_factor: float
    """Factor on the variances of the instrument specification in the fit: 1, or estimated from the residuals."""

    @cached_property
    def good(self) -> Measurement:
        """The measurement with the rows that were kept."""
        return self.measurement.rows(np.flatnonzero(self.kept))

    @property
    def observations(self) -> int:
        """Number of fitted scalars."""
        return int(np.count_nonzero(self.kept) * self.residual.shape[1])

    @cached_property
    def effective_parameters(self) -> float:
        """Degrees of freedom that the data determine."""
        return self.solved.effective_parameters

    @property
    def degrees_of_freedom(self) -> float:
        """Observations less effective parameters."""
        return max(self.observations - self.effective_parameters, 1.0)

    @property
    def chi2_reduced(self) -> float:
        """chi2 per degree of freedom, by the instrument specification; 1 when the model explains all but the noise."""
        if self.measurement.noise is None:
            return self.chi2 / self.degrees_of_freedom
        kept = replace(self.measurement, noise=None).rows(self.kept)
        return float(np.sum(whitened(kept.whiteners, self.residual[self.kept]) ** 2)) / self.degrees_of_freedom

    @property
    def p_value(self) -> float:
        """One-sided p of chi2 by the noise of the fit: small when the model lacks an effect, or this noise is small."""
        return float(special.chdtrc(self.degrees_of_freedom, self.chi2))

    @property
    def doubtful(self) -> bool:
        """True where the residuals are larger than the noise of the fit allows."""
        return self.variance_factor == 1.0 and self.p_value < DOUBTFUL_P

    @property
    def widening(self) -> float:
        """Factor on the variances of the fit by which its uncertainties are widened; 1 unless it is doubtful."""
        return self.chi2 / self.degrees_of_freedom if self.doubtful else 1.0

    @property
    def noise_factor(self) -> float:
        """Factor on the variances of the instrument specification in the noise of the fit."""
        noise = self.measurement.noise
        return self.variance_factor * (1.0 if noise is None else noise.instrument_factor)

    @property
    def white(self) -> Array:
        """Residuals `(n, d)` of all rows in units of the noise of the fit; those of one stop are independent."""
        own = whitened(self.measurement.whiteners, self.residual)
        return np.asarray(decorrelation_of(self.measurement).apply(own) / self.variance_factor**0.5)

    @property
    def rms_um(self) -> float:
        """RMS residual of the kept rows per scalar, um; urad on rotary axes of an interferometer."""
        return float(np.sqrt(np.mean((self.residual * self.measurement.per_micro)[self.kept] ** 2)))

    @property
    def max_um(self) -> float:
        """Largest length of the residual of a kept row, um; urad on rotary axes of an interferometer."""
        return float(self.residual_um[self.kept].max())

    @property
    def residual_um(self) -> Array:
        """Lengths `(n,)` of the residuals, um; urad on rotary axes of an interferometer."""
        return np.asarray(np.linalg.norm(self.residual * self.measurement.per_micro, axis=1))

    @property
    def outliers(self) -> np.ndarray:
        """Numbers of the rows rejected one by one: no copies, and no rows of failed stations."""
        lost = np.isin(self.measurement.groups, self.failed)
        return np.flatnonzero(~self.kept & ~self.copies & ~lost)

    @property
    def disagreeing(self) -> np.ndarray:
        """True `(n,)` for rows that disagree with the others, whether they were left out or had to stay."""
        return np.asarray((~self.kept & ~self.copies) | self.suspected)

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood, up to a constant of the data: misfit, distance from the priors, log determinant.

        Calibrated distances between spheres count as priors of the registration.
        """
        stated = self.measurement.instrument.stated_residuals(self.measurement, self.registration)
        own = float(np.sum(self.away**2)) + float(np.sum(stated**2))
        scale = self.observations * float(np.log(self.variance_factor))
        return -0.5 * (self.chi2 / self.variance_factor + own + self.solved.log_determinant + scale)

    @property
    def log_probability(self) -> float:
        """Log evidence with the volume of the noise: comparable between fits of the same rows under other noise.

        A row that was left out counts with the distance from which rows are left out.
        """
        white = self.measurement.whiteners
        volume = float(np.sum(np.linalg.slogdet(white[~self.copies])[1]))
        volume += decorrelation_of(self.measurement, self.kept.astype(float)).log_determinant
        lost = np.count_nonzero(~self.kept & ~self.copies)
        return self.log_evidence + volume - 0.5 * lost * largest_distance(len(self.kept), self.residual.shape[1])


def fit(
    measurement: Measurement,
    model: ErrorModel,
    *,
    prior: Array | None = None,
    variance: Variance = "sheet",
    near: Fit | None = None,
    progress: Progress = silent,
) -> Fit:
    """Fit all parameters of `model`, starting from their present values, and the registration.

    prior: standard deviations `(p,)` of the parameters about their start, or a root `(p, p)` of their covariance;
    default: the typical sizes of the table of effects. `variance="estimate"` scales the instrument's covariance to the
    residuals, for an instrument specification that is uncertain or unknown. near: a fit of the same model to the same
    rows, at which the iteration begins. UserError when the data cannot be fitted.
    """
    problem = Problem.of(measurement, model, priors(model) if prior is None else prior)
    progress("iterating")
    first, least = _converged(problem, variance, near)
    progress("solving")
    (point, factor, solved), kept, left_out = _of_all_rows(problem, first, least, variance)
    found = Fit(
        measurement,
        model,
        problem.at(point.parameters),
        point.registration,
        point.residual,
        kept,
        measurement.copies,
        left_out.suspected,
        left_out.failed,
        problem.away(point.parameters),
        problem.prior,
        solved,
        problem.squares(point, kept.astype(float)),
        factor,
    )
    covariance = problem.covariance(solved, found.widening)
    return replace(found, model=found.model.with_parameters(point.parameters, covariance))


class _Solution(NamedTuple):
    """A point of the iteration, the variance factor there, and the normal equations solved last."""

    point: Point
    factor: float
    solved: Solved


def _converged(problem: Problem, variance: Variance, near: Fit | None) -> tuple[_Solution, float]:
    """The solution by at most ENOUGH_ROWS of the trusted rows, and the smallest variance factor that they permit."""
    registration, trusted = problem.measurement.first_registration
    some = _some(np.flatnonzero(trusted & ~problem.measurement.copies))
    iterated = problem.rows(some)
    if near is None:
        first = iterated.point(np.array(problem.model.parameters), registration)
    else:
        first = iterated.point(near.model.parameters, near.registration)
    found = _iterate(iterated, first, variance, shapes_held=near is None)
    return found, _least(found.solved, len(some) * problem.measurement.components, variance)


def _of_all_rows(
    problem: Problem, first: _Solution, least: float, variance: Variance
) -> tuple[_Solution, np.ndarray, LeftOut]:
    """The solution by all rows but the outliers, the kept rows `(n,)`, and the rows that the solution leaves out."""
    point, factor, solved = problem.point(first.point.parameters, first.point.registration), first.factor, first.solved
    left_out = _left_out(problem, point, solved.effective_parameters, least)
    for _ in range(STEPS_OF_OUTLIERS):
        kept = ~left_out.rows
        _refuse_too_few(problem.measurement, kept, point)
        weights = kept * _weights(problem, point, solved.effective_parameters, least, left_out)
        solved = problem.solve(point, weights, factor)
        point = problem.moved(point, solved.step)
        if variance == "estimate":
            factor = max(problem.variance_factor(point, kept, solved), least)
        stay = bool(left_out.suspected.any())
        again = _left_out(problem, point, solved.effective_parameters, least, stay=stay)
        # a fit of all rows hides some of those that disagree
        left_out = again._replace(suspected=left_out.suspected) if stay else again
        if np.array_equal(left_out.rows, ~kept):
            break
    if variance == "estimate":  # the covariance belongs to the factor that these rows show
        solved = problem.solve(point, weights, factor)
    return _Solution(point, factor, solved), kept, left_out


def _iterate(problem: Problem, point: Point, variance: Variance, *, shapes_held: bool) -> _Solution:
    """The point to which Gauss-Newton with Huber's weights converges.

    shapes_held: in the first step, which begins with no amplitudes.
    """
    components, stop = problem.measurement.components, problem.stop
    factor, effective_parameters, least = 1.0, 0.0, 1.0
    shaped = not problem.linear.all()
    derivatives, last, taken = None, np.zeros(0), np.zeros(0)
    for step in range(MOST_FIT_STEPS):
        if shaped or derivatives is None:
            derivatives = problem.derivatives(point)
        weights_of = partial(
            _huber, components=components, effective_parameters=effective_parameters, least=least, stop=stop
        )
        # amplitudes first: a period or time constant is undetermined without one
        held = shapes_held and not step
        found = (problem.shapes_fixed() if held else problem).solve_reweighted(point, weights_of, factor, derivatives)
        aim = found.solved.step
        if shaped and not held:
            own = problem.shapes_of(aim, point)
            taken = own * _shares(own, last, taken)
            aim, last = problem.step_with_shapes(taken, point, found.normal), own
        before, effective_parameters = point, found.solved.effective_parameters
        decorrelation = problem.decorrelation(found.weights)
        point, halvings = problem.descended(point, aim, found.weights, factor, decorrelation)
        taken = taken * 0.5**halvings
        if variance == "estimate":
            least = _least(found.solved, len(stop) * components, variance)
            factor = robust_factor(problem.distances(point), components, effective_parameters, least, stop)
        if step and (found.solved.length < LAST_STEP_U or point is before):
            break
    return _Solution(point, factor, found.solved)


def _huber(distances: Array, components: int, effective_parameters: float, least: float, stop: np.ndarray) -> Array:
    """Huber's weights `(n,)` of rows by their squared distances; the rest as `robust_factor` takes it."""
    return huber_weights(distances, components, robust_factor(distances, components, effective_parameters, least, stop))


def _shares(own: Array, last: Array, taken: Array) -> Array:
    """Shares `(k,)` of the Gauss-Newton steps of shapes that lead to their zero by the secant.

    last, taken: the steps before, and the moves that were made then; empty for none. Where residuals are large, a
    Gauss-Newton step is too long or far too short.
    """
    if not len(last):
        return np.ones(len(own))
    change = last - own
    secant = np.divide(taken, change, out=np.full(len(own), np.inf), where=change != 0.0)
    return np.where(secant > 0.0, np.clip(secant, 1.0 / LARGEST_STEP_FACTOR, LARGEST_STEP_FACTOR), LARGEST_STEP_FACTOR)


def _least(solved: Solved, scalars: int, variance: Variance) -> float:
    """Smallest permitted variance factor: 1, unless there are enough observations to estimate a smaller one."""
    spare = scalars * (1.0 - EXCESS_SHARE)
    # the rank is slower to compute than the number of parameters
    return (
        LEAST_VARIANCE_FACTOR if variance == "estimate" and (solved.parameters < spare or solved.rank < spare) else 1.0
    )


def _left_out(
    problem: Problem, point: Point, effective_parameters: float, least: float, *, stay: bool = False
) -> LeftOut:
    """The rows to leave out, and the stations that failed as a whole; stay: no single rows."""
    components, copies = problem.measurement.components, problem.measurement.copies
    distances = problem.distances(point)
    factor = robust_factor(distances[~copies], components, effective_parameters, least, problem.stop[~copies])
    return LeftOut.of(problem.measurement, outlying(distances, components, factor) & ~copies, stay=stay)


def _weights(problem: Problem, point: Point, effective_parameters: float, least: float, left_out: LeftOut) -> Array:
    """Weights `(n,)` of the rows in the last steps: 1, or Huber's where too many rows disagree to leave them out."""
    components, distances = problem.measurement.components, problem.distances(point)
    if not left_out.suspected.any():
        return np.ones(len(distances))
    some = ~left_out.rows
    factor = robust_factor(distances[some], components, effective_parameters, least, problem.stop[some])
    return huber_weights(distances, components, factor)


def _refuse_too_few(measurement: Measurement, kept: np.ndarray, point: Point) -> None:
    instrument = measurement.instrument
    stated = len(instrument.stated_residuals(measurement, point.registration)) if instrument.MAY_BE_FEW else 0
    if kept.sum() * measurement.components <= point.registered - stated:
        if kept.all():
            stations = len(np.unique(measurement.groups))
            raise UserError(
                f"{measurement.source}: {len(measurement)} rows of {stations} set-ups are too few for the positions of "
                "the instrument alone"
            )
        raise UserError(
            f"{measurement.source}: of {len(measurement)} rows only {kept.sum()} agree with one another, too few for "
            "the position of the instrument alone; are units, axis names and targets right?"
        )


def _some(rows: np.ndarray) -> np.ndarray:
    """At most ENOUGH_ROWS of the rows, evenly spread."""
    return rows if len(rows) <= ENOUGH_ROWS else rows[np.linspace(0, len(rows) - 1, ENOUGH_ROWS).astype(int)]
