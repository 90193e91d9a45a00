"""The public functions that make calibrations from measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, temperatures_of
from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError
from machines.given import load_calibration

if TYPE_CHECKING:
    from calibration.diagnosis.conclusion.result import Diagnosis
    from calibration.fit.calibrate import Calibration
    from calibration.fit.together import Together
    from calibration.following.drift import Drift
    from calibration.measurement.measurement import Measurement
    from calibration.on_the_fly.along_path import OnTheFly
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel


@public
def fit(
    measurement: Measurement | OnTheFly,
    *,
    basis: str = "auto",
    effects: Sequence[str | Effect] = (),
    noise: Literal["sheet", "estimate"] = "sheet",
    prior_scale: Annotated[float, 1e-3, None] | None = None,
    reversal: Literal["none", "constant", "curves"] = "none",
    hold_out: bool = True,
    valid_days: Annotated[float, 1, 36500] | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Calibration:
    """Fit the errors of a machine to measured points, with uncertainties; `model` of the result is the calibration.

    basis: that of the error motions (`auto`, `legendre:5`, `X=b-spline:12,...`); effects: others of docs/effects.md
    (`backlash:axis=X,width=0`); noise: standard uncertainty of the instrument, as stated unless the residuals
    contradict it, or estimated from them; prior_scale: size of the errors, times the typical 30 um and urad, by default
    found from the data; reversal: for data taken on the fly, `constant` or `curves` that depend on the direction of
    motion; hold_out: predict lines that are left out of the fit; valid_days: validity of the calibration, days, 365 by
    default; force: accept the result although there is a reason against it; progress: called with the text of each
    step.

    UserError for too few data; `ncomp.NotAccepted`, a UserError with the result in `found`, where
    too many rows disagree, and where the fit does not predict held-out lines better than the nominal machine does.
    """
    from calibration.fit.calibrate import calibrate
    from calibration.on_the_fly.along_path import OnTheFly
    from calibration.on_the_fly.reversals import reversals
    from calibration.simulation.effect_text import given_effects

    data = measurement.measurement if isinstance(measurement, OnTheFly) else measurement
    return calibrate(
        data,
        basis=basis,
        effects=[*given_effects(effects, data.machine), *reversals(data, reversal)],
        variance=noise,
        prior_scale=prior_scale,
        hold_out=hold_out,
        valid_days=valid_days,
        force=force,
        progress=progress,
    )


@public
def fit_together(
    measurements: Sequence[Measurement],
    *,
    basis: str = "auto",
    effects: Sequence[str | Effect] = (),
    noise: Literal["sheet", "estimate"] = "sheet",
    prior_scale: Annotated[float, 1e-3, None] | None = None,
    hold_out: bool = True,
    valid_days: Annotated[float, 1, 36500] | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Together:
    """Fit the errors of a machine to measurements by several instruments, each with its own registration.

    Arguments as for `fit`. `parts` of the result has each measurement alone, with the others and predicted by them.

    UserError for fewer than two measurements, for those of different machines, and for too few data;
    `ncomp.TogetherNotAccepted`, a UserError with the result in `found`, where the calibration is no improvement for one
    of the measurements.
    """
    from calibration.fit.together import calibrate_together
    from calibration.simulation.effect_text import given_effects

    if (count := len(measurements)) < 2:
        number = "1 measurement" if count else "0 measurements"
        raise UserError(f"{number}: a common fit needs two or more; 'ncomp fit' takes one")
    return calibrate_together(
        measurements,
        basis=basis,
        effects=given_effects(effects, measurements[0].machine),
        variance=noise,
        prior_scale=prior_scale,
        hold_out=hold_out,
        valid_days=valid_days,
        force=force,
        progress=progress,
    )


@public
def diagnose(
    measurement: Measurement,
    calibration: str | Path | ErrorModel | None = None,
    *,
    unexplained: Literal["report", "add"] = "report",
    force: bool = False,
    progress: Progress = silent,
) -> Diagnosis:
    """Find the causes of the errors that a model of the machine lacks; `model` of the result has them added.

    calibration: the present one; None begins with error motions of all axes. unexplained: functions without a known
    cause are reported, or corrected too, as far as they depend on positions or temperatures. force: accept the new
    model although there is a reason against it. `accepted` of the result is False where the new model is no
    improvement, and `reason` says why. The noise is found with the causes, within its prior.

    UserError for too few data, and for a calibration of another machine.
    """
    from calibration.diagnosis.diagnose import diagnose

    present = None if calibration is None else load_calibration(measurement.machine, calibration)
    add = unexplained == "add"
    return diagnose(measurement, present, force=force, add_unexplained=add, progress=progress)


@public
def drift(
    measurement: Measurement,
    calibration: str | Path | ErrorModel | None = None,
    *,
    at: str | None = None,
    since: str | None = None,
    temperature: Texts = (),
    tolerance_um: Annotated[float, 0, None] | None = None,
    accept_jumps: bool = False,
    earlier: Sequence[Measurement] = (),
    progress: Progress = silent,
) -> Drift:
    """The drift of a machine between parts, by a log of touches of spheres or other features.

    measurement: that of a touch probe, with times, and with temperatures if it has any; calibration: the one that the
    drift is added to, `model` of the result. at: time stamp by the clock of the log, or seconds, for which the drift is
    predicted, by default the last reading; since: when the work offsets were touched off, by default the first reading;
    temperature: those at that time, degC (`spindle=31.5`), by default those of the last reading; tolerance_um: largest
    uncertainty (k = 2) with which the drift is of use; accept_jumps: a jump between two readings is taken as drift.
    earlier: logs of the same machine, from which walk, scatter and the dependences on temperatures are learned too.

    UserError for a log that cannot be used, whose newest readings contradict the earlier ones, for a drift that is not
    known within the tolerance, and for a calibration that has a drift already.
    """
    from calibration.following.drift import drift_at
    from calibration.following.follow import follow
    from kinematics.effects import after_touch_off

    present, kelvin = load_calibration(measurement.machine, calibration), temperatures_of(temperature)
    if any(map(after_touch_off, present.effects)):
        name = calibration if isinstance(calibration, (str, Path)) else present.id
        raise UserError(
            f"calibration {name} has a drift already ({present.provenance.source}), which would count twice: give the "
            "calibration without the drift"
        )
    found = follow(measurement, earlier, jumps=accept_jumps, progress=progress)
    return drift_at(found, present, at, since, kelvin, tolerance_um)
