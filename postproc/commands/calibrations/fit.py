"""`ncomp fit`: measured points in, a calibration out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import ncomp
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.measurement import DataOptions, Force, Noise
from postproc.commands.options.path import OnTheFlyOptions, read_path
from postproc.commands.options.program import SetUpOptions
from postproc.commands.options.shared import (
    MachineName,
    ResultOptions,
    check_files,
    whole_results,
)

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from calibration.on_the_fly.along_path import OnTheFly


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """The fitted model, its prior and its validity, by the names of the public interface."""

    basis: str = option(
        "Basis of the error motions: b-spline:NODES (a table), cubic:NODES, legendre:DEGREE, polynomial:DEGREE, "
        "fourier:HARMONICS; auto or auto:KIND: selected by the evidence of the data.",
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
        "Expected size of the errors, as a multiple of 30 um and urad; default: selected by the evidence of the data.",
        min=1e-3,
    )
    hold_out: bool = option("Predict each line, region of stops or cycle from all others as a check.", default=True)
    valid_days: float | None = option("Validity of the calibration, days; default: 365.", "days", min=1.0, max=36500.0)
    force: Force


EPILOG = (
    "Examples:\n\n"
    "`ncomp fit tracker.csv --machine gantry -o gantry.json --report gantry.html`\n\n"
    "`ncomp fit tracker.csv --machine dmu50 --basis legendre:5 -o cal.json --json fit.json`\n\n"
    "`ncomp fit tracker.csv --machine cframe --effect backlash:axis=X,width=0 -o cal.json`\n\n"
    "`ncomp fit log.csv --machine gantry --plan plan.csv -o gantry.json`  finds the standstills in a "
    "tracker's stream\n\n"
    "`ncomp fit points.csv --machine cframe --path path.nc --reversal constant -o cal.json`  fits "
    "data taken on the fly\n\n"
    "`ncomp fit plate.txt --machine cframe --header u_um=2.3 --noise estimate -o cal.json`  reads a CMM's table\n\n"
    "`ncomp fit tracker.csv --machine gantry --valid-days 90 -o gantry.json`  makes a calibration that "
    "is refused after 90 days\n\n"
    "then `ncomp part.nc --machine gantry --calibration gantry.json -o part_c.nc`"
)


def fit(
    *,
    data: Path = argument("Measurement file.", "DATA.csv"),
    machine: MachineName,
    output: Path = option("File for the calibration.", "CAL.json", "-o", default=REQUIRED),
    model: FitOptions,
    form: DataOptions,
    moving: OnTheFlyOptions,
    set_up: SetUpOptions,
    others: ResultOptions,
) -> None:
    """Fit the machine's errors to measured points, with uncertainties, and list the errors that the points cannot show.

    Error motions of all axes that move, the instrument's position and outliers are found jointly. Errors that the data
    do not determine are listed by name and keep their prior uncertainty.
    """
    from calibration.fit.beyond_measured import calibration_file
    from calibration.fit.calibrate import NotAccepted
    from calibration.reports.fit import fit_json, fit_report
    from postproc.commands.show.terminal import console, show

    check_files((data, form.plan, moving.path), {"--output": output, **others.by_option})
    moving.check(form, set_up)
    found_machine = ncomp.load_machine(machine)
    measured: Measurement | OnTheFly
    if moving.path is None:
        measured = form.read([data], found_machine)
    else:
        nominal = read_path(moving.path, found_machine, set_up.setup(found_machine), set_up.dialect)
        measured = moving.read(data, nominal, form)
    refusal = None
    with console.status("reading") as status:
        try:
            found = ncomp.fit(measured, reversal=moving.reversal, progress=status.update, **vars(model))
        except NotAccepted as refused:
            refusal, found = refused, refused.found
    taken = None if moving.path is None else cast("OnTheFly", measured)
    command = f"ncomp fit {data} --machine {machine} --basis {model.basis} --noise {model.noise}"
    report = fit_report(found, taken, command)
    with whole_results(*others.files, None if refusal else str(output)) as (results, page, file):
        if refusal is None:
            file.write(calibration_file(found.model, found_machine))
        others.write(fit_json(found, taken), report, (results, page))
    show(report, *others.files)
    if refusal is not None:
        raise refusal
