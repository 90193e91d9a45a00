"""`ncomp three-points`: three targets on each moving part in, six error motions of each axis and a calibration out."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import ncomp
from postproc.commands.options.declared import MODEL, OUTPUT, argument, option, output_option
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import MachineName, ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp three-points tracker.csv --machine dmu50 -o cal.json`\n\n"
    "`ncomp three-points tracker.csv --machine dmu50 --degree XX=4 --degree YY=6 -o cal.json --json three_points.json`"
)


def three_points(
    *,
    data: Path = argument("Measurement file of a tracker on the bed.", "DATA.csv", reads=True),
    machine: MachineName,
    output: Path = output_option("File for the calibration.", "CAL.json"),
    basis: Literal["polynomial", "table"] = option("Basis of the error motions.", default="polynomial", panel=MODEL),
    degree: tuple[str, ...] = option("Degree of the polynomial of E_XX; default: by the data.", "XX=4", panel=MODEL),
    form: DataOptions,
    tables: bool = option("Also show the errors at each position of each axis.", default=False, panel=OUTPUT),
    others: ResultOptions,
) -> None:
    """Identify the six error motions of each axis from three or more targets on the part that the axis moves."""
    from calibration.fit.beyond_measured import calibration_file
    from calibration.reports.head import measured_head
    from calibration.reports.three_points import three_points_json, three_points_report
    from postproc.commands.show.terminal import say, show

    inputs = (data, *form.files)
    measurement = form.read([data], ncomp.load_machine(machine))
    result = ncomp.three_points(measurement, basis=basis, degree=degree)
    found, checked = result.found, result.check
    for note in result.notes:
        say("note", note)
    command = f"ncomp three-points {data} --machine {machine} --basis {basis}"
    head = measured_head(measurement, found.model, command)
    report = three_points_report(found, checked, measurement.source, head, tables=tables)
    with whole_results(*others.files, str(output)) as (results, page, file):
        file.write(calibration_file(found.model, measurement.machine))
        others.write(three_points_json(found, checked), report, (results, page), inputs)
    show(report, *others.files)
