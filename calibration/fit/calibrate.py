"""A calibration from start to end: basis, fit, datum, location errors, identifiability, cross-validation."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from calibration.fit.acceptance import (
    Judged,
    disagreement,
    nominal_residuals,
    reason_against,
    refuse_few,
    relative_deviations,
    significant_share,
)
from calibration.fit.bases.search import AUTO, Choice
from calibration.fit.cross_validation import CrossValidation, cross_validate
from calibration.fit.curves.between_positions import BetweenPositions, with_curves_between
from calibration.fit.datum import to_datum
from calibration.fit.fit import Fit
from calibration.fit.identifiability import Identifiability, identifiability
from calibration.fit.location_errors import split_locations, transformed
from calibration.fit.prediction import RelativeDeviation
from calibration.fit.residual_tests import DependenceTest, dependences
from calibration.fit.set_up.bases_and_noise import Wanted, with_bases_and_noise
from calibration.fit.set_up.distances import distance_findings
from calibration.fit.set_up.moved_spheres import moved_spheres
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.fit.set_up.target_positions import TargetPosition, at_positions, target_positions
from calibration.fit.set_up.target_positions import findings as target_findings
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import with_effects
from calibration.observation.normal_equations import whitened, whiteners
from calibration.observation.outliers import Variance
from calibration.plausibility.checks import Finding, usable
from kinematics.effects import Effect
from kinematics.error_model.model import SIMULATED, ErrorModel, Provenance
from kinematics.running.progress import Progress, numbered, silent
from kinematics.user_error import UserError
from kinematics.version import VERSION


@dataclass(frozen=True)
class Calibration(Judged):
    """A calibration with its fit and its checks."""

    fit: Fit
    model: ErrorModel
    """The model to be written: in the datum, location errors as separate effects, with covariance."""
    choice: Choice
    identifiability: Identifiability
    before_rms_um: float
    """RMS residual per scalar, um, of the nominal machine with a registration of its own."""
    before_max_um: float
    """Largest length of these residuals in a row, um."""
    before_chi2_reduced: float
    """chi2 of these residuals per degree of freedom."""
    dependences: tuple[DependenceTest, ...]
    """Variables on which the residuals depend."""
    cross_validation: CrossValidation | None
    between_positions: tuple[BetweenPositions, ...]
    """Uncertainty between the positions of each axis that was measured at few; none for stated bases."""
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
    margin: int = 0,
    effects: Sequence[Effect] = (),
    prior_scale: float | None = None,
    variance: Variance = "sheet",
    hold_out: bool = True,
    valid_days: float | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Calibration:
    """Error motions of every axis that moves, and additional `effects`, from measured points.

    basis: `auto`, `auto:KIND`, `KIND:SIZE`, or by axis `X=b-spline:12,Y=legendre:5`. margin: number of sizes by which
    automatic bases are finer than the choice of the evidence. prior_scale: size of the error motions as a multiple of
    the typical one; None leaves it to the evidence where the basis is automatic, else it is 1. valid_days: period of
    validity, days, in the calibration; None for no statement. force: accept it nevertheless.

    NotAccepted for a calibration that is no improvement, or with which too many rows disagree, without `force`.
    """
    findings = usable(measurement)
    moved = moved_spheres(measurement)
    if moved and not force:
        raise UserError(f"{measurement.source}: {moved}; --force fits the rows as they are")
    findings += [Finding("spheres", moved, False)] if moved else []
    positions = target_positions(measurement)
    findings += target_findings(measurement, positions)
    measurement = at_positions(measurement, positions)
    steps = 3 if hold_out else 2
    wanted = Wanted(basis, margin, tuple(effects), prior_scale, variance, numbered(progress, 1, steps))
    choice, found = with_bases_and_noise(measurement, wanted)
    measurement, prior = found.measurement, found.prior
    variance = variance if measurement.noise is None else "sheet"
    before = nominal_residuals(found)
    numbered(progress, 2, steps)("identifiability")
    identified = identifiability(found)
    refuse_few([found], identified)
    start, _ = with_effects(measurement, choice.bases, effects, *choice.scales)
    held_out = None
    if hold_out:
        last = numbered(progress, steps, steps)
        last("held-out residuals")
        held_out = cross_validate(measurement, start, prior, found.kept, variance, found, last)
    too_many = disagreement(found)
    findings += [*zero_findings(run_zeros(found)), *distance_findings(found)]
    if too_many:
        findings.append(Finding("outliers", too_many, False))
    curved, between = with_curves_between(found) if wanted.automatic else (found, ())
    written = _written(curved, valid_days)
    kept = measurement.rows(np.flatnonzero(found.kept))
    before_um = before * kept.per_micro
    freedom = max(found.observations - len(found.registration.names), 1)
    result = Calibration(
        found,
        written,
        choice,
        identified,
        float(np.sqrt(np.mean(before_um**2))),
        float(np.linalg.norm(before_um, axis=1).max()),
        float(np.sum(whitened(whiteners(replace(kept, noise=None)), before) ** 2)) / freedom,
        tuple(dependences(found)),
        held_out,
        between,
        tuple(findings),
        tuple(positions),
        relative_deviations(written, kept),
        too_many or reason_against(found, before, held_out),
        force,
    )
    if not result.accepted:
        raise NotAccepted(result)
    return result


def in_datum(found: Fit) -> ErrorModel:
    """The fitted model in the datum, with its location errors."""
    machine = found.measurement.machine
    moved = transformed(found.model, found.model.effects, to_datum(machine, found.model, found.prior))
    effects, matrix = split_locations(machine, moved)
    return transformed(moved, effects, matrix)


def _written(found: Fit, valid_days: float | None) -> ErrorModel:
    """The fitted model in the datum, with its location errors and its provenance."""
    source = f"fit of {found.observations} observations, chi2/dof {found.chi2_reduced:.3g}"
    return msgspec.structs.replace(in_datum(found), provenance=provenance([found.measurement], source, valid_days))


def provenance(measurements: Sequence[Measurement], source: str, valid_days: float | None) -> Provenance:
    """Provenance of a calibration from measurements; source: the fit in words."""
    known = [name for each in measurements for name in each.temperatures]
    ranges = {name: [each.temperatures[name] for each in measurements if name in each.temperatures] for name in known}
    temperatures = {name: (min(low for low, _ in own), max(high for _, high in own)) for name, own in ranges.items()}
    return Provenance(
        made_by=f"ncomp {VERSION}",
        made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        source=f"{source}, {SIMULATED}" if any(each.simulated for each in measurements) else source,
        inputs={each.source: each.fingerprint for each in measurements},
        valid_days=msgspec.UNSET if valid_days is None else valid_days,
        temperatures_degC=temperatures or msgspec.UNSET,
    )
