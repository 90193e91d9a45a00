"""How commands read the path of a program, and readings that were taken along it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kinematics.user_error import UserError
from postproc.commands.options.measurement import header_of

if TYPE_CHECKING:
    from rich.console import Console

    from calibration.fit.calibrate import Calibration
    from calibration.on_the_fly.along_path import OnTheFly
    from calibration.on_the_fly.nominal_path import NominalPath
    from kinematics.machine import Machine
    from postproc.control.setup import Setup

PANEL = "On the fly"
PathProgram = Annotated[
    str | None,
    typer.Option(
        "--path",
        metavar="PATH.nc",
        rich_help_panel=PANEL,
        help="NC program that ran while the tracker followed: DATA has time_s,x,y,z[,target][,station][,run].",
    ),
]
CellLength = Annotated[
    float | None,
    typer.Option(
        "--cell-mm", min=0.1, rich_help_panel=PANEL, help="Readings are taken together in cells of the path; default 4."
    ),
]
CornerLength = Annotated[
    float, typer.Option("--corner-mm", min=0.0, rich_help_panel=PANEL, help="Left out on both sides of corners.")
]
ReversalMode = Annotated[
    str,
    typer.Option(
        "--reversal",
        metavar="none|constant|curves",
        rich_help_panel=PANEL,
        help="Also fit what differs forward and backward: backlash and a constant of each error motion, or curves.",
    ),
]


def read_path(program: str, machine: Machine, dialect: str, setup: Setup) -> NominalPath:
    """The path of a program, whose notes are shown; UserError for what can't be followed."""
    from calibration.on_the_fly.nominal_path import NominalPath
    from postproc.commands.show.terminal import say
    from postproc.dialects import find_dialect
    from postproc.program_path import program_path
    from postproc.text.source import open_source

    source = open_source(program)
    found = program_path(source, find_dialect(dialect, source.name, source.text_head), machine, setup)
    for note in found.notes:
        say("note", note)
    return NominalPath(machine, found.positions, found.way, found.counts, source.name, source.hash)


def read_on_the_fly(
    data: Path,
    path: NominalPath,
    format: str,
    header: list[str] | None,
    columns: str | None,
    cell_mm: float | None,
    corner_mm: float,
) -> OnTheFly:
    """Readings along a path as a measurement, whose notes are shown."""
    from calibration.measurement.readers import table_in
    from calibration.on_the_fly.along_path import on_path
    from calibration.on_the_fly.footing import with_footing
    from calibration.on_the_fly.readings import read_readings
    from postproc.commands.show.terminal import console, say

    table, notes = table_in(data, path.machine, format, header=header_of(header or []), columns=columns)
    readings = read_readings(table, path.machine)
    for note in (*notes, *readings.notes):
        say("note", note)
    with console.status("reading") as status:
        taken = on_path(readings, path, cell_mm=cell_mm, corner_mm=corner_mm, progress=status.update)
        status.update("where on the path each reading was taken")
        return replace(taken, measurement=with_footing(taken))


def refuse_without_path(**options: object) -> None:
    """UserError for options of data taken on the fly where there is no path."""
    for name, value in options.items():
        if value not in (None, [], "none"):
            raise UserError(f"--{name.replace('_', '-')} is for data taken on the fly: give --path PATH.nc too")


def refuse_plan(plan: Path | None) -> None:
    """UserError for a plan beside a path."""
    if plan is not None:
        raise UserError("--plan is for measurements at standstill, --path for data taken on the fly: give one of them")


def moving_summary(found: Calibration, taken: OnTheFly | None) -> dict[str, Any]:
    """What data taken on the fly add to the result for programs."""
    if taken is None:
        return {}
    from calibration.on_the_fly.planning.blind_mode import common_odd_mode

    reduction = taken.reduction
    return {
        "on_the_fly": {
            "readings": reduction.readings,
            "used": reduction.used,
            "left_out": {"corners": reduction.corners, "unsteady": reduction.unsteady, "astray": reduction.astray},
            "rows": reduction.rows,
            "cell_mm": reduction.cell_mm,
            "passes": reduction.passes,
            "feeds_mm_min": list(reduction.feeds),
            "length_m": reduction.length_m,
            "noise_correlation": reduction.correlation,
            "blind_mode": common_odd_mode(taken.measurement, found.fit.registration),
        }
    }


def show_moving(found: Calibration, taken: OnTheFly, to: Console) -> None:
    """What data taken on the fly add to the result for people."""
    from calibration.on_the_fly.planning.blind_mode import common_odd_mode

    to.print(f"on the fly   {taken.reduction}")
    blind = common_odd_mode(taken.measurement, found.fit.registration)
    if blind is not None:
        to.print(f"BLIND MODE   {blind}")
