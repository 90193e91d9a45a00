"""`ncomp diagnose`: errors that the present model does not explain, traced to their cause, and added."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import (
    MachineName,
    ResultOptions,
    check_places,
    either,
    refuse_one_place,
    show_insignificant,
    whole_results,
    write_json,
)

if TYPE_CHECKING:
    from calibration.diagnosis.diagnose import Diagnosis, LeftOver
    from calibration.observation.outliers import Variance

EPILOG = (
    "Examples:\n\n"
    "`ncomp diagnose tracker.csv --machine gantry -o gantry.json --report diagnosis.html`\n\n"
    "`ncomp diagnose monday.csv friday.csv --machine dmu50 -o new.json --json out.json`  several runs together\n\n"
    "`ncomp diagnose check.csv --machine gantry --calibration gantry.json -o new.json`  what has changed since\n\n"
    "then `ncomp verify part.nc part_c.nc --machine gantry --calibration new.json`"
)


def diagnose(
    *,
    data: Annotated[list[Path], typer.Argument(metavar="DATA.csv...", help="Measurement files, as of ncomp fit.")],
    machine: MachineName,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="NEW.json", help="The new calibration.")],
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration", "-c", metavar="CAL.json", help="The present model; default: error motions of all axes."
        ),
    ] = None,
    noise: Annotated[
        str,
        typer.Option(
            "--noise",
            metavar="sheet|estimate",
            help="Instrument's uncertainty: as stated (from repeats where they contradict it), or from the residuals.",
        ),
    ] = "sheet",
    unexplained: Annotated[
        str,
        typer.Option(
            "--unexplained",
            metavar="report|add",
            help="What no cause explains: only told, or also added to the calibration as a smooth function, unnamed.",
        ),
    ] = "report",
    form: DataOptions,
    others: ResultOptions,
) -> None:
    """Find the errors that a model lacks, name their cause, add it, and show the error before and after.

    Causes that the data can't show are listed, never named. Causes that the data can't distinguish are printed as a
    tie, with the next measurement that distinguishes them. Effects of the instrument are taken out of the data and not
    written.
    """
    from postproc.commands.show.diagnosis import show
    from postproc.commands.show.terminal import console
    from postproc.commands.show.terminal import output as screen

    refuse_one_place(others.json, str(output), "the new calibration")
    check_places((*data, form.plan, calibration), (output, *others.files))
    sheet: Variance = either("--noise", noise, ("sheet", "estimate"))
    left_over: LeftOver = either("--unexplained", unexplained, ("report", "add"))
    found_machine = ncomp.load_machine(machine)
    present = None if calibration is None else ncomp.load_calibration(found_machine, calibration)
    measurement = form.read(data, found_machine)
    with console.status("reading") as status:
        found = ncomp.diagnose(measurement, present, noise=sheet, unexplained=left_over, progress=status.update)
    against = "" if calibration is None else f" --calibration {calibration}"
    command = f"ncomp diagnose {' '.join(map(str, data))} --machine {machine}{against}"
    _write(found, str(output), others, command)
    to = console if "-" in (*others.files, str(output)) else screen
    if not found.accepted:
        to.print(f"NOT WRITTEN  {found.reason}")
    show_insignificant(found.significant_share, to)
    show(found, to)
    if not found.accepted:
        raise UserError(f"{measurement.source}: {found.reason}")


def _write(found: Diagnosis, output: str, others: ResultOptions, command: str) -> None:
    """Write the new calibration where it is accepted, the results for programs and the report, all or none."""
    from calibration.fit.beyond_measured import calibration_file
    from postproc.commands.show.diagnosis import summary

    with whole_results(*others.files, output if found.accepted else None) as (results, shown, file):
        if found.accepted:
            file.write(calibration_file(found.model, found.measurement.machine))
        if others.json is not None:
            write_json(summary(found), results)
        if others.report is not None:
            from calibration.pages.diagnosis import diagnosis_page

            shown.write(diagnosis_page(found, command))
