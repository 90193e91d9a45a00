"""`ncomp iso230`: positioning accuracy and repeatability of axes by ISO 230-2, from interferometer runs."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import ncomp
from postproc.commands.options.declared import argument, option
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import (
    JsonFile,
    MachineName,
    check_files,
    whole_results,
    write_json,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from calibration.single_axis.iso230 import AxisTest

EPILOG = (
    "Examples:\n\n"
    "`ncomp iso230 laser.csv --machine dmu50`\n\n"
    "`ncomp iso230 x_axis.rtl --machine gantry --header axis=X --header u_um=0.3 --header u_um_per_m=0.5 -o x.csv`"
)


def iso230(
    *,
    data: Path = argument("Interferometer data, in any known format.", "DATA"),
    machine: MachineName,
    output: str | None = option("Error tables of both directions; `-` is standard output.", "TABLE.csv", "-o"),
    form: DataOptions,
    json: JsonFile,
) -> None:
    """Evaluate interferometer runs by ISO 230-2: reversal, repeatability, systematic deviation and accuracy of axes.

    Deviations are measured minus target, positive where the axis goes too far in its positive direction; the reversal
    value is forward minus backward. U (k = 2) of each value comes from the uncertainty of the instrument.
    """
    from calibration.single_axis.iso230 import evaluate
    from postproc.commands.show.terminal import console, say
    from postproc.commands.show.terminal import output as screen

    check_files((data, form.plan), {"--output": output, "--json": json})
    tests = evaluate(form.read([data], ncomp.load_machine(machine)))
    with whole_results(json, output) as (results, file):
        write_json({"axes": [test.json() for test in tests]}, results)
        _write_tables(tests, file)
    to = console if "-" in (json, output) else screen
    for test in tests:
        _show(test, to)
        for note in test.notes:
            say("note", note)


def _write_tables(tests: Sequence[AxisTest], file: BinaryIO) -> None:
    """Write rows of axis, direction, position, error, standard uncertainty (k = 1) and number of readings."""
    from calibration.single_axis.iso230 import WAYS

    units = list(dict.fromkeys((test.position_unit, test.unit) for test in tests))
    names = [name for p, e in units for name in (f"position_{p}", f"error_{e}", f"u_{e}")]
    text = io.StringIO()
    writer = csv.DictWriter(text, ["axis", "direction", *names, "n"], restval="", lineterminator="\n")
    writer.writeheader()
    for test in tests:
        p, e = test.position_unit, test.unit
        for way, name in enumerate(WAYS):
            for row in test.table(way):
                numbers = {
                    f"position_{p}": f"{row.position:g}",
                    f"error_{e}": f"{row.error:.4f}",
                    f"u_{e}": f"{row.u:.4f}",
                }
                writer.writerow({"axis": test.axis, "direction": name, **numbers, "n": row.n})
    file.write(text.getvalue().encode())


def _show(test: AxisTest, to: Console) -> None:
    from rich.table import Table

    unit = test.unit
    targets = Table(
        f"target, {test.position_unit}", "forward mean", "s", "runs", "backward mean", "s", "runs", "reversal B_i",
        title=f"axis {test.axis}: deviations in {unit}, measured minus target",
    )  # fmt: skip
    for i, position in enumerate(test.positions):
        ways = [cell for way in (0, 1) for cell in (test.mean[way, i], test.spread[way, i], int(test.count[way, i]))]
        targets.add_row(f"{position:g}", *map(_cell, (*ways, test.reversal[i])))
    to.print(targets)
    values = Table(f"axis {test.axis}, ISO 230-2:2014", "", unit, f"U (k=2, instrument), {unit}")
    for value in test.values:
        values.add_row(value.symbol, value.title, _cell(value.value), _cell(value.U))
    to.print(values)


def _cell(value: float) -> str:
    """A number for people; empty for nan."""
    if isinstance(value, int):
        return str(value)
    return "" if math.isnan(value) else f"{value:z.2f}"
