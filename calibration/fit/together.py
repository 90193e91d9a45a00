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
from functools import cached_property, reduce
from itertools import chain
from operator import add

import msgspec
import numpy as np
from scipy import special

from calibration.fit.acceptance import Judged, disagreement, nominal_residuals, reason_against, refuse_few
from calibration.fit.bases.common import common_basis
from calibration.fit.bases.search import AUTO, Choice, scale_of
from calibration.fit.calibrate import in_datum, provenance
from calibration.fit.cross_validation import CrossValidation, cross_validate
from calibration.fit.fit import Fit, fit
from calibration.fit.identifiability import Identifiability, identifiability
from calibration.fit.linear import Posterior, pseudo_inverse
from calibration.fit.omitted_waves import OmittedWaves, left_out
from calibration.fit.problem import FIXED, Problem
from calibration.fit.set_up.bases_and_noise import Wanted, with_bases_and_noise
from calibration.fit.set_up.checked_data import CheckedData
from calibration.fit.set_up.distances import distance_findings
from calibration.fit.set_up.drift import repeat_findings
from calibration.fit.set_up.rows_and_noise import noise_findings, outlier_findings
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
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

MOST_JOINT_STEPS, LAST_JOINT_STEP_PRIORS = 8, 1e-3
"""Most steps of the fit, and the length of a step, in units of the priors, at which it ends."""
CONTRADICTION_P = 1e-3
"""p-value below which a measurement contradicts the others."""
INFORMED_SHARE = 1e-8
"""Share of the largest eigenvalue of an information above which it has information on a direction."""


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

    The arguments are those of `calibration.fit.calibrate.calibrate`. Each axis has the finest of the bases that the
    measurements determine alone, over the range of all.

    UserError where the measurements are of different machines. Without `force` also for a sphere that moved, and
    TogetherNotAccepted for a calibration that is no improvement for one of the measurements, or with which too many of
    its rows disagree.
    """
    machine = _machine(measurements)
    steps = len(measurements) + 2
    singles = []
    for number, measurement in enumerate(measurements, start=1):
        step = numbered(progress, number, steps)
        step(f"fitting {measurement.source} alone")
        wanted = Wanted(basis, 0, tuple(effects), prior_scale, variance, step)
        singles.append(_Single.of(measurement, wanted, force=force))
    model = _model(machine, [single.fit.start for single in singles], _arms(measurements))
    prior = _prior(model, singles, measurements)
    numbered(progress, steps - 1, steps)("fitting all measurements together")
    joint = _Joint.fitted([_Share.of(single.fit, model, prior) for single in singles], model, prior)
    whole = joint.whole
    identified = identifiability(whole)
    refuse_few([single.fit for single in singles], identified)
    parts = []
    for k in range(len(singles)):
        numbered(progress, steps, steps)("predicting each measurement by the others", k / len(singles))
        parts.append(joint.part(k, hold_out=hold_out))
    findings = chain.from_iterable(single.findings for single in singles)
    objection = "; ".join(part.objection for part in parts if part.objection)
    waves = joint.omitted_waves(chosen=Wanted(basis, 0, (), None, variance, silent).automatic)
    written = _written(whole if waves is None else waves.uncertain_fit(whole), parts, valid_days)
    result = Together(tuple(parts), whole, written, identified, tuple(findings), objection, force)
    if not result.accepted:
        raise TogetherNotAccepted(result)
    return result


@dataclass(frozen=True)
class _Single:
    """The fit of one measurement alone."""

    fit: Fit
    choice: Choice
    findings: tuple[Finding, ...]
    """Anomalies of the data, each with the name of the file."""

    @classmethod
    def of(cls, measurement: Measurement, wanted: Wanted, *, force: bool) -> _Single:
        """The fit of a measurement alone; UserError as by `CheckedData.of_fit`."""
        data = CheckedData.of_fit(measurement, force=force)
        choice, own = with_bases_and_noise(data.measurement, wanted)
        findings = [
            *data.findings,
            *zero_findings(run_zeros(own)),
            *distance_findings(own),
            *repeat_findings(own),
            *noise_findings(own),
        ]
        named = (each._replace(message=f"{measurement.source}: {each.message}") for each in findings)
        return cls(own, choice, (*named, *outlier_findings(own)))


def _prior(model: ErrorModel, singles: Sequence[_Single], measurements: Sequence[Measurement]) -> Array:
    """Prior standard deviations `(p,)` of the parameters: the largest that one of the measurements has alone."""
    prior = priors(model)
    for motion, part in model.error_motions:
        prior[part] *= max(scale_of(single.choice.scales, motion.axis) for single in singles)
    return np.asarray(np.maximum.reduce([prior, *(least_priors(each, model) for each in measurements)]))


def _written(whole: Fit, parts: Sequence[Part], valid_days: float | None) -> ErrorModel:
    """The fitted model in the datum, with its location errors and its provenance."""
    observations = sum(part.together.observations for part in parts)
    source = f"fit of {observations} observations by {len(parts)} instruments"
    model = in_datum(whole)
    made = provenance([part.alone.measurement for part in parts], model.effects, source, valid_days)
    return msgspec.structs.replace(model, provenance=made)


@dataclass(frozen=True)
class _Share:
    """The information of one measurement on the parameters, linearised at a model; all in units of their priors."""

    alone: Fit
    information: Array
    """`(p, p)`, registration eliminated."""
    machine_information: Array
    """The same for an instrument whose position is known."""
    registered: int
    slope: Array
    """Slope `(p,)` of the log likelihood along the parameters."""

    @classmethod
    def of(cls, alone: Fit, model: ErrorModel, prior: Array) -> _Share:
        """The share of the measurement of a fit, at the parameters of a model; prior `(p,)`."""
        problem = Problem.of(alone.measurement, model, prior)
        point = problem.point(model.parameters, _registered(alone, model).registration)
        solved = problem.solve(point, alone.kept.astype(float), alone.variance_factor * alone.widening)
        step = solved.step[point.registered :] / prior
        slope = solved.information @ step + step
        return cls(alone, solved.information, solved.machine_information, solved.registered, slope)


@dataclass(frozen=True)
class _Joint:
    """The parameters that several measurements determine together."""

    shares: tuple[_Share, ...]
    """Linearised at the parameters of the model."""
    model: ErrorModel
    prior: Array
    """Standard deviations `(p,)` of the parameters."""

    @classmethod
    def fitted(cls, shares: Sequence[_Share], model: ErrorModel, prior: Array) -> _Joint:
        """The joint fit: Gauss-Newton steps until the parameters move no more."""
        joint = cls(tuple(shares), model, prior)
        for _ in range(MOST_JOINT_STEPS):
            step = joint.step(joint.shares)
            moved = joint.model.with_parameters(joint.model.parameters + prior * step)
            joint = cls(tuple(_Share.of(share.alone, moved, prior) for share in shares), moved, prior)
            if np.linalg.norm(step) < LAST_JOINT_STEP_PRIORS:
                break
        return joint

    def step(self, shares: Sequence[_Share]) -> Array:
        """Step `(p,)`, in units of the priors, from the model to the parameters by some of the measurements."""
        away = self.model.parameters / self.prior
        return self._posterior(shares).solve(_sum([share.slope for share in shares]) - away)

    def _posterior(self, shares: Sequence[_Share]) -> Posterior:
        return Posterior(_sum([share.information for share in shares]), 1.0)

    def by(self, shares: Sequence[_Share]) -> tuple[ErrorModel, Array]:
        """The model by some of the measurements, and a root `(p, p)` of its covariance."""
        root = self.prior[:, None] * self._posterior(shares).root
        moved = self.model.parameters + self.prior * self.step(shares)
        return self.model.with_parameters(moved, root @ root.T), root

    @cached_property
    def result(self) -> ErrorModel:
        """The model with the covariance by all measurements."""
        return self.by(self.shares)[0]

    def part(self, number: int, *, hold_out: bool) -> Part:
        """One of the measurements in this fit."""
        own = self.shares[number]
        model, root = self.by([*self.shares[:number], *self.shares[number + 1 :]])
        together, by_others = _registered(own.alone, self.result), _registered(own.alone, model)
        held_out = cross_validate(own.alone.good, model, root) if hold_out else None
        return Part(own.alone, together, nominal_residuals(together), by_others, self._p_value(number), held_out)

    @property
    def whole(self) -> Fit:
        """The fit of the measurement with the most observations, with the information of all."""
        largest = max((share.alone for share in self.shares), key=lambda each: each.observations)
        information = _sum([share.information for share in self.shares])
        solved = largest.solved._replace(
            information=information,
            machine_information=_sum([share.machine_information for share in self.shares]),
            registered=sum(share.registered for share in self.shares),
        )
        return replace(_registered(largest, self.result), model=self.result, prior=self.prior, solved=solved)

    def omitted_waves(self, *, chosen: bool) -> OmittedWaves | None:
        """The waves that the model leaves out, as `calibration.fit.omitted_waves.omitted_waves`."""
        measurements = [share.alone.measurement for share in self.shares]
        model, prior, own = left_out(self.result, self.prior, measurements, chosen=chosen)
        if not own.any():
            return None
        shares = [_Share.of(share.alone, model, prior) for share in self.shares]
        information, slope = _sum([each.information for each in shares]), _sum([each.slope for each in shares])
        return OmittedWaves.of(model, prior, own, information, slope)

    def _p_value(self, number: int) -> float:
        """p-value of the difference of one measurement from the others, in directions that both show."""
        own, others = self.shares[number], [*self.shares[:number], *self.shares[number + 1 :]]
        information, slope = _sum([each.information for each in others]), _sum([each.slope for each in others])
        half = pseudo_inverse(own.information + information, INFORMED_SHARE, 1.0).root
        both = own.information @ half @ (half.T @ information)
        # at the estimate by all, without the prior, the slopes of both are equal and opposite
        along = own.slope - own.information @ half @ (half.T @ (own.slope + slope))
        values, vectors = np.linalg.eigh((both + both.T) / 2.0)
        shown = values > 1.0
        squares = float(np.sum((vectors[:, shown].T @ along) ** 2 / values[shown]))
        return float(special.chdtrc(np.count_nonzero(shown), squares)) if shown.any() else 1.0


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


def _registered(own: Fit, model: ErrorModel) -> Fit:
    """The fit of the registration of a measurement to a model; own: its fit alone."""
    variance: Variance = "sheet" if own.variance_factor == 1.0 else "estimate"
    return fit(own.measurement, model, prior=np.full(len(model.parameters), FIXED), variance=variance)


def _sum(values: Sequence[Array]) -> Array:
    return np.asarray(reduce(add, values))
