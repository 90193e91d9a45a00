"""`ncomp fit`: measured points in, a calibration out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import ncomp
from kinematics.running.progress import Progress
from kinematics.user_error import UserError
from postproc.commands.options.declared import MODEL, argument, option, output_option
from postproc.commands.options.measurement import DataOptions, Force, Noise
from postproc.commands.options.path import OnTheFlyOptions, Reversal, read_path
from postproc.commands.options.program import SetUpOptions
from postproc.commands.options.recorded import RecordedOptions, calibration_entry
from postproc.commands.options.shared import MachineName, whole_results

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.measurement.measurement import Measurement
    from calibration.on_the_fly.along_path import OnTheFly
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from rendering.report import Report


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """The fitted model, its prior and its validity, by the names of the public interface."""

    PANEL: ClassVar[str] = MODEL

    basis: str = option(
        "Basis of the error motions: b-spline:NODES (a table), cubic:NODES, legendre:DEGREE, polynomial:DEGREE, "
        "fourier:HARMONICS; auto: functions of all degrees, whose sizes the data decide.",
        "auto|KIND:SIZE|X=KIND:SIZE,...",
        default="auto",
    )
    effects: tuple[str, ...] = option(
        "Another effect of docs/effects.md to fit, with its initial values: backlash:axis=X,width=0.",
        "KIND:FIELD=VALUE,...",
        "--effect",
    )
    noise: Noise
    prior_scale: float | None = option(
        "Expected size of the errors, as a multiple of 30 um and urad; default: by the data.",
        min=1e-3,
    )
    hold_out: bool = option("Predict each line, region of stops or cycle from all others as a check.", default=True)
    valid_days: float | None = option("Validity of the calibration, days; default: 365.", "days", min=1.0, max=36500.0)
    force: Force


@dataclass(frozen=True, kw_only=True)
class PathSetUp(SetUpOptions):
    """Set-up of the program of data taken on the fly."""

    PANEL: ClassVar[str] = "Program of data taken on the fly"


EPILOG = (
    "Examples:\n\n"
    "`ncomp fit tracker.csv --machine gantry -o gantry.json --report gantry.html`\n\n"
    "`ncomp fit tracker.csv --machine dmu50 --basis legendre:5 -o cal.json --json fit.json`\n\n"
    "`ncomp fit tracker.csv --machine cframe --effect backlash:axis=X,width=0 -o cal.json`\n\n"
    "`ncomp fit log.csv --machine gantry --plan plan.csv -o gantry.json`  finds the standstills in a "
    "tracker's stream\n\n"
    "`ncomp fit points.csv --machine cframe --path path.nc --reversal constant -o cal.json`  fits "
    "data taken on the fly\n\n"
    "`ncomp fit spheres.csv lengths.csv --machine dmu50 -o cal.json`  fits data of several instruments together\n\n"
    "`ncomp fit plate.txt --machine cframe --header u_um=2.3 --noise estimate -o cal.json`  reads a CMM's table\n\n"
    "`ncomp fit tracker.csv --machine gantry --valid-days 90 -o gantry.json`  makes a calibration that "
    "is refused after 90 days\n\n"
    "then `ncomp part.nc --machine gantry --calibration gantry.json -o part_c.nc`"
)


def fit(
    *,
    data: tuple[Path, ...] = argument("Measurement files, of one instrument or of several.", "DATA.csv...", reads=True),
    machine: MachineName,
    output: Path = output_option("File for the calibration.", "CAL.json"),
    model: FitOptions,
    form: DataOptions,
    moving: OnTheFlyOptions,
    set_up: PathSetUp,
    others: RecordedOptions,
) -> None:
    """Fit the machine's errors to measured points, with uncertainties, and list the errors that the points cannot show.

    Error motions of all axes that move, the instrument's position and outliers are found jointly. Errors that the data
    do not determine are listed by name and keep their prior uncertainty. Files of several instruments are fitted
    together: each has its own registration and is also predicted by the others.
    """
    from calibration.measurement.measurement import Measurement
    from postproc.commands.show.terminal import console, show

    inputs = (*data, *form.files, moving.path)
    moving.check(form, set_up)
    if moving.path is not None and len(data) > 1:
        raise UserError("--path needs one measurement file: several cannot be along one path")
    found_machine = ncomp.load_machine(machine)
    command = f"ncomp fit {' '.join(map(str, data))} --machine {machine} --basis {model.basis} --noise {model.noise}"
    with console.status("reading") as status:
        if moving.path is None:
            measured: Sequence[Measurement | OnTheFly] = form.by_instrument(data, found_machine)
        else:
            nominal = read_path(moving.path, found_machine, set_up.setup(found_machine), set_up.dialect)
            measured = [moving.read(data[0], nominal, form)]
        fitted = _of_one if len(measured) == 1 else _of_several
        found = fitted(measured, model, moving.reversal, command, status.update)
    _write(found, found_machine, output, others, inputs)
    show(found.report, *others.files)
    if found.refusal is not None:
        raise found.refusal
    form.note_date([each if isinstance(each, Measurement) else each.measurement for each in measured])


class _Fitted(NamedTuple):
    """A calibration, its results for programs and for people, and its refusal if it must not be used."""

    model: ErrorModel
    results: dict[str, Any]
    report: Report
    refusal: UserError | None


def _write(
    found: _Fitted, machine: Machine, output: Path, others: RecordedOptions, inputs: Sequence[Path | str | None]
) -> None:
    """Write the results, and the calibration if it may be used."""
    from calibration.fit.beyond_measured import calibration_file

    target = None if found.refusal else str(output)
    with others.recorded(machine) as record, whole_results(*others.files, target) as (results, page, file):
        others.write(found.results, found.report, (results, page), inputs)
        if found.refusal is None:
            content = calibration_file(found.model, machine)
            file.write(content)
            record(calibration_entry(machine, content, target, found.report, inputs))


def _of_one(
    measured: Sequence[Measurement | OnTheFly], model: FitOptions, reversal: Reversal, command: str, progress: Progress
) -> _Fitted:
    """The fit of the measurement by one instrument."""
    from calibration.fit.calibrate import NotAccepted
    from calibration.measurement.measurement import Measurement
    from calibration.reports.fit import fit_json, fit_report

    refusal, (one,) = None, measured
    try:
        found = ncomp.fit(one, reversal=reversal, progress=progress, **vars(model))
    except NotAccepted as refused:
        refusal, found = refused, refused.found
    taken = None if isinstance(one, Measurement) else one
    return _Fitted(found.model, fit_json(found, taken), fit_report(found, taken, command), refusal)


def _of_several(
    measured: Sequence[Measurement | OnTheFly], model: FitOptions, _: Reversal, command: str, progress: Progress
) -> _Fitted:
    """The fit of the measurements by several instruments."""
    from calibration.fit.together import TogetherNotAccepted
    from calibration.reports.together import together_json, together_report

    refusal = None
    try:
        found = ncomp.fit_together(cast("Sequence[Measurement]", measured), progress=progress, **vars(model))
    except TogetherNotAccepted as refused:
        refusal, found = refused, refused.found
    return _Fitted(found.model, together_json(found), together_report(found, command), refusal)
