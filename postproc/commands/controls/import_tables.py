"""`ncomp import`: compensation tables of a control as an error model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import ncomp
from kinematics.user_error import UserError
from postproc.commands.controls.export import TableOptions, check_format
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.shared import MachineName, check_files

if TYPE_CHECKING:
    from collections.abc import Iterable

    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n"
    "`ncomp import machine.ini comp_x.txt comp_y.txt --machine gantry --format linuxcnc -o in_control.json`\n\n"
    "`ncomp import tables --machine mill.toml --format siemens-cec --sign error --less-tables-from cal.json "
    "-o rest.json`"
)


def import_tables(
    *,
    files: tuple[Path, ...] = argument("Tables, or folders with tables.", "FILES"),
    machine: MachineName,
    tables: TableOptions,
    output: Path = option("File for the error model.", "OUT.json", "-o", default=REQUIRED),
    less_tables_from: Path | None = option(
        "Calibration without the tables: write it less the errors that the tables compensate.", "CAL.json"
    ),
    with_tables_to: Path | None = option(
        "Calibration measured with the tables active: write the errors of the machine without the tables.", "CAL.json"
    ),
) -> None:
    """Read a control's tables as the errors that they compensate.

    A calibration measured without the tables, less their errors, leaves the errors for programs to correct. A
    calibration measured with the tables active, plus their errors, is that of the machine itself, for new tables.
    """
    from kinematics.error_model.model import read_model, write_model
    from postproc.commands.controls.export_parameters import is_parameters, read_parameters
    from postproc.commands.show.terminal import say
    from postproc.tables.export import sign_of
    from postproc.tables.format import parse_settings
    from postproc.tables.formats import find_format
    from postproc.tables.readers import read_tables
    from postproc.tables.readers.source import Source

    if less_tables_from is not None and with_tables_to is not None:
        raise UserError("--less-tables-from and --with-tables-to exclude each other: give one of them")
    check_files((*files, less_tables_from, with_tables_to), {"--output": output})
    check_format(tables.format)
    found = ncomp.load_machine(machine)
    texts, prints = _texts(files)
    if is_parameters(tables.format):
        title, effects = tables.format, read_parameters(found, tables, texts)
    else:
        form = find_format(tables.format)
        parse_settings(form.settings, tables.settings)
        settings = dict(text.partition("=")[::2] for text in tables.settings)
        title, effects = (
            form.title,
            read_tables(tables.format, Source(found, texts, sign_of(form, tables.sign), settings)),
        )
    joined_to = less_tables_from or with_tables_to
    base = None if joined_to is None else read_model(joined_to, found)
    write_model(_model(found, effects, base, -1.0 if less_tables_from else 1.0, title, prints), output)
    say("read", ", ".join(effect.name for effect in effects))


def _texts(paths: Iterable[Path]) -> tuple[dict[str, str], dict[str, str]]:
    """Texts and fingerprints by file name; for a folder, of all its files except sheets (.md)."""
    from kinematics.files import fingerprint, read_input

    files = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    texts, prints = {}, {}
    for file in files:
        if file.suffix == ".md" or file.is_dir():
            continue
        data = read_input(file, "tables")
        if file.name in texts:
            raise UserError(f"{file}: two files have this name; give them different names")
        texts[file.name] = _decoded(data, file)
        prints[file.name] = fingerprint(data)
    return texts, prints


def _decoded(data: bytes, file: Path) -> str:
    """The text of a file with or without a byte order mark; UserError for a binary file."""
    import codecs

    from kinematics.files.mistaken import kind_of_file

    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    if b"\0" in data:
        if data[1::2].count(0) > len(data) // 3:
            raise UserError(f"tables {file}: this is UTF-16 without a byte order mark: save it as plain text (UTF-8)")
        found = kind_of_file(data) or "a file with zero bytes"
        raise UserError(f"tables {file}: expected a text file, found {found}: give the files of the control")
    return data.removeprefix(codecs.BOM_UTF8).decode("latin-1")


def _model(
    machine: Machine, effects: list[Effect], base: ErrorModel | None, sign: float, title: str, prints: dict[str, str]
) -> ErrorModel:
    """The tables as an error model, or `sign` times the tables joined to the model `base`."""
    import datetime

    import msgspec

    from kinematics.error_model.model import ErrorModel, Provenance, reference
    from postproc.tables.table_model import joined

    if base is None:
        made = Provenance("ncomp import", datetime.datetime.now(datetime.UTC), title, prints)
        return ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects))
    model = joined(base, effects, sign)
    source = f"{base.provenance.source}; {'with' if sign > 0 else 'less'} {title}".removeprefix("; ")
    made = msgspec.structs.replace(base.provenance, source=source, inputs=base.provenance.inputs | prints)
    return msgspec.structs.replace(model, provenance=made)
