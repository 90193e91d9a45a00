"""Tables of tools, work offsets and datums as controls write them, one module for each control's form."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path

from kinematics.files import read_input
from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control.tool_table import ToolTable, checked, joined
from postproc.control_data.tool_tables.form import Form

FORMS = tuple(f"{name}_tool_table" for name in ("json", "heidenhain", "siemens", "fanuc", "grbl", "linuxcnc"))
"""The modules, tried in this order; each is imported when it is tried."""

__all__ = ["ToolTable", "read_tool_table", "read_tool_tables"]


def read_tool_table(path: Path, unit: str = "") -> ToolTable:
    """A table of any form; UserError with the line that is not understood.

    unit: `mm` or `inch`, of a table that contains none; without it its lengths are taken in mm, and its entries marked.
    """
    data = read_input(path, "tool table")
    if b"\0" in data:
        raise UserError(f"tool table {path} is a binary file, as of a spreadsheet: export it as text")
    text = data.decode("latin-1").removeprefix("\xef\xbb\xbf")
    forms: Iterator[Form] = (import_module(f".{name}", __package__).FORM for name in FORMS)
    form = next(form for form in forms if form.is_it(path, text))
    table = checked(form.read(path, text), path)
    if form.has_unit(text):
        return table
    return table.in_unit(UNIT_NAMES[unit]) if unit else table.marked(path)


def read_tool_tables(paths: Iterable[Path], unit: str = "") -> ToolTable:
    """Several tables as one, unit as of `read_tool_table`; UserError for an entry that two of them have."""
    tables: dict[Path, ToolTable] = {}
    for path in paths:
        if path in tables:
            raise UserError(f"--tool-table {path} is given twice: give it once")
        tables[path] = read_tool_table(path, unit)
    return joined(tables)
