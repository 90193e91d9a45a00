"""`ncomp export` and `ncomp import` with a format of kinematic parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import ncomp

if TYPE_CHECKING:
    from collections.abc import Mapping

    from kinematics.effects import Effect
    from kinematics.machine import Machine
    from postproc.commands.controls.export import TableOptions
    from postproc.commands.options.shared import ResultOptions
    from postproc.kinematic_parameters.export import ExportedParameters
    from postproc.kinematic_parameters.format import ParameterFormat
    from postproc.tables.not_representable import Unrepresented


def is_parameters(format: str) -> bool:
    """True for a format of kinematic parameters."""
    from postproc.kinematic_parameters.formats import FORMATS

    return format in FORMATS


def find_parameters(format: str) -> ParameterFormat:
    """The format of kinematic parameters of this name."""
    from postproc.kinematic_parameters.formats import FORMATS

    return FORMATS[format]


def write_parameters(
    machine: Machine,
    calibration: str | None,
    options: TableOptions,
    output: Path,
    tool_mm: float,
    probe: str | None,
    rest: Path | None,
    others: ResultOptions,
) -> None:
    """Write the folder, REST.json and the JSON results, and show the remaining errors."""
    from kinematics.error_model.model import encode_model
    from kinematics.files import whole_folder
    from postproc.commands.controls.control_files import encoded, show_export, write_probe
    from postproc.commands.options.shared import whole_results
    from postproc.kinematic_parameters.formats import FORMATS
    from postproc.kinematic_parameters.probe import probe as probe_files
    from postproc.kinematic_parameters.report import parameters_report
    from postproc.kinematic_parameters.sheet import sheet
    from postproc.tables.format import parse_settings

    form = FORMATS[options.format]
    if probe is not None:
        write_probe(output, probe_files(machine, probe, form, parse_settings(form.settings, options.settings)))
        return
    exported = ncomp.export_parameters(machine, model=calibration, tool_mm=tool_mm, **vars(options))
    left, volume = exported.left, exported.errors_in_the_volume()
    files = {**exported.files, "sheet.md": sheet(exported, left, volume)}
    report = parameters_report(exported, left, volume, f"{', '.join(files)} in {output}")
    written = whole_results(*others.files, None if rest is None else str(rest))
    with whole_folder(output, encoded(files)), written as (results, page, rest_file):
        others.write(
            _json(exported, left, volume, list(files)),
            report,
            (results, page),
            [] if calibration is None else [calibration],
        )
        rest_file.write(encode_model(exported.rest))
    last = f"{len(exported.files)} files and sheet.md in {output}; read sheet.md before setting any parameter"
    show_export(report, last, others)


def read_parameters(machine: Machine, options: TableOptions, files: Mapping[str, str]) -> list[Effect]:
    """The errors that the parameters in a control correct, against the machine file."""
    from kinematics.user_error import UserError
    from postproc.kinematic_parameters.as_errors import errors_of_lines
    from postproc.kinematic_parameters.formats import FORMATS
    from postproc.kinematic_parameters.lines import reflected
    from postproc.kinematic_parameters.plausible import refuse_far_lines
    from postproc.tables.export import sign_of
    from postproc.tables.format import parse_settings
    from postproc.tables.readers.source import Source

    form = FORMATS[options.format]
    chosen = parse_settings(form.settings, options.settings)
    form.freedoms(machine, chosen)
    sign = sign_of(form, options.sign)
    named = [name for name in files if not name.endswith(form.file_before)]
    if len(named) != 1:
        raise UserError(f"{form.name}: expected one file of parameters, found {', '.join(named) or 'none'}")
    settings = dict(text.partition("=")[::2] for text in options.settings)
    moved = form.read(Source(machine, files, sign, settings), named[0], machine)
    refuse_far_lines(machine, moved, named[0])
    return errors_of_lines(machine, moved if sign == "correction" else reflected(machine, moved))


def _json(
    exported: ExportedParameters, left: list[Unrepresented], volume: dict[str, Any], files: list[str]
) -> dict[str, Any]:
    shift = exported.best.frame
    before, after = exported.numbers
    return {
        "format": exported.format.name,
        "machine": exported.machine.name,
        "calibration": exported.whole.id,
        "demonstration": exported.whole.demonstration,
        "values_are": exported.sign,
        "sign_confirmed": exported.format.sign is not None,
        "tool_mm": -float(exported.tool[2]),
        "files": files,
        "parameters": [
            {"name": new.name, "before": float(old.text), "value": float(new.text), "unit": new.unit}
            for old, new in zip(before, after, strict=True)
        ],
        "lines": [
            {"line": each.freedom.name, "change": each.value, "u": each.u, "unit": each.freedom.unit}
            for each in exported.changes
        ],
        "work_offset_shift": {"mm": shift[:3].tolist(), "urad": (1e6 * shift[3:]).tolist()},
        "errors": {"volume": volume},
        "not_carried": [
            {"error": item.name, "rms_um": None if item.rms_um != item.rms_um else item.rms_um, "why": item.why}
            for item in left
        ],
    }
