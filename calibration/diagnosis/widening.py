"""Errors of a calibration at unseen states beside a residual that no cause explains; its widened uncertainties.

A fit propagates noise. A dependence of the residuals on recorded variables is none: it may be an error of the machine,
which the calibration lacks at every pose, or one of the measurement, of which the calibration has learned a part. Both
follow from a fit with a smooth function of these variables beside the model.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.unexplained import nearly_of_readings, of_same_variables, shared_squares
from calibration.diagnosis.residual.unnamed import may_depend_on
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.unseen.beside_function import BesideFunction
from calibration.diagnosis.unseen.beside_moving import BesideMoving
from calibration.diagnosis.unseen.unseen_states import MOMENTS, Moment, mean_squares, moments, squares_along
from calibration.fit.curves.between_positions import BetweenPositions, with_curves_between
from calibration.fit.fit import Fit
from calibration.fit.linear import singular_values
from calibration.fit.noise import with_noise_of_visits
from calibration.measurement.measurement import Measurement
from kinematics.effects.base import unit_of
from kinematics.error_model.covariance import root_of
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.state import TEMPERATURE, TIME
from kinematics.transforms import Array

SEEN = 1e-3
"""Share of the largest uncertainty below which a direction does not show a combination of parameters."""
IMITATES = 1e-2
"""Share of the largest uncertainty below which a combination of parameters is not taken to imitate an error."""
MOMENTS_OF_SWING = 20
"""Moments of the measurement at which errors are predicted beside a swing: few might all have the same phase."""
NOTABLE = 1.05
"""Factor of the uncertainties from which they are enlarged."""


class UnseenErrors(NamedTuple):
    """Expected errors of predicted deviations within the measured ranges, beside an unexplained function."""

    squares: Array
    """Mean squares `(3,)` in x, y, z, um^2."""
    squares_without: Array
    """Mean squares `(3,)` in x, y, z, um^2, of the errors of the calibration that the model replaces."""
    with_um: float
    """RMS length, um, of the expected errors of the model."""
    without_um: float
    """RMS length, um, of those of the calibration that the model replaces."""
    uncertain_um: float
    """RMS length, um, of the uncertainty of these errors."""
    recurs: bool
    """True for an error of the machine that recurs with the position: a model holds it rightly."""
    beside: tuple[Fit, tuple[BetweenPositions, ...]] | None = None
    """The fit beside the function, with its curves, which the calibration takes; None where a model holds the error."""
    function: Array | None = None
    """The function beside which the calibration is fitted, as `BesideFunction.values`; None where a model holds it."""

    def besides(self, squares: Array) -> UnseenErrors:
        """The same with these mean squares `(3,)`, um^2, of an error besides, that neither calibration holds."""
        return self._replace(squares=self.squares + squares, squares_without=self.squares_without + squares)

    def of_at_least(self, squares: Array) -> UnseenErrors:
        """The same with at least these mean squares `(3,)`, um^2, of an error that neither calibration holds."""
        without = np.maximum(self.squares_without, squares)
        return self._replace(squares=np.maximum(self.squares, squares), squares_without=without)


class Widened(NamedTuple):
    """A model with uncertainties that hold an unexplained error too."""

    model: ErrorModel
    factor: float
    """Uncertainties of predicted deviations in RMS, as a multiple of those that follow from the noise."""


def unseen_errors(
    linearised: LinearisedFit,
    dependence: Unexplained,
    present: ErrorModel | None,
    *,
    curves: bool,
    moving: BesideMoving | None = None,
) -> UnseenErrors:
    """Errors of the model of a fit at unseen states, beside an unexplained function, and of the one that it replaces.

    An error of the machine is the function itself, as far as the model has not learned it; an error of the tracker's
    readings, or a common shift that moves with time, only the part that the model has learned.

    present: the calibration that the model replaces; None for the nominal machine. Where an error of the readings is
    nearly as likely as one of the machine, the squares are the larger ones of both. curves: whether error motions are
    smooth curves, as of `with_curves_between`. moving: as of `beside_moving`, if there is one.
    """
    if moving is not None:
        # the fit beside the function has another noise, and may be evaluated at other rows
        there = of_same_variables(moving.solution.plain, dependence)
        swings = moving.swinging is not None
        return _of_model_beside(moving.solution, there, present, curves=curves, swings=swings)
    if _moves(dependence) or dependence.of_readings:
        # estimated noise of the axes holds what the function does not
        beside = BesideFunction.of(linearised, dependence)
        if _holds(beside, dependence):
            return _of_model_beside(beside, dependence, present, curves=curves)
    even, misread = linearised.evenly_noisy, nearly_of_readings(linearised, dependence)
    found = _errors_beside(BesideFunction.of(even, dependence), linearised, dependence, present)
    if misread is None:
        return found
    other = _errors_beside(BesideFunction.of(even, misread), linearised, misread, present)
    return found._replace(squares=np.maximum(found.squares, other.squares))


def _errors_beside(
    beside: BesideFunction, linearised: LinearisedFit, dependence: Unexplained, present: ErrorModel | None
) -> UnseenErrors:
    """`unseen_errors` of the model of the fit, beside the unexplained function as it is."""
    model, given, parts = linearised.fit.model, _given(present, linearised.measurement), []
    for moment in moments(linearised.measurement):
        design, lacking = moment.design(model), _lacking(beside, moment)
        error = design @ beside.moved + lacking @ beside.coefficients
        variance = np.sum((np.concatenate([design, lacking], axis=2) @ beside.root) ** 2, axis=2)
        before = moment.deviations(model) - moment.deviations(given) + error
        parts.append(np.mean([error**2 + variance, error**2, before**2], axis=1))
    squares, after, without = np.mean(parts, axis=0)
    if len(shared := shared_squares(linearised, dependence)) == 3 and not _holds(beside, dependence):
        squares = np.maximum(squares, shared)
    uncertain = math.sqrt(max(float(np.sum(squares - after)), 0.0))
    recurs = not _moves(dependence) and not dependence.of_readings
    found = UnseenErrors(squares, without, math.sqrt(after.sum()), math.sqrt(without.sum()), uncertain, recurs)
    return found.besides(_left_by(beside, dependence))


def _of_model_beside(
    beside: BesideFunction,
    dependence: Unexplained,
    present: ErrorModel | None,
    *,
    curves: bool,
    swings: bool = False,
) -> UnseenErrors:
    """The errors of the model beside the function, which no calibration holds: it stays, with a model and without.

    Beside estimated non-repeatability, which contains it too, an error of the tool is too small: the residuals show its
    size. A swing comes back to its largest size: the squares are those of that moment.
    """
    fit, between = with_curves_between(beside.fit, beside.information) if curves else (beside.fit, ())
    given, parts = _given(present, fit.measurement), []
    for moment in moments(fit.measurement, MOMENTS_OF_SWING if swings else MOMENTS):
        error = _lacking(beside, moment) @ beside.coefficients
        before = moment.deviations(fit.model) - moment.deviations(given) + error
        variance = fit.model.propagated(moment.design(fit.model)) ** 2
        parts.append(np.mean([error**2 + variance, error**2, before**2], axis=1))
    squares, after, without = np.mean(parts, axis=0)
    with_um, without_um, uncertain_um = (math.sqrt(each.sum()) for each in (after, without, squares - after))
    if swings:
        squares, _, without = np.max(parts, axis=0)
    noise, shared = beside.plain.measurement.noise, shared_squares(beside.plain, dependence)
    of_tool = not dependence.of_readings and len(shared) == 3
    if noise is not None and noise.non_repeatability and of_tool:
        squares = np.maximum(squares, shared)
    held = (fit, between), beside.values
    found = UnseenErrors(squares, without, with_um, without_um, uncertain_um, False, *held)
    return found.besides(_left_by(beside, dependence))


def _left_by(beside: BesideFunction, dependence: Unexplained) -> Array:
    """Mean squares `(3,)`, um^2, at unseen states of the errors of the axes that a smooth function leaves.

    Visits of one position share them, or nothing shows whether they do.
    """
    if dependence.of_readings:
        return np.zeros(3)
    fit = beside.plain.fit
    noise = with_noise_of_visits(replace(fit, residual=fit.residual - beside.values)).noise
    if noise is None:
        return np.zeros(3)
    left = {**noise.recurring, **noise.misfit}
    return squares_along(fit.measurement, {axis: (off / unit_of(axis)[1]) ** 2 for axis, off in left.items()})


def _given(present: ErrorModel | None, measurement: Measurement) -> ErrorModel:
    return no_errors(measurement.machine) if present is None else present


def _moves(dependence: Unexplained) -> bool:
    """True where the function changes with time or a temperature."""
    return any(name == TIME or name.startswith(TEMPERATURE) for name in dependence.variables)


def _lacking(beside: BesideFunction, moment: Moment) -> Array:
    """Derivatives `(n, 3, k)`, um, by the coefficients of the function in units of their priors."""
    model = msgspec.structs.replace(beside.plain.fit.model, effects=beside.function.effects, covariance=None)
    return moment.design(model) * beside.function.prior


def _holds(beside: BesideFunction, dependence: Unexplained) -> bool:
    """True where the solution is one beside the whole function."""
    return beside.function.log_odds > 0.0 and _of_tool(beside.plain, dependence)


def _of_tool(linearised: LinearisedFit, dependence: Unexplained) -> bool:
    """True where the fit beside the function holds the whole of it."""
    return dependence.of_readings or all(may_depend_on(linearised, name) for name in dependence.variables)


def errors_by_choice(found: Fit, finer: Fit) -> Array:
    """Mean squares `(3,)`, um^2, of the errors of a model at unseen states, by a fit with finer bases.

    Few rows leave a choice between bases open: waves that the evidence tolerates have not left the machine.
    """
    parts = []
    for moment in moments(found.measurement):
        apart = moment.deviations(found.model) - moment.deviations(finer.model)
        parts.append(np.mean(apart**2 + finer.model.propagated(moment.design(finer.model)) ** 2, axis=0))
    return np.asarray(np.mean(parts, axis=0))


def widened(
    model: ErrorModel,
    measurement: Measurement,
    squares: Array,
    besides: Array | float = 0.0,
    possible: Array | None = None,
) -> Widened:
    """The model with larger uncertainties, where those of its predictions are smaller than their errors.

    squares: mean squares of the errors of predicted deviations `(3,)`, um^2, in x, y, z, as of `UnseenErrors`. besides:
    mean squares of errors besides those of its own uncertainties, likewise. possible: such errors `(k, m, 3)`, um, of
    one standard deviation each, at all states of `moments`.

    A possible error becomes an uncertainty of the parameters that imitate it. For the others, and for what no
    parameters imitate, the variance of each combination of parameters that moves the tool in a direction is multiplied
    (Birge 1932), such that those of the predicted deviations at unseen states reach these mean squares.
    """
    if model.covariance is None:
        return Widened(model, 1.0)
    from scipy.optimize import nnls

    design = np.concatenate([moment.design(model) for moment in moments(measurement)])
    root = root_of(np.array(model.covariance))
    parts = design @ root
    variance = np.mean(np.sum(parts**2, axis=2), axis=0)
    own = []
    for k in np.flatnonzero(variance):
        _, sizes, directions = singular_values(parts[:, k])
        own.append(root @ directions[sizes > SEEN * sizes[0]].T)
    if not own:
        return Widened(model, 1.0)
    more = np.zeros_like(root @ root.T)
    if possible is not None and len(possible):
        imitating = root @ _imitating(parts, possible)
        more += imitating @ imitating.T
        imitated = mean_squares(np.moveaxis(design @ imitating, 2, 0))
        squares, besides = squares - imitated, besides + mean_squares(possible) - imitated
    # a combination of parameters moves the tool in other directions too
    moved = np.stack([np.mean(np.sum((design @ each) ** 2, axis=2), axis=0) for each in own], axis=1)
    factors, _ = nnls(moved, np.maximum(squares - variance, besides))
    more += sum(factor * each @ each.T for factor, each in zip(factors.tolist(), own, strict=True))
    if not more.any():
        return Widened(model, 1.0)
    larger = model.with_parameters(model.parameters, np.array(model.covariance) + more)
    after = np.mean(larger.propagated(design) ** 2, axis=0)
    factor = float(np.sqrt(after.mean() / variance.mean()))
    return Widened(larger, factor) if factor > NOTABLE else Widened(model, 1.0)


def _imitating(parts: Array, errors: Array) -> Array:
    """Coefficients `(r, k)` of combinations of parameters that imitate errors `(k, m, 3)`; parts `(m, 3, r)`: theirs.

    Combinations that hardly move the tool at these states may move it at others: they imitate nothing.
    """
    left, sizes, directions = singular_values(parts.reshape(-1, parts.shape[2]))
    kept = sizes > IMITATES * sizes[0]
    along = left[:, kept].T @ errors.reshape(len(errors), -1).T
    return np.asarray(directions[kept].T @ (along / sizes[kept, None]))
