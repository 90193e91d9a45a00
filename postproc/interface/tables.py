"""The public functions on compensation tables and kinematic parameters of controls."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, texts
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control_data.format import Format, Settings, Sign
    from postproc.control_data.parameters.export_parameters import ExportedParameters
    from postproc.control_data.tables.export_tables import Exported


@public
def export(
    machine: str | Path | Machine,
    format: str,
    calibration: str | Path | ErrorModel | None = None,
    *,
    sign: Literal["error", "correction"] | None = None,
    settings: Texts = (),
    tool_mm: Annotated[float, 0, None] = 0.0,
) -> Exported:
    """A calibration as the compensation tables of a control: `files` by name, and `rest`, the calibration without them.

    format: one of docs/tables.md; calibration: by default the machine's own; sign: `error` or `correction`, for formats
    whose sign no source states; settings: `NAME=VALUE` of the format; tool_mm: length of the tool, mm, for which the
    tables are made.

    UserError for an unknown format or setting, and for a calibration without errors that the tables can contain.

    >>> sorted(export("dmu50", "csv").files)[:1]
    ['errors.csv']
    """
    from postproc.control_data.formats import find_format
    from postproc.control_data.tables.table_format import TableFormat

    form = find_format(format, TableFormat)
    return form.export(*_for(form, machine, calibration, sign, settings, tool_mm))


@public
def export_parameters(
    machine: str | Path | Machine,
    format: str,
    calibration: str | Path | ErrorModel | None = None,
    *,
    sign: Literal["error", "correction"] | None = None,
    settings: Texts = (),
    tool_mm: Annotated[float, 0, None] = 0.0,
) -> ExportedParameters:
    """Location errors of rotary axes as the kinematic parameters of a control: `files` by name, `rest`, `changes`.

    format: one of docs/kinematic_parameters.md; the other arguments are those of `export`.

    UserError for an unknown format or setting, and for a machine whose kinematics the format does not have.

    >>> sorted(export_parameters("dmu50", "fanuc-kinematics").files)
    ['parameters.csv', 'parameters_before.csv']
    """
    from postproc.control_data.formats import find_format
    from postproc.control_data.parameters.parameter_format import ParameterFormat

    form = find_format(format, ParameterFormat)
    return form.export(*_for(form, machine, calibration, sign, settings, tool_mm))


def _for(
    form: Format,
    machine: str | Path | Machine,
    calibration: str | Path | ErrorModel | None,
    sign: str | None,
    settings: Texts,
    tool_mm: float,
) -> tuple[Machine, ErrorModel, Settings, Sign, tuple[float, float, float]]:
    """The arguments of an export to a format; the tool is the vector from the spindle nose to its tip, mm."""
    from machines.given import load_calibration, load_machine
    from postproc.control_data.format import parse_settings, sign_of

    found = load_machine(machine)
    chosen, meaning = parse_settings(form.settings, texts(settings)), sign_of(form, sign)
    return found, load_calibration(found, calibration), chosen, meaning, (0.0, 0.0, -tool_mm)


class Imported(NamedTuple):
    """The errors that the tables of a control compensate."""

    model: ErrorModel
    """The errors of the tables, or a calibration joined with them."""
    effects: tuple[Effect, ...]
    """The errors of the tables alone."""
    not_read: tuple[str, ...] = ()
    """Names of files of a folder without any of these tables."""
    unit_assumed: bool = False
    """True where nothing states the unit of the control, in which the tables are: their lengths are taken in mm."""


@public
def import_tables(
    files: str | Path | Iterable[str | Path],
    machine: str | Path | Machine,
    format: str,
    *,
    sign: Literal["error", "correction"] | None = None,
    settings: Texts = (),
    less_tables_from: str | Path | ErrorModel | None = None,
    with_tables_to: str | Path | ErrorModel | None = None,
) -> Imported:
    """The errors that the tables of a control compensate, from its files or a folder of them; `model` of the result.

    format, sign and settings as for `export` and `export_parameters`. less_tables_from: a calibration that was measured
    without the tables; `model` is that calibration less their errors, for programs. with_tables_to: one that was
    measured with the tables active; `model` is then that of the machine itself, for new tables.

    UserError with file and line of the first entry that cannot be used, and for files without tables of the format.
    """
    from machines.given import load_calibration, load_machine
    from postproc.control_data.format import Format, sign_of
    from postproc.control_data.formats import find_format
    from postproc.control_data.imported import imported_model, texts_in

    if less_tables_from is not None and with_tables_to is not None:
        raise UserError("--less-tables-from and --with-tables-to exclude each other: give one of them")
    paths = [Path(path) for path in ([files] if isinstance(files, (str, Path)) else files)]
    found, (contents, prints) = load_machine(machine), texts_in(paths)
    form = find_format(format, Format)  # type: ignore[type-abstract]
    searched = frozenset(contents) - {path.name for path in paths if not path.is_dir()}
    read = form.read_files(found, contents, sign_of(form, sign), texts(settings), searched)
    joined_to = less_tables_from if with_tables_to is None else with_tables_to
    base = None if joined_to is None else load_calibration(found, joined_to)
    factor = 1.0 if less_tables_from is None else -1.0
    model = imported_model(found, read.effects, base, factor, form.provenance, prints)
    return Imported(model, tuple(read.effects), read.not_read, read.unit_assumed)
