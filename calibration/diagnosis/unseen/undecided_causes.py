"""Errors of a calibration at unseen states by causes that the data neither name nor exclude.

A cause without enough evidence to be named is no part of the model, which has learned a part of its signal instead.
Each such cause counts with its probability against none (Bayesian model averaging). A named cause may have another form
than the one fitted, such as a drift that settles instead of one of constant rate, or be tied with another cause: each
counts with its probability, and with the difference that it makes. An axis that does not repeat has lost motion too:
friction and play make both. It counts with the size that the non-repeatability lets expect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.forms import Forms, compared, forms
from calibration.diagnosis.search.candidates import Candidate, at_zero
from calibration.diagnosis.search.evaluation import Evaluated, Sibling, complexity, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Stage
from calibration.diagnosis.terms.contract import where
from calibration.diagnosis.unseen.beside_function import scaled
from calibration.diagnosis.unseen.unseen_states import MOMENTS, POSES, Moment, moments
from calibration.diagnosis.verdict import tied_with
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
        return _of_machine(moment, self.effect) - _of_machine(moment, self.instead)


def errors_by_undecided(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Array:
    """Errors `(k, m, 3)`, um, of a model at unseen states, besides those of its uncertainty: RMS, by each cause.

    By causes that are likely, and by lost motion of axes that do not repeat. evaluated: candidates beside the model,
    the best first, with the scores of any noise.
    """
    causes = list(_likely(linearised, evaluated))
    causes += _lost_motions(linearised, [*linearised.fit.model.effects, *(cause.effect for cause in causes)])
    return _errors(linearised, causes)


def errors_by_forms(stage: Stage, library: Sequence[Candidate]) -> Array:
    """The same by other forms of the causes of the machine that a stage has; library: all candidates."""
    return _errors(stage.linearised, [each for found in forms(stage, library) for each in _instead(stage, found)])


def errors_by_ties(stage: Stage) -> Array:
    """The same by causes that these data do not distinguish from those that a stage has."""
    return _errors(stage.linearised, [each for found in _ties(stage) for each in _instead(stage, found)])


def _errors(linearised: LinearisedFit, causes: Sequence[_Possible]) -> Array:
    """Errors `(k, m, 3)`, um, by causes, each in RMS over its probability, at all states of `moments`."""
    if not causes:
        return np.zeros((0, MOMENTS * POSES, 3))
    model, found = linearised.fit.model, []
    for moment in moments(linearised.measurement):
        design = moment.design(model)
        errors = [np.sqrt(cause.weight) * (cause.lacking(moment) + design @ cause.moved) for cause in causes]
        found.append(errors)
    return np.concatenate(found, axis=1)


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


def _ties(stage: Stage) -> Iterator[Forms]:
    """The causes that are tied, each with those that these data do not distinguish from it."""
    for i, own in enumerate(stage.accepted):
        others = tied_with(own)
        if not others or own.candidate.replaces or own.candidate.changes:
            continue
        without = stage.without(i)
        this, *found = compared(without, [own.candidate, *(each.evaluated.candidate for each in others)])
        costs = (_cost(own.candidate, each, without) for each in others)
        rest = tuple(each._replace(cost=cost) for each, cost in zip(found, costs, strict=True))
        yield Forms(i, without, this._replace(cost=0.0), rest)


def _cost(own: Candidate, sibling: Sibling, without: LinearisedFit) -> float:
    """Twice the log odds of a cause against a sibling.

    Between two effects of the instrument the number of parameters does not count: a knock may turn it, or not.
    """
    other = sibling.evaluated.candidate
    turns = 0
    if own.effect.ACTS_ON == other.effect.ACTS_ON == "instrument":
        turns = complexity(other) - complexity(own)
    return 2.0 * sibling.log_odds - turns * float(np.log(without.scalars))


def _instead(stage: Stage, found: Forms) -> Iterator[_Possible]:
    """Possible causes in place of one of a stage, each of its most likely size, with its probability."""
    own, others, without = found.own, found.others, found.without
    costs = np.array([own.cost, *(each.cost for each in others)])
    odds = np.exp(-0.5 * (costs - costs.min()))
    instead = _of_size(own.candidate, own.size).lasting()
    kept = np.delete(np.arange(len(stage.fit.model.parameters)), stage.fit.model.slices[stage.numbers[found.number]])
    for each, weight in zip(others, (odds[1:] / odds.sum()).tolist(), strict=True):
        moved = np.zeros(len(stage.fit.model.parameters))
        moved[kept] = _in_priors(without, each.signal - own.signal)
        effect = _of_size(each.candidate, each.size).lasting()
        yield _Possible(weight, effect, -scaled(stage.fit.prior, moved), instead)


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
    found = _of_machine(moment, effect)
    changing = {"time", "temperatures"} & set(effect.needs)
    return found - _of_machine(moment.at_mean, effect) if changing else found


def _of_machine(moment: Moment, effect: Effect) -> Array:
    """Deviations `(n, 3)`, um, of an effect of the machine; 0 of one of the instrument."""
    return np.zeros_like(moment.tool) if effect.ACTS_ON == "instrument" else moment.deviations_of(effect)
