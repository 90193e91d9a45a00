"""A calibration from start to end: terms, fit, datum, location errors, identifiability, cross-validation."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from calibration.fit.acceptance import (
    Judged,
    disagreement,
    nominal_residuals,
    reason_against,
    refuse_few,
    significant_share,
    undetermined,
)
from calibration.fit.cross_validation import CrossValidation, cross_validate
from calibration.fit.datum import model_in_datum
from calibration.fit.fit import Fit
from calibration.fit.identifiability import LOW_LINES, Identifiability, identifiability, of_low_degrees
from calibration.fit.prediction import RelativeDeviation, relative_deviations
from calibration.fit.residual_tests import DependenceTest, dependences
from calibration.fit.set_up.checked_data import CheckedData
from calibration.fit.set_up.distances import distance_findings
from calibration.fit.set_up.drift import Drift, with_drift
from calibration.fit.set_up.explained import AUTO, Wanted
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.fit.set_up.target_positions import TargetPosition
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice
from calibration.observation.normal_equations import whitened
from calibration.observation.outliers import Variance
from calibration.plausibility.finding import Finding
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import SIMULATED, Provenance, plugin_inputs
from kinematics.running.progress import Progress, numbered, silent
from kinematics.transforms import Array
from kinematics.user_error import UserError
from kinematics.version import VERSION
from rendering.shown import Shown


@dataclass(frozen=True, repr=False)
class Calibration(Shown, Judged):
    """A calibration with its fit and its checks."""

    fit: Fit
    """The fit: residuals, um, outliers, and the registration of the instrument."""
    model: ErrorModel
    """The model to be written: in the datum, location errors as separate effects, with covariance."""
    bases: Mapping[str, BasisChoice]
    """Basis of the error motions of each axis."""
    prior_scale: float | None
    """Size of the error motions, in typical sizes; None where the data have decided those of each band of degrees."""
    identifiability: Identifiability
    """Errors that the data do not show, by name."""
    before_rms_um: float
    """RMS residual per scalar, um, of the nominal machine with a registration of its own."""
    before_max_um: float
    """Largest length of these residuals in a row, um."""
    before_chi2_reduced: float
    """chi2 of these residuals per degree of freedom."""
    dependences: tuple[DependenceTest, ...]
    """Variables on which the residuals depend."""
    cross_validation: CrossValidation | None
    """Prediction of held-out lines, regions of stops or cycles, um; None without one."""
    findings: tuple[Finding, ...]
    """Anomalies of the data."""
    targets: tuple[TargetPosition, ...]
    """Targets on the tool that are not at a stated position."""
    relative_deviation: RelativeDeviation
    """Predicted deviations at the measured states relative to their mean, with uncertainties."""
    objection: str
    """Reason against the calibration: too many rows disagree, or it is no improvement; empty without one."""
    forced: bool
    """True where it is accepted nevertheless."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        state = "accepted" if self.accepted else "not accepted"
        return (
            f"{self.model.machine.name}, {self.fit.observations} observations, residual {self.before_rms_um:.3g} -> "
            f"{self.fit.rms_um:.3g} um RMS, {len(self.model.effects)} effects, {state}"
        )

    @property
    def significant_share(self) -> float:
        """Share of the measured states at which the correction exceeds twice its standard uncertainty."""
        return significant_share(self.relative_deviation)


class NotAccepted(UserError):
    """A calibration that must not be used: the message is the reason, `found` has its figures."""

    def __init__(self, found: Calibration) -> None:
        super().__init__(f"{found.fit.measurement.source}: {found.reason}")
        self.found = found


def calibrate(
    measurement: Measurement,
    *,
    basis: str = AUTO,
    effects: Sequence[Effect] = (),
    prior_scale: float | None = None,
    variance: Variance = "sheet",
    hold_out: bool = True,
    valid_days: float | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Calibration:
    """Error motions of every axis that moves, and additional `effects`, from measured points.

    basis: `auto`, `KIND:SIZE`, or by axis `X=b-spline:12,Y=legendre:5`. prior_scale: size of the error motions as a
    multiple of the typical one; None leaves it to the data where the basis is automatic, else it is 1. valid_days:
    period of validity, days, in the calibration; None for no statement. force: accept it nevertheless.

    NotAccepted for a calibration that is no improvement, or with which too many rows disagree, without `force`.
    """
    data = CheckedData.of_fit(measurement, force=force)
    steps = 3 if hold_out else 2
    wanted = Wanted(basis, tuple(effects), prior_scale, variance, numbered(progress, 1, steps))
    drift = with_drift(data.measurement, wanted)
    found = drift.fit
    numbered(progress, 2, steps)("identifiability")
    positions_of = data.measurement.distinct_positions
    identified = identifiability(of_low_degrees(found, positions_of) if wanted.automatic else found)
    least = identifiability(of_low_degrees(found, positions_of, LOW_LINES)) if wanted.automatic else identified
    refuse_few([found], least)
    held_out = _held_out(found, variance, numbered(progress, steps, steps)) if hold_out else None
    before = nominal_residuals(found)
    before_rms_um, before_max_um, before_chi2_reduced = _sizes(found, before)
    too_many = disagreement(found)
    written = _model_of(drift, valid_days)
    result = Calibration(
        fit=found,
        model=written,
        bases=drift.explained.bases,
        prior_scale=prior_scale if wanted.automatic else prior_scale or 1.0,
        identifiability=identified,
        before_rms_um=before_rms_um,
        before_max_um=before_max_um,
        before_chi2_reduced=before_chi2_reduced,
        dependences=tuple(dependences(found)),
        cross_validation=held_out,
        findings=(*data.findings, *_findings(drift, too_many)),
        targets=data.targets,
        relative_deviation=relative_deviations(written, found.good),
        objection=too_many or reason_against(found, before, held_out) or undetermined(found, least),
        forced=force,
    )
    if not result.accepted:
        raise NotAccepted(result)
    return result


def _model_of(drift: Drift, valid_days: float | None) -> ErrorModel:
    """The model to be written, without the drift, with its provenance."""
    found = drift.fit
    source = f"fit of {found.observations} observations, chi2/dof {found.chi2_reduced:.3g}"
    model = drift.model
    made = provenance([found.measurement], model.effects, source, valid_days)
    return msgspec.structs.replace(model, provenance=made)


def _findings(drift: Drift, too_many: str) -> list[Finding]:
    """Anomalies of the data that a fit shows; too_many: the statement that too many rows disagree, or empty."""
    found = drift.fit
    outliers = [Finding("outliers", too_many, False)] if too_many else []
    negative = [Finding("backlash", note, False) for effect in found.model.effects if (note := effect.finding)]
    return [*zero_findings(run_zeros(found)), *distance_findings(found), *drift.findings, *negative, *outliers]


def _held_out(found: Fit, variance: Variance, progress: Progress) -> CrossValidation | None:
    """The cross-validation of a fit; variance: as it was asked for, before the noise was estimated."""
    progress("held-out residuals")
    variance = variance if found.measurement.noise is None else "sheet"
    return cross_validate(found.good, found.start, found.prior, variance, found, progress)


def _sizes(found: Fit, residual: Array) -> tuple[float, float, float]:
    """RMS per scalar and largest length, um, and chi2 per degree of freedom, of the residuals `(kept, d)` of a fit.

    found: another fit of the same registration, which kept these rows; chi2 is by the instrument specification.
    """
    in_um = residual * found.good.per_micro
    chi2 = float(np.sum(whitened(replace(found.good, noise=None).whiteners, residual) ** 2))
    degrees_of_freedom = max(found.observations - len(found.registration.names), 1)
    rms, largest = float(np.sqrt(np.mean(in_um**2))), float(np.linalg.norm(in_um, axis=1).max())
    return rms, largest, chi2 / degrees_of_freedom


def in_datum(found: Fit) -> ErrorModel:
    """The fitted model in the datum, with its location errors."""
    return model_in_datum(found.model, found.measurement, found.prior)


def provenance(
    measurements: Sequence[Measurement], effects: Iterable[Effect], source: str, valid_days: float | None
) -> Provenance:
    """Provenance of a calibration with some effects from measurements; source: the fit in words."""
    known = [name for each in measurements for name in each.temperatures]
    ranges = {name: [each.temperatures[name] for each in measurements if name in each.temperatures] for name in known}
    temperatures = {name: (min(low for low, _ in own), max(high for _, high in own)) for name, own in ranges.items()}
    return Provenance(
        made_by=f"ncomp {VERSION}",
        made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        source=f"{source}, {SIMULATED}" if any(each.simulated for each in measurements) else source,
        inputs={each.source: each.fingerprint for each in measurements} | plugin_inputs(effects),
        valid_days=msgspec.UNSET if valid_days is None else valid_days,
        measured_on=min((each.measured for each in measurements if each.measured is not None), default=msgspec.UNSET),
        temperatures_degC=temperatures or msgspec.UNSET,
    )
