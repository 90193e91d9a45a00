"""Refusal of a calibration: too few data for its parameters, or predictions worse than without it.

Held-out data, or the uncertainty of the calibration itself, show worse predictions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.fit.cross_validation import CrossValidation, uncorrected
from calibration.fit.fit import Fit, fit
from calibration.fit.identifiability import Identifiability
from calibration.fit.prediction import RelativeDeviation, usual_target
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import decorrelation_of, whitened
from calibration.observation.outliers import OUTLIER_SHARE, too_many
from kinematics.deviation import exact_deviation
from kinematics.effects import COMPONENTS
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.files.number_text import rounded
from kinematics.forward import forward
from kinematics.state import State
from kinematics.transforms import Array, by_turn
from kinematics.user_error import UserError

SPARE_SHARE = 0.2
"""Share of the observations that must be left over to check the parameters that they determine."""
CUBIC = 4
"""Parameters of a cubic."""
QUIET = 0.1
"""chi2/dof below which the stated uncertainty of the instrument is too large for the data."""
SIGNIFICANT_SHARE = 0.5
"""Share of positions at which the correction must be significant."""
ANYWHERE = 300
"""Number of states, within the measured ranges of all axes, at which a correction is compared with its uncertainty."""


class Judged:
    """A result that must not be used where there is a reason against it, unless it is accepted nevertheless."""

    objection: str
    """Reason against it; empty without one."""
    forced: bool
    """True where it is accepted nevertheless."""

    @property
    def reason(self) -> str:
        """Reason why it must not be used; empty if it may."""
        return "" if self.forced else self.objection

    @property
    def accepted(self) -> bool:
        """True where it may be used."""
        return not self.reason


def undetermined(found: Fit, identified: Identifiability) -> str:
    """Reason against few observations that determine only a combination of effects, without a full stop; else empty.

    How much of it belongs to which effect, only the priors say, and these are wide. An effect that the data do not show
    at all, or a shape of one, has the value zero and corrects nothing.
    """
    mixed = next((each for each in identified.unidentifiable if len(each.effects) > 1), None)
    if mixed is None or not found.measurement.instrument.MAY_BE_FEW:
        return ""
    return f"the rows do not show which of these errors the machine has. {mixed}. No calibration is written"


def refuse_few(fits: Sequence[Fit], identified: Identifiability) -> None:
    """UserError with the reason of `too_few`."""
    reason = too_few(fits, identified)
    if reason:
        raise UserError(f"{' and '.join(found.measurement.source for found in fits)}: {reason}")


def too_few(fits: Sequence[Fit], identified: Identifiability) -> str:
    """Reason why the rows cannot determine and check the model's parameters, without a full stop; else empty.

    fits: of all measurements that determine the model, each with its own registration.
    """
    registered = sum(len(found.registration.names) for found in fits)
    if identified.parameters and not identified.rank_registered:
        return (
            "the rows do not show the machine's errors: no axis moves between the instrument and its targets, or the "
            "registration absorbs every motion; measure positions at which an axis moves"
        )
    # the priors determine the parameters of a basis finer than cubics where the rows do not
    moving = {axis for found in fits for axis in found.measurement.moving}
    unknown = registered + min(identified.parameters - identified.by_convention, CUBIC * len(COMPONENTS) * len(moving))
    known = sum(information(found.good) for found in fits)
    observations = sum(found.observations for found in fits)
    components = max(found.measurement.components for found in fits)
    determined = registered + identified.rank_registered
    checked = observations * (1.0 - SPARE_SHARE) >= determined
    if all(found.measurement.instrument.MAY_BE_FEW for found in fits):
        return ""
    if checked and (known >= unknown or components == 1):
        return ""
    enough = math.ceil((registered + identified.parameters - identified.by_convention) / (1.0 - SPARE_SHARE))
    advice = f"repeat the runs or measure more positions ({enough} rows are enough for these), or fit a smaller basis"
    if components > 1:
        positions = math.ceil(max(unknown, determined) / (1.0 - SPARE_SHARE) / components)
        advice = f"measure about {positions} positions or more, spread over the travel, or fit a smaller basis"
    those = unknown if determined < unknown else "them"
    rows = sum(int(np.count_nonzero(found.kept)) for found in fits)
    return (
        f"{rows} rows ({observations} observations) are too few for "
        f"{identified.parameters} parameters of the machine and {registered} of the registration: they determine "
        f"{determined} of {those}, and {100 * SPARE_SHARE:g} % of the observations must remain to check them; {advice}"
    )


def information(measurement: Measurement) -> int:
    """Largest number of parameters that the rows can determine: at each position the six of a rigid body at most."""
    _, position = np.unique(np.round(measurement.state.positions, 6), axis=0, return_inverse=True)
    _, read = np.unique(measurement.motions, return_inverse=True)
    seen = np.unique(np.stack([position.reshape(-1), measurement.target_number, read], axis=1), axis=0)
    return int(np.minimum(np.bincount(seen[:, 0]) * measurement.components, 6).sum())


def disagreement(found: Fit) -> str:
    """Statement, without a full stop, that too many rows disagree with the fit for a calibration; else empty.

    Rows of failed stations count: only a user knows that their failure is not the machine's.
    """
    number, rows = int(np.count_nonzero(found.disagreeing)), int(np.count_nonzero(~found.copies))
    if not too_many(number, rows):
        return ""
    kind = "runs" if found.measurement.axis_rows else "stations"
    fate = [f"all rows of {kind} {', '.join(found.failed)} are left out"] if found.failed else []
    stay = int(np.count_nonzero(found.suspected))
    fate += [f"{stay} of them stay in the fit and in every figure"] if stay else []
    return (
        f"{number} of {rows} rows ({100 * number / rows:.0f} %) disagree with the others by more than noise allows, "
        f"more than the {100 * OUTLIER_SHARE:g} % that may be outliers: {'; '.join(fate)}. The model lacks an effect, "
        "or something happened during the measurement: find it, or remove these rows from the file; --force writes the "
        "calibration nevertheless"
    )


def nominal_residuals(found: Fit) -> Array:
    """Residuals `(kept, d)`, mm and rad, of the nominal machine in the kept rows, with a registration of its own.

    The registration is that of the instrument's specification: estimated noise describes what the model found leaves,
    and would register another model by it. Effects of the instrument are fitted as in the model found.
    """
    return fit(replace(found.good, noise=None), uncorrected(found.model)).residual


def refuse_worse(found: Fit, before: Array, held_out: CrossValidation | None) -> None:
    """UserError for a fit that is no improvement, with the reason of `reason_against`."""
    reason = reason_against(found, before, held_out)
    if reason:
        raise UserError(f"{found.measurement.source}: {reason}")


def reason_against(found: Fit, before: Array, held_out: CrossValidation | None) -> str:
    """Reason why a fit is no improvement over the nominal machine, without a full stop; else empty.

    It is none where its residuals are larger, in um and in units of the instrument's uncertainty, and where it does not
    predict the held-out blocks better (`Gains.better`). before: as `nominal_residuals`.
    """
    advice = "No calibration is written: check the data and the model (ncomp diagnose), or measure more"
    if found.chi2_reduced < QUIET and found.measurement.noise is None:
        advice += (
            f"; chi2/dof is {found.chi2_reduced:.2g}: the stated uncertainty of the instrument is too large for these "
            "data; 'ncomp fit --noise estimate' takes it from the residuals"
        )
    kept = found.good
    rms_um = float(np.sqrt(np.mean((before * kept.per_micro) ** 2)))
    squares = float(np.sum(decorrelation_of(kept).apply(whitened(kept.whiteners, before)) ** 2))
    if found.rms_um > rms_um and found.chi2 > squares:
        sizes = rounded(found.rms_um, 3), rounded(rms_um, 3)
        return f"the fit leaves {sizes[0]} um RMS, more than the nominal machine ({sizes[1]} um). {advice}"
    if held_out is not None and not held_out.gains.better:
        return f"{not_better('the fit of the others', held_out, 'the nominal machine')}. {advice}"
    return ""


def not_better(model: str, held_out: CrossValidation, other: str) -> str:
    """Clause that a model does not predict the held-out blocks better than another one, with both figures."""
    own, others, name = (
        f"{rounded(held_out.rms_um, 3)} um RMS",
        f"{rounded(held_out.other_rms_um, 3)} um",
        held_out.name,
    )
    if held_out.gains.worse:
        weighted = held_out.rms_um < held_out.other_rms_um
        units = ", in units of the instrument's uncertainty" if weighted else ""
        return f"{model} predicts held-out {name} worse ({own}) than {other} does ({others}){units}"
    return (
        f"{model} predicts held-out {name} no better ({own}) than {other} does ({others}): the difference is within "
        f"its spread over {held_out.blocks} blocks"
    )


def refuse_uncertain(model: ErrorModel, measurement: Measurement) -> None:
    """UserError for a model whose correction, by its uncertainty, leaves larger deviations than it removes.

    The states are drawn within the measured ranges of all axes, where lever arms are longer than at the measured
    states. A correction d with standard uncertainty u removes d^2 - u^2 on the average, and leaves u^2. Both exclude
    the shift and rotation common to all states, which clamping and probing the part compensate.
    """
    low, high = (end(measurement.state.positions, axis=0) for end in (np.min, np.max))
    q = np.random.default_rng(0).uniform(low, high, (ANYWHERE, len(low)))
    state = State(q)
    tool = np.tile(usual_target(measurement), (ANYWHERE, 1))
    machine, less = measurement.machine, without_clamp(forward(measurement.machine, q).apply(tool))
    deviation = less @ exact_deviation(machine, q, model.errors(machine, state), tool).position.reshape(-1)
    design = model.design(machine, state, error_transform_with_tool(machine, q, tool)[:, :3]).reshape(3 * ANYWHERE, -1)
    u = model.propagated((less @ design).reshape(ANYWHERE, 3, -1))
    rms_um, u_um = (1e3 * float(np.sqrt(np.sum(each**2) / ANYWHERE)) for each in (deviation, u))
    if 0.0 < rms_um < math.sqrt(2.0) * u_um:
        raise UserError(
            f"{measurement.source}: within the measured ranges of all axes the correction is {rounded(rms_um, 3)} um "
            f"RMS, with a standard uncertainty of {rounded(u_um, 3)} um: it would add more error than it removes "
            f"({math.sqrt(max(rms_um**2 - u_um**2, 0.0)):.3g} um). No calibration is written: measure from more "
            "stations, with targets farther from each other, in more rounds, or only the ranges that are used"
        )


def without_clamp(points: Array) -> Array:
    """Matrix `(3n, 3n)` that removes the common shift and rotation from displacements of points `(n, 3)`."""
    arms = points - points.mean(axis=0)
    moved = np.concatenate([np.broadcast_to(np.eye(3), (len(arms), 3, 3)), by_turn(arms)], axis=2).reshape(-1, 6)
    return np.asarray(np.eye(len(moved)) - moved @ np.linalg.pinv(moved))


def significant_share(identified: RelativeDeviation) -> float:
    """Share of the states at which a component of the deviation exceeds `COVERAGE_FACTOR` standard uncertainties.

    Deviations are relative to their mean: a common shift is no error of a part whose zero was touched off on the
    machine.
    """
    u = np.where(identified.u > 0.0, identified.u, np.inf)
    return float(np.mean(np.any(np.abs(identified.deviation) > COVERAGE_FACTOR * u, axis=1)))
