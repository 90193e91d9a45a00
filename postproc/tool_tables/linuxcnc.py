"""LinuxCNC's `tool.tbl`: `T1 P1 D10 Z120.5 ;mill`, lengths in the unit of the machine (its INI file, LINEAR_UNITS)."""

from __future__ import annotations

import re
from pathlib import Path

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable

FORM = "LinuxCNC's tool.tbl: T1 P1 D10 Z120.5"
_ENTRY = re.compile(r"\s*T(?P<number>\d+)\b(?P<rest>[^;]*)", re.I)
_NUMBER = r"([+-]?(?:\d+\.?\d*|\.\d+))"
_LENGTH = re.compile(rf"\bZ\s*{_NUMBER}", re.I)
_DIAMETER = re.compile(rf"\bD\s*{_NUMBER}", re.I)
_WORDS = re.compile(rf"(?:[TPXYZABCUVWDIJQ]\s*{_NUMBER}\s*)+", re.I)
_SIDEWAYS = re.compile(r"\b([XYABCUVW])\s*[+-]?[\d.]*[1-9]", re.I)


def is_it(_: Path, __: str) -> bool:
    """True: a table of no other form is read as this one."""
    return True


def contains_unit(_: str) -> bool:
    """False: the unit is that of the machine's INI file."""
    return False


def read(path: Path, text: str) -> ToolTable:
    """Lengths and radii; UserError with the line that is not understood, or has an offset sideways."""
    lengths, radii = {}, {}
    for i, line in enumerate(text.splitlines(), start=1):
        content = line.split(";")[0].strip()
        if not content:
            continue
        match = _ENTRY.match(content)
        length = _LENGTH.search(content)
        if match is None or length is None or not _WORDS.fullmatch(content):
            comma = "; write the decimal point as '.'" if re.search(r"\d,\d", content) else ""
            raise UserError(
                f"tool table {path}:{i}: {line.strip()!r} is not a tool entry of LinuxCNC; expected T1 P1 Z120.5{comma}"
            )
        sideways = _SIDEWAYS.search(content)
        if sideways is not None:
            raise UserError(
                f"tool table {path}:{i}: an offset in {sideways[1].upper()} is not supported: expected Z and D only"
            )
        if match["number"] in lengths:
            raise UserError(f"tool table {path}:{i}: T{match['number']} is in the table twice: delete one line")
        lengths[match["number"]] = float(length[1])
        diameter = _DIAMETER.search(content)
        if diameter is not None:
            radii[match["number"]] = float(diameter[1]) / 2.0
    return ToolTable(lengths, radii=radii)
