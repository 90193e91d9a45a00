"""Tool tables: lengths by tool number, from a LinuxCNC `tool.tbl` or JSON."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec

from kinematics.errors import UserError
from kinematics.files import read_input

_LINUXCNC = re.compile(r"\s*T(?P<number>\d+)\b(?P<rest>[^;]*)", re.I)
_LENGTH = re.compile(r"\bZ\s*([+-]?(?:\d+\.?\d*|\.\d+))", re.I)


def read_tool_table(path: Path) -> dict[str, float]:
    """Tool lengths, mm, by number as text. UserError with the line that isn't understood."""
    data = read_input(path, "tool table")
    if path.suffix.lower() == ".json":
        try:
            return msgspec.json.decode(data, type=dict[str, float])
        except msgspec.DecodeError as fault:
            raise UserError(f'tool table {path}: {fault}; expected {{"1": 120.5, ...}}') from None
    lengths = {}
    for i, line in enumerate(data.decode("latin-1").splitlines(), start=1):
        content = line.split(";")[0].strip()
        if not content:
            continue
        match = _LINUXCNC.match(content)
        length = _LENGTH.search(content)
        if match is None or length is None:
            raise UserError(f"tool table {path}:{i}: {line.strip()!r} is no LinuxCNC tool entry (T1 P1 Z120.5)")
        lengths[str(int(match["number"]))] = float(length[1])
    return lengths
