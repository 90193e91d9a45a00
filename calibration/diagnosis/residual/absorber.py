"""Absorber: a smooth function of the variables of the unexplained residual, beside which a cause must prove itself.

Where an unknown cause is at work, known causes and searched shapes imitate parts of it. A cause stands only if the data
with the cause and the function are far likelier than with the function alone.
"""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.residual.dependence import EVIDENCE, Unexplained
from calibration.diagnosis.residual.unnamed import COMPONENTS, may_depend_on, propose
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.evaluation import evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Accepted, Stage
from kinematics.effects import CrossAxis, Cyclic, QuantisedCompensation, Unnamed
from kinematics.state import TIME

MOST = 0.5
"""Share of the log odds of the function that is most of them."""
CLEARLY = 0.75
"""Least share of the excess over the noise that a cause explains beside an unexplained function of its variables."""


def absorbed(linearised: LinearisedFit, dependence: Unexplained | None) -> LinearisedFit:
    """The linearised fit with a smooth function of the variables of a dependence, in the directions that it needs."""
    return _absorbed(linearised, dependence)[0]


def log_odds_of_function(linearised: LinearisedFit, dependence: Unexplained) -> float:
    """Log odds of the smooth function against none."""
    return _absorbed(linearised, dependence)[1]


def without_support(stage: Stage, dependence: Unexplained) -> list[Accepted]:
    """Accepted causes without which the function explains the data nearly as well as with them.

    A cause that alone explains most of what the function explains stands: the function then imitates the cause. Also a
    cause that depends on one of the variables, and is less clear than the function beside it or leaves much
    beyond the noise: it is a mean of the function, or a part of it. A finer error motion of an axis falls where the
    rest depends on this axis and time: it is the mean of an error that changes.
    """
    # estimated noise of an axis would hold much of the function
    even = stage._replace(linearised=stage.linearised.evenly_noisy)
    together = _absorbed(even.linearised, dependence)[1]
    found = []
    for i, each in enumerate(stage.accepted):
        without = even.without(i)
        score = each.score if even.linearised is stage.linearised else evaluate(without, [each.candidate])[0].score
        own, alone = -0.5 * score.delta_bic, _absorbed(without, dependence)[1]
        named = not isinstance(each.candidate.effect, Unnamed)
        imitated = own + together - alone < EVIDENCE and own < MOST * alone
        part = own < together or _share(without, even.linearised) < CLEARLY
        depends = not _variables(each.candidate).isdisjoint(dependence.variables)
        if (named and (imitated or (part and depends))) or _changes(each.candidate, dependence):
            found.append(each)
    return found


def _changes(candidate: Candidate, dependence: Unexplained) -> bool:
    """True for a finer error motion of an axis that the unexplained residual depends on, together with time."""
    return bool(candidate.replaces) and {TIME, getattr(candidate.effect, "axis", "")} <= set(dependence.variables)


def _share(without: LinearisedFit, with_cause: LinearisedFit) -> float:
    """Share of the squares beyond the specified noise, without a cause, that the cause explains."""
    explained = without.squares - with_cause.squares
    left = with_cause.squares - with_cause.degrees_of_freedom / with_cause.fit.variance_factor
    return explained / max(explained + left, explained, 1.0)


def _variables(candidate: Candidate) -> set[str]:
    """Variables of a course in time, or in temperatures, which are functions of time; of a sag, a wave or a sawtooth,
    and of a finer error motion.

    None for an effect that depends on anything but time and the positions of axes.
    """
    effect = candidate.effect
    timed = TIME in effect.needs or "temperatures" in effect.needs
    if not timed and not candidate.replaces and not isinstance(effect, (CrossAxis, Cyclic, QuantisedCompensation)):
        return set()
    axes = {getattr(effect, name) for name in ("axis", "other") if hasattr(effect, name)}
    return {TIME, *axes} if timed else axes


def _absorbed(linearised: LinearisedFit, dependence: Unexplained | None) -> tuple[LinearisedFit, float]:
    """The linearised fit with the function, and its log odds against none."""
    log_odds = 0.0
    if dependence is None or not all(may_depend_on(linearised, name) for name in dependence.variables):
        return linearised, log_odds
    missing = COMPONENTS
    while proposed := propose(linearised, dependence, missing):
        log_odds += proposed[0].log_odds
        candidate = proposed[0].candidate
        typical = [quantity.typical for quantity in candidate.effect.parameter_table]
        linearised = linearised.along(candidate.effect, np.array(candidate.prior) * typical)
        missing = tuple(component for component in missing if component != candidate.axis)
    return linearised, log_odds
