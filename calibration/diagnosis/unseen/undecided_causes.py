"""Errors of a calibration at unseen states by causes that the data neither name nor exclude.

A cause without enough evidence to be named is no part of the model, which has learned a part of its signal instead.
Each such cause counts with its probability against none (Bayesian model averaging). A named cause may have another form
than the one fitted, such as a drift that settles instead of one of constant rate: each form counts with its
probability, and with the difference that it makes. An axis that does not repeat has lost motion too: friction and play
make both. It counts with the size that the non-repeatability lets expect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.forms import forms
from calibration.diagnosis.search.candidates import Candidate, at_zero, where
from calibration.diagnosis.search.evaluation import Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Stage
from calibration.diagnosis.unseen.beside_function import scaled
from calibration.diagnosis.widening import Moment, moments
from kinematics.effects import Backlash, Effect, unit_of
from kinematics.transforms import Array

LIKELY = 20.0
"""Odds against none from which a cause counts (Kass and Raftery 1995: strong evidence).

With nothing hidden, the best of many waves reaches 5 to 15.
"""
HALF_WIDTH = 1.0
"""Standard deviation of half the width of a backlash before the data, as a multiple of the axis' non-repeatability."""
MOST = 40
"""Most causes that count."""


class _Possible(NamedTuple):
    """A cause that the model may lack."""

    weight: float
    """Expected square of its size, as a multiple of that of `effect`."""
    effect: Effect
    moved: Array
    """Change `(p,)` of the parameters of the model beside the effect."""
    instead: Effect | None = None
    """Effect of the model in place of which it may be; None for one besides."""

    def lacking(self, moment: Moment) -> Array:
        """Deviations `(n, 3)`, um, that the model lacks, its parameters unchanged."""
        if self.instead is None:
            return _lacking(moment, self.effect)
        return moment.deviations_of(self.effect) - moment.deviations_of(self.instead)


def squares_by_undecided(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Array:
    """Mean squares `(3,)`, um^2, of the errors of a model at unseen states, besides those of its uncertainty.

    Those by causes that are likely, and by lost motion of axes that do not repeat. evaluated: candidates beside the
    model, the best first, with the scores of any noise.
    """
    causes = list(_likely(linearised, evaluated))
    causes += _lost_motions(linearised, [*linearised.fit.model.effects, *(cause.effect for cause in causes)])
    return _mean_squares(linearised, causes)


def squares_by_forms(stage: Stage, library: Sequence[Candidate]) -> Array:
    """The same by other forms of the causes of the machine that a stage has; library: all candidates."""
    return _mean_squares(stage.linearised, list(_other_forms(stage, library)))


def _mean_squares(linearised: LinearisedFit, causes: Sequence[_Possible]) -> Array:
    """Mean squares `(3,)`, um^2, of the expected errors by some causes at unseen states."""
    squares = np.zeros(3)
    for count, moment in enumerate(moments(linearised.measurement) if causes else (), start=1):
        design = moment.design(linearised.fit.model)
        errors = [cause.weight * (cause.lacking(moment) + design @ cause.moved) ** 2 for cause in causes]
        squares += (np.sum(errors, axis=0).mean(axis=0) - squares) / count
    return squares


def _likely(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Iterator[_Possible]:
    """Causes that are likely against none, each of its most likely size, with its probability."""
    tried = evaluate(linearised, [each.candidate for each in evaluated[:MOST]]) if evaluated else []
    odds = np.exp(-0.5 * np.array([each.score.delta_bic for each in tried]))
    for each, against_none in zip(tried, odds.tolist(), strict=True):
        if against_none >= LIKELY:
            signal = linearised.candidate(each.candidate.effect).columns @ each.score.size
            yield _Possible(
                against_none / (1.0 + float(odds.sum())),
                _of_size(each.candidate, each.score.size),
                _moved(linearised, signal),
            )


def _other_forms(stage: Stage, library: Sequence[Candidate]) -> Iterator[_Possible]:
    """Other forms of the named causes of the machine, each of its most likely size, with its probability."""
    for found in forms(stage, library):
        own, others, without = found.own, found.others, found.without
        costs = np.array([own.cost, *(each.cost for each in others)])
        odds = np.exp(-0.5 * (costs - costs.min()))
        instead = _of_size(own.candidate, own.size)
        kept = np.delete(
            np.arange(len(stage.fit.model.parameters)), stage.fit.model.slices[stage.numbers[found.number]]
        )
        for each, weight in zip(others, (odds[1:] / odds.sum()).tolist(), strict=True):
            moved = np.zeros(len(stage.fit.model.parameters))
            moved[kept] = _in_priors(without, each.signal - own.signal)
            yield _Possible(weight, _of_size(each.candidate, each.size), -scaled(stage.fit.prior, moved), instead)


def _lost_motions(linearised: LinearisedFit, effects: Sequence[Effect]) -> Iterator[_Possible]:
    """Backlash of each axis that does not repeat, of typical size, unless one of the effects is of its direction.

    Where the two directions of an axis lie at different positions, its error motions may have learned the backlash.
    """
    measurement = linearised.measurement
    if measurement.noise is None or measurement.state.approach is None:
        return
    known = {where(effect) for effect in effects if "approach" in effect.needs and effect.ACTS_ON != "instrument"}
    for axis, off in measurement.noise.non_repeatability.items():
        if axis in known:
            continue
        candidate, typical = linearised.candidate(Backlash(axis, 0.0)), Backlash.QUANTITIES[0].typical
        before = HALF_WIDTH * 2.0 * off / unit_of(axis)[1] / typical
        variance = 1.0 / (before**-2 + float(candidate.schur[0, 0]))
        size = variance * float(candidate.columns[:, 0] @ linearised.residual)
        yield _Possible(variance + size**2, Backlash(axis, typical), _moved(linearised, candidate.columns[:, 0]))


def _moved(linearised: LinearisedFit, signal: Array) -> Array:
    """Change `(p,)` of the parameters of a model beside a signal `(N,)` that it lacks."""
    return -scaled(linearised.fit.prior, _in_priors(linearised, signal))


def _in_priors(linearised: LinearisedFit, signal: Array) -> Array:
    """What the parameters of a linearised fit take up of a signal `(N,)`, in units of their priors."""
    moved = linearised.posterior.solve(linearised.design.T @ signal)
    return np.asarray(moved[len(linearised.fit.registration.names) :])


def _of_size(candidate: Candidate, size: Array) -> Effect:
    """The effect of a candidate with a size in typical ones."""
    table, effect = candidate.effect.parameter_table, at_zero(candidate.effect)
    linear = np.array([quantity.linear for quantity in table])
    typical = np.array([quantity.typical for quantity in table])[linear]
    values = np.array(effect.parameters)
    values[linear] = size * np.where(np.isfinite(typical), typical, 1.0)
    return effect.with_parameters(values.tolist(), (0.0,) * len(values))


def _lacking(moment: Moment, effect: Effect) -> Array:
    """Deviations `(n, 3)`, um, of an effect of the machine; of one that changes, less those at the mean."""
    if effect.ACTS_ON == "instrument":
        return np.zeros_like(moment.tool)
    found = moment.deviations_of(effect)
    changing = {"time", "temperatures"} & set(effect.needs)
    return found - moment.at_mean.deviations_of(effect) if changing else found
