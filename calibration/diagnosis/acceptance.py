"""Acceptance of a diagnosis: its calibration is written only if it predicts held-out blocks better than the others.

The others are no correction (the nominal machine), and the present calibration, or the model without the causes where
these very data are its only source. Blocks, and the rule by which a difference is beyond its spread, are those of
`calibration.fit.cross_validation`. The other models are registered on all rows, which favours them. If the present
calibration is as good, and no cause is missing, these data confirm it, and it stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.search.stage import Stage
from calibration.diagnosis.unseen.unseen_states import rms_correction
from calibration.diagnosis.widening import UnseenErrors
from calibration.fit.acceptance import Judged, disagreement, freed, nominal_residuals, not_better, reason_against
from calibration.fit.cross_validation import CrossValidation, predicted_by_others, summed_up, uncorrected
from calibration.fit.curves.between_positions import with_curves_between
from calibration.fit.fit import Fit, fit
from calibration.fit.problem import FIXED
from calibration.fit.set_up.moved_spheres import moved_spheres
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import priors
from calibration.observation.normal_equations import whiteners
from calibration.observation.stops_and_lines import inner_positions
from kinematics.effects import LocationJump, StationShift
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import rounded
from kinematics.transforms import Array

ESTABLISHED = 0.75
"""Share of the expected errors without a model up to which it is an improvement: the expectation is uncertain."""
CLEARLY = 2.0
"""Standard errors by which curves must predict the few positions of an axis better than the nominal machine."""
ADVICE = "The present model stays: check the data (ncomp fit, --report), or measure more"
FREED = "Held-out rows are compared less the unexplained dependence, which no calibration can hold"


class _Comparison(NamedTuple):
    """A new model beside the others on held-out blocks."""

    nominal: Array
    """As `nominal_residuals`."""
    after: Stage
    none: CrossValidation | None
    present: CrossValidation | None
    as_it_is: CrossValidation | None
    """The calibration as it was given beside the nominal machine; None without one of other data."""

    @classmethod
    def of(cls, before: Stage, after: Stage, given: ErrorModel | None, less: Array | None) -> _Comparison:
        """The stage `after` beside the nominal machine, and beside a calibration that it updates, or `before`.

        less: a function `(n, d)`, mm and rad, of which all rows are freed: an error that no calibration holds, but that
        would decide which model predicts better.
        """
        freed_after, nominal = after.less(less), nominal_residuals(after.fit, less)
        none = _compared(freed_after, _of_all_rows(after, nominal))
        if given is not None:
            unchanged = _unchanged(after, given, less)
            present = _compared(freed_after, _of_all_rows(after, unchanged))
            return cls(nominal, freed_after, none, present, _beside(after, unchanged, nominal))
        present = None if after is before else _compared(freed_after, _held_out(before.less(less)))
        return cls(nominal, freed_after, none, present, None)


@dataclass(frozen=True)
class Acceptance(Judged):
    """Comparison of the new model with the others on held-out blocks, and its consequence."""

    none: CrossValidation | None
    """The new model against the nominal machine; None where too few rows can be held out."""
    present: CrossValidation | None
    """Against the present calibration, or the model without the causes; None where it is the new model."""
    objection: str
    """Reason against the new calibration: too many rows disagree, or it is no improvement; empty without one."""
    forced: bool
    """True where it is accepted nevertheless."""
    confirmed: bool
    """True where these data confirm the present calibration, which stays."""
    as_it_is: CrossValidation | None = None
    """The present calibration as it was given against the nominal machine; None without one of other data."""

    @property
    def worse_than_none(self) -> CrossValidation | None:
        """`as_it_is` where the machine is better without the present calibration; else None."""
        return self.as_it_is if self.as_it_is is not None and self.as_it_is.gains.worse else None

    @classmethod
    def of(
        cls,
        before: Stage,
        after: Stage,
        calibration: ErrorModel | None,
        unexplained_um: float,
        unseen: UnseenErrors | None,
        new: ErrorModel,
        undecided_um: float,
        *,
        force: bool,
    ) -> Acceptance:
        """The acceptance of the model `after`; `before`: the fit of the present model; calibration: as it was given.

        unexplained_um: RMS, um per scalar, of a dependence of the residuals that no cause explains. unseen: errors of
        the model at unseen states beside it. new: the machine's part of the model. undecided_um: RMS length of its
        errors by causes that are undecided.
        """
        updated = calibration is not None and before.base.origin == "updated"
        given = calibration if updated else None
        shown = _Comparison.of(before, after, given, None)
        less = None if unseen is None else unseen.function
        nominal, after, none, present, _ = shown if less is None else _Comparison.of(before, after, given, less)
        too_many = _disagreement(after)
        causes = [each for each in after.accepted if each.candidate.effect.ACTS_ON != "instrument"]
        confirmed = updated and not causes and present is not None and not present.gains.better
        against = _against_present(present, updated=updated) if not confirmed else ""
        if updated and not causes and not against and not confirmed and present is not None:
            against = against_imitation(present, unexplained_um)
        if unseen is not None and not confirmed:
            against = against or against_learned(unseen)
        reason = against or ("" if confirmed else reason_against(after.fit, shown.nominal, none))
        reason = reason or ("" if confirmed else against_positions(after, nominal, less))
        reason = reason or ("" if updated else against_undecided(new, after.fit.measurement, undecided_um))
        if confirmed and none is not None and none.gains.worse:
            reason = f"{not_better('the present calibration, updated,', none, 'the nominal machine')}. {ADVICE}"
        if reason and less is not None:
            reason += f". {FREED}"
        confirmed = confirmed and not (too_many or reason)
        return cls(shown.none, shown.present, too_many or reason, force, confirmed, shown.as_it_is)


def _disagreement(after: Stage) -> str:
    """As `calibration.fit.acceptance.disagreement`, with the spheres whose move is the reason.

    Fine bases may take up the move of all spheres together, so that no row disagrees: without a named jump it counts.
    """
    too_many = disagreement(after.fit)
    jumps = any(isinstance(each.candidate.effect, StationShift | LocationJump) for each in after.accepted)
    moved = "" if jumps and not too_many else moved_spheres(after.fit.measurement)
    if moved and not too_many:
        return f"{moved}; --force writes the calibration nevertheless"
    return f"{moved}; {too_many}" if moved else too_many


def _against_present(present: CrossValidation | None, *, updated: bool) -> str:
    """Reason why the new model is no improvement over the present one; empty if it is."""
    if present is None or present.gains.better or not (updated or present.gains.worse):
        return ""
    name = "the present calibration" if updated else "the model without the causes"
    return f"{not_better('the new model', present, name)}. {ADVICE}"


def against_imitation(present: CrossValidation, unexplained_um: float) -> str:
    """Reason why an updated calibration may have learned the unexplained residual; empty if it has learned more."""
    learned_um = math.sqrt(max(present.other_rms_um**2 - present.rms_um**2, 0.0))
    if learned_um >= unexplained_um:
        return ""
    return (
        f"an update of the present calibration explains {rounded(learned_um, 3)} um RMS, less than the "
        f"{rounded(unexplained_um, 3)} um "
        "of the residuals that depend on recorded variables without a known cause: it would hold a part of these. "
        f"{ADVICE}"
    )


def against_learned(unseen: UnseenErrors) -> str:
    """Reason why a model may add more of an unexplained error than it removes of the machine's; empty if it does not.

    Held-out blocks do not show it where the error holds on from block to block, as one that moves with time does.
    """
    if unseen.recurs or unseen.beside is not None:
        return _against_uncertain(unseen)
    if unseen.with_um < ESTABLISHED * unseen.without_um:
        return ""
    return (
        "the residuals depend on recorded variables without a known cause, and a fit with a function of these beside "
        f"the model shows that the new model has learned a part of it: at unseen poses it would leave errors of "
        f"{rounded(unseen.with_um, 3)} um RMS, {rounded(unseen.without_um, 3)} um are left without it. {ADVICE}"
    )


def _against_uncertain(unseen: UnseenErrors) -> str:
    """Reason why a model may be no improvement beside an unexplained error: its own errors are too uncertain."""
    if unseen.without_um**2 - unseen.with_um**2 > unseen.uncertain_um**2:
        return ""
    removed_um = math.sqrt(max(unseen.without_um**2 - unseen.with_um**2, 0.0))
    return (
        "the residuals depend on recorded variables without a known cause, and a fit with a function of these beside "
        "the model leaves open whether the new model is an improvement: at unseen poses it should remove errors "
        f"of {rounded(removed_um, 3)} um RMS, and it is uncertain by {rounded(unseen.uncertain_um, 3)} um. {ADVICE}"
    )


def against_undecided(new: ErrorModel, measurement: Measurement, undecided_um: float) -> str:
    """Reason why a correction may be no improvement beside causes that are undecided; empty where it is one.

    undecided_um: RMS length of the errors by causes that it lacks, of which it may have learned a part. A correction d
    with such an error l removes d^2 - l^2 on the average, and leaves l^2.
    """
    correction_um = rms_correction(new, measurement)
    if correction_um**2 >= 2.0 * undecided_um**2:
        return ""
    return (
        "causes that the data neither name nor exclude leave open whether the new model is an improvement: at unseen "
        f"poses within the measured ranges the correction is {rounded(correction_um, 3)} um RMS, and errors of "
        f"{rounded(undecided_um, 3)} um are expected by these causes. {ADVICE}"
    )


def against_positions(stage: Stage, nominal: Array, less: Array | None = None) -> str:
    """Reason why a model may be no improvement between the measured positions of an axis; empty if it is one.

    Lines and regions of stops may share the few positions of an axis: a fit then has learned the errors there. Each
    position inside the range is predicted by a fit of the others instead. Bases that are fine for the positions predict
    poorly there; where the model becomes curves, these may predict better. nominal, less: as of `nominal_residuals`.
    """
    for axis in stage.fit.measurement.moving:
        labels = inner_positions(stage.fit.measurement, axis)
        if labels is None:
            continue
        name = f"positions of {axis}"
        by_position = stage._replace(linearised=stage.linearised.held_by(labels, name))
        none = _compared(by_position, _of_all_rows(stage, nominal))
        if none is None or none.gains.better or (stage.base.curves and _clear(_by_curves(stage.fit, labels, less))):
            continue
        count = stage.fit.measurement.distinct_positions[axis]
        return (
            f"{not_better('the fit of the others', none, 'the nominal machine')}. The present model stays: the {count} "
            f"positions of {axis} do not show the errors between them; measure at about {2 * count - 1}, or at "
            "irregular ones"
        )
    return ""


def _clear(by_curves: CrossValidation | None) -> bool:
    """True where positions are predicted better than by the nominal machine, by `CLEARLY` standard errors.

    A wave that is finer than the positions makes the difference large at each of them, and of either sign.
    """
    if by_curves is None or not by_curves.gains.better:
        return False
    gains = by_curves.gains.um
    return len(gains) > 1 and float(gains.sum()) > CLEARLY * float(np.sqrt(len(gains) * gains.var(ddof=1)))


def _by_curves(found: Fit, labels: np.ndarray, less: Array | None) -> CrossValidation | None:
    """Positions, labelled `(n,)`, predicted by the curves of a fit of the others, against the nominal machine."""
    good, finite = freed(found, less), np.isfinite(found.prior)
    start = np.array(found.model.parameters) - np.where(finite, found.prior, 0.0) * found.away

    def refit(others: np.ndarray) -> Fit:
        part = fit(good.rows(np.flatnonzero(others)), found.model.with_parameters(start), prior=found.prior)
        return with_curves_between(part)[0]

    return predicted_by_others(good, labels[found.kept], "positions", refit, uncorrected(found.model))


def _held_out(stage: Stage) -> Array:
    """Residuals `(n, d)`, mm and rad, of all rows in fits of a stage to the other blocks; NaN where not predicted."""
    held, fitted = stage.linearised.cross_validation, stage.fit
    result = np.full_like(fitted.residual, np.nan)
    rows = stage.linearised.rows[held.counted]
    result[rows] = held.residual_um[held.counted] / fitted.measurement.per_micro[rows]
    return result


def _of_all_rows(stage: Stage, kept: Array) -> Array:
    """Residuals of all rows `(n, d)` from those of the rows that the fit kept; NaN for the others."""
    result = np.full_like(stage.fit.residual, np.nan)
    result[stage.fit.kept] = kept
    return result


def _unchanged(stage: Stage, calibration: ErrorModel, less: Array | None) -> Array:
    """Residuals `(kept, d)`, mm and rad, of the calibration as it was given, registered as in `nominal_residuals`.

    Effects of the instrument are fitted as in the new model. less: as of `nominal_residuals`.
    """
    kept = replace(freed(stage.fit, less), noise=None)
    machine = calibration.part(lambda effect: effect.ACTS_ON != "instrument")
    instrument = uncorrected(stage.fit.model)
    model = msgspec.structs.replace(machine, effects=(*machine.effects, *instrument.effects), covariance=None)
    prior = np.concatenate([np.full(len(machine.parameters), FIXED), priors(instrument)])
    return fit(kept, model, prior=prior).residual


def _beside(stage: Stage, own: Array, other: Array) -> CrossValidation | None:
    """Residuals `(kept, d)` of one model that these data did not make against those of another, by held-out block."""
    labels, name = stage.linearised.held_out
    labels = labels[stage.fit.kept]
    rows = np.flatnonzero(labels >= 0)
    if not len(rows):
        return None
    some = stage.fit.measurement.rows(np.flatnonzero(stage.fit.kept)[rows])
    white = whiteners(replace(some, noise=None))
    return summed_up(np.stack([own[rows], other[rows]]), white, some.per_micro, labels[rows], name)


def _compared(stage: Stage, other: Array) -> CrossValidation | None:
    """The held-out residuals of a stage against residuals `(n, d)` of another model; None without common rows."""
    own, (labels, name) = _held_out(stage), stage.linearised.held_out
    rows = np.flatnonzero(~np.isnan(own[:, 0]) & ~np.isnan(other[:, 0]))
    if not len(rows):
        return None
    some = stage.fit.measurement.rows(rows)
    white = whiteners(some) / stage.fit.variance_factor**0.5
    return summed_up(np.stack([own[rows], other[rows]]), white, some.per_micro, labels[rows], name)
