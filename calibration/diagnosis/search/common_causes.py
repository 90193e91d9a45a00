"""Common causes in place of rare ones that imitate them: compared as a whole, since one alone explains less."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.causes import jumps
from calibration.diagnosis.search.evaluation import SEEN, WORTH, Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import squares_of_all
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Accepted, Stage, chosen_of
from kinematics.effects import LocationJump, StationShift

UNSEEN = 1e-12
"""Least sum of squares that is not zero."""


def commoner(selector: Selector, stage: Stage) -> Stage:
    """The stage with common causes in place of a rare one, where these explain as much.

    Also with a drift along X, Y and Z in place of a growth beside a part of this drift, where it explains more, and
    with a knock at the instrument in place of several jumps of the machine.
    """
    stage = knocked(selector, stage)
    for i, own in enumerate(stage.accepted):
        others = [each for each in stage.accepted if each is not own]
        beside = own.candidate.kind == "thermal-scale" and any(each.candidate.shifts_tool for each in others)
        if not (own.candidate.rarity or beside) or _irreplaceable(selector, stage, i):
            continue
        library = [candidate for candidate in selector.library if candidate.cause != own.candidate.cause]
        lacking = replace(selector, library=library)
        for known in (*drifting(lacking, stage, i), *([] if beside else [others])):
            trial = lacking.select(known).stages[-1]
            likelier = trial.rarity == stage.rarity and trial.cost < stage.cost
            less_rare = trial.rarity < stage.rarity and trial.cost < stage.cost + 2.0 * own.candidate.rarity
            if likelier or less_rare:
                return commoner(selector, trial)
    return stage


def knocked(selector: Selector, stage: Stage) -> Stage:
    """The stage with one knock at the instrument in place of several jumps of the machine, where it is far likelier.

    By the data alone: zeros of axes that were lost at once may have the very signal of a knock, which is a tie. The
    jumps have one moment. A set-up that is knocked already is not knocked again.
    """
    jumping = [i for i, each in enumerate(stage.accepted) if isinstance(each.candidate.effect, LocationJump)]
    if len(jumping) < 2:
        return stage
    first, without = stage.accepted[jumping[0]].candidate, stage.without(*jumping)
    others = [each for i, each in enumerate(stage.accepted) if i not in jumping]
    known = {each.candidate.cause for each in others}
    since = first.effect.moment
    for knock in jumps(selector.measurement):
        if not isinstance(knock, StationShift):
            continue
        candidate = Candidate(msgspec.structs.replace(knock, since_s=since), 1, first.trials)
        if candidate.cause in known:
            continue
        (tried,) = evaluate(without, [candidate])
        trial = selector.stage([*chosen_of(others), (tried.candidate, tried.score.size)])
        if trial.cost_of_choices < stage.cost_of_choices + WORTH:
            return trial
    return stage


def drifting(selector: Selector, stage: Stage, index: int) -> Iterator[Sequence[Accepted]]:
    """The causes without one, with a thermal drift along X, Y and Z of one course; nothing where none can be.

    A drift is a vector: its directions, one by one, leave the others' part and seem to explain little. The course is
    that of its clearest direction among the causes; else the one that explains most.
    """
    others = [each for i, each in enumerate(stage.accepted) if i != index]
    without = stage.without(index)
    directions = [each for each in others if each.candidate.shifts_tool]
    if directions:
        clearest = min(directions, key=lambda each: each.score.delta_bic).candidate
        effects = [msgspec.structs.replace(clearest.effect, component=component) for component in "XYZ"]
        vectors = [evaluate(without, [replace(clearest, effect=effect) for effect in effects])]
    else:
        courses: dict[str, list[Candidate]] = {}
        for candidate in selector.library:
            if candidate.shifts_tool:
                course = msgspec.structs.replace(candidate.effect, component="X")
                courses.setdefault(repr(course), []).append(candidate)
        vectors = [evaluate(without, candidates) for candidates in courses.values()]
    if vectors:
        best = max(vectors, key=lambda vector: _squares(without, vector))
        rest = chosen_of([each for each in others if not each.candidate.shifts_tool])
        yield selector.stage([*rest, *((each.candidate, each.score.size) for each in best)]).accepted


def _irreplaceable(selector: Selector, stage: Stage, index: int) -> bool:
    """True where all visible candidates together, in place of a cause, explain much less than the cause does."""
    own = stage.accepted[index]
    if not stage.needs(own):
        return False
    without = stage.without(index)
    others = [each for each in selector.evaluated(without, stage.accepted) if each.projected.visible >= SEEN]
    return stage.needs(own, _squares(without, others) / max(own.score.squares, UNSEEN))


def _squares(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> float:
    """Reduction of the sum of squares by all of some candidates together."""
    return squares_of_all([each.projected for each in evaluated], linearised.residual)
