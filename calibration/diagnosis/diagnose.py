"""Diagnosis of a model: missing causes, their verdicts, the new calibration and its improvement."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from calibration.diagnosis.acceptance import Acceptance
from calibration.diagnosis.improvement import closure
from calibration.diagnosis.misplaced_targets import beside_causes, misplaced_targets
from calibration.diagnosis.next.ranking import proposed_measurements
from calibration.diagnosis.not_visible import below_spacing, not_visible
from calibration.diagnosis.preparation import Start, prepared
from calibration.diagnosis.residual import unexplained as unexplained_residual
from calibration.diagnosis.residual.absorber import absorbed
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.unnamed import add_unnamed
from calibration.diagnosis.residual.whiteness import Test
from calibration.diagnosis.result import Diagnosis, noise_um
from calibration.diagnosis.search.candidates import HIGHER_FREQUENCY
from calibration.diagnosis.search.evaluation import Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Stage
from calibration.diagnosis.searched_causes import Searched, searched_causes
from calibration.diagnosis.separability import separability
from calibration.diagnosis.terms.conclusion.volume import volume
from calibration.diagnosis.unseen.beside_moving import BesideMoving, settled_beside
from calibration.diagnosis.unseen.fine_errors import squares_by_fine_errors
from calibration.diagnosis.unseen.random_walk import squares_by_walk
from calibration.diagnosis.unseen.undecided_causes import errors_by_forms, errors_by_ties, errors_by_undecided
from calibration.diagnosis.unseen.unseen_states import mean_squares
from calibration.diagnosis.updated_model import new_calibration
from calibration.diagnosis.verdict import Named, in_terms_of, named, outliers, with_changed_lines
from calibration.diagnosis.widening import UnseenErrors, Widened, errors_by_choice, unseen_errors, widened
from calibration.evaluation.machine_change import MachineChange, machine_change
from calibration.fit.acceptance import disagreement
from calibration.fit.curves.between_positions import BetweenPositions
from calibration.fit.fit import Fit
from calibration.fit.identifiability import identifiability
from calibration.fit.omitted_waves import with_curves_and_waves
from calibration.fit.set_up.repeated_centres import repeat_findings
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.fit.set_up.target_positions import TargetPosition
from calibration.fit.set_up.target_positions import findings as target_findings
from calibration.gaussian_terms.given.larger_range import within
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance
from calibration.plausibility.finding import Finding
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.running.progress import Progress, numbered, silent
from kinematics.state import TIME
from kinematics.transforms import Array

LeftOver = Literal["report", "add"]


class _Completed(NamedTuple):
    """The fit of the result, with its whiteness tests."""

    selector: Selector
    stage: Stage
    tests: list[Test]
    unnamed: str
    """Result of the request to add unnamed effects; empty without one, or with nothing to add."""


class _Evidence(NamedTuple):
    """The named causes, and the evidence for them."""

    bare: LinearisedFit
    """The fit without causes, with the noise of the result."""
    positions: list[TargetPosition]
    causes: list[Named]
    finer: tuple[Effect, ...]
    """Error motions whose bases the search has refined itself."""
    evaluated: tuple[Evaluated, ...]


class _Curved(NamedTuple):
    """The fit of the result with its error motions as curves, beside an unexplained function where there is one."""

    fit: Fit
    between: tuple[BetweenPositions, ...]
    unseen: UnseenErrors | None
    """Errors at unseen states beside the function; None without a function, or where an unnamed effect holds it."""
    beside: str
    """Variables of the function beside which it was fitted, as a list in words; empty without one."""
    moving: BesideMoving | None = None
    """The solution beside this function where it moves with time, with the noise that it leaves."""


class _Calibrated(NamedTuple):
    """The new calibration with its uncertainties, and its acceptance."""

    widened: Widened
    acceptance: Acceptance
    beside_function: bool
    present: Widened | None
    """The present calibration where these data confirm it: its uncertainties hold an unexplained error too."""


class _Given(NamedTuple):
    """The result beside the calibration of other data as it was given, or the present model."""

    before: Stage
    tests: list[Test]
    causes: list[Named]
    model: ErrorModel
    factor: float
    change: MachineChange | None


COMPARABLE = 10
"""Least number of rows in the ranges of the present calibration at which a new one is compared with it."""
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
    searched = searched_causes(start.selector, bare, steps[2])
    completed = _completed(searched, left_over, steps[3])
    # without a cause, before and after are one
    after = searched.before if completed.stage is bare else completed.selector.cautious(completed.stage)
    steps[3]("conclusions and proposed measurements")
    return _concluded(start, searched, completed._replace(stage=after), calibration, force=force)


def _completed(searched: Searched, left_over: LeftOver, progress: Progress) -> _Completed:
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
    start: Start, searched: Searched, completed: _Completed, calibration: ErrorModel | None, *, force: bool
) -> Diagnosis:
    """The diagnosis: the named causes, the new calibration and its comparison with the present one."""
    first, after, dependence = start.selector, completed.stage, searched.dependence
    measurement = completed.selector.measurement
    curved = _curved(searched, completed, calibration)
    # the solution beside a function is one of the linearised fit, far from it where the function is large; but a swing
    # that is large would also distort the sizes of causes that are seen only without it
    sized = after.fit.model if curved.beside and not searched.beside_swing else curved.fit.model
    evidence = _evidence(start, searched, completed, sized)
    new = _calibrated(searched, completed, evidence, curved, calibration, force=force)
    given = _compared_with_given(first, searched, completed, evidence, new, calibration)
    moving = curved.moving
    noisy, swing = (after.linearised, None) if moving is None else (moving.solution.plain, moving.swing)
    return Diagnosis(
        measurement=measurement,
        base=completed.selector.base,
        before=given.before,
        named=searched.found.stage,
        after=after,
        model=given.model,
        findings=(*start.findings, *target_findings(measurement, evidence.positions), *_findings(after.fit)),
        repeats=start.noise,
        tests=tuple(given.tests),
        tests_after=tuple(completed.tests),
        causes=tuple(given.causes),
        finer=evidence.finer,
        unexplained_share=after.linearised.squares / in_terms_of(evidence.bare, after.linearised),
        not_visible=(*not_visible(evidence.evaluated, measurement), *below_spacing(measurement)),
        untested=tuple(start.untested),
        identifiability=identifiability(after.fit) if after.fit.prior.ndim == 1 else None,
        unexplained=dependence,
        widened=given.factor,
        beside_function=new.beside_function,
        noise_um=noise_um(noisy),
        estimated_noise=noisy.measurement.noise,
        swing=swing,
        unnamed=completed.unnamed,
        evaluated=evidence.evaluated,
        closure=closure(after.linearised),
        volume=volume(after.fit.measurement, after.fit.model, given.before.fit.model),
        proposed_measurements=tuple(proposed_measurements(searched.found.stage, given.causes, dependence, swing)),
        acceptance=new.acceptance,
        design=tuple(separability(searched.before.linearised, first.library)),
        between_positions=curved.between,
        machine_change=given.change,
    )


def _curved(searched: Searched, completed: _Completed, calibration: ErrorModel | None) -> _Curved:
    """The fit of the result with its error motions as curves."""
    after, dependence, curves = completed.stage, searched.dependence, completed.selector.base.curves
    held = len(after.accepted) != len(searched.found.stage.accepted)  # by the model, as an unnamed effect
    unseen = None
    if dependence is not None and not held:
        moving, found = searched.moving, searched.found.stage
        # where noise and bases were found again, both stages lead to the same model
        if moving is not None and after is not found and moving.solution.plain is found.linearised:
            moving = settled_beside(completed.selector, after, dependence, moving.swinging)
        unseen = unseen_errors(after.linearised, dependence, calibration, curves=curves, moving=moving)
        if TIME in dependence.variables:
            unseen = unseen.of_at_least(squares_by_walk(after.linearised))
        if unseen.beside is not None:
            return _Curved(*unseen.beside, unseen, dependence.listed, moving)
    fit, between = with_curves_and_waves(after.fit, chosen=True)[:2] if curves else (after.fit, ())
    return _Curved(fit, between, unseen, "")


def _evidence(start: Start, searched: Searched, completed: _Completed, model: ErrorModel) -> _Evidence:
    """The named causes with their sizes in the model of the result, and the evidence for them."""
    first, after, dependence = start.selector, completed.stage, searched.dependence
    bare = after.linearised if not after.accepted else completed.selector.without_causes(after)
    positions = beside_causes(start.positions, absorbed(after.linearised, dependence))
    # an unexplained dependence makes outliers too
    lost = outliers(after.fit, bare) if dependence is None else None
    found = named(after, bare, model)
    # a basis that the search has chosen itself is no fault of the model
    finer = [each for each in found if each.kind == HIGHER_FREQUENCY and first.base.origin == "automatic"]
    causes = [each for each in found if each not in finer]
    causes += [*([] if lost is None else [lost]), *misplaced_targets(positions, after.fit)]
    evaluated = searched.found.evaluated or tuple(evaluate(after.linearised, first.library))
    return _Evidence(bare, positions, causes, tuple(each.effect for each in finer), evaluated)


def _calibrated(
    searched: Searched,
    completed: _Completed,
    evidence: _Evidence,
    curved: _Curved,
    calibration: ErrorModel | None,
    *,
    force: bool,
) -> _Calibrated:
    """The new calibration with its uncertainties, and its acceptance."""
    selector, after, dependence = completed.selector, completed.stage, searched.dependence
    added = [f"{cause.kind} {cause.axis or ''}".strip() for cause in evidence.causes if cause.where == "machine"]
    with_causes = searched.found.stage.linearised
    unexplained_um = 0.0 if dependence is None else unexplained_residual.shared_rms(with_causes, dependence)
    alone = new_calibration(selector.base, curved.fit, added, calibration, curved.beside)
    undecided, fine = errors_by_ties(after), np.zeros(3)
    forms = undecided[:0]
    if dependence is None:
        undecided = np.concatenate([undecided, errors_by_undecided(after.linearised, evidence.evaluated)])
        forms, fine = errors_by_forms(after, selector.library), squares_by_fine_errors(after.linearised)
    elif curved.moving is not None:
        fine = squares_by_fine_errors(curved.moving.solution.free)
    unseen = curved.unseen
    new = _with_uncertainties(alone, completed, dependence, unseen, np.concatenate([undecided, forms]), fine)
    undecided_um = math.sqrt(float(mean_squares(undecided).sum()))
    acceptance = Acceptance.of(
        searched.before, after, calibration, unexplained_um, unseen, new.model, undecided_um, force=force
    )
    if not acceptance.confirmed or calibration is None:
        return _Calibrated(new, acceptance, bool(curved.beside), None)
    present = Widened(calibration, 1.0)
    if unseen is not None:
        present = widened(calibration, selector.measurement, unseen.squares_without)
    return _Calibrated(new, acceptance, False, present)


def _compared_with_given(
    first: Selector,
    searched: Searched,
    completed: _Completed,
    evidence: _Evidence,
    new: _Calibrated,
    calibration: ErrorModel | None,
) -> _Given:
    """The result beside the calibration of other data as it was given; without one beside the present model."""
    model, factor = new.widened
    known = first.base.calibration
    if known is None or calibration is None:
        return _Given(searched.before, searched.tests, evidence.causes, model, factor, None)
    before, causes, after = first.on(first.base.as_it_is).bare, evidence.causes, completed.stage
    measurement = completed.selector.measurement
    common = after.fit.kept & within(calibration, measurement)
    change = machine_change(measurement, common, known, model) if np.count_nonzero(common) >= COMPARABLE else None
    if new.present is not None:
        model, factor = new.present
    elif searched.dependence is None and change is not None:
        causes = with_changed_lines(causes, change, before, after)
    return _Given(before, unexplained_residual.tests(before.linearised), causes, model, factor, change)


def _with_uncertainties(
    model: ErrorModel,
    completed: _Completed,
    dependence: Unexplained | None,
    unseen: UnseenErrors | None,
    possible: Array,
    fine: Array,
) -> Widened:
    """The new calibration, its uncertainties enlarged by possible errors `(k, m, 3)`, and by fine ones."""
    selector, after = completed.selector, completed.stage
    if unseen is not None:
        return widened(model, selector.measurement, unseen.squares, fine, possible)
    if dependence is not None:
        return Widened(model, 1.0)
    finer = selector.with_finer_turns(after)
    by_choice = np.zeros(3) if finer is None else errors_by_choice(after.fit, finer)
    return widened(model, selector.measurement, by_choice, fine, possible)


def _findings(fit: Fit) -> list[Finding]:
    """Anomalies of the data that the fit of the result shows."""
    too_many = disagreement(fit)
    outliers = [Finding("outliers", too_many, False)] if too_many else []
    return [*zero_findings(run_zeros(fit)), *repeat_findings(fit), *outliers]
