"""Several instruments in one fit: spheres for the rotary axes, an interferometer for the scales, a ballbar, ...

All measurements determine one model of the machine; each has its own registration and its own noise. With the
registrations eliminated, the information of the measurements on the parameters adds up. The order of the measurements
has no effect.

The others also predict each measurement alone. They contradict each other where they differ in directions of the
parameters that both show better than the prior does: with the information A of the one and B of the others, the
difference d of their estimates has the inverse covariance P = A (A + B)^-1 B (the parallel sum), and d'P d the chi2
distribution with the rank of P. The prior has no part in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import msgspec
import numpy as np

from calibration.fit.acceptance import Judged, disagreement, nominal_residuals, reason_against, refuse_few
from calibration.fit.calibrate import in_datum, provenance
from calibration.fit.cross_validation import CrossValidation, cross_validate
from calibration.fit.fit import Fit
from calibration.fit.identifiability import LOW_LINES, Identifiability, identifiability, of_low_degrees
from calibration.fit.joint import Joint, registered
from calibration.fit.set_up.checked_data import CheckedData
from calibration.fit.set_up.common_basis import common_basis
from calibration.fit.set_up.distances import distance_findings
from calibration.fit.set_up.drift import repeat_findings
from calibration.fit.set_up.explained import AUTO, Explained, Wanted, explained
from calibration.fit.set_up.rows_and_noise import noise_findings, outlier_findings
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.fit.written.next_stop import with_next_stop
from calibration.gaussian_terms.geometry import bands_of
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import least_priors, priors
from calibration.observation.mean_lines import centred
from calibration.observation.outliers import Variance
from calibration.plausibility.finding import Finding
from kinematics.basis import Basis
from kinematics.effects import Effect, ErrorMotion
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine
from kinematics.running.progress import Progress, numbered, silent
from kinematics.transforms import Array
from kinematics.user_error import UserError
from rendering.shown import Shown

CONTRADICTION_P = 1e-3
"""p-value below which a measurement contradicts the others."""


@dataclass(frozen=True)
class Part:
    """One measurement in the fit of all."""

    alone: Fit
    """Its own fit."""
    together: Fit
    """The fit of its registration to the model of all."""
    before: Array
    """Residuals `(kept, d)`, mm and rad, of the nominal machine with a registration of its own."""
    by_others: Fit
    """The fit of its registration to the model of the others."""
    p_value: float
    """p-value of its difference from the others; 1 where they share no direction."""
    held_out: CrossValidation | None
    """Residuals of its blocks, predicted by its other blocks and the other measurements."""

    @classmethod
    def of(cls, joint: Joint, number: int, *, hold_out: bool) -> Part:
        """One of the measurements in the fit of all."""
        own = joint.shares[number]
        model, root = joint.by([*joint.shares[:number], *joint.shares[number + 1 :]])
        together, by_others = registered(own.alone, joint.result), registered(own.alone, model)
        held_out = cross_validate(own.alone.good, model, root) if hold_out else None
        return cls(own.alone, together, nominal_residuals(together), by_others, joint.p_value(number), held_out)

    @property
    def before_um(self) -> float:
        """RMS residual per scalar, um, of the nominal machine in the rows that the fit of all kept."""
        return float(np.sqrt(np.mean((self.before * self.together.good.per_micro) ** 2)))

    @property
    def contradicts(self) -> bool:
        """True where it differs from the prediction by the others more than the uncertainties allow."""
        return self.p_value < CONTRADICTION_P

    @property
    def objection(self) -> str:
        """Reason against the calibration that this measurement shows, with the name of its file; empty without one."""
        reason = disagreement(self.together) or reason_against(self.together, self.before, self.held_out)
        return f"{self.alone.measurement.source}: {reason}" if reason else ""


@dataclass(frozen=True, repr=False)
class Together(Shown, Judged):
    """The fit of several measurements, with its checks."""

    parts: tuple[Part, ...]
    """Each measurement alone, with the others, and predicted by them."""
    fit: Fit
    """The fit of the measurement with the most observations, with the information of all."""
    model: ErrorModel
    """The model to be written: in the datum, location errors as separate effects, with covariance."""
    identifiability: Identifiability
    """Errors that the data do not show, by name."""
    findings: tuple[Finding, ...]
    """Anomalies of the data."""
    objection: str
    """Reason against the calibration; empty without one."""
    forced: bool
    """True where it is accepted nevertheless."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        names = ", ".join(part.together.measurement.source for part in self.parts)
        return f"{self.model.machine.name}, {names}, {'accepted' if self.accepted else 'not accepted'}"

    @property
    def bases(self) -> dict[str, Basis]:
        """The basis of each error motion, by its name."""
        return {motion.name: motion.basis for motion, _ in self.fit.model.error_motions}


class TogetherNotAccepted(UserError):
    """A calibration of several measurements that must not be used; `found` has its figures."""

    def __init__(self, found: Together) -> None:
        super().__init__(found.reason)
        self.found = found


def calibrate_together(
    measurements: Sequence[Measurement],
    *,
    basis: str = AUTO,
    effects: Sequence[Effect] = (),
    prior_scale: float | None = None,
    variance: Variance = "sheet",
    hold_out: bool = True,
    valid_days: float | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Together:
    """Error motions of every axis that moves in one of the measurements, and additional `effects`, from all of them.

    The arguments are those of `calibration.fit.calibrate.calibrate`. The error motions of each axis are functions over
    the range of all; all measurements together decide their sizes, each alone its noise and its outliers.

    UserError where the measurements are of different machines. Without `force` also for a sphere that moved, and
    TogetherNotAccepted for a calibration that is no improvement for one of the measurements, or with which too many of
    its rows disagree.
    """
    machine = _machine(measurements)
    steps = len(measurements) + 2
    singles, wanted = [], Wanted(basis, tuple(effects), prior_scale, variance, silent)
    for number, measurement in enumerate(measurements, start=1):
        step = numbered(progress, number, steps)
        step(f"fitting {measurement.source} alone")
        singles.append(_Single.of(measurement, replace(wanted, progress=step), force=force))
    model = _model(machine, [single.fit.start for single in singles], _arms(measurements))
    numbered(progress, steps - 1, steps)("fitting all measurements together")
    joint = _joint(wanted, model, [single.fit for single in singles])
    whole = joint.whole
    positions_of = _positions(measurements)
    identified = identifiability(of_low_degrees(whole, positions_of) if wanted.automatic else whole)
    least = identifiability(of_low_degrees(whole, positions_of, LOW_LINES)) if wanted.automatic else identified
    refuse_few([single.fit for single in singles], least)
    parts = []
    for k in range(len(singles)):
        numbered(progress, steps, steps)("predicting each measurement by the others", k / len(singles))
        parts.append(Part.of(joint, k, hold_out=hold_out))
    findings = chain.from_iterable(single.findings for single in singles)
    objection = "; ".join(part.objection for part in parts if part.objection)
    written = _written(whole, parts, valid_days, _not_repeating(singles))
    result = Together(tuple(parts), whole, written, identified, tuple(findings), objection, force)
    if not result.accepted:
        raise TogetherNotAccepted(result)
    return result


@dataclass(frozen=True)
class _Single:
    """The fit of one measurement alone."""

    explained: Explained
    findings: tuple[Finding, ...]
    """Anomalies of the data, each with the name of the file."""

    @classmethod
    def of(cls, measurement: Measurement, wanted: Wanted, *, force: bool) -> _Single:
        """The fit of a measurement alone; UserError as by `CheckedData.of_fit`."""
        data = CheckedData.of_fit(measurement, force=force)
        found = explained(data.measurement, wanted)
        own = found.fit
        findings = [
            *data.findings,
            *zero_findings(run_zeros(own)),
            *distance_findings(own),
            *repeat_findings(own),
            *noise_findings(own),
        ]
        named = (each._replace(message=f"{measurement.source}: {each.message}") for each in findings)
        return cls(found, (*named, *outlier_findings(own)))

    @property
    def fit(self) -> Fit:
        """The fit."""
        return self.explained.fit


def _not_repeating(singles: Sequence[_Single]) -> dict[str, float]:
    """Standard deviation of each axis from stop to stop, um or urad, where one of the measurements shows it clearly."""
    found: dict[str, float] = {}
    for single in singles:
        for axis, size in single.explained.not_repeating.items():
            found[axis] = max(size, found.get(axis, 0.0))
    return found


def _positions(measurements: Sequence[Measurement]) -> dict[str, int]:
    """Largest number of positions of each axis in one of the measurements."""
    names = measurements[0].machine.names
    return {axis: max(each.distinct_positions[axis] for each in measurements) for axis in names}


def _joint(wanted: Wanted, model: ErrorModel, alone: Sequence[Fit]) -> Joint:
    """The fit of all measurements, with the likeliest sizes of the error motions, unless these are stated."""
    least = np.maximum.reduce([least_priors(each.measurement, model) for each in alone])
    if wanted.automatic:
        known = alone[0].measurement.machine.priors
        bands, prior = bands_of(model, wanted.asked(alone[0].measurement, wanted.effects), known, least)
        joint = Joint.fitted(alone, model, prior)
        sizes, wider = joint.sizes(bands)
        return Joint.fitted(alone, joint.model, prior * sizes, wider)
    prior = priors(model)
    for _, part in model.error_motions:
        prior[part] *= wanted.prior_scale or 1.0
    return Joint.fitted(alone, model, np.maximum(prior, least))


def _written(
    whole: Fit, parts: Sequence[Part], valid_days: float | None, not_repeating: Mapping[str, float]
) -> ErrorModel:
    """The fitted model in the datum, with its location errors and its provenance."""
    observations = sum(part.together.observations for part in parts)
    source = f"fit of {observations} observations by {len(parts)} instruments"
    model = with_next_stop(in_datum(whole), not_repeating)
    made = provenance([part.alone.measurement for part in parts], model.effects, source, valid_days)
    return msgspec.structs.replace(model, provenance=made)


def _machine(measurements: Sequence[Measurement]) -> Machine:
    """The machine of all measurements; UserError where they differ."""
    first = measurements[0]
    for other in measurements[1:]:
        if other.machine != first.machine:
            raise UserError(f"{first.source} and {other.source} are of different machines")
    return first.machine


def _model(machine: Machine, models: Sequence[ErrorModel], arms: Mapping[str, Array]) -> ErrorModel:
    """The start of the fit: the effects of all models, each error motion in the finest basis of those that have it."""
    motions: dict[str, list[ErrorMotion]] = {}
    others: dict[str, Effect] = {}
    for motion, _ in chain.from_iterable(model.error_motions for model in models):
        motions.setdefault(motion.name, []).append(motion)
    for effect in chain.from_iterable(model.effects for model in models):
        if effect.name not in motions:
            others.setdefault(effect.name, effect)
    found = []
    for same in motions.values():
        axis = same[0].axis
        basis = common_basis([each.basis for each in same], turning=machine.axes[machine.index(axis)].turns_fully)
        zero = (0.0,) * basis.size
        found.append(ErrorMotion(same[0].component, axis, basis, zero, u=zero))
    found.sort(key=lambda motion: machine.names.index(motion.axis))
    return msgspec.structs.replace(no_errors(machine), effects=(*centred(found, arms), *others.values()))


def _arms(measurements: Sequence[Measurement]) -> dict[str, Array]:
    """The mean arms of the centres of all measurements, as `arms_of`."""
    every = [each.arms for each in measurements]
    axes = dict.fromkeys(axis for own in every for axis in own)
    return {axis: np.mean([own[axis] for own in every if axis in own], axis=0) for axis in axes}
