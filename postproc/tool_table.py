"""Tool tables: lengths by tool number from a LinuxCNC `tool.tbl`, or with work offsets from JSON."""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec

from kinematics.errors import UserError
from kinematics.files import read_input

_LINUXCNC = re.compile(r"\s*T(?P<number>\d+)\b(?P<rest>[^;]*)", re.I)
_LENGTH = re.compile(r"\bZ\s*([+-]?(?:\d+\.?\d*|\.\d+))", re.I)
_SIDEWAYS = re.compile(r"\b([XYABCUVW])\s*[+-]?[\d.]*[1-9]", re.I)


class ToolTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a table says of the set-up."""

    tools: dict[str, float] = {}
    """Lengths, mm, by number as text."""
    work_offsets: dict[str, dict[str, float]] = {}
    """By name and axis, mm or degrees."""


def read_tool_table(path: Path) -> ToolTable:
    """A table of tools; UserError with the line that isn't understood.

    JSON is `{"1": 120.5, ...}`, or `{"tools": {"1": 120.5}, "work_offsets": {"G54": {"X": 10, "C": 30}}}`.
    """
    data = read_input(path, "tool table")
    if path.suffix.lower() == ".json":
        return _from_json(data, path)
    lengths = {}
    for i, line in enumerate(data.decode("latin-1").splitlines(), start=1):
        content = line.split(";")[0].strip()
        if not content:
            continue
        match = _LINUXCNC.match(content)
        length = _LENGTH.search(content)
        if match is None or length is None:
            raise UserError(f"tool table {path}:{i}: {line.strip()!r} is no LinuxCNC tool entry (T1 P1 Z120.5)")
        sideways = _SIDEWAYS.search(content)
        if sideways is not None:
            raise UserError(f"tool table {path}:{i}: an offset in {sideways[1].upper()} is not corrected for")
        lengths[match["number"]] = float(length[1])
    return _checked(ToolTable(lengths), path)


def _from_json(data: bytes, path: Path) -> ToolTable:
    try:
        entries = msgspec.json.decode(data, type=dict[str, msgspec.Raw])
        if entries.keys() <= {"tools", "work_offsets"}:
            return _checked(msgspec.json.decode(data, type=ToolTable), path)
        return _checked(ToolTable(msgspec.json.decode(data, type=dict[str, float])), path)
    except msgspec.DecodeError as fault:
        raise UserError(f'tool table {path}: {fault}; expected {{"1": 120.5, ...}}') from None


def _checked(table: ToolTable, path: Path) -> ToolTable:
    """The table with its names as programs are read to write them; UserError for what could never be looked up."""
    for name, values in {"tools": table.tools, **table.work_offsets}.items():
        for key, value in values.items():
            if not math.isfinite(value):
                raise UserError(f"tool table {path}: {name}: {key}: {value} is not finite")
    for number in table.tools:
        if not number.isdecimal():
            raise UserError(f"tool table {path}: tool {number!r} is no number")
    tools = {str(int(number)): length for number, length in table.tools.items()}
    return ToolTable(tools, {"".join(name.split()).upper(): values for name, values in table.work_offsets.items()})
