"""Causes in whose place the evidence has chosen finer bases.

Where an axis has few positions, or is approached from its second side at few of them, an error motion bends around the
rows that a cause moves. Beside such bases the cause is not visible, and its error spreads to all poses. The bases are
therefore also selected beside each cause that coarse bases show: with it coarser ones may be enough.
"""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.search.evaluation import WORTH, Evaluated, evaluate
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Stage

MOST = 6
"""Most causes beside which bases are selected."""


def imitated(selector: Selector) -> tuple[Selector, Stage] | None:
    """The selector with the bases beside an imitated cause, and the stage with this cause; None without one.

    The bases and the cause must be likelier than the present bases alone, and predict held-out blocks better.
    """
    if selector.base.choice is None:
        return None
    found, most = None, _bic(selector.bare) + WORTH
    for each in _suspected(selector):
        effect = each.candidate.effect
        selector.progress(f"selecting bases beside {effect.name}")
        base = selector.base.coarser_beside(selector.measurement, (effect,), selector.progress)
        trial = selector.on(base).stage([(each.candidate, each.score.size)])
        likely = trial.accepted[0].score.delta_bic < WORTH and _bic(trial) < most
        if likely and selector.bare.predicts_worse_than(trial):
            found, most = (selector.on(base), trial), _bic(trial)
    return found


def _suspected(selector: Selector) -> list[Evaluated]:
    """Causes that coarse bases leave to be explained, and the present bases do not; the likeliest first."""
    coarse = selector.on(selector.base.coarsest(selector.measurement)).bare.linearised
    tried = [each for each in evaluate(coarse, selector.library) if each.score.delta_bic < WORTH]
    beside = evaluate(selector.bare.linearised, [each.candidate for each in tried])
    explained = {id(each.candidate) for each in beside if each.score.delta_bic > WORTH}
    found: dict[object, Evaluated] = {}
    for each in tried:
        if id(each.candidate) in explained:
            found.setdefault(each.candidate.cause, each)
    return list(found.values())[:MOST]


def _bic(stage: Stage) -> float:
    """BIC of a fit with the effective parameters of its bases, up to a constant of the data."""
    linearised = stage.linearised
    parameters = linearised.posterior.effective_parameters
    rare = 2.0 * stage.rarity
    return linearised.squares + linearised.spread + parameters * float(np.log(linearised.scalars)) + rare
