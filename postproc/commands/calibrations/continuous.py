"""`ncomp continuous`: laser runs in motion and a quasi-static measurement of an axis, joined into one error table."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO

import typer

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.measurement import HeaderLines, header_of
from postproc.commands.options.shared import (
    ResultOptions,
    check_apart,
    check_places,
    machine_names,
    whole_results,
    write_json,
)

if TYPE_CHECKING:
    from calibration.continuous.axis_model import AxisModel
    from calibration.continuous.estimate import Estimate, TableRows
    from calibration.continuous.reading import Data
    from calibration.continuous.records import QuasiStatic

EPILOG = (
    "Examples:\n\n"
    "`ncomp continuous x_run.csv x_targets.csv -o x_table.csv --report x.html`\n\n"
    "`ncomp continuous forward.csv backward.csv x_axis.rtl --header u_um=0.3 -o x_table.csv --direction backward`\n\n"
    "`ncomp continuous x_run.csv x_targets.csv --run 1 -o x_table.csv`  only the first cycle, before the axis warmed up"
    "\n\n"
    "`ncomp continuous x_run.csv x_targets.csv -o x_table.csv --machine cframe --write-calibration cal.json`  for "
    "*ncomp part.nc*, *ncomp export* and every other command that takes --calibration\n\n"
    "`ncomp continuous y_run.csv y_targets.csv -o y_table.csv --machine cframe --add-to cal.json "
    "--write-calibration cal_xy.json`  the next axis"
)
CALIBRATION = "The calibration"


def continuous(
    *,
    data: Annotated[
        list[Path],
        typer.Argument(
            metavar="CONTINUOUS.csv... QUASISTATIC.csv...",
            help="Continuous runs and quasi-static data, told apart by their columns.",
        ),
    ],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="TABLE.csv", help="Error table; - for standard output.")
    ],
    spacing_mm: Annotated[
        float | None,
        typer.Option("--spacing-mm", metavar="mm", help="Between rows of the table; default about 500 rows."),
    ] = None,
    direction: Annotated[
        str,
        typer.Option(
            metavar="auto|forward|backward|mean",
            help="Of the table; auto: mean where both directions have continuous runs, else that of the run.",
        ),
    ] = "auto",
    run: Annotated[
        list[str] | None,
        typer.Option("--run", metavar="NAME", help="Quasi-static run to use; default all of them. Repeatable."),
    ] = None,
    header: HeaderLines = None,
    write_calibration: Annotated[
        str | None,
        typer.Option(
            "--write-calibration",
            metavar="CAL.json",
            rich_help_panel=CALIBRATION,
            help="Also the errors of both directions, with their uncertainty, as a calibration of --machine.",
        ),
    ] = None,
    machine: Annotated[
        str | None,
        typer.Option(
            "--machine",
            "-m",
            rich_help_panel=CALIBRATION,
            help="Name of a machine, or path of its .toml file.",
            autocompletion=machine_names,
        ),
    ] = None,
    add_to: Annotated[
        str | None,
        typer.Option(
            "--add-to",
            metavar="OLD.json",
            rich_help_panel=CALIBRATION,
            help="A calibration of the machine, whose errors along this axis are replaced; all else of it stays.",
        ),
    ] = None,
    others: ResultOptions,
) -> None:
    """Join laser runs at constant velocity with a coarse quasi-static measurement of the same axis: one fine table.

    The run shows the shape of the error in full detail, the targets its scale and datum. Errors are measured minus
    target, positive where the axis goes too far in its positive direction; u_um is their standard uncertainty (k = 1).
    Cyclic errors, table steps, vibrations, reversal and drift between runs are reported.
    """
    from calibration.continuous.estimate import DIRECTIONS, estimate
    from calibration.continuous.reading import read_all
    from calibration.fit.beyond_measured import calibration_file
    from postproc.commands.show.continuous import show, summary
    from postproc.commands.show.terminal import console, say
    from postproc.commands.show.terminal import output as screen

    places = {"--output": output, "--write-calibration": write_calibration}
    places |= {"--json": others.json, "--report": others.report}
    check_apart(places)
    check_places((*data, add_to), places.values())
    _check_calibration(write_calibration, machine, add_to)
    if direction not in DIRECTIONS:
        raise UserError(f"--direction {direction}: expected one of {', '.join(DIRECTIONS)}")
    if spacing_mm is not None and not 0.0 < spacing_mm < float("inf"):
        raise UserError(f"--spacing-mm {spacing_mm:g}: expected a length above zero")
    with console.status("reading") as status:
        read = read_all(data, header_of(header or []))
        quasi = _runs(read.quasi, run or [])
        status.update("joining")
        found = estimate(read.records, quasi, spacing_mm, direction)
        made = _calibration(found, read, quasi, machine, add_to, header) if write_calibration and machine else None
    with whole_results(*others.files, write_calibration, output) as (results, shown, calibration, file):
        _write_table(found.table(), file)
        if made is not None and machine is not None:
            calibration.write(calibration_file(made.model, ncomp.load_machine(machine)))
        write_json(summary(found, read), results)
        if others.report is not None:
            from calibration.pages.continuous import continuous_page

            shown.write(continuous_page(found, read, f"ncomp continuous {' '.join(map(str, data))}"))
    show(found, read, console if "-" in places.values() else screen)
    for note in (*read.notes, *found.notes, *(made.notes if made else ())):
        say("note", note)
    if made is not None:
        say("calibration", f"{write_calibration}: {', '.join(made.effects)}; {made.nodes} nodes")


def _check_calibration(write_calibration: str | None, machine: str | None, add_to: str | None) -> None:
    """UserError for options of the calibration without --write-calibration, and for that without --machine."""
    if write_calibration is not None and machine is None:
        raise UserError("--write-calibration: --machine is missing, the machine that the calibration is of")
    for option, value in (("--machine", machine), ("--add-to", add_to)):
        if value is not None and write_calibration is None:
            raise UserError(f"{option} {value}: only with --write-calibration CAL.json")


def _calibration(
    found: Estimate, read: Data, quasi: QuasiStatic, name: str, add_to: str | None, header: list[str] | None
) -> AxisModel:
    """The estimate as a calibration of the machine; UserError where the data are of another machine or axis."""
    from calibration.continuous.axis_model import axis_model, line_of
    from calibration.measurement.readers import read_any
    from kinematics.error_model.model import read_model

    machine = ncomp.load_machine(name)
    if read.machine not in ("", machine.name):
        raise UserError(f"{', '.join(read.fingerprints)}: of machine {read.machine}, --machine is {machine.name}")
    if read.axis not in machine.names:
        raise UserError(f"{', '.join(read.fingerprints)}: {machine.name} ({machine.chain}) has no axis {read.axis}")
    base = None if add_to is None else read_model(Path(add_to), machine)
    given = header_of(header or [])
    line = line_of([read_any(path, machine, header=given) for path in read.standing], read.axis)
    return axis_model(found, read, quasi, machine, line, base)


def _runs(quasi: QuasiStatic, wanted: Sequence[str]) -> QuasiStatic:
    """The readings of the requested runs, all of them by default; UserError for an unknown run."""
    import numpy as np

    unknown = [name for name in wanted if name not in quasi.runs]
    if unknown:
        raise UserError(f"--run {unknown[0]}: {quasi.source} has runs {', '.join(quasi.runs)}")
    return quasi.rows(np.flatnonzero(np.isin(quasi.run, list(wanted)))) if wanted else quasi


def _write_table(rows: TableRows, file: BinaryIO) -> None:
    """Write the error table: position_mm, error_um, u_um (k = 1)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["position_mm", "error_um", "u_um"])
    for x, error, u in zip(rows.position.tolist(), rows.error.tolist(), rows.u.tolist(), strict=True):
        writer.writerow([f"{x:.6f}".rstrip("0").rstrip("."), f"{error:z.4f}", f"{u:.4f}"])
    file.write(text.getvalue().encode())
