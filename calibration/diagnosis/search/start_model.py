"""The model that a diagnosis starts from: error motions of all axes, or the present calibration.

- Without a calibration: six error motions of each axis. Their bases are selected by the evidence, up to a limit above
  which they could imitate a missing cause.
- A calibration of these very data (by its provenance): its structure, fitted again, so that nothing counts twice.
- A calibration of other data: its parameters with their covariance as prior knowledge, and finer error motions whose
  bases and sizes are chosen by the evidence of the data (`refinement`); over larger ranges where the data reach beyond
  its own (`larger_range`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import msgspec
import numpy as np
from scipy.linalg import block_diag

from calibration.diagnosis.search.candidates import Candidate, at_zero, changes, library
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.present import refinement
from calibration.diagnosis.search.present.refinement import GENEROUS, Refinement
from calibration.fit.bases.search import AT_TARGETS, AUTOMATIC_KINDS, ROTARY_KIND, Choice
from calibration.fit.bases.selection import choose, coarse_choice, finer
from calibration.fit.curves.between_positions import as_table
from calibration.fit.fit import Fit, fit
from calibration.fit.noise import WithNoise
from calibration.fit.problem import FIXED
from calibration.gaussian_terms.given.larger_range import extended, larger_ranges
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import TARGETS, is_log, priors, with_effects
from calibration.observation.mean_lines import arms_of, centred
from calibration.observation.outliers import Variance
from kinematics.basis import Legendre
from kinematics.effects import (
    Backlash,
    Cyclic,
    Effect,
    ErrorMotion,
    QuantisedCompensation,
    UnknownApproach,
)
from kinematics.error_model.model import ErrorModel
from kinematics.machine import split_chain
from kinematics.running.progress import Progress
from kinematics.user_error import UserError

FINEST = 16
"""Most parameters of a linear axis' error motion; finer errors are named as higher frequency or as cyclic errors."""
COARSE, COARSE_OF_A_LOG = 8, 4
"""The same during the search for causes, and for a log: a finer basis would imitate missing causes."""
WIDE = 10.0
"""Prior of an accepted effect, as a multiple of the size found: the data determine its size."""
CHANGED = 10.0
"""Logarithmic evidence, twice, for a change of a scale or of a location error since the calibration (Kass, Raftery)."""
EXACT = 1e-3
"""Least standard uncertainty of a calibrated parameter, um or urad."""
TOGETHER = 1e-3
"""Root of the sum of squares, mm, of distances of targets up to which they are one, or on a line."""
MARGIN = 1
"""Sizes by which bases of rotary axes are finer in the uncertainty of their choice."""
Origin = Literal["automatic", "refitted", "updated"]


@dataclass(frozen=True)
class Base:
    """A model, at zero or as calibrated, and the prior of its fit."""

    model: ErrorModel
    prior: np.ndarray
    """Standard deviations `(p,)`, or a root `(p, p)` of their covariance."""
    origin: Origin
    choice: Choice | None = None
    known: dict[str, Base] = field(default_factory=dict, compare=False, repr=False)
    """Bases that were selected already, by noise, finest size and effects."""
    present: Base | None = None
    """The base without a refinement, where it is that of a calibration of other data."""
    refinement: Refinement | None = None
    curves: bool = False
    """True where error motions of axes with few positions become curves (`calibration.fit.curves`)."""
    calibration: ErrorModel | None = None
    """The calibration of other data over the ranges of these; None without one."""

    @property
    def bases(self) -> object:
        """The bases of the error motions, as far as the evidence chooses them."""
        return self.choice, self.refinement, [effect.name for effect in self.lines]

    @property
    def lines(self) -> list[Effect]:
        """Scales and location errors that are free because they have changed since the calibration."""
        first = len(self.model.effects) if self.present is None else len(self.present.model.effects)
        return [effect for effect in self.model.effects[first:] if effect.OF_AXIS_LINE]

    @property
    def as_it_is(self) -> Base:
        """The base of the calibration of other data with its parameters held."""
        present = self.present or self
        model = msgspec.structs.replace(present.model, covariance=None)
        held = [not isinstance(effect, UnknownApproach) for effect in model.effects]
        each = np.repeat(held, [part.stop - part.start for part in model.slices])
        return Base(model, np.where(each, FIXED, priors(model)), self.origin)

    def chosen_again(self, measurement: Measurement, effects: Sequence[Effect], progress: Progress) -> Base:
        """The base with bases selected again by the evidence, together with the effects found."""
        if self.present is not None:
            again = _refined(self.present, measurement, effects, progress)
            return self if again.bases == self.bases else replace(again, calibration=self.calibration)
        if self.choice is None:
            return self
        return _automatic(measurement, effects, (_finest(measurement, effects), np.inf), progress, self.known)

    def with_bases_of(self, other: Base, measurement: Measurement) -> dict[str, Base]:
        """By each axis in which two bases differ, the base with the basis of this axis as the other has it."""
        if self.choice is None or other.choice is None:
            return {}
        bases = self.choice.bases
        choices = {
            axis: replace(self.choice, bases={**bases, axis: basis})
            for axis, basis in other.choice.bases.items()
            if basis != bases[axis]
        }
        return {axis: _of_choice(measurement, choice, self.known) for axis, choice in choices.items()}

    def with_finer_turns(self, measurement: Measurement) -> Base | None:
        """The base with finer bases of rotary axes, whose next waves the evidence tolerates; None without any."""
        if self.choice is None:
            return None
        finest = finer(self.choice, measurement, MARGIN)
        bases = {axis: (finest if axis[0] in "ABC" else self.choice).bases[axis] for axis in self.choice.bases}
        if bases == self.choice.bases:
            return None
        return _of_choice(measurement, replace(self.choice, bases=bases), self.known)

    def fine(self, measurement: Measurement) -> bool:
        """True where it may imitate a cause, so that its residuals may not show the cause."""
        most = coarse(measurement)
        return self.choice is not None and any(
            basis.over((0.0, 1.0)).size > most * (AT_TARGETS if basis.kind == TARGETS else 1)
            for basis in self.choice.bases.values()
        )

    def coarser(self, measurement: Measurement, progress: Progress) -> Base:
        """The base for the search for causes, too coarse to imitate one with an error motion."""
        return self.coarser_beside(measurement, (), progress) if self.fine(measurement) else self

    def coarser_beside(self, measurement: Measurement, effects: Sequence[Effect], progress: Progress) -> Base:
        """The base for the search, its bases selected by the evidence together with some effects."""
        most = coarse(measurement)
        return _automatic(measurement, effects, (most, float(most)), progress, self.known)

    def coarsest(self, measurement: Measurement) -> Base:
        """The base of bases that cannot imitate single rows, for few rows of spheres."""
        return _of_choice(measurement, coarse_choice(measurement), self.known)

    def first_fit(
        self,
        measurement: Measurement,
        accepted: Sequence[tuple[Candidate, np.ndarray]],
        variance: Variance,
        near: WithNoise | None = None,
    ) -> WithNoise:
        """The fit of the base and of accepted candidates, each with its linear sizes in units of the typical ones.

        near: a similar fit, with whose noise the estimate begins.
        """
        return WithNoise.of(self.fit_as_noisy(measurement, accepted, variance), near)

    def fit(
        self,
        measurement: Measurement,
        accepted: Sequence[tuple[Candidate, np.ndarray]],
        variance: Variance,
        known: WithNoise | None = None,
    ) -> Fit:
        """The fit of the base and of accepted candidates; known: their first fit.

        The noise is estimated where the residuals contradict the specification; it holds the variance factor then.
        Errors that the model lacks are no noise.
        """
        first = known or self.first_fit(measurement, accepted, variance)
        return self._as_noisy_as(first, first.of_visits, accepted)

    def cautious_fit(
        self,
        measurement: Measurement,
        accepted: Sequence[tuple[Candidate, np.ndarray]],
        variance: Variance,
        known: WithNoise | None = None,
    ) -> Fit:
        """The same, its uncertainty enlarged by errors that the model lacks."""
        first = known or self.first_fit(measurement, accepted, variance)
        return self._as_noisy_as(first, first.whole, accepted)

    def _as_noisy_as(
        self, first: WithNoise, noisy: Measurement, accepted: Sequence[tuple[Candidate, np.ndarray]]
    ) -> Fit:
        """The fit with the noise of a measurement; the first fit where this is as specified."""
        return first.fit if noisy.noise is None else self.fit_as_noisy(noisy, accepted, "sheet", first.fit)

    def fit_as_noisy(
        self,
        measurement: Measurement,
        accepted: Sequence[tuple[Candidate, np.ndarray]],
        variance: Variance,
        near: Fit | None = None,
    ) -> Fit:
        """The same with the noise of the measurement; near: the fit with another noise."""
        finer = {c.replaces: c.effect for c, _ in accepted if c.replaces}
        effects, prior = list(self.model.effects), self.prior
        if finer:
            parts = [prior[part] for part in self.model.slices]
            for i, effect in enumerate(effects):
                if effect.name in finer:
                    effects[i] = finer[effect.name]
                    parts[i] = np.full(len(effects[i].parameters), float(np.median(parts[i])))
            prior = np.concatenate(parts)
        added = [(candidate, size) for candidate, size in accepted if candidate.replaces not in finer]
        model = msgspec.structs.replace(self.model, effects=(*effects, *(c.effect for c, _ in added)), covariance=None)
        own = np.concatenate([prior_of(candidate, size) for candidate, size in added] or [np.zeros(0)])
        whole = np.concatenate([prior, own]) if prior.ndim == 1 else block_diag(prior, np.diag(own))
        return fit(measurement, model, prior=whole, variance=variance, near=near)

    def lacking(self, linearised: LinearisedFit, *left_out: tuple[Candidate, int]) -> LinearisedFit:
        """The linearised fit without some accepted candidates, each with the number of its effect.

        Where a candidate refined an error motion, the base's own motion replaces it.
        """
        without = linearised.without(*(number for _, number in left_out))
        for candidate, number in left_out:
            if candidate.replaces:
                without = without.along(self.model.effects[number], self.prior[self.model.slices[number]])
        return without

    def numbers(self, accepted: Sequence[tuple[Candidate, np.ndarray]]) -> list[int]:
        """Indices of accepted candidates among the effects of the fitted model."""
        names = [effect.name for effect in self.model.effects]
        found, last = [], len(names)
        for candidate, _ in accepted:
            if candidate.replaces:
                found.append(names.index(candidate.replaces))
            else:
                found.append(last)
                last += 1
        return found


def base_of(measurement: Measurement, calibration: ErrorModel | None, progress: Progress) -> Base:
    """The base for these data; UserError where the calibration has no error motions of an axis that moves in them."""
    if calibration is None:
        return _automatic(measurement, (), (FINEST, np.inf), progress, {})
    machine_effects = calibration.part(lambda effect: effect.ACTS_ON != "instrument")
    known = {motion.axis for motion, _ in machine_effects.error_motions}
    unknown = [axis for axis in measurement.moving if axis not in known]
    if unknown:
        raise UserError(
            f"the calibration has no error motions of {', '.join(unknown)}, which moves in {measurement.source}: "
            "diagnose without --calibration, or calibrate with data in which it moves"
        )
    if measurement.fingerprint and measurement.fingerprint in calibration.provenance.inputs.values():
        return _refitted(machine_effects, measurement)
    larger = extended(machine_effects, measurement.machine, larger_ranges(machine_effects, measurement))
    present = _updated(larger, unknown_approaches(measurement))
    return replace(_refined(present, measurement, (), progress), calibration=larger)


def _finest(measurement: Measurement, effects: Sequence[Effect]) -> int:
    """Most parameters of a linear axis' error motion beside the effects: in a log, none between two of its waves."""
    least = coarse(measurement)
    if least != COARSE_OF_A_LOG:
        return FINEST
    axes = measurement.moving
    waves = [np.ptp(axes[effect.axis]) / effect.period for effect in effects if isinstance(effect, Cyclic)]
    return int(np.clip(min(waves, default=least), least, FINEST))


def coarse(measurement: Measurement) -> int:
    """Most parameters of a linear axis' error motion during the search for causes."""
    return COARSE_OF_A_LOG if all(is_log(measurement, axis) for axis in measurement.moving) else COARSE


def _automatic(
    measurement: Measurement,
    effects: Sequence[Effect],
    finest: tuple[int, float],
    progress: Progress,
    known: dict[str, Base],
) -> Base:
    """The base with bases selected by the evidence; of the same noise and effects the one known already.

    finest: most parameters of linear and of rotary axes.
    """
    noise = measurement.noise
    estimated = None if noise is None else (noise.instrument_factor, noise.non_repeatability)
    key = repr((measurement.instrument, estimated, finest, effects))
    if key not in known:
        choice = choose(
            measurement,
            AUTOMATIC_KINDS,
            rotary_kind=ROTARY_KIND,
            effects=(*unknown_approaches(measurement), *effects),
            finest=finest[0],
            finest_turn=finest[1],
            progress=progress,
        )
        known[key] = _of_choice(measurement, choice, known)
    return known[key]


def _of_choice(measurement: Measurement, choice: Choice, known: dict[str, Base]) -> Base:
    unknown = unknown_approaches(measurement)
    model, prior = with_effects(measurement, choice.bases, unknown, *choice.scales)
    # backlash, which the fit of an interferometer includes, is a cause to be found here
    kept = np.array([not isinstance(effect, Backlash) for effect in model.effects])
    each = np.repeat(kept, [part.stop - part.start for part in model.slices])
    own = model.part(lambda effect: not isinstance(effect, Backlash))
    return Base(own, prior[each], "automatic", choice, known, curves=True)


def unknown_approaches(measurement: Measurement) -> list[Effect]:
    """An error of each axis that moves, in the rows before its first move; none where every approach is known.

    Without them a backlash of an axis that does not move at first would appear with a false growth with time.
    """
    state, machine = measurement.state, measurement.machine
    if state.approach is None or measurement.axis is not None:
        return []
    unknown = np.any(state.approach == 0.0, axis=0)
    return [UnknownApproach(axis=axis, offset=0.0) for axis in measurement.moving if unknown[machine.index(axis)]]


def _refitted(calibration: ErrorModel, measurement: Measurement) -> Base:
    """The structure of the calibration at zero, without location errors: the error motions hold these again.

    A curve between few positions has more parameters than there are positions: a spline with one for each replaces it.
    """
    kept = [at_zero(each) for each in calibration.effects if not (each.OF_ISO_230 and each.OF_AXIS_LINE)]
    zero = [as_table(effect, measurement) for effect in kept]
    motions = centred(zero, arms_of(measurement))
    model = msgspec.structs.replace(calibration, effects=(*motions, *unknown_approaches(measurement)), covariance=None)
    return Base(model, priors(model), "refitted", curves=zero != kept)


def _updated(calibration: ErrorModel, unknown: Sequence[Effect]) -> Base:
    if calibration.covariance is None:
        u = np.array([value for effect in calibration.effects for value in effect.uncertainties])
        root = np.diag(np.maximum(u, EXACT))
    else:
        values, vectors = np.linalg.eigh(np.array(calibration.covariance))
        root = vectors * np.sqrt(np.maximum(values, EXACT**2))
    model = msgspec.structs.replace(calibration, effects=(*calibration.effects, *unknown), covariance=None)
    return Base(model, block_diag(root, np.diag(priors(model)[len(root) :])), "updated")


def _turns_of_targets(calibration: ErrorModel, measurement: Measurement) -> list[ErrorMotion]:
    """Turns of the targets on the tool since the calibration, at zero; none where less than two of them show these.

    They were mounted again, or the line of the axis has turned by which the datum is set. Two targets do not show a
    turn about the line through them; those on a rotary axis turn as by a location error of it.
    """
    carried = [name for name, side in split_chain(calibration.machine.chain) if side == "tool"]
    apart = measurement.tool - measurement.tool.mean(axis=0)
    _, sizes, lines = np.linalg.svd(apart, full_matrices=False)
    if not carried or carried[-1][0] in "ABC" or sizes[0] < TOGETHER:
        return []
    unseen = "ABC"[int(np.abs(lines[0]).argmax())] if sizes[1] < TOGETHER else ""
    motions = [motion for motion, _ in calibration.error_motions if motion.axis == carried[-1]]
    seen = [each for each in motions if each.component in "ABC" and each.component != unseen]
    return [ErrorMotion(each.component, each.axis, Legendre(each.basis.interval, 0), (0.0,), u=(0.0,)) for each in seen]


def _refined(present: Base, measurement: Measurement, effects: Sequence[Effect], progress: Progress) -> Base:
    """The base with error motions added, as the evidence chooses them beside the effects found and common causes.

    Scales and location errors that have changed beyond chance are free, so that the calibration does not hold them, and
    turns of the targets.
    """
    progress("choosing the refinement of the calibration")
    common = [*changes(present.model), *library(measurement, present.model)[0]]
    known = {effect.name for effect in effects}
    free = [each.effect for each in common if each.simple and each.effect.name not in known]
    axes = dict.fromkeys(motion.axis for motion, _ in present.model.error_motions)
    generous = _with_added(present, measurement, dict.fromkeys(axes, GENEROUS))
    turns = _turns_of_targets(present.model, measurement)
    besides = [*effects, *turns, *free]
    first = _with_free(generous, besides).cautious_fit(measurement, (), "estimate")
    chosen = refinement.chosen(first, present.model, present.prior, [at_zero(effect) for effect in besides])
    base = _with_added(present, measurement, chosen)
    found = _with_free(base, besides).cautious_fit(measurement, (), "estimate")
    limit = np.log(found.observations) + CHANGED
    lines = [
        at_zero(effect)
        for effect in found.model.effects[len(base.model.effects) + len(effects) + len(turns) :]
        if effect.OF_AXIS_LINE and effect.parameters[0] ** 2 > limit * effect.uncertainties[0] ** 2
    ]
    return _with_free(base, [*turns, *lines])


def _with_free(base: Base, effects: Sequence[Effect]) -> Base:
    """The base with further effects, whose size the data determine."""
    model = refinement.with_more(base.model, effects)
    wide = refinement.WIDE * priors(model)[len(base.prior) :]
    return replace(base, model=model, prior=block_diag(base.prior, np.diag(wide)))


def _with_added(present: Base, measurement: Measurement, chosen: Refinement) -> Base:
    """The base of a calibration with the error motions of a refinement."""
    found = [
        (effect, own.scale)
        for axis, own in chosen.items()
        if own.scale
        for effect in refinement.added(measurement, present.model, axis, own.level)
    ]
    model = refinement.with_more(present.model, [effect for effect, _ in found])
    scales = np.repeat([scale for _, scale in found], [effect.basis.size for effect, _ in found])
    own = scales * priors(model)[len(present.prior) :]
    return Base(model, block_diag(present.prior, np.diag(own)), "updated", present=present, refinement=chosen)


def prior_of(candidate: Candidate, size: np.ndarray) -> np.ndarray:
    """Prior standard deviations `(k,)` of an accepted candidate; `size` is in typical sizes of its parameters.

    They double with the size: candidates of nearly the same sizes have the same fit.
    """
    effect, table = candidate.effect, candidate.effect.parameter_table
    typical = np.array([quantity.typical for quantity in table])
    if candidate.prior:
        return np.asarray(candidate.prior * typical)
    linear = np.array([quantity.linear for quantity in table])
    largest = 2.0 ** np.ceil(np.log2(max(float(np.abs(size).max(initial=0.0)), 1.0)))
    # a jump has no derivative that a fit could follow: its offset and pitch are held
    held = FIXED if isinstance(effect, QuantisedCompensation) else 1.0
    return np.where(linear, WIDE * largest * typical, held * typical)
