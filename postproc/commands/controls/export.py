"""`ncomp export`: a calibration as the compensation tables of a control."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import ncomp
from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, option
from postproc.commands.options.program import SetUpOptions, moves_of
from postproc.commands.options.shared import CalibrationName, MachineName, ResultOptions, whole_results

if TYPE_CHECKING:
    from collections.abc import Iterable

    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.control_data.exported import ExportedData, Unrepresented
    from postproc.control_data.remaining_error import EvaluationPoints
    from postproc.control_data.tables.export_tables import Exported

FORMAT_LIST = (
    "Formats of tables: linuxcnc, siemens-eec, siemens-cec, heidenhain, heidenhain-kinematics, fanuc, isg, isg-cross, "
    "isg-volumetric, etalon, mitsubishi, klipper, reprap, marlin, grbl, linuxcnc-matrix, linuxcnc-calibxyz, csv "
    "(docs/tables.md). Of kinematic parameters: linuxcnc-kinematics, siemens-trafo5, siemens-tcarr, "
    "heidenhain-transformations, fanuc-kinematics (docs/kinematic_parameters.md).\n\n"
)
"""All formats, for the help."""
EPILOG = (
    f"{FORMAT_LIST}Examples:\n\n"
    "`ncomp export --machine gantry --calibration cal.json --format linuxcnc -o tables`\n\n"
    "`ncomp export --machine mill.toml -c cal.json --format siemens-cec --probe X -o probe`  writes a "
    "table that shows the sign of the values\n\n"
    "`ncomp export --machine mill.toml -c cal.json --format siemens-cec --sign error --set points=200 -o tables "
    "--rest rest.json --json -`"
)


def format_names() -> list[str]:
    """Names of the formats that can be written."""
    from postproc.control_data.formats import FORMATS

    return list(FORMATS)


def check_format(name: str) -> None:
    """UserError that lists all formats for one that is none of them."""
    if name not in format_names():
        raise UserError(
            f"--format {name}: expected one of {', '.join(format_names())}{did_you_mean(name, format_names())}"
        )


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Format and conventions of compensation tables."""

    PANEL: ClassVar[str] = "Tables"

    format: str = option(
        "Format of the tables or of the kinematic parameters, one of those below.",
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
    output: Path = option("New folder for the tables.", "DIR", "-o", default=REQUIRED, writes="folder"),
    calibration: CalibrationName,
    tool_mm: float = option("Length of the tool for which the tables are made, mm.", "mm", default=0.0, min=0.0),
    probe: str | None = option("Write only a probe table, which shows the sign of the values of this axis.", "AXIS"),
    rest: Path | None = option(
        "File for the calibration less the errors that the tables compensate.", "REST.json", writes="file"
    ),
    program: str | None = option(
        "Also show the errors along this program; `-` is standard input.", "IN.nc", reads=True
    ),
    set_up: SetUpOptions,
    others: ResultOptions,
) -> None:
    """Write a calibration as a control's tables or kinematic parameters, with a page on them and the remaining errors.

    Tables hold the part of the correction that is a function of quantities in the control, with the values and nodes
    that leave least volumetric error. A program is then corrected with REST.json, and no error is corrected twice.
    """
    from postproc.commands.controls.control_files import probe_command, write_probe
    from postproc.control_data.format import parse_settings, sign_of
    from postproc.control_data.formats import FORMATS

    inputs = (calibration, program, *set_up.tool_table)
    _check_folder(output)
    check_format(tables.format)
    found, form = ncomp.load_machine(machine), FORMATS[tables.format]
    if probe is not None and (tables.sign, rest, program, *others.files) != (None,) * 5:
        raise UserError("--probe excludes --sign, --rest, --program, --json and --report: it writes only a probe table")
    if program is not None and not form.ALONG_PROGRAMS:
        raise UserError("--program: errors along a program are shown for tables only")
    chosen = parse_settings(form.settings, tables.settings)
    if probe is not None:
        write_probe(output, form.probe(found, probe, chosen))
        return
    sign_of(form, tables.sign, probe_command(machine, found, form.name, rotary=form.ROTARY))
    model = ncomp.load_calibration(found, calibration)
    _write(_exported(found, model, tables, tool_mm, program, set_up), output, rest, inputs, others)


class _Result(NamedTuple):
    """The result of an export."""

    exported: ExportedData
    """The tables, or the kinematic parameters."""
    left: list[Unrepresented]
    """Errors that they cannot contain."""
    errors: dict[str, dict[str, Any]]
    """Remaining errors over the volume, and along a program."""


def _write(
    found: _Result, output: Path, rest: Path | None, inputs: Iterable[str | Path | None], others: ResultOptions
) -> None:
    """Write the files, their sheet, the calibration without their errors and the results, and show the report."""
    from kinematics.error_model.model import encode_model
    from kinematics.files import whole_folder
    from postproc.commands.controls.control_files import encoded, show_export
    from postproc.commands.controls.export_json import export_json
    from postproc.control_data.export_report import export_report
    from postproc.control_data.sheet import sheet

    exported, left, errors = found
    files = {**exported.files, "sheet.md": sheet(exported, left, errors["volume"])}
    report = export_report(exported, left, errors, str(output), list(files))
    written = whole_results(*others.files, None if rest is None else str(rest))
    with whole_folder(output, encoded(files)), written as (results, page, rest_file):
        others.write(export_json(exported, left, errors, list(files)), report, (results, page), inputs)
        rest_file.write(encode_model(exported.rest))
    last = f"{len(exported.files)} files and sheet.md in {output}; read sheet.md before {exported.format.LOADED}"
    show_export(report, last, others)


def _exported(
    machine: Machine,
    model: ErrorModel,
    tables: TableOptions,
    tool_mm: float,
    program: str | None,
    set_up: SetUpOptions,
) -> _Result:
    """The data of a control for a machine, and what they leave."""
    from postproc.commands.show.terminal import console
    from postproc.control_data.formats import FORMATS
    from postproc.control_data.tables.export_tables import Exported

    steps, kind = (3 if program is None else 5), FORMATS[tables.format].KIND
    export = ncomp.export if kind == "tables" else ncomp.export_parameters
    with console.status(f"1 of {steps}: {kind}") as status:
        exported = export(machine, calibration=model, tool_mm=tool_mm, **vars(tables))
        status.update(f"2 of {steps}: errors that the {kind} cannot hold")
        left = exported.left
        status.update(f"3 of {steps}: remaining errors over the volume")
        errors = {"volume": exported.errors_in_the_volume()}
        if program is not None and isinstance(exported, Exported):
            status.update(f"4 of {steps}: reading {program}")
            points = _points(program, exported, set_up.setup(machine), set_up.dialect)
            status.update(f"5 of {steps}: remaining errors along the program")
            errors["program"] = exported.errors_at(points)
    return _Result(exported, left, errors)


def _check_folder(output: Path) -> None:
    """UserError when the folder cannot be made, before any work."""
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise UserError(f"cannot write {output}: expected a new or empty folder")
    if not output.parent.is_dir():
        raise UserError(f"cannot write {output}: its parent is not a folder")


def _points(program: str, exported: Exported, setup: Setup, dialect: str) -> EvaluationPoints:
    from postproc.control_data.remaining_error import program_points

    motions = moves_of(program, exported.target.machine, setup, dialect)
    points = program_points(motions, exported.target.model)
    if not len(points.q):
        raise UserError(
            f"{program}: no move has known positions of all axes: the errors along the program cannot be evaluated"
        )
    return points
