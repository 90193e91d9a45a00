"""HEIDENHAIN's tables, text in columns of fixed width: tools (`TOOL.T`), presets (`PRESET.PR`), datums (`*.D`).

    BEGIN TOOL    .T       MM
    T    NAME             L          R          DL      DR      TL RT  TIME1 TIME2 CUR.TIME DOC
    5    MILL_D14         +120,686   +7,000     +0,000  +0,000         0     0     0
    [END]

A column begins where its name does in the line of names and ends where the next one begins. Numbers have a point or a
comma; an empty field is 0.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable
from postproc.control_data.tool_tables.form import Form

_BEGIN = re.compile(r"\s*BEGIN\b.*\.(T|PR|D)\s+(MM|INCH)\b", re.I)
_KEYS = {"T": ("T",), "PR": ("NO", "NR", "NUM"), "D": ("D", "NO", "NR")}
_END = "[END]"
_AXES = "XYZABCUVW"
_INCH = 25.4


@dataclass(frozen=True)
class _Line:
    """A line of a table, by columns."""

    path: Path
    number: int
    fields: dict[str, str]
    unit: float
    """mm per unit of its lengths."""

    def value(self, column: str, unit: float = 1.0) -> float:
        """The number in a column, in mm or degrees; 0 where there is none."""
        text = self.fields.get(column, "")
        try:
            return float(text.replace(",", ".").replace("+ ", "+").replace("- ", "-") or 0.0) * unit
        except ValueError:
            raise UserError(f"tool table {self.path}:{self.number}: {column}: {text!r} is not a number") from None

    def length(self, column: str) -> float:
        """A length in a column, mm."""
        return self.value(column, self.unit)

    def positions(self) -> dict[str, float]:
        """The values of the columns named for axes, mm or degrees."""
        return {axis: self.value(axis, 1.0 if axis in "ABC" else self.unit) for axis in _AXES if self.fields.get(axis)}


def read(path: Path, text: str) -> ToolTable:
    """The table; UserError with the line that is not understood."""
    match = _BEGIN.match(text)
    assert match is not None
    kind, unit = match[1].upper(), _INCH if match[2].upper() == "INCH" else 1.0
    lines = dict(_lines(path, text.splitlines(), _KEYS[kind], unit))
    if kind == "T":
        return _tools(lines)
    positions = {key: line.positions() for key, line in lines.items()}
    if kind == "D":
        return ToolTable(datums=positions)
    turns = {key: _turn(line) for key, line in lines.items()}
    return ToolTable(work_offsets=positions, turned={key: turn for key, turn in turns.items() if any(turn)})


def _turn(line: _Line) -> tuple[float, float, float]:
    if "ROT" in line.fields:
        return 0.0, 0.0, line.value("ROT")
    return line.value("SPA"), line.value("SPB"), line.value("SPC")


def _tools(lines: dict[str, _Line]) -> ToolTable:
    lengths, radii = {}, {}
    names: dict[str, list[str]] = {}
    for key, line in lines.items():
        lengths[key] = line.length("L") + line.length("DL")
        radii[key] = line.length("R") + line.length("DR")
        name = line.fields.get("NAME", "").upper()
        if name:
            names.setdefault(name, []).append(key)
    for name, keys in names.items():
        # several tools of one name: the control takes the one that is free, which is not known here
        if len({(lengths[key], radii[key]) for key in keys}) == 1 and not name.isdecimal():
            lengths[name], radii[name] = lengths[keys[0]], radii[keys[0]]
    return ToolTable(lengths, radii=radii)


def _lines(path: Path, lines: list[str], keys: tuple[str, ...], unit: float) -> Iterator[tuple[str, _Line]]:
    """The lines after the names of columns, each with its number."""
    columns: list[tuple[str, int, int | None]] = []
    done = set()
    for number, line in enumerate(lines, start=1):
        if not columns:
            columns = _columns(line, keys)
            continue
        if line.strip().upper() == _END:
            return
        if not line.strip("\0\x1a \t"):
            continue
        fields = {name: line[start:end].strip() for name, start, end in columns}
        key = fields[columns[0][0]]
        if not re.fullmatch(r"\d+(\.\d+)?", key):
            raise UserError(
                f"tool table {path}:{number}: {key!r} in column {columns[0][0]} is not the number of a line"
            )
        if key in done:
            raise UserError(f"tool table {path}:{number}: {key} is in the table twice: delete one line")
        done.add(key)
        yield key, _Line(path, number, fields, unit)
    if not columns:
        raise UserError(f"tool table {path}: expected a line with the names of the columns, {' or '.join(keys)} first")


def _columns(line: str, keys: tuple[str, ...]) -> list[tuple[str, int, int | None]]:
    """Name, start and end of the columns that a line names, none where it is no such line."""
    found = [(match[0].upper(), match.start()) for match in re.finditer(r"\S+", line)]
    if len(found) < 2 or found[0][0] not in keys:
        return []
    ends: list[int | None] = [start for _, start in found[1:]]
    return [(name, start, end) for (name, start), end in zip(found, [*ends, None], strict=True)]


FORM = Form(lambda _, text: _BEGIN.match(text) is not None, read, has_unit=lambda _: True)
