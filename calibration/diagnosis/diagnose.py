"""The closed loop: is anything missing, what is it, how sure is that, and what does adding it bring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.improvement import Volume, by_direction, closure, volume
from calibration.diagnosis.next.ranking import ProposedMeasurement, proposed_measurements
from calibration.diagnosis.repeatability import Repeats, repeats
from calibration.diagnosis.residual import unexplained as remainder
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.distance_correlation import Dependence
from calibration.diagnosis.residual.unnamed import add_unnamed
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.search.candidates import Candidate, Untested, changes, library
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Accepted, Evaluated, Selector, Stage, evaluate
from calibration.diagnosis.search.start_model import Base, base_of
from calibration.diagnosis.updated_model import new_calibration
from calibration.diagnosis.verdict import Named, NotVisible, in_terms_of, named, not_visible, outliers, smallest_sizes
from calibration.fit.acceptance import no_gain, nominal_residuals, refuse_few, seen_by, significant_share
from calibration.fit.cross_validation import summed_up
from calibration.fit.identifiability import Identifiability, identifiability
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance
from calibration.plausibility.checks import Finding, usable
from kinematics.error_model.model import ErrorModel

GATE = 0.2
"""Chance that pure noise is looked into any further."""
LEFT = 0.01
"""Chance that pure noise is said to depend on something."""
AGAIN = 3
"""Times that the bases are chosen anew with what was found."""
QUIET = 1e-2
"""Share of the sheet's variance below which repeats are not believed: rounded readings repeat themselves."""
LATE = 3.0
"""Times that the data take: a clock that begins later counts from midnight, or from another epoch."""
LeftOver = Literal["report", "add"]
DOUBT, ENOUGH = 1e-3, 20
"""p-value of the instrument's sheet, from so many degrees of freedom of repeats, below which these say its noise."""


@dataclass(frozen=True)
class Diagnosis:
    """What the data say of a model."""

    measurement: Measurement
    base: Base
    before: Stage
    """The present model."""
    named: Stage
    """With the causes that were found."""
    after: Stage
    """With what has no name as well, where that was asked for and could be added."""
    model: ErrorModel
    """The new calibration: of the machine, without the instrument's effects."""
    findings: tuple[Finding, ...]
    repeats: Repeats | None
    tests: tuple[Test, ...]
    """Of the residuals of the present model."""
    tests_after: tuple[Test, ...]
    causes: tuple[Named, ...]
    left_share: float
    """Of what the model without causes leaves, as the shares of these: what is left with all of them."""
    not_visible: tuple[NotVisible, ...]
    untested: tuple[Untested, ...]
    identifiability: Identifiability | None
    """Of the error motions; None against a calibration, whose knowledge stands in for what the data do not see."""
    unexplained: Unexplained | None
    """What no cause explains, also where it was added without a name."""
    unnamed: str
    """What came of the request to add that; empty where there was none."""
    evaluated: tuple[Evaluated, ...]
    """All candidates, evaluated on the linearised fit of the result, the best first."""
    closure: float | None
    """Share of what is left beyond the noise that no rigid chain can explain; None where data are too few to say."""
    volume: Volume
    proposed_measurements: tuple[ProposedMeasurement, ...]
    """Measurements that would tell most, per minute, the best first."""
    reason: str
    """Reason why the new calibration must not be used; empty if it may."""

    @property
    def accepted(self) -> bool:
        """True where the new calibration may be used."""
        return not self.reason

    @cached_property
    def significant_share(self) -> float:
        """Share of the measured states at which the correction exceeds twice its standard uncertainty."""
        kept = self.after.fit.measurement.rows(np.flatnonzero(self.after.fit.kept))
        return significant_share(seen_by(self.model, kept))

    @property
    def with_unnamed(self) -> bool:
        """True where what no cause explains is in the new model."""
        return self.after is not self.named

    @property
    def unexplained_um(self) -> float:
        """RMS per scalar of what depends on variables that no cause explains; urad on rotary axes."""
        if self.unexplained is None:
            return 0.0
        return remainder.shared_rms(self.named.linearised, self.unexplained)

    @cached_property
    def one_by_one(self) -> list[Dependence]:
        """How what no cause explains depends on each variable alone; empty where nothing is left."""
        return [] if self.unexplained is None else remainder.one_by_one(self.named.linearised)

    @property
    def by_direction(self) -> dict[str, dict[str, float]]:
        """RMS residual, um, by direction (of an interferometer by axis), before and after."""
        return {"before": by_direction(self.before), "after": by_direction(self.after)}

    @property
    def smallest(self) -> list[tuple[str, float, str]]:
        """Name, size and unit of the smallest effects of one parameter that these data would show."""
        return list(smallest_sizes(self.evaluated, self.after.linearised.scalars))

    @property
    def next_measurement(self) -> str:
        """What to measure next, in workshop words."""
        if self.proposed_measurements:
            return self.proposed_measurements[0].says
        if self.unexplained is not None:
            what = ", ".join(self.unexplained.variables)
            return f"the same positions once more: what depends on {what} is the machine's where it comes again"
        return "nothing is asked for: no tie, and nothing left that depends on anything"

    @property
    def noise_um(self) -> float:
        """RMS per scalar that the residuals would have were they noise alone; urad on rotary axes."""
        return _noise_um(self.after.linearised)


class _Found(NamedTuple):
    """Where the search has come to."""

    selector: Selector
    stage: Stage
    evaluated: tuple[Evaluated, ...]


def diagnose(
    measurement: Measurement,
    calibration: ErrorModel | None = None,
    *,
    variance: Variance = "sheet",
    left_over: LeftOver = "report",
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """What a model of these data lacks: the present calibration, or one of all error motions.

    left_over: what is done with what no cause explains.

    UserError when the data can't be what they say they are, or can't be fitted.
    """
    progress("looking at the data")
    measurement, findings = _looked_at(measurement)
    base = base_of(measurement, calibration, progress)
    progress("fitting the present model")
    candidates, untested = library(measurement, base.model)
    candidates += changes(base.model) if base.origin == "updated" else []
    selector = Selector(measurement, base, candidates, variance, progress)
    noise = repeats(measurement, selector.bare.fit.kept)
    if variance == "sheet" and noise is not None and _in_doubt(noise):
        selector = replace(selector, measurement=_as_noisy_as(measurement, noise))
        says = f"the instrument's sheet is in doubt, its noise is taken from repeats: {noise.says}"
        findings.append(Finding("noise", says, False))
    before = selector.bare
    if calibration is None:
        refuse_few(before.fit, identifiability(before.fit))
    tests = remainder.tests(before.linearised)
    found = _Found(selector, before, ())
    if combined(tests, GATE) or len(before.fit.outliers) or base.fine:
        found = _causes(selector)
    progress("what is left")
    found, tests_after, left = _left(found)
    complete, unnamed = found, ""
    if left is not None and left_over == "add":
        progress("adding what has no name")
        selector, after, unnamed = add_unnamed(found.selector, found.stage, left)
        complete = found._replace(selector=selector, stage=after)
    selector, after = complete.selector, complete.stage
    if after is not found.stage:
        tests_after = remainder.tests(after.linearised)
    bare = after.linearised if not after.accepted else selector.bare.linearised
    causes = named(after, bare)
    # what no cause explains makes outliers as well
    lost = outliers(after.fit, bare) if left is None else None
    causes += [] if lost is None else [lost]
    evaluated = found.evaluated or tuple(evaluate(after.linearised, candidates))
    told = [f"{cause.kind} {cause.axis or ''}".strip() for cause in causes if cause.where == "machine"]
    return Diagnosis(
        selector.measurement,
        selector.base,
        before,
        found.stage,
        after,
        new_calibration(selector.base, after.fit, told, calibration),
        tuple(findings),
        noise,
        tuple(tests),
        tuple(tests_after),
        tuple(causes),
        after.linearised.squares / in_terms_of(bare, after.linearised),
        tuple(not_visible(evaluated)),
        tuple(untested),
        identifiability(after.fit) if after.fit.prior.ndim == 1 else None,
        left,
        unnamed,
        evaluated,
        closure(after.linearised),
        volume(before, after),
        tuple(proposed_measurements(found.stage, causes, evaluated)),
        _no_gain(after) if calibration is None else "",
    )


def _no_gain(stage: Stage) -> str:
    """Reason why the fitted model is no improvement over the nominal machine; empty if it is."""
    found, linearised = stage.fit, stage.linearised
    before, held = nominal_residuals(found), linearised.cross_validation
    everywhere = np.full_like(found.residual, np.nan)
    everywhere[found.kept] = before
    micro = found.measurement.per_micro[linearised.rows]
    counted = held.counted & found.kept[linearised.rows]
    if not counted.any():
        return no_gain(found, before, None)
    predicted = np.stack([held.residual_um / micro, everywhere[linearised.rows]])[:, counted]
    figures = summed_up(predicted, linearised.white[counted], micro[counted], held.blocks, "cells of space")
    return no_gain(found, before, figures)


def _looked_at(measurement: Measurement) -> tuple[Measurement, list[Finding]]:
    """The measurement on a clock that begins with it, and what is odd about it; UserError where it can't be used."""
    findings = usable(measurement)
    measurement, late = _from_its_start(measurement)
    if late:
        says = f"time_s begins at {late:.10g}: it is counted from the first row, as drift is"
        findings.append(Finding("epoch", says, False))
    return measurement, findings


def _causes(selector: Selector) -> _Found:
    """The causes, each held against its siblings, and the bases chosen anew until they stay with what was found."""
    selector = selector.on(selector.base.coarser(selector.measurement, selector.progress))
    selection = selector.select()
    for _ in range(AGAIN):
        stage = selector.against_siblings(selection.stages[-1])
        base = selector.chosen_again(stage)
        if base.choice == selector.base.choice:
            break
        selector = replace(selector, base=base)
        selection = selector.select(stage.accepted)
    else:
        stage = selector.against_siblings(selection.stages[-1])
    return _Found(selector, stage, selection.last_round)


def _left(found: _Found) -> tuple[_Found, list[Test], Unexplained | None]:
    """What is left, once causes that were only blamed for it are taken back."""
    while True:
        tests = remainder.tests(found.stage.linearised)
        left = remainder.unexplained(found.stage.linearised) if combined(tests, LEFT) else None
        blamed = remainder.impostors(found.stage, left, found.selector.library) if left else []
        if not blamed:
            return found, tests, left
        kept: Sequence[tuple[Candidate, np.ndarray]] = [
            (each.candidate, each.size) for each in found.stage.accepted if not _among(each, blamed)
        ]
        fewer = found.selector.pruned(found.selector.stage(kept)) if kept else found.selector.bare
        found = found._replace(stage=fewer, evaluated=())


def _noise_um(linearised: LinearisedFit) -> float:
    spread = (
        np.linalg.inv(linearised.white)[linearised.good]
        * linearised.measurement.per_micro[linearised.rows][linearised.good, None]
    )
    return float(np.sqrt(np.sum(spread**2) / spread[:, :, 0].size))


def _among(accepted: Accepted, others: Sequence[Accepted]) -> bool:
    return any(accepted is other for other in others)


def _from_its_start(measurement: Measurement) -> tuple[Measurement, float]:
    """The measurement on a clock of its own where its clock counts from an epoch; when that was, else 0."""
    time = measurement.state.time
    if time is None or time.min() <= LATE * np.ptp(time):
        return measurement, 0.0
    late = float(time.min())
    return replace(measurement, state=replace(measurement.state, time=time - late)), late


def _in_doubt(noise: Repeats) -> bool:
    """Drifts between repeats make them scatter more, never less."""
    return (not noise.apart or noise.factor < 1.0) and noise.degrees_of_freedom >= ENOUGH and noise.p_value < DOUBT


def _as_noisy_as(measurement: Measurement, noise: Repeats) -> Measurement:
    """The measurement with the uncertainties of its instrument as the repeats show them."""
    instrument = measurement.instrument
    sheet = {field: getattr(instrument, field) for field in instrument.__struct_fields__ if field.startswith("u_")}
    factor = max(noise.factor, QUIET) ** 0.5
    scaled = {field: value * factor for field, value in sheet.items()}
    return replace(measurement, instrument=msgspec.structs.replace(instrument, **scaled))
