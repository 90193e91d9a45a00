"""`ncomp three-points`: three targets on each moving part in, six error motions of each axis and a calibration out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import (
    MachineName,
    ResultOptions,
    check_files,
    whole_results,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

EPILOG = (
    "Examples:\n\n"
    "`ncomp three-points tracker.csv --machine dmu50 -o cal.json`\n\n"
    "`ncomp three-points tracker.csv --machine dmu50 --degree XX=4 --degree YY=6 -o cal.json --json three_points.json`"
)


def three_points(
    *,
    data: Path = argument("Measurement file of a tracker on the bed.", "DATA.csv"),
    machine: MachineName,
    output: Path = option("File for the calibration.", "CAL.json", "-o", default=REQUIRED),
    basis: Literal["polynomial", "table"] = option("Basis of the error motions.", default="polynomial"),
    degree: tuple[str, ...] = option("Degree of the polynomial of E_XX; default: chosen by AIC.", "XX=4"),
    form: DataOptions,
    tables: bool = option("Also show the errors at each position of each axis.", default=False),
    others: ResultOptions,
) -> None:
    """Identify the six error motions of each axis from three or more targets on the part that the axis moves."""
    from calibration.fit.acceptance import refuse_uncertain
    from calibration.fit.beyond_measured import calibration_file
    from calibration.reports.head import measured_head
    from calibration.reports.three_points import three_points_json, three_points_report
    from calibration.single_axis.three_points import Choice, identify
    from calibration.single_axis.three_points_check import check
    from postproc.commands.show.terminal import say, show

    inputs = check_files((data, form.plan), {"--output": output, **others.by_option})
    measurement = form.read([data], ncomp.load_machine(machine))
    choice = Choice(basis, _degrees(degree))
    found = identify(measurement, choice)
    for note in found.notes:
        say("note", note)
    refuse_uncertain(found.model, measurement)
    checked = check(measurement, found, choice)
    command = f"ncomp three-points {data} --machine {machine} --basis {basis}"
    head = measured_head(measurement, found.model, command)
    report = three_points_report(found, checked, measurement.source, head, tables=tables)
    with whole_results(*others.files, str(output)) as (results, page, file):
        file.write(calibration_file(found.model, measurement.machine))
        others.write(three_points_json(found, checked), report, (results, page), inputs)
    show(report, *others.files)


def _degrees(texts: Iterable[str]) -> dict[str, int]:
    degrees = {}
    for text in texts:
        name, _, number = text.partition("=")
        if not number.strip().isdigit():
            raise UserError(f"--degree {text}: expected NAME=DEGREE, as in XX=4")
        degrees[name.strip().removeprefix("E_")] = int(number)
    return degrees
