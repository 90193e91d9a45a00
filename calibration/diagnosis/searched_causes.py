"""The search for missing causes: first in the library, then searched shapes; and the doubts about those found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.forms import with_likelier_forms
from calibration.diagnosis.residual import unexplained as unexplained_residual
from calibration.diagnosis.residual.absorber import MOST, absorbed, function_of_tool, share_of_excess
from calibration.diagnosis.residual.cancelling import cancelling
from calibration.diagnosis.residual.chance_level import ByChance
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.modulation import Modulated, modulated, modulation
from calibration.diagnosis.residual.recurring import recurring
from calibration.diagnosis.residual.undetermined_periods import Undetermined, at_positions, undetermined
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.result import LEFT
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.common_causes import commoner
from calibration.diagnosis.search.evaluation import Evaluated
from calibration.diagnosis.search.imitated_causes import imitated
from calibration.diagnosis.search.selection import Search, Selection, Selector
from calibration.diagnosis.search.shapes import proposed_shapes
from calibration.diagnosis.search.shapes.imitated_waves import imitated_wave
from calibration.diagnosis.search.stage import Accepted, Stage, chosen_of, unconfirmed
from calibration.diagnosis.search.sudden_changes import sudden_changes, with_outliers_beyond
from calibration.diagnosis.unseen.beside_moving import (
    BesideMoving,
    beside_moving,
    parts_of_swing,
    without_evidence,
    without_swing,
)
from calibration.diagnosis.unseen.fast_swing import fast_swing
from calibration.diagnosis.verdict import verdict_of
from kinematics.running.progress import Progress, silent

GATE = 0.2
"""Chance that causes are searched for although the residuals are pure noise."""
AGAIN = 3
"""Times that the bases are selected again with the causes found."""
DOUBTS = (
    *(unexplained_residual.misread, unexplained_residual.wandering, unexplained_residual.smoothed, recurring),
    unconfirmed,
)
"""Each finds causes of a stage that only imitate another error, or that chance gives; they are tried in turn."""


class Found(NamedTuple):
    """State of the search: its selector, the present stage and the candidates evaluated last."""

    selector: Selector
    stage: Stage
    evaluated: tuple[Evaluated, ...]


class Searched(NamedTuple):
    """Result of the search for causes; the whiteness tests are those before and after it."""

    before: Stage
    """Fit of the present model, with the uncertainties of a result."""
    tests: list[Test]
    found: Found
    tests_after: list[Test]
    dependence: Unexplained | None
    """The dependence that no cause explains."""
    moving: BesideMoving | None = None
    """The model beside it, as far as it is an error of the tool that moves with time."""
    beside_swing: bool = False
    """True for causes that were found in the observations less this swing."""


def searched_causes(first: Selector, bare: Stage, progress: Progress) -> Searched:
    """The causes of the residuals of the present model, of which `bare` is the fit."""
    return _with_causes_beside_swing(_searched(first, bare, progress), progress)


def _searched(first: Selector, bare: Stage, progress: Progress) -> Searched:
    """The causes that the observations of a selector show as they are."""
    tests = unexplained_residual.tests(bare.linearised)
    found = without = Found(first, bare, ())
    # the noise of an axis hides whatever acts along it, a larger noise of the instrument any cause
    doubtful = _noisier(bare) or len(bare.fit.outliers) or first.base.fine(first.measurement)
    # noise is also left where finer bases have taken the place of a cause
    hidden = (search(first, bare)[1] is not bare for search in (imitated, imitated_wave))
    if doubtful or combined(tests, GATE) or any(hidden):
        found = _causes(first)
        found = found._replace(stage=with_outliers_beyond(found.selector, found.stage))
    progress("testing the residual")
    before = first.cautious(bare)
    found, tests_after, dependence = _without_impostors(found, without, before)
    stage = found.stage if dependence else with_likelier_forms(found.selector, found.stage)
    if stage is not found.stage:
        found, tests_after = found._replace(stage=stage), unexplained_residual.tests(stage.linearised)
    found = found._replace(stage=found.selector.with_odds_of_ties(found.stage))
    return Searched(before, tests, found, tests_after, dependence)


def _with_causes_beside_swing(searched: Searched, progress: Progress) -> Searched:
    """The result with further causes that the observations less a swing show, if there is one.

    The smooth function of time that shows the swing imitates them: they fell before the swing was known. The swing is
    found again beside them, and a part of it falls.
    """
    (selector, stage, _), dependence = searched.found, searched.dependence
    function = function_of_tool(stage.linearised, dependence) if dependence else None
    if dependence is None or function is None:
        return searched
    of_tool = dependence._replace(variables=function.variables, lengths=function.lengths)
    moving = beside_moving(selector, stage, of_tool)
    if of_tool.variables == dependence.variables:
        searched = searched._replace(moving=moving)
    quiet = without_swing(selector, stage, of_tool, moving)
    if quiet is None:
        return searched
    progress("searching for causes beside a swing")
    less = _searched(quiet, quiet.bare, silent).found
    causes = less.stage.accepted
    while len(causes) > len(searched.found.stage.accepted):
        stage = selector.stage(chosen_of(causes))
        of_tool = unexplained_residual.of_same_variables(stage.linearised, of_tool)
        moving = beside_moving(selector, stage, of_tool)
        if moving is None:
            break
        parts = parts_of_swing(selector, stage, moving)
        if not parts:
            found = Found(selector, stage.judged_by(causes), less.evaluated)
            tests = unexplained_residual.tests(stage.linearised)
            return Searched(searched.before, searched.tests, found, tests, of_tool, moving, beside_swing=True)
        causes = tuple(each for own, each in zip(stage.accepted, causes, strict=True) if not _among(own, parts))
    return searched


def _causes(selector: Selector) -> Found:
    """The causes, each compared with its siblings: first those of the library, then searched shapes.

    Shapes must be likely beside a smooth function of the variables on which the residual depends.
    """
    coarser = selector.on(selector.base.coarser(selector.measurement, selector.progress))
    found = _with_bases(coarser, sudden_changes(coarser))
    beside, more = imitated(found.selector, found.stage)
    if more is not found.stage:
        found = _with_bases(beside, more.accepted)
    beside, more = imitated_wave(found.selector, found.stage)
    if more is not found.stage:
        found = _with_bases(beside, more.accepted)
    # causes that leave most of the excess imitate an unknown one, and so would those in place of them
    if found.stage.accepted and _explain_most(found.selector, found.stage):
        common = commoner(found.selector, found.stage)
        if common is not found.stage:
            found = _with_bases(found.selector, common.accepted)
    tests = unexplained_residual.tests(found.stage.linearised)
    dependence = _dependence(found.stage, tests) or _random_walk(found.stage, tests)
    absorb = partial(absorbed, dependence=dependence)
    shapes = Search(proposed_shapes.proposals, absorb, ByChance(selector.library))
    return _with_bases(replace(found.selector, search=shapes), found.stage.accepted)


def _explain_most(selector: Selector, stage: Stage) -> bool:
    """True where the causes of a stage explain most of what exceeds the noise."""
    return share_of_excess(selector.without_causes(stage), stage.linearised) > MOST


def _with_bases(selector: Selector, known: Sequence[Accepted]) -> Found:
    """The causes beside those known; bases are selected again until the causes do not change them.

    Beside causes that leave most of the excess nothing more is searched for: it would imitate the rest.
    """
    done: dict[str, tuple[Selection, Stage]] = {}

    def selected(known: Sequence[Accepted]) -> tuple[Selection, Stage]:
        """The causes beside those known, and the stage compared with siblings; once for the same base and causes."""
        key = repr((selector.base.bases, _forms(known)))
        if key not in done:
            selection = selector.select(known)
            done[key] = selection, selector.against_siblings(selection.stages[-1])
        return done[key]

    selection, stage = selected(known)
    for _ in range(AGAIN):
        base = selector.chosen_again(stage)
        # a selection would add again the causes that its siblings have replaced
        back = _forms(stage.accepted) == _forms(known)
        settled = back or len(stage.accepted) == len(selection.stages[-1].accepted)
        if base is selector.base and settled:
            break
        imitating = bool(stage.accepted) and not _explain_most(selector, stage)
        selector, known = selector.on(base), stage.accepted
        if imitating:
            beside = selector.against_siblings(selector.pruned(selector.stage(chosen_of(known))))
            return Found(selector, beside, ())
        selection, stage = selected(known)
    return Found(selector, stage, selection.last_round)


def _forms(accepted: Sequence[Accepted]) -> list[tuple[object, ...]]:
    """Forms of causes, and the moments of those that begin at one: a fit refines their other shapes."""
    return [(*each.candidate.form, each.candidate.effect.moment) for each in accepted]


def _noisier(stage: Stage) -> bool:
    """True where the noise of a stage is larger than specified: it may hold errors that the model lacks."""
    noise = stage.fit.measurement.noise
    return _unrepeatable(stage) or (noise is not None and noise.instrument_factor > 1.0)


def _unrepeatable(stage: Stage) -> bool:
    """True where the noise of a stage holds non-repeatability, or misfit, of an axis."""
    noise = stage.fit.measurement.noise
    return noise is not None and bool(noise.non_repeatability or noise.misfit)


def _dependence(stage: Stage, tests: Sequence[Test]) -> Unexplained | None:
    """The dependence of the residuals of a stage that its causes leave; None where they are noise as specified.

    tests: of these residuals. Non-repeatability may hide a dependence.
    """
    if not _doubtful(stage, tests):
        return None
    smooth = unexplained_residual.unexplained(stage.linearised)
    return fast_swing(stage.linearised, smooth) or smooth


def _random_walk(stage: Stage, tests: Sequence[Test], *, shown: bool = False) -> Unexplained | None:
    """The random walk that the causes of a stage leave, as by `_dependence`; `shown` by a cause that was a part of it.

    It withdraws no cause: beside so many steps nearly every cause would have little support.
    """
    doubtful = shown or _doubtful(stage, tests)
    return unexplained_residual.random_walk(stage.linearised, shown=shown) if doubtful else None


def _doubtful(stage: Stage, tests: Sequence[Test]) -> bool:
    """True where the residuals of a stage, by their tests, may be more than noise as specified."""
    return _unrepeatable(stage) or bool(combined(tests, LEFT))


def _without_impostors(found: Found, without: Found, cautious: Stage) -> tuple[Found, list[Test], Unexplained | None]:
    """The result without impostors, the tests of its residuals, and the dependence that no cause explains.

    Impostors are causes that were accepted only because they imitate this dependence, alone or together. Where no
    clear cause remains, causes and bases of the search stay only if they predict held-out rows as well as the result
    `without` the search, whose fit with the uncertainty of errors that the model lacks is `cautious`. So do its bases
    beside clear causes.
    """
    imitated: list[Modulated | Undetermined] = []
    wandered = False
    while True:
        found = found if found.stage.accepted else _with_better_bases(found, without, cautious)
        stage, selector = found.stage, found.selector
        blamed = cancelling(selector.without_causes(stage), stage.accepted) if len(stage.accepted) > 1 else []
        if blamed and unexplained_residual.stand_together(stage, blamed):
            blamed = []
        if not blamed:
            more: list[Modulated | Undetermined] = [*modulated(stage), *undetermined(stage)]
            imitated += more
            blamed = [each.accepted for each in more]
        for doubted in DOUBTS:
            if not blamed:
                blamed = doubted(stage)
                wandered |= bool(blamed) and doubted is unexplained_residual.wandering
        blamed = blamed or _unsupported(selector, stage)
        if not blamed:
            tests = unexplained_residual.tests(stage.linearised)
            dependence = _dependence(stage, tests) or next(filter(None, _imitated(stage, imitated)), None)
            if dependence:
                blamed = unexplained_residual.impostors(stage, dependence, selector.library)
                blamed = blamed or without_evidence(selector, stage, dependence)
            elif combined(tests, LEFT):
                blamed = unexplained_residual.small_parts(stage)
            weak = bool(stage.accepted) and all(verdict_of(each) == "weak" for each in stage.accepted)
            if not blamed and weak and _predicts_worse(found, cautious):
                blamed = [*stage.accepted]
            if not blamed:
                better = _with_better_bases(found, without, cautious)
                if better is found:
                    return found, tests, dependence or _random_walk(stage, tests, shown=wandered)
                found = better
                continue
        kept: Sequence[tuple[Candidate, np.ndarray]] = [
            (each.candidate, each.size) for each in stage.accepted if not _among(each, blamed)
        ]
        # a cause that has fallen may have kept a sibling of another one away
        fewer = selector.against_siblings(selector.pruned(selector.stage(kept))) if kept else selector.bare
        found = found._replace(stage=fewer, evaluated=())


def _with_better_bases(found: Found, without: Found, cautious: Stage) -> Found:
    """The result, or its causes beside the bases `without` the search where these predict held-out rows better.

    cautious: as in `_without_impostors`.
    """
    if found.selector is without.selector or not _predicts_worse(found, cautious):
        return found
    if not found.stage.accepted:
        return without
    first = without.selector
    beside = first.against_siblings(first.pruned(first.stage(chosen_of(found.stage.accepted))))
    other = Found(first, beside, ())
    return found if _predicts_worse(other, cautious) else other


def _predicts_worse(found: Found, cautious: Stage) -> bool:
    """True where a result predicts held-out rows worse than the one without a search, as `_without_impostors`."""
    return found.selector.cautious(found.stage).predicts_worse_than(cautious, 1.0)


def _unsupported(selector: Selector, stage: Stage) -> list[Accepted]:
    """Causes of a stage without evidence where errors that the model lacks are part of the noise."""
    cautious = selector.cautious(stage)
    both = zip(stage.accepted, cautious.accepted, strict=True)
    return [each for each, other in both if other.score.delta_bic > 0.0]


def _imitated(stage: Stage, imitated: Sequence[Modulated | Undetermined]) -> Iterator[Unexplained | None]:
    """The error that each of some causes imitates, in the residual of a stage without them."""
    for each in imitated:
        found = stage.linearised
        yield modulation(found, each) if isinstance(each, Modulated) else at_positions(found, each)


def _among(accepted: Accepted, others: Sequence[Accepted]) -> bool:
    return any(accepted is other for other in others)
