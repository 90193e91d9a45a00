"""Errors of a calibration at unseen states by causes that the data neither name nor exclude.

A cause without enough evidence to be named is no part of the model, which has learned a part of its signal instead.
Each such cause counts with its probability against none (Bayesian model averaging). An axis that does not repeat has
lost motion too: friction and play make both. It counts with the size that the non-repeatability lets expect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.diagnosis.search.candidates import at_zero, where
from calibration.diagnosis.search.evaluation import Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.widening import Moment, moments, scaled
from kinematics.effects import Backlash, Effect, unit_of
from kinematics.transforms import Array

LIKELY = 20.0
"""Odds against none from which a cause counts (Kass and Raftery 1995: strong evidence).

With nothing hidden, the best of many waves reaches 5 to 15.
"""
MOST = 40
"""Most causes that count."""


def squares_by_undecided(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Array:
    """Mean squares `(3,)`, um^2, of the errors of a model at unseen states, besides those of its uncertainty.

    evaluated: candidates beside the model, the best first, with the scores of any noise.
    """
    tried = evaluate(linearised, [each.candidate for each in evaluated[:MOST]])
    odds = np.exp(-0.5 * np.array([each.score.delta_bic for each in tried]))
    shares = odds / (1.0 + odds.sum())
    likely = zip(tried, shares.tolist(), odds.tolist(), strict=True)
    counted = [(each, share) for each, share, against_none in likely if against_none >= LIKELY]
    model, squares = linearised.fit.model, []
    signals = [linearised.candidate(each.candidate.effect).columns @ each.score.size for each, _ in counted]
    moved = [_moved(linearised, signal) for signal in signals]
    for moment in moments(linearised.measurement):
        design = moment.design(model)
        own = np.zeros(moment.tool.shape)
        for (each, share), parameters in zip(counted, moved, strict=True):
            own += share * (_lacking(moment, _of_size(each)) + design @ parameters) ** 2
        squares.append(own.mean(axis=0))
    return np.asarray(np.mean(squares, axis=0))


def squares_by_lost_motion(linearised: LinearisedFit) -> Array:
    """Mean squares `(3,)`, um^2, of the errors at unseen states by backlash of axes that do not repeat.

    Where the two directions of an axis lie at different positions, its error motions may have learned the backlash.
    """
    squares = np.zeros(3)
    for effect in _lost_motions(linearised):
        candidate = linearised.candidate(effect)
        expected = _expected(linearised, effect)
        variance = 1.0 / (expected**-2 + float(candidate.schur[0, 0]))
        size = variance * float(candidate.columns[:, 0] @ linearised.residual)
        moved = _moved(linearised, candidate.columns[:, 0])
        found = effect.with_parameters([effect.parameter_table[0].typical], (0.0,))
        of_one = [
            (moment.deviations_of(found) + moment.design(linearised.fit.model) @ moved) ** 2
            for moment in moments(linearised.measurement)
        ]
        squares += (variance + size**2) * np.mean(of_one, axis=(0, 1))
    return squares


def _lost_motions(linearised: LinearisedFit) -> Iterator[Backlash]:
    """Backlash of each axis that does not repeat, unless the model has an effect of its direction."""
    measurement, effects = linearised.measurement, linearised.fit.model.effects
    if measurement.noise is None or measurement.state.approach is None:
        return
    known = {where(effect) for effect in effects if "approach" in effect.needs and effect.ACTS_ON != "instrument"}
    yield from (Backlash(axis, 0.0) for axis in measurement.noise.non_repeatability if axis not in known)


def _expected(linearised: LinearisedFit, effect: Backlash) -> float:
    """Standard deviation of the width of a backlash, in its typical size, before the data.

    Half of it is as large as the non-repeatability of its axis.
    """
    assert linearised.measurement.noise is not None
    off = linearised.measurement.noise.non_repeatability[effect.axis] / unit_of(effect.axis)[1]
    return 2.0 * off / effect.parameter_table[0].typical


def _moved(linearised: LinearisedFit, signal: Array) -> Array:
    """Change `(p,)` of the parameters of a model beside a signal `(N,)` that it lacks."""
    moved = linearised.posterior.solve(linearised.design.T @ signal)
    return -scaled(linearised.fit.prior, moved[len(linearised.fit.registration.names) :])


def _of_size(each: Evaluated) -> Effect:
    """The effect of a candidate with its most likely size."""
    table, effect = each.candidate.effect.parameter_table, at_zero(each.candidate.effect)
    linear = np.array([quantity.linear for quantity in table])
    typical = np.array([quantity.typical for quantity in table])[linear]
    values = np.array(effect.parameters)
    values[linear] = each.score.size * np.where(np.isfinite(typical), typical, 1.0)
    return effect.with_parameters(values.tolist(), (0.0,) * len(values))


def _lacking(moment: Moment, effect: Effect) -> Array:
    """Deviations `(n, 3)`, um, of an effect of the machine; of one that changes, less those at the mean."""
    if effect.ACTS_ON == "instrument":
        return np.zeros_like(moment.tool)
    found = moment.deviations_of(effect)
    changing = {"time", "temperatures"} & set(effect.needs)
    return found - moment.at_mean.deviations_of(effect) if changing else found
