"""Diagnosis of a model: missing causes, their verdicts, the new calibration and its improvement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.acceptance import Acceptance
from calibration.diagnosis.conclusion import Conclusion
from calibration.diagnosis.improvement import Figures, Volume, by_direction, closure, figures, volume
from calibration.diagnosis.linear_order import other_order
from calibration.diagnosis.machine_change import MachineChange, machine_change
from calibration.diagnosis.misplaced_targets import misplaced_targets
from calibration.diagnosis.next.ranking import ProposedMeasurement, proposed_measurements
from calibration.diagnosis.repeatability import Repeats, repeats
from calibration.diagnosis.residual import unexplained as unexplained_residual
from calibration.diagnosis.residual.absorber import absorbed
from calibration.diagnosis.residual.cancelling import cancelling
from calibration.diagnosis.residual.chance_level import SEARCHES, Chance
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.distance_correlation import Dependence
from calibration.diagnosis.residual.unnamed import add_unnamed
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.search import proposed_shapes
from calibration.diagnosis.search.candidates import Candidate, Untested, changes, library
from calibration.diagnosis.search.evaluation import Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Search, Selection, Selector
from calibration.diagnosis.search.stage import Accepted, Stage
from calibration.diagnosis.search.start_model import Base, base_of
from calibration.diagnosis.search.sudden_changes import sudden_changes
from calibration.diagnosis.separability import Separability, separability
from calibration.diagnosis.updated_model import new_calibration
from calibration.diagnosis.verdict import (
    Named,
    NotVisible,
    below_spacing,
    in_terms_of,
    named,
    not_visible,
    outliers,
    smallest_sizes,
    with_changed_lines,
)
from calibration.fit.acceptance import disagreement, relative_deviations, significant_share, too_few
from calibration.fit.curves.between_positions import BetweenPositions, with_curves_between
from calibration.fit.fit import Fit
from calibration.fit.identifiability import Identifiability, identifiability
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.fit.set_up.target_positions import TargetPosition, at_positions, target_positions
from calibration.fit.set_up.target_positions import findings as target_findings
from calibration.measurement.instruments import LaserTracker
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import is_log, moving_axes
from calibration.observation.outliers import Variance
from calibration.plausibility.checks import Finding, usable
from kinematics.effects import Unnamed
from kinematics.error_model.model import ErrorModel
from kinematics.user_error import UserError

GATE = 0.2
"""Chance that causes are searched for although the residuals are pure noise."""
LEFT = 0.01
"""Chance that residuals of pure noise are found to depend on something."""
AGAIN = 3
"""Times that the bases are selected again with the causes found."""
QUIET = 1e-2
"""Least ratio of the repeats' variance to the specified variance: rounded readings repeat exactly."""
LATE = 3.0
"""Multiple of the duration of the data: a clock that begins later counts from midnight or another epoch."""
LeftOver = Literal["report", "add"]
CONTRADICTED, ENOUGH = 1e-3, 20
"""p-value of the specification below which repeats replace it, and the degrees of freedom that they need."""


@dataclass(frozen=True)
class Diagnosis:
    """Result of a diagnosis: the data, the fits before and after, the causes and the new calibration."""

    measurement: Measurement
    base: Base
    before: Stage
    """Fit of the present model; of a calibration of other data as it is."""
    named: Stage
    """Fit with the causes found, errors that the model lacks no part of its noise."""
    after: Stage
    """Fit with unnamed effects too, where these were requested and predict better; otherwise `named`."""
    model: ErrorModel
    """The new calibration: the machine's effects, without the instrument's; the present one where it is confirmed."""
    findings: tuple[Finding, ...]
    repeats: Repeats | None
    tests: tuple[Test, ...]
    """Whiteness tests of the residuals of the present model."""
    tests_after: tuple[Test, ...]
    causes: tuple[Named, ...]
    unexplained_share: float
    """Squares of the residuals with all causes, as a share of those without any; reference as of the causes' shares."""
    not_visible: tuple[NotVisible, ...]
    untested: tuple[Untested, ...]
    identifiability: Identifiability | None
    """Identifiability of the error motions; None where a calibration of other data is the prior knowledge."""
    unexplained: Unexplained | None
    """Dependence that no cause explains, also where unnamed effects were added for it."""
    unnamed: str
    """Result of the request to add unnamed effects; empty without a request, or with nothing to add."""
    evaluated: tuple[Evaluated, ...]
    """All candidates, evaluated on the linearised fit of the result, the best first."""
    closure: float | None
    """Share of the residual beyond the noise that no rigid chain can explain; None where the data are too few."""
    volume: Volume
    proposed_measurements: tuple[ProposedMeasurement, ...]
    """Proposed measurements: first for an unexplained dependence, then by predicted information per minute."""
    acceptance: Acceptance
    """Comparison with no correction and with the present model on held-out blocks."""
    design: tuple[Separability, ...]
    """Causes that the design of these data can show and separate, without the readings."""
    between_positions: tuple[BetweenPositions, ...]
    """Uncertainty between the positions of each axis that was measured at few."""
    machine_change: MachineChange | None
    """Change of the machine since its present calibration; None without one of other data."""

    @property
    def reason(self) -> str:
        """Reason why the new calibration must not be used; empty if it may."""
        return self.acceptance.reason

    @property
    def accepted(self) -> bool:
        """True where the new calibration may be used."""
        return not self.reason

    @cached_property
    def significant_share(self) -> float:
        """Share of the measured states at which the correction exceeds twice its standard uncertainty."""
        kept = self.after.fit.measurement.rows(np.flatnonzero(self.after.fit.kept))
        return significant_share(relative_deviations(self.model, kept))

    @property
    def with_unnamed(self) -> bool:
        """True where the new model has unnamed effects."""
        return any(isinstance(each.candidate.effect, Unnamed) for each in self.after.accepted)

    @property
    def unexplained_um(self) -> float:
        """RMS, um per scalar (rotary axes: urad), of the dependence that no cause explains; 0 without one."""
        if self.unexplained is None:
            return 0.0
        return unexplained_residual.shared_rms(self.named.linearised, self.unexplained)

    @cached_property
    def one_by_one(self) -> list[Dependence]:
        """Dependence of the residuals on each variable alone; empty where `unexplained` is None."""
        return [] if self.unexplained is None else unexplained_residual.one_by_one(self.named.linearised)

    @cached_property
    def figures(self) -> tuple[Figures, Figures]:
        """Residuals before and after, of the same rows."""
        return figures(self.before, self._same_rows), figures(self.after, self._same_rows)

    @property
    def by_direction(self) -> dict[str, dict[str, float]]:
        """RMS residual, um, before and after, of the same rows, by direction (interferometer: by axis)."""
        rows = self._same_rows
        return {"before": by_direction(self.before, rows), "after": by_direction(self.after, rows)}

    @property
    def held_out_name(self) -> str:
        """Name of the held-out blocks, plural."""
        return self.after.linearised.held_out[1]

    @property
    def _same_rows(self) -> np.ndarray:
        """Mask `(n,)` of the rows that both fits kept."""
        return np.asarray(self.before.fit.kept & self.after.fit.kept)

    @property
    def smallest(self) -> list[tuple[str, float, str]]:
        """Name, size and unit of the smallest effects of one parameter that these data would show."""
        return list(smallest_sizes(self.evaluated, self.after.linearised.scalars))

    @property
    def next_measurement(self) -> str:
        """Recommended next measurement, as text for the workshop."""
        if self.proposed_measurements and self.conclusion.condition != "not noise":
            return self.proposed_measurements[0].text
        return self.conclusion.advice

    @cached_property
    def conclusion(self) -> Conclusion:
        """The figures that decide on success, and the sentences that they permit."""
        fit, left = self.after.fit, self.unexplained
        return Conclusion(
            tuple(cause.verdict for cause in self.causes),
            tuple(combined(self.tests_after, LEFT)),
            bool(self.tests_after),
            ""
            if left is None
            else f"{self.unexplained_um:.2f} um depend on {', '.join(left.variables)} (p = {left.p_value:.2g})",
            self.with_unnamed,
            self.acceptance.objection,
            fit.failed,
            fit.chi2_reduced,
            fit.variance_factor == 1.0,
            fit.degrees_of_freedom,
            "the present model" if self.base.present is None else "the present calibration, updated by these data,",
        )

    @property
    def noise_um(self) -> float:
        """RMS, um per scalar (rotary axes: urad), that residuals of pure noise would have."""
        return _noise_um(self.after.linearised)


class _Start(NamedTuple):
    """What a search starts from."""

    selector: Selector
    findings: list[Finding]
    positions: list[TargetPosition]
    """Positions of targets by the data."""
    noise: Repeats | None
    untested: list[Untested]


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


def diagnose(
    measurement: Measurement,
    calibration: ErrorModel | None = None,
    *,
    variance: Variance = "sheet",
    left_over: LeftOver = "report",
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Diagnosis of the present calibration, or without one of a model of all error motions, against the data.

    left_over: "report" only lists the dependence that no cause explains; "add" adds unnamed effects for it. force: the
    new calibration is accepted although there is a reason against it.

    UserError when the data are not plausible or cannot be fitted.
    """
    start = _start(measurement, calibration, variance, progress)
    if calibration is None:
        start = start._replace(selector=_determined(start.selector))
    bare = start.selector.bare
    searched = _searched(start.selector, bare, progress)
    completed = _completed(searched, left_over, progress)
    # without a cause, before and after are one
    after = searched.before if completed.stage is bare else completed.selector.cautious(completed.stage)
    return _concluded(start, searched, completed._replace(stage=after), calibration, force=force)


def _determined(selector: Selector) -> Selector:
    """The selector, with the coarser bases of the search where the rows are too few for its own.

    UserError where they are too few for these too.
    """
    coarser = selector.on(selector.base.coarser(selector.measurement, selector.progress))
    for tried in (selector, coarser):
        reason = too_few(tried.bare.fit, identifiability(tried.bare.fit))
        if not reason:
            return tried
    raise UserError(f"{selector.measurement.source}: {reason}")


def _searched(first: Selector, bare: Stage, progress: Callable[[str], None]) -> _Searched:
    """The causes of the residuals of the present model, of which `bare` is the fit."""
    tests = unexplained_residual.tests(bare.linearised)
    found = without = _Found(first, bare, ())
    # the noise of an axis hides whatever acts along it
    doubtful = _unrepeatable(bare) or len(bare.fit.outliers) or first.base.fine(first.measurement)
    if doubtful or combined(tests, GATE):
        found = _causes(first)
    progress("testing the residual")
    before = first.cautious(bare)
    return _Searched(before, tests, *_without_impostors(found, without, before))


def _completed(searched: _Searched, left_over: LeftOver, progress: Callable[[str], None]) -> _Completed:
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
    start: _Start, searched: _Searched, completed: _Completed, calibration: ErrorModel | None, *, force: bool
) -> Diagnosis:
    """The diagnosis: the named causes, the new calibration and its comparison with the present one."""
    first, found, dependence = start.selector, searched.found, searched.dependence
    selector, after, before, tests = completed.selector, completed.stage, searched.before, searched.tests
    bare = after.linearised if not after.accepted else selector.without_causes(after)
    # an unexplained dependence makes outliers too
    lost = outliers(after.fit, bare) if dependence is None else None
    causes = [*named(after, bare), *([] if lost is None else [lost]), *misplaced_targets(start.positions, after.fit)]
    evaluated = found.evaluated or tuple(evaluate(after.linearised, first.library))
    added = [f"{cause.kind} {cause.axis or ''}".strip() for cause in causes if cause.where == "machine"]
    acceptance = Acceptance.of(before, after, calibration, force=force)
    curved, between = with_curves_between(after.fit) if selector.base.curves else (after.fit, ())
    model = new_calibration(selector.base, curved, added, calibration)
    given, change = before, None
    if first.base.present is not None and calibration is not None:
        given = first.on(first.base.as_it_is).bare
        tests = unexplained_residual.tests(given.linearised)
        change = machine_change(selector.measurement, after.fit.kept, calibration, model)
        if acceptance.confirmed:
            model = calibration
        elif dependence is None:
            causes = with_changed_lines(causes, change, given, after)
    return Diagnosis(
        measurement=selector.measurement,
        base=selector.base,
        before=given,
        named=found.stage,
        after=after,
        model=model,
        findings=(*start.findings, *_findings(after.fit)),
        repeats=start.noise,
        tests=tuple(tests),
        tests_after=tuple(completed.tests),
        causes=tuple(causes),
        unexplained_share=after.linearised.squares / in_terms_of(bare, after.linearised),
        not_visible=(*not_visible(evaluated), *below_spacing(selector.measurement)),
        untested=tuple(start.untested),
        identifiability=identifiability(after.fit) if after.fit.prior.ndim == 1 else None,
        unexplained=dependence,
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


def _findings(fit: Fit) -> list[Finding]:
    """Anomalies of the data that the fit of the result shows."""
    too_many = disagreement(fit)
    return [*zero_findings(run_zeros(fit)), *([Finding("outliers", too_many, False)] if too_many else [])]


def _start(
    measurement: Measurement,
    calibration: ErrorModel | None,
    variance: Variance,
    progress: Callable[[str], None],
) -> _Start:
    """The start of the search; UserError where the data are not plausible or cannot be fitted."""
    progress("checking the data")
    measurement, findings, positions = _checked(measurement)
    base = base_of(measurement, calibration, progress)
    if base.choice is not None and (doubt := other_order(measurement, base.choice)):
        findings.append(Finding("chain", doubt, False))
    progress("fitting the present model")
    candidates, untested = library(measurement, base.model)
    if base.present is not None:
        free = [line.name for line in base.lines]
        candidates += [each for each in changes(base.present.model) if each.effect.name not in free]
    # in the log of a moving axis waves are no rare causes, and larger than others
    log = all(is_log(measurement, axis) for axis in moving_axes(measurement))
    search = Search(proposed_shapes.proposals if log else proposed_shapes.dominant)
    selector = Selector(measurement, base, candidates, variance, progress, search)
    noise = repeats(measurement, selector.bare.fit.kept)
    if variance == "sheet" and noise is not None and _contradicted(noise):
        selector = replace(selector, measurement=_as_noisy_as(measurement, noise), bare_stages={}, recent={})
        text = f"repeats contradict the instrument specification, its noise is taken from them: {noise.text}"
        findings.append(Finding("noise", text, False))
    return _Start(selector, findings, positions, noise, untested)


def _checked(measurement: Measurement) -> tuple[Measurement, list[Finding], list[TargetPosition]]:
    """The measurement with times from its first row, and targets at their positions by the data, which come with it.

    In between the findings about it. UserError where it cannot be used.
    """
    findings = usable(measurement)
    # where all rows of a target are in sequence, the search compares its offset with a knock at the instrument
    found = [each for each in target_positions(measurement) if not each.at_once]
    findings += target_findings(measurement, found)
    measurement = at_positions(measurement, found)
    measurement, late = _from_its_start(_with_station(measurement))
    if late:
        text = f"time_s begins at {late:.10g}: times are counted from the first row"
        findings.append(Finding("epoch", text, False))
    return measurement, findings, found


def _causes(selector: Selector) -> _Found:
    """The causes, each compared with its siblings: first those of the library, then searched shapes.

    Shapes must stand beside a smooth function of the variables on which the residual depends.
    """
    coarser = selector.on(selector.base.coarser(selector.measurement, selector.progress))
    found = _with_bases(coarser, sudden_changes(coarser))
    commoner = found.selector.commoner(found.stage)
    if commoner is not found.stage:
        found = _with_bases(found.selector, commoner.accepted)
    dependence = _dependence(found.stage, unexplained_residual.tests(found.stage.linearised))
    absorb = partial(absorbed, dependence=dependence)
    latest: list[Chance] = []

    def by_chance(linearised: LinearisedFit, evaluated: Evaluated) -> bool:
        """True where the same search finds as much in residuals with random signs."""
        if evaluated.candidate.kind not in SEARCHES:
            return False
        if not latest or latest[0].linearised is not linearised:
            latest[:] = [Chance(linearised, selector.library)]
        return latest[0].finds(evaluated.candidate, evaluated.score.gain)

    shapes = Search(proposed_shapes.proposals, absorb, by_chance)
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


def _unrepeatable(stage: Stage) -> bool:
    """True where the noise of a stage holds non-repeatability, or misfit, of an axis."""
    noise = stage.fit.measurement.noise
    return noise is not None and bool(noise.non_repeatability or noise.misfit)


def _dependence(stage: Stage, tests: Sequence[Test]) -> Unexplained | None:
    """The dependence of the residuals of a stage that its causes leave; None where they are noise as specified.

    tests: of these residuals. Non-repeatability may hide a dependence.
    """
    if not _unrepeatable(stage) and not combined(tests, LEFT):
        return None
    return unexplained_residual.unexplained(stage.linearised)


def _without_impostors(
    found: _Found, without: _Found, cautious: Stage
) -> tuple[_Found, list[Test], Unexplained | None]:
    """The result without impostors, the tests of its residuals, and the dependence that no cause explains.

    Impostors are causes that were accepted only because they imitate this dependence, alone or together. Where no cause
    remains, the bases of the search stay only if they predict held-out rows as well as those of the result `without`
    the search, whose fit with the uncertainty of errors that the model lacks is `cautious`.
    """
    while True:
        stage, selector = found.stage, found.selector
        searched = not stage.accepted and selector is not without.selector
        if searched and selector.cautious(stage).predicts_worse_than(cautious, 1.0):
            found = without
            continue
        blamed = cancelling(selector.without_causes(stage), stage.accepted) if len(stage.accepted) > 1 else []
        if not blamed:
            tests = unexplained_residual.tests(stage.linearised)
            dependence = _dependence(stage, tests)
            blamed = unexplained_residual.impostors(stage, dependence, selector.library) if dependence else []
            if not blamed:
                return found, tests, dependence
        kept: Sequence[tuple[Candidate, np.ndarray]] = [
            (each.candidate, each.size) for each in stage.accepted if not _among(each, blamed)
        ]
        fewer = selector.pruned(selector.stage(kept)) if kept else selector.bare
        found = found._replace(stage=fewer, evaluated=())


def _noise_um(linearised: LinearisedFit) -> float:
    spread = (
        np.linalg.inv(linearised.white)[linearised.good]
        * linearised.measurement.per_micro[linearised.rows][linearised.good, None]
    )
    return float(np.sqrt(np.sum(spread**2) / spread[:, :, 0].size))


def _among(accepted: Accepted, others: Sequence[Accepted]) -> bool:
    return any(accepted is other for other in others)


def _with_station(measurement: Measurement) -> Measurement:
    """The measurement; where it names no station of a tracker, all rows are of one, which may have been knocked."""
    if measurement.state.station is not None or not isinstance(measurement.instrument, LaserTracker):
        return measurement
    return replace(measurement, state=replace(measurement.state, station=measurement.groups))


def _from_its_start(measurement: Measurement) -> tuple[Measurement, float]:
    """The measurement, with times from its first row where its clock counts from an epoch.

    Also the time that was subtracted, s; 0 where the clock is kept.
    """
    time = measurement.state.time
    if time is None or time.min() <= LATE * np.ptp(time):
        return measurement, 0.0
    late = float(time.min())
    return replace(measurement, state=replace(measurement.state, time=time - late)), late


def _contradicted(noise: Repeats) -> bool:
    """True where repeats contradict the instrument specification.

    Repeats far apart in time count only where they scatter less than specified, since drift adds scatter.
    """
    return (
        (not noise.apart or noise.factor < 1.0) and noise.degrees_of_freedom >= ENOUGH and noise.p_value < CONTRADICTED
    )


def _as_noisy_as(measurement: Measurement, noise: Repeats) -> Measurement:
    """The measurement with the uncertainties of its instrument scaled to the noise of the repeats."""
    instrument = measurement.instrument
    specified = {field: getattr(instrument, field) for field in instrument.__struct_fields__ if field.startswith("u_")}
    factor = max(noise.factor, QUIET) ** 0.5
    scaled = {field: value * factor for field, value in specified.items()}
    return replace(measurement, instrument=msgspec.structs.replace(instrument, **scaled))
