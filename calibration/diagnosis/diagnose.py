"""Diagnosis of a model: missing causes, their verdicts, the new calibration and its improvement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from calibration.diagnosis.acceptance import Acceptance
from calibration.diagnosis.improvement import closure, volume
from calibration.diagnosis.machine_change import machine_change
from calibration.diagnosis.misplaced_targets import beside_causes, misplaced_targets
from calibration.diagnosis.next.ranking import proposed_measurements
from calibration.diagnosis.not_visible import below_spacing, not_visible
from calibration.diagnosis.preparation import Start, prepared
from calibration.diagnosis.residual import unexplained as unexplained_residual
from calibration.diagnosis.residual.absorber import absorbed
from calibration.diagnosis.residual.cancelling import cancelling
from calibration.diagnosis.residual.chance_level import ByChance
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.modulation import Modulated, modulated, modulation
from calibration.diagnosis.residual.undetermined_periods import Undetermined, at_positions, undetermined
from calibration.diagnosis.residual.unnamed import add_unnamed
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.result import LEFT, Diagnosis
from calibration.diagnosis.search.candidates import HIGHER_FREQUENCY, Candidate
from calibration.diagnosis.search.common_causes import commoner
from calibration.diagnosis.search.evaluation import Evaluated, evaluate
from calibration.diagnosis.search.imitated_causes import imitated
from calibration.diagnosis.search.selection import Search, Selection, Selector
from calibration.diagnosis.search.shapes import proposed_shapes
from calibration.diagnosis.search.stage import Accepted, Stage
from calibration.diagnosis.search.sudden_changes import sudden_changes
from calibration.diagnosis.separability import separability
from calibration.diagnosis.undecided_causes import squares_by_lost_motion, squares_by_undecided
from calibration.diagnosis.updated_model import new_calibration
from calibration.diagnosis.verdict import in_terms_of, named, outliers, with_changed_lines
from calibration.diagnosis.widening import UnseenErrors, Widened, errors_by_choice, unseen_errors, widened
from calibration.fit.acceptance import disagreement
from calibration.fit.curves.between_positions import with_curves_between
from calibration.fit.fit import Fit
from calibration.fit.identifiability import identifiability
from calibration.fit.set_up.repeated_centres import repeat_findings
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.fit.set_up.target_positions import findings as target_findings
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance
from calibration.plausibility.checks import Finding
from kinematics.error_model.model import ErrorModel
from kinematics.running.progress import Progress, numbered, silent

GATE = 0.2
"""Chance that causes are searched for although the residuals are pure noise."""
AGAIN = 3
"""Times that the bases are selected again with the causes found."""
DOUBTS = (unexplained_residual.misread, unexplained_residual.wandering, unexplained_residual.smoothed)
"""Each finds causes of a stage that only imitate another error; they are tried in turn."""
LeftOver = Literal["report", "add"]


class _Found(NamedTuple):
    """State of the search: its selector, the present stage and the candidates evaluated last."""

    selector: Selector
    stage: Stage
    evaluated: tuple[Evaluated, ...]


class _Searched(NamedTuple):
    """Result of the search for causes; the whiteness tests are those before and after it."""

    before: Stage
    """Fit of the present model, with the uncertainties of a result."""
    tests: list[Test]
    found: _Found
    tests_after: list[Test]
    dependence: Unexplained | None


class _Completed(NamedTuple):
    """The fit of the result, with its whiteness tests."""

    selector: Selector
    stage: Stage
    tests: list[Test]
    unnamed: str
    """Result of the request to add unnamed effects; empty without one, or with nothing to add."""


STEPS = 4
"""Steps of a diagnosis: the present model, the causes, the tests of the residual, the conclusions."""


def diagnose(
    measurement: Measurement,
    calibration: ErrorModel | None = None,
    *,
    variance: Variance = "sheet",
    left_over: LeftOver = "report",
    force: bool = False,
    progress: Progress = silent,
) -> Diagnosis:
    """Diagnosis of the present calibration, or without one of a model of all error motions, against the data.

    left_over: "report" only lists the dependence that no cause explains; "add" adds unnamed effects for it. force: the
    new calibration is accepted although there is a reason against it.

    UserError when the data are not plausible or cannot be fitted.
    """
    steps = [numbered(progress, number, STEPS) for number in range(1, STEPS + 1)]
    start = prepared(measurement, calibration, variance, steps[0], steps[1])
    bare = start.selector.bare
    searched = _searched(start.selector, bare, steps[2])
    completed = _completed(searched, left_over, steps[3])
    # without a cause, before and after are one
    after = searched.before if completed.stage is bare else completed.selector.cautious(completed.stage)
    steps[3]("conclusions and proposed measurements")
    return _concluded(start, searched, completed._replace(stage=after), calibration, force=force)


def _searched(first: Selector, bare: Stage, progress: Progress) -> _Searched:
    """The causes of the residuals of the present model, of which `bare` is the fit."""
    tests = unexplained_residual.tests(bare.linearised)
    found = without = _Found(first, bare, ())
    # the noise of an axis hides whatever acts along it, a larger noise of the instrument any cause
    doubtful = _noisier(bare) or len(bare.fit.outliers) or first.base.fine(first.measurement)
    # noise is also left where finer bases have taken the place of a cause
    if doubtful or combined(tests, GATE) or imitated(first, bare)[1] is not bare:
        found = _causes(first)
    progress("testing the residual")
    before = first.cautious(bare)
    return _Searched(before, tests, *_without_impostors(found, without, before))


def _completed(searched: _Searched, left_over: LeftOver, progress: Progress) -> _Completed:
    """The fit with the causes, and with unnamed effects where these are requested and predict better."""
    (selector, stage, _), tests = searched.found, searched.tests_after
    if searched.dependence is None or left_over != "add":
        return _Completed(selector, stage, tests, "")
    progress("adding unnamed effects")
    selector, complete, unnamed = add_unnamed(selector, stage, searched.dependence)
    if complete is not stage:
        tests = unexplained_residual.tests(complete.linearised)
    return _Completed(selector, complete, tests, unnamed)


def _concluded(
    start: Start, searched: _Searched, completed: _Completed, calibration: ErrorModel | None, *, force: bool
) -> Diagnosis:
    """The diagnosis: the named causes, the new calibration and its comparison with the present one."""
    first, found, dependence = start.selector, searched.found, searched.dependence
    selector, after, before, tests = completed.selector, completed.stage, searched.before, searched.tests
    bare = after.linearised if not after.accepted else selector.without_causes(after)
    positions = beside_causes(start.positions, absorbed(after.linearised, dependence))
    # an unexplained dependence makes outliers too
    lost = outliers(after.fit, bare) if dependence is None else None
    found_causes = named(after, bare)
    # a basis that the search has chosen itself is no fault of the model
    finer = [each for each in found_causes if each.kind == HIGHER_FREQUENCY and first.base.origin == "automatic"]
    causes = [each for each in found_causes if each not in finer]
    causes += [*([] if lost is None else [lost]), *misplaced_targets(positions, after.fit)]
    evaluated = found.evaluated or tuple(evaluate(after.linearised, first.library))
    added = [f"{cause.kind} {cause.axis or ''}".strip() for cause in causes if cause.where == "machine"]
    unexplained_um = 0.0 if dependence is None else unexplained_residual.shared_rms(found.stage.linearised, dependence)
    held = dependence is None or len(after.accepted) != len(found.stage.accepted)  # by the model, as an unnamed effect
    unseen = None if held or dependence is None else unseen_errors(after.linearised, dependence, calibration)
    curved, between = with_curves_between(after.fit) if selector.base.curves else (after.fit, ())
    alone = new_calibration(selector.base, curved, added, calibration)
    model, factor = _with_uncertainties(alone, completed, dependence, unseen, evaluated)
    acceptance = Acceptance.of(before, after, calibration, unexplained_um, unseen, model, force=force)
    given, change = before, None
    if first.base.present is not None and calibration is not None:
        given = first.on(first.base.as_it_is).bare
        tests = unexplained_residual.tests(given.linearised)
        change = machine_change(selector.measurement, after.fit.kept, calibration, model)
        if acceptance.confirmed:
            model, factor = calibration, 1.0
        elif dependence is None:
            causes = with_changed_lines(causes, change, given, after)
    return Diagnosis(
        measurement=selector.measurement,
        base=selector.base,
        before=given,
        named=found.stage,
        after=after,
        model=model,
        findings=(*start.findings, *target_findings(selector.measurement, positions), *_findings(after.fit)),
        repeats=start.noise,
        tests=tuple(tests),
        tests_after=tuple(completed.tests),
        causes=tuple(causes),
        finer=tuple(each.effect for each in finer),
        unexplained_share=after.linearised.squares / in_terms_of(bare, after.linearised),
        not_visible=(*not_visible(evaluated), *below_spacing(selector.measurement)),
        untested=tuple(start.untested),
        identifiability=identifiability(after.fit) if after.fit.prior.ndim == 1 else None,
        unexplained=dependence,
        widened=factor,
        unnamed=completed.unnamed,
        evaluated=evaluated,
        closure=closure(after.linearised),
        volume=volume(given, after),
        proposed_measurements=tuple(proposed_measurements(found.stage, causes, dependence)),
        acceptance=acceptance,
        design=tuple(separability(before.linearised, first.library)),
        between_positions=between,
        machine_change=change,
    )


def _with_uncertainties(
    model: ErrorModel,
    completed: _Completed,
    dependence: Unexplained | None,
    unseen: UnseenErrors | None,
    evaluated: Sequence[Evaluated],
) -> Widened:
    """The new calibration, its uncertainties enlarged by errors that it lacks."""
    selector, after = completed.selector, completed.stage
    if unseen is not None:
        return widened(model, selector.measurement, unseen.squares)
    if dependence is not None:
        return Widened(model, 1.0)
    finer = selector.with_finer_turns(after)
    by_choice = np.zeros(3) if finer is None else errors_by_choice(after.fit, finer)
    undecided = squares_by_undecided(after.linearised, evaluated)
    besides = np.maximum(undecided, squares_by_lost_motion(after.linearised))
    return widened(model, selector.measurement, by_choice, besides)


def _findings(fit: Fit) -> list[Finding]:
    """Anomalies of the data that the fit of the result shows."""
    too_many = disagreement(fit)
    outliers = [Finding("outliers", too_many, False)] if too_many else []
    return [*zero_findings(run_zeros(fit)), *repeat_findings(fit), *outliers]


def _causes(selector: Selector) -> _Found:
    """The causes, each compared with its siblings: first those of the library, then searched shapes.

    Shapes must be likely beside a smooth function of the variables on which the residual depends.
    """
    coarser = selector.on(selector.base.coarser(selector.measurement, selector.progress))
    found = _with_bases(coarser, sudden_changes(coarser))
    beside, more = imitated(found.selector, found.stage)
    if more is not found.stage:
        found = _with_bases(beside, more.accepted)
    common = commoner(found.selector, found.stage)
    if common is not found.stage:
        found = _with_bases(found.selector, common.accepted)
    tests = unexplained_residual.tests(found.stage.linearised)
    dependence = _dependence(found.stage, tests) or _random_walk(found.stage, tests)
    absorb = partial(absorbed, dependence=dependence)
    shapes = Search(proposed_shapes.proposals, absorb, ByChance(selector.library))
    return _with_bases(replace(found.selector, search=shapes), found.stage.accepted)


def _with_bases(selector: Selector, known: Sequence[Accepted]) -> _Found:
    """The causes beside those known; bases are selected again until the causes do not change them."""
    done: dict[str, tuple[Selection, Stage]] = {}

    def selected(known: Sequence[Accepted]) -> tuple[Selection, Stage]:
        """The causes beside those known, and the stage compared with siblings; once for the same base and causes."""
        key = repr((selector.base.bases, [(each.candidate.effect, each.size.tolist()) for each in known]))
        if key not in done:
            selection = selector.select(known)
            done[key] = selection, selector.against_siblings(selection.stages[-1])
        return done[key]

    selection, stage = selected(known)
    for _ in range(AGAIN):
        base = selector.chosen_again(stage)
        if base is selector.base and len(stage.accepted) == len(selection.stages[-1].accepted):
            break
        selector = selector.on(base)
        selection, stage = selected(stage.accepted)
    return _Found(selector, stage, selection.last_round)


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
    return unexplained_residual.unexplained(stage.linearised) if _doubtful(stage, tests) else None


def _random_walk(stage: Stage, tests: Sequence[Test]) -> Unexplained | None:
    """The random walk that the causes of a stage leave, as by `_dependence`.

    It withdraws no cause: beside so many steps nearly every cause would have little support.
    """
    return unexplained_residual.random_walk(stage.linearised) if _doubtful(stage, tests) else None


def _doubtful(stage: Stage, tests: Sequence[Test]) -> bool:
    """True where the residuals of a stage, by their tests, may be more than noise as specified."""
    return _unrepeatable(stage) or bool(combined(tests, LEFT))


def _without_impostors(
    found: _Found, without: _Found, cautious: Stage
) -> tuple[_Found, list[Test], Unexplained | None]:
    """The result without impostors, the tests of its residuals, and the dependence that no cause explains.

    Impostors are causes that were accepted only because they imitate this dependence, alone or together. Where no cause
    remains, the bases of the search stay only if they predict held-out rows as well as those of the result `without`
    the search, whose fit with the uncertainty of errors that the model lacks is `cautious`.
    """
    imitated: list[Modulated | Undetermined] = []
    while True:
        stage, selector = found.stage, found.selector
        searched = not stage.accepted and selector is not without.selector
        if searched and selector.cautious(stage).predicts_worse_than(cautious, 1.0):
            found = without
            continue
        blamed = cancelling(selector.without_causes(stage), stage.accepted) if len(stage.accepted) > 1 else []
        if not blamed:
            more: list[Modulated | Undetermined] = [*modulated(stage), *undetermined(stage)]
            imitated += more
            blamed = [each.accepted for each in more]
        for doubted in DOUBTS:
            blamed = blamed or doubted(stage)
        blamed = blamed or _unsupported(selector, stage)
        if not blamed:
            tests = unexplained_residual.tests(stage.linearised)
            dependence = _dependence(stage, tests) or next(filter(None, _imitated(stage, imitated)), None)
            blamed = unexplained_residual.impostors(stage, dependence, selector.library) if dependence else []
            if not blamed:
                return found, tests, dependence or _random_walk(stage, tests)
        kept: Sequence[tuple[Candidate, np.ndarray]] = [
            (each.candidate, each.size) for each in stage.accepted if not _among(each, blamed)
        ]
        fewer = selector.pruned(selector.stage(kept)) if kept else selector.bare
        found = found._replace(stage=fewer, evaluated=())


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
