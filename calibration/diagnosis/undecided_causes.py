"""Errors of a calibration at unseen states by causes that the data neither name nor exclude.

A cause without enough evidence to be named is no part of the model, which has learned a part of its signal instead.
Each such cause counts with its probability against none (Bayesian model averaging).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.diagnosis.search.candidates import at_zero
from calibration.diagnosis.search.evaluation import Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.widening import Moment, moments, scaled
from kinematics.effects import Effect
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
    moved = [_moved(linearised, each) for each, _ in counted]
    for moment in moments(linearised.measurement):
        design = moment.design(model)
        own = np.zeros(moment.tool.shape)
        for (each, share), parameters in zip(counted, moved, strict=True):
            own += share * (_lacking(moment, _of_size(each)) + design @ parameters) ** 2
        squares.append(own.mean(axis=0))
    return np.asarray(np.mean(squares, axis=0))


def _moved(linearised: LinearisedFit, each: Evaluated) -> Array:
    """Change `(p,)` of the parameters of a model beside a cause of its most likely size."""
    signal = linearised.candidate(each.candidate.effect).columns @ each.score.size
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
