"""Causes in whose place the evidence has chosen finer bases.

Where an axis has few positions, or is approached from its second side at few of them, an error motion bends around the
rows that a cause moves. Beside such bases the cause is hardly visible, and its error spreads to all poses. The bases
are therefore also selected beside each cause that coarse bases show: with it coarser ones may be enough. Where lines
have positions of their own, error motions of these positions move the lines behind a jump as the jump does.
"""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.search.evaluation import SEEN, WORTH, Evaluated, evaluate
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Stage, chosen_of
from kinematics.effects import AngleStep, Cyclic, QuantisedCompensation

FAINT = 0.2
"""Share of the signal of a cause that the bases of a stage do not imitate, below which they may hold the cause."""
MOST = 6
"""Most causes beside which bases are selected."""


def imitated(selector: Selector, stage: Stage) -> tuple[Selector, Stage]:
    """The selector with the bases beside a cause that those of a stage imitate, and the stage with this cause too.

    The bases and the cause must be likelier than the bases of the stage alone, and predict held-out blocks better.
    """
    found, most = (selector, stage), bic(stage) + WORTH
    for each in _suspected(selector, stage) if selector.base.choice is not None else ():
        selector.progress(f"selecting bases beside {each.candidate.effect.name}")
        effects = [stage.fit.model.effects[i] for i in stage.numbers if i >= len(selector.base.model.effects)]
        effects.append(each.candidate.effect)
        base = selector.base.coarser_beside(selector.measurement, effects, selector.progress)
        trial = selector.on(base).stage([*chosen_of(stage.accepted), (each.candidate, each.score.size)])
        likely = trial.accepted[-1].score.delta_bic < WORTH and bic(trial) < most
        if likely and stage.predicts_worse_than(trial):
            found, most = (selector.on(base), trial), bic(trial)
    return found


def _suspected(selector: Selector, stage: Stage) -> list[Evaluated]:
    """Causes that are hardly visible beside the bases of a stage, and that coarse bases leave; the likeliest first."""
    tried = [each for each in selector.evaluated(stage.linearised, stage.accepted) if not _searched(each)]
    hidden = [each.candidate for each in tried if each.projected.visible < FAINT]
    if not hidden:
        return []
    coarse = selector.on(selector.base.coarsest(selector.measurement)).stage(chosen_of(stage.accepted))
    found: dict[object, Evaluated] = {}
    for each in evaluate(coarse.linearised, hidden):
        if each.score.delta_bic < WORTH and each.projected.visible >= SEEN:
            found.setdefault(each.candidate.cause, each)
    return list(found.values())[:MOST]


def _searched(each: Evaluated) -> bool:
    """True for a shape that was searched for among very many, other than a moment."""
    shapes = Cyclic | QuantisedCompensation | AngleStep
    return bool(each.candidate.replaces) or isinstance(each.candidate.effect, shapes)


def bic(stage: Stage) -> float:
    """BIC of a fit with the effective parameters of its bases, up to a constant of the data."""
    linearised = stage.linearised
    parameters = linearised.posterior.effective_parameters
    rare = 2.0 * stage.rarity
    return linearised.squares + linearised.spread + parameters * float(np.log(linearised.scalars)) + rare
