"""`ncomp iso230`: positioning accuracy and repeatability of axes by ISO 230-2, from interferometer runs."""

from __future__ import annotations

import csv
import io
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import ncomp
from postproc.commands.options.declared import argument, output_option
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.recorded import RecordedOptions, results_entry
from postproc.commands.options.shared import MachineName, whole_results

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.single_axis.iso230 import AxisTest

EPILOG = (
    "Examples:\n\n"
    "`ncomp iso230 laser.csv --machine dmu50 --report laser.html`\n\n"
    "`ncomp iso230 x_axis.rtl --machine gantry --header axis=X --header u_um=0.3 --header u_um_per_m=0.5 -o x.csv`"
)


def iso230(
    *,
    data: Path = argument("Interferometer data, or a tracker's along the body diagonals.", "DATA", reads=True),
    machine: MachineName,
    output: str | None = output_option("Error tables of both directions; `-` is standard output.", "TABLE.csv", None),
    form: DataOptions,
    others: RecordedOptions,
) -> None:
    """Evaluate interferometer runs by ISO 230-2: reversal, repeatability, systematic deviation and accuracy of axes.

    Deviations are measured minus target, positive where the axis goes too far in its positive direction; the reversal
    value is forward minus backward. U (k = 2) of each value comes from the uncertainty of the instrument. Points of a
    laser tracker along the body diagonals are evaluated by ISO 230-6: each diagonal like an axis, and E_d and B_d.
    """
    from calibration.reports.head import measured_head
    from calibration.reports.iso230 import iso230_json, iso230_report
    from history.figures import of_axes
    from postproc.commands.show.terminal import console, say, show

    inputs = (data, *form.files)
    found = ncomp.load_machine(machine)
    with console.status("1 of 2: reading") as status:
        measurement = form.read([data], found)
        status.update("2 of 2: evaluating")
        tests = ncomp.iso230(measurement)
    head = measured_head(measurement, None, f"ncomp iso230 {data} --machine {machine}")
    for test in tests:
        for note in test.notes:
            say("note", note)
    report = iso230_report(tests, str(data), head)
    answer, title = iso230_json(tests), "; ".join(test.headline for test in tests)
    figures = partial(of_axes, answer["axes"])
    with others.recorded(found) as record, whole_results(*others.files, output) as (results, page, file):
        others.write(answer, report, (results, page), inputs)
        _write_tables(tests, file)
        record(results_entry("iso230-2", title, answer, figures, inputs, measurement))
    show(report, *others.files, output)


def _write_tables(tests: Sequence[AxisTest], file: BinaryIO) -> None:
    """Write rows of axis, direction, position, error, standard uncertainty (k = 1) and number of readings."""
    from calibration.single_axis.cells import DIRECTIONS

    units = list(dict.fromkeys((test.position_unit, test.unit) for test in tests))
    names = [name for p, e in units for name in (f"position_{p}", f"error_{e}", f"u_{e}")]
    text = io.StringIO()
    writer = csv.DictWriter(text, ["axis", "direction", *names, "n"], restval="", lineterminator="\n")
    writer.writeheader()
    for test in tests:
        p, e = test.position_unit, test.unit
        for number, name in enumerate(DIRECTIONS):
            for row in test.table(number):
                numbers = {
                    f"position_{p}": f"{row.position:g}",
                    f"error_{e}": f"{row.error:.4f}",
                    f"u_{e}": f"{row.u:.4f}",
                }
                writer.writerow({"axis": test.axis, "direction": name, **numbers, "n": row.n})
    file.write(text.getvalue().encode())
