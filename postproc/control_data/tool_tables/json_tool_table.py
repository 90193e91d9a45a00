"""Tool tables in JSON: `{"1": 120.5, ...}`, or `{"tools": {"1": 120.5}, "work_offsets": {"G54": {"X": 10}}}`."""

from __future__ import annotations

from pathlib import Path

import msgspec

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable, is_number
from postproc.control_data.tool_tables.form import Form


class _Whole(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    tools: dict[str, float] = {}
    work_offsets: dict[str, dict[str, float]] = {}
    radii: dict[str, float] = {}
    datums: dict[str, dict[str, float]] = {}


def read(path: Path, text: str) -> ToolTable:
    """The table; UserError for JSON of another form."""
    try:
        entries = msgspec.json.decode(text, type=dict[str, msgspec.Raw])
        if entries.keys() <= {*_Whole.__struct_fields__}:
            whole = msgspec.json.decode(text, type=_Whole)
        else:
            whole = _Whole(msgspec.json.decode(text, type=dict[str, float]))
    except msgspec.DecodeError as fault:
        raise UserError(f'tool table {path}: {fault}; expected {{"1": 120.5, ...}}') from None
    for number in (*whole.tools, *whole.radii):
        if not is_number(number):
            raise UserError(f"tool table {path}: tool {number!r} is not a number")
    return ToolTable(whole.tools, whole.work_offsets, whole.radii, whole.datums)


FORM = Form(lambda path, _: path.suffix.lower() == ".json", read, has_unit=lambda _: True)
