"""Waves in whose place the evidence has chosen finer bases: an axis with few positions may have as many parameters.

Beside such bases a wave leaves no residual. It is therefore searched for beside coarse bases too, and stands beside
those that the evidence then selects, where both are much likelier than the fine bases alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import get_args

import numpy as np

from calibration.diagnosis.residual.undetermined_periods import MANY, undetermined
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.evaluation import WORTH, Evaluated, evaluate
from calibration.diagnosis.search.imitated_causes import bic
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.shapes.proposed_shapes import SCANNED, waves_of
from calibration.diagnosis.search.stage import Accepted, Stage, chosen_of
from kinematics.effects import Component

MOST = 0.5
"""Least share of the squares beyond the noise, beside coarse bases, that a wave explains."""


def imitated_wave(selector: Selector, stage: Stage) -> tuple[Selector, Stage]:
    """The selector with the bases beside a wave that those of a stage imitate, and the stage with this wave.

    With its causes, or without them: jumps imitate a wave too. The bases and the wave must be likelier than the stage,
    by its search too, and predict held-out blocks better; and the positions must determine its period.
    """
    known = {len(each): each for each in (stage.accepted, ())} if selector.base.choice is not None else {}
    for causes in known.values():
        best = _strongest(selector, causes)
        if best is None:
            continue
        selector.progress(f"selecting bases beside {best.candidate.effect.name}")
        effects = [*(each.candidate.effect for each in causes), best.candidate.effect]
        base = selector.base.coarser_beside(selector.measurement, effects, selector.progress)
        trial = selector.on(base).stage([*chosen_of(causes), (best.candidate, best.score.size)])
        likelier = bic(trial) + 2.0 * float(np.log(best.candidate.trials)) < bic(stage) + WORTH
        stands = trial.accepted[-1].score.delta_bic < WORTH and stage.predicts_worse_than(trial)
        if likelier and stands and not undetermined(trial):
            return selector.on(base), trial
    return selector, stage


def _strongest(selector: Selector, causes: Sequence[Accepted]) -> Evaluated | None:
    """The wave along an axis with few positions that explains most of the squares beside the coarsest bases."""
    linearised = selector.on(selector.base.coarsest(selector.measurement)).stage(chosen_of(causes)).linearised
    some = linearised.thinned(SCANNED)
    beyond = some.squares - some.degrees_of_freedom
    if beyond < some.degrees_of_freedom:
        return None
    first = next(iter(evaluate(some, list(_waves(some)))), None)
    return first if first is not None and first.score.squares > MOST * beyond else None


def _waves(linearised: LinearisedFit) -> Iterator[Candidate]:
    """The strongest waves along each axis with few positions."""
    for axis in linearised.measurement.moving:
        if len(np.unique(np.round(linearised.positions(axis), 3))) <= MANY:
            yield from waves_of(linearised, axis, get_args(Component))
