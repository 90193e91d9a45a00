"""`ncomp diagnose`: the causes of the errors that measured data show, and a calibration that contains them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import MODEL, argument, option, output_option
from postproc.commands.options.measurement import DataOptions, Force
from postproc.commands.options.recorded import RecordedOptions, calibration_entry
from postproc.commands.options.shared import MachineName, whole_results

if TYPE_CHECKING:
    from calibration.diagnosis.conclusion.result import Diagnosis
    from kinematics.machine import Machine
    from rendering.report import Report

EPILOG = (
    "Examples:\n\n"
    "`ncomp diagnose tracker.csv --machine gantry -o gantry.json --report diagnosis.html`\n\n"
    "`ncomp diagnose monday.csv friday.csv --machine dmu50 -o new.json --json out.json`  joins several runs\n\n"
    "`ncomp diagnose check.csv --machine gantry --calibration gantry.json -o new.json`  finds "
    "the errors that are new since the calibration\n\n"
    "then `ncomp verify part.nc part_c.nc --machine gantry --calibration new.json`"
)


Unexplained = Annotated[
    Literal["report", "add"],
    option(
        "Functions that no cause explains: only reported, or also corrected by the calibration, as far as they recur.",
        default="report",
        panel=MODEL,
    ),
]


def diagnose(
    *,
    data: tuple[Path, ...] = argument("Measurement files, as for ncomp fit.", "DATA.csv...", reads=True),
    machine: MachineName,
    output: Path = output_option("File for the new calibration.", "NEW.json"),
    calibration: Path | None = option(
        "Present calibration: the diagnosis finds what has changed since.", "CAL.json", "-c", reads=True, panel=MODEL
    ),
    unexplained: Unexplained,
    force: Force,
    form: DataOptions,
    others: RecordedOptions,
) -> None:
    """Find the causes of the errors that measured data show, with their odds, and write a calibration with them.

    Causes that the data cannot show are only listed. Causes that the data cannot distinguish are shown as a tie, with
    the measurement that distinguishes them. Effects of the instrument are removed from the data and not written.
    """
    from calibration.reports.diagnosis.commands import Files
    from calibration.reports.diagnosis.page import diagnosis_report
    from postproc.commands.show.terminal import console, show

    found_machine = ncomp.load_machine(machine)
    present = None if calibration is None else ncomp.load_calibration(found_machine, calibration)
    measurement = form.read(data, found_machine)
    with console.status("reading") as status:
        found = ncomp.diagnose(measurement, present, unexplained=unexplained, force=force, progress=status.update)
    files = Files(machine, str(output), None if calibration is None else str(calibration))
    report = diagnosis_report(found, _command(data, machine, calibration), files)
    _write(found, found_machine, report, str(output), others, (*data, *form.files, calibration))
    show(report, *others.files, str(output))
    if not found.accepted:
        raise UserError(f"{measurement.source}: {found.reason}")
    form.note_date([measurement])


def _write(
    found: Diagnosis,
    machine: Machine,
    report: Report,
    output: str,
    others: RecordedOptions,
    inputs: Sequence[Path | str | None],
) -> None:
    """Write the results, and the calibration if it is accepted."""
    from calibration.fit.beyond_measured import calibration_file
    from calibration.reports.diagnosis.document import diagnosis_json

    answer = diagnosis_json(found)
    target = output if found.accepted else None
    with others.recorded(machine) as record, whole_results(*others.files, target) as (results, page, file):
        others.write(answer, report, (results, page), inputs)
        if found.accepted:
            content = calibration_file(found.model, machine)
            file.write(content)
            title = f"diagnosis {found.model.id}: {found.headline}"
            effects = answer["effects"]
            record(
                calibration_entry(
                    machine, content, target, report, inputs, kind="diagnosis", title=title, effects=effects
                )
            )


def _command(data: Sequence[Path], machine: str, calibration: Path | None) -> str:
    """The command, as the report shows it."""
    against = "" if calibration is None else f" --calibration {calibration}"
    return f"ncomp diagnose {' '.join(map(str, data))} --machine {machine}{against}"
