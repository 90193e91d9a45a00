"""When a calibration is refused: too few data for its parameters, or predictions worse than without it."""

from __future__ import annotations

import math

import numpy as np

from calibration.fit import Fit, fit
from calibration.heldout import HeldOut
from calibration.measurement import Measurement
from calibration.normal import whitened, whiteners
from calibration.prediction import Seen, relative_at_most
from calibration.visibility import Visibility
from kinematics.errors import UserError
from kinematics.model import ErrorModel, no_errors
from kinematics.transforms import Array

SPARE = 0.2
"""Share of the observations that must be left over to check the parameters that they determine."""
QUIET = 0.1
"""chi2/dof below which the stated uncertainty can't be that of the data."""
COVERAGE = 2.0
"""k: a correction is significant above so many standard uncertainties."""
MOSTLY = 0.5
"""Share of positions at which the correction must be significant."""


def refuse_few(found: Fit, seen: Visibility) -> None:
    """UserError where the rows show nothing, can't determine the model's parameters, or leave nothing to check them."""
    measurement, registered = found.measurement, len(found.registration.names)
    if seen.parameters and not seen.rank_registered:
        raise UserError(
            f"{measurement.source}: the rows show nothing of the machine's errors: no axis moves between the "
            "instrument and its targets, or nothing but what the registration takes up"
        )
    unknown = registered + seen.parameters - seen.by_convention
    told = _information(measurement.rows(np.flatnonzero(found.kept)))
    checked = found.observations * (1.0 - SPARE) >= registered + seen.rank_registered
    if checked and (told >= unknown or measurement.components == 1):
        return
    advice = "repeat the runs, or measure more positions"
    if measurement.components > 1:
        positions = math.ceil(unknown / (1.0 - SPARE) / measurement.components)
        advice = f"measure about {positions} positions or more, spread over the travel, or fit a smaller basis"
    raise UserError(
        f"{measurement.source}: {np.count_nonzero(found.kept)} rows ({found.observations} observations) are too few "
        f"for {seen.parameters} parameters of the machine and {registered} of the registration: they determine "
        f"{registered + seen.rank_registered} of {unknown}, and {100 * SPARE:g} % of the observations must remain to "
        f"check them; {advice}"
    )


def _information(measurement: Measurement) -> int:
    """Most parameters that the rows can determine: of a rigid body at each position six at most."""
    _, position = np.unique(np.round(measurement.state.positions, 6), axis=0, return_inverse=True)
    targets = np.unique(np.stack([position.reshape(-1), measurement.target_number], axis=1), axis=0)
    return int(np.minimum(np.bincount(targets[:, 0]) * measurement.components, 6).sum())


def nominal_residuals(found: Fit) -> Array:
    """Residuals `(kept, d)`, mm and rad, of the nominal machine in the kept rows, with a registration of its own."""
    kept = found.measurement.rows(np.flatnonzero(found.kept))
    return fit(kept, no_errors(kept.machine), prior=np.zeros(0)).residual


def refuse_worse(found: Fit, before: Array, held: HeldOut | None) -> None:
    """UserError for a fit that is no gain, as `no_gain` has it."""
    reason = no_gain(found, before, held)
    if reason:
        raise UserError(f"{found.measurement.source}: {reason}")


def no_gain(found: Fit, before: Array, held: HeldOut | None) -> str:
    """Why a fit is no gain, empty where it is one: it leaves, or predicts, larger deviations than the nominal machine.

    Larger both as they are and in units of the instrument's uncertainty. before: as `nominal_residuals`.
    """
    advice = "No calibration is written: check the data and the model (ncomp diagnose), or measure more"
    if found.chi2_reduced < QUIET:
        advice += (
            f"; chi2/dof is {found.chi2_reduced:.2g}: the stated uncertainty of the instrument hides what the data "
            "show, --noise estimate takes it from the residuals"
        )
    kept = found.measurement.rows(np.flatnonzero(found.kept))
    rms_um = float(np.sqrt(np.mean((before * kept.per_micro) ** 2)))
    if found.rms_um > rms_um and found.chi2 > float(np.sum(whitened(whiteners(kept), before) ** 2)):
        return f"the fit leaves {found.rms_um:.3g} um RMS, more than the nominal machine ({rms_um:.3g} um). {advice}"
    if held is not None and held.gain < 0.0 and held.rms_um > held.nominal_rms_um:
        return (
            f"the fit of the others predicts held-out {held.what} worse ({held.rms_um:.3g} um RMS) than the nominal "
            f"machine does ({held.nominal_rms_um:.3g} um). {advice}"
        )
    return ""


def seen_by(model: ErrorModel, measurement: Measurement) -> Seen:
    """Predicted deviations at measured states, evenly spread, of the target that most rows on the tool have."""
    on_tool = np.array([target.known for target in measurement.targets.values()])[measurement.target_number]
    rows = np.flatnonzero(on_tool) if on_tool.any() else np.arange(len(measurement))
    usual = np.bincount(measurement.target_number[rows]).argmax()
    position = list(measurement.targets.values())[usual].position if on_tool.any() else (0.0, 0.0, 0.0)
    return relative_at_most(model, measurement.machine, measurement.state.rows(rows), np.tile(position, (len(rows), 1)))


def significant_share(seen: Seen) -> float:
    """Share of the states at which a component of the deviation exceeds COVERAGE standard uncertainties.

    Relative to the mean of all: a common shift is no error of a part whose zero was touched off on the machine.
    """
    u = np.where(seen.u > 0.0, seen.u, np.inf)
    return float(np.mean(np.any(np.abs(seen.deviation) > COVERAGE * u, axis=1)))
