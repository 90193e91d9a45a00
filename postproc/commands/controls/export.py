"""`ncomp export`: a calibration as the compensation tables of a control."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import ncomp
from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, option
from postproc.commands.options.program import SetUpOptions, moves_of
from postproc.commands.options.shared import (
    CalibrationName,
    MachineName,
    ResultOptions,
    check_files,
    whole_results,
)

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.tables.export import Exported
    from postproc.tables.not_representable import Unrepresented
    from postproc.tables.remaining_error import EvaluationPoints

EPILOG = (
    "Examples:\n\n"
    "`ncomp export --machine gantry --calibration cal.json --format linuxcnc -o tables`\n\n"
    "`ncomp export --machine mill.toml -c cal.json --format siemens-cec --probe X -o probe`  writes a "
    "table that shows the sign of the values\n\n"
    "`ncomp export --machine mill.toml -c cal.json --format siemens-cec --sign error --set points=200 -o tables "
    "--rest rest.json --json -`"
)


def format_names() -> list[str]:
    """Names of the formats that can be written."""
    from postproc.kinematic_parameters.formats import FORMATS as PARAMETERS
    from postproc.tables.formats import FORMATS

    return [*FORMATS, *PARAMETERS]


def check_format(name: str) -> None:
    """UserError that lists all formats for one that is none of them."""
    if name not in format_names():
        raise UserError(
            f"--format {name}: expected one of {', '.join(format_names())}{did_you_mean(name, format_names())}"
        )


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Format and conventions of compensation tables."""

    format: str = option(
        "Format of the tables (docs/tables.md), or of the kinematic parameters (docs/kinematic_parameters.md).",
        default=REQUIRED,
        complete=format_names,
    )
    sign: Literal["error", "correction"] | None = option(
        "Meaning of the values, for a format whose sign no source states: errors of the machine, or their correction."
    )
    settings: tuple[str, ...] = option("Setting of the control that the format needs.", "NAME=VALUE", "--set")


def export(
    *,
    machine: MachineName,
    tables: TableOptions,
    output: Path = option("New folder for the tables.", "DIR", "-o", default=REQUIRED),
    calibration: CalibrationName,
    tool_mm: float = option("Length of the tool for which the tables are made, mm.", "mm", default=0.0, min=0.0),
    probe: str | None = option("Write only a probe table, which shows the sign of the values of this axis.", "AXIS"),
    rest: Path | None = option("File for the calibration less the errors that the tables compensate.", "REST.json"),
    program: str | None = option("Also show the errors along this program; `-` is standard input.", "IN.nc"),
    set_up: SetUpOptions,
    others: ResultOptions,
) -> None:
    """Write a calibration as a control's tables or kinematic parameters, with a page on them and the remaining errors.

    Tables hold the part of the correction that is a function of quantities in the control, with the values and nodes
    that leave least volumetric error. A program is then corrected with REST.json, and no error is corrected twice.
    """
    from kinematics.error_model.model import encode_model
    from kinematics.files import whole_folder
    from postproc.commands.controls.control_files import encoded, probe_command, show_export, write_probe
    from postproc.commands.controls.export_parameters import find_parameters, is_parameters, write_parameters
    from postproc.tables.export import sign_of
    from postproc.tables.format import parse_settings
    from postproc.tables.formats import find_format
    from postproc.tables.probe import probe as probe_files
    from postproc.tables.report import export_report
    from postproc.tables.sheet import sheet

    inputs = check_files((calibration, program, *set_up.tool_table), {"--rest": rest, **others.by_option})
    _check_folder(output)
    check_format(tables.format)
    found = ncomp.load_machine(machine)
    if probe is not None and (tables.sign, rest, program, *others.files) != (None,) * 5:
        raise UserError("--probe excludes --sign, --rest, --program, --json and --report: it writes only a probe table")
    if is_parameters(tables.format):
        if program is not None:
            raise UserError("--program: errors along a program are shown for tables only")
        if probe is None:
            shown = probe_command(machine, found, tables.format, rotary=True)
            sign_of(find_parameters(tables.format), tables.sign, shown)
        write_parameters(found, calibration, tables, output, tool_mm, probe, rest, others)
        return
    form = find_format(tables.format)
    chosen = parse_settings(form.settings, tables.settings)
    if probe is not None:
        write_probe(output, probe_files(found, probe, form, chosen))
        return
    sign_of(form, tables.sign, probe_command(machine, found, form.name, rotary=False))
    model = ncomp.load_calibration(found, calibration)
    exported, left, errors = _exported(found, model, tables, tool_mm, program, set_up)
    files = {**exported.files, "sheet.md": sheet(exported, left, errors["volume"])}
    report = export_report(exported, left, errors, str(output), list(files))
    written = whole_results(*others.files, None if rest is None else str(rest))
    with whole_folder(output, encoded(files)), written as (results, page, rest_file):
        others.write(_json(exported, left, errors, list(files)), report, (results, page), inputs)
        rest_file.write(encode_model(exported.rest))
    last = f"{len(exported.files)} files and sheet.md in {output}; read sheet.md before loading the tables"
    show_export(report, last, others)


def _exported(
    machine: Machine,
    model: ErrorModel,
    tables: TableOptions,
    tool_mm: float,
    program: str | None,
    set_up: SetUpOptions,
) -> tuple[Exported, list[Unrepresented], dict[str, dict[str, Any]]]:
    """The tables, the errors that they cannot hold, and the remaining errors over the volume and along a program."""
    from postproc.commands.show.terminal import console

    steps = 3 if program is None else 5
    with console.status(f"1 of {steps}: tables") as status:
        exported = ncomp.export(machine, model=model, tool_mm=tool_mm, **vars(tables))
        status.update(f"2 of {steps}: errors that the tables cannot hold")
        left = exported.left
        status.update(f"3 of {steps}: remaining errors over the volume")
        errors = {"volume": exported.errors_in_the_volume()}
        if program is not None:
            status.update(f"4 of {steps}: reading {program}")
            points = _points(program, exported, set_up.setup(machine), set_up.dialect)
            status.update(f"5 of {steps}: remaining errors along the program")
            errors["program"] = exported.errors_at(points)
    return exported, left, errors


def _check_folder(output: Path) -> None:
    """UserError when the folder cannot be made, before any work."""
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise UserError(f"cannot write {output}: expected a new or empty folder")
    if not output.parent.is_dir():
        raise UserError(f"cannot write {output}: its parent is not a folder")


def _points(program: str, exported: Exported, setup: Setup, dialect: str) -> EvaluationPoints:
    from postproc.tables.remaining_error import program_points

    motions = moves_of(program, exported.target.machine, setup, dialect)
    points = program_points(motions, exported.target.model)
    if not len(points.q):
        raise UserError(
            f"{program}: no move has known positions of all axes: the errors along the program cannot be evaluated"
        )
    return points


def _json(exported: Exported, left: list[Unrepresented], errors: dict[str, Any], files: list[str]) -> dict[str, Any]:
    from postproc.tables.sheet import table_rows

    content = exported.content
    return {
        "format": exported.format.name,
        "machine": exported.target.machine.name,
        "calibration": exported.whole.id,
        "demonstration": exported.whole.demonstration,
        "values_are": content.sign,
        "sign_confirmed": exported.format.sign is not None,
        "tool_mm": -float(exported.target.tool[2]),
        "files": files,
        "tables": [row._asdict() for row in table_rows(exported)],
        "errors": errors,
        "not_carried": [
            {"error": item.name, "rms_um": None if item.rms_um != item.rms_um else item.rms_um, "why": item.why}
            for item in left
        ],
        "not_carried_orientation_urad": errors["volume"]["tool_axis_urad"]["after_tables"],
        "datum_shift": {axis: round(value, 7) for axis, value in exported.datum.items()},
    }
