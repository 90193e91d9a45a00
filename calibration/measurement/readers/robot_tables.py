"""Tables of a robot: measured points, and the joint angles at which they were measured, in one file or in two.

    point;x [mm];y [mm];z [mm]               point;J1 [deg];J2 [deg];J3 [deg];J4 [deg];J5 [deg];J6 [deg]
    P1;1893,2211;-512,8420;1104,3310         P1;10,000;-45,500;30,250;0,000;60,000;-90,000

The file with x, y, z is the measurement; the file with the joints is the plan. Rows are joined by the names in a column
`point` (name, id, pose) that both have, otherwise by their order. A joint is named as the axis of the machine, or J1,
Joint 1, q1, theta1, axis 1 by its position in the chain; `actual_J1`, `J1 actual` or `J1 measured` is its read-back.
Units are in brackets or behind an underscore; without one they are mm and deg, with a note. Cells are separated by
semicolons, tabs, commas or blanks; with the former two a decimal comma is also read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.measurement.readers.text import given_entries
from calibration.measurement.text_table import Table, table_of
from kinematics.files import fingerprint, read_input
from kinematics.files.text_cells import ANGLES, LENGTHS, number_at, numbered_lines, unit_size
from kinematics.machine import Machine
from kinematics.user_error import UserError

POINTS = ("x", "y", "z")
_NAMED = re.compile(r"(?:point|name|id|pose|point name|point id|pose id)", re.I)
_UNIT = re.compile(
    r"(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\)|_(?P<behind>mm|m|um|deg|rad))\s*", re.I
)
_JOINT = re.compile(r"(?:j|joint|q|theta|axis|a)[ _]?(?P<number>\d)", re.I)
_MARK = "(?:actual|act|measured|readback)"
_ACTUAL = re.compile(rf"{_MARK}[ _](?P<before>.+)|(?P<behind>.+)[ _]{_MARK}", re.I)
_OTHERS = ("time_s", "target", "station", "run")
_SPELLED = {"°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad"}


@dataclass(frozen=True)
class _Text:
    """The cells of one table."""

    source: str
    line: int
    """Line of the names."""
    names: Sequence[str]
    rows: Sequence[Sequence[str]]
    lines: Sequence[int]
    decimal_comma: bool
    """True where a decimal comma is also read."""

    def column(self, number: int) -> list[str]:
        """The cells of a column."""
        return [row[number] for row in self.rows]


def recognises(head: str) -> bool:
    """True for the beginning of a table with the columns x, y and z of points, and of joints or names only."""
    lines = [line for line in head.splitlines() if line.strip()]
    if not lines or lines[0].lstrip().startswith("#"):
        return False
    names = [_parted(cell)[0] for cell in _cells(lines[0], _delimiter(lines[0]))]
    lower = [name.lower() for name in names]
    others = [name for name in names if name.lower() not in (*POINTS, *_OTHERS)]
    joints = [name for name in others if not _NAMED.fullmatch(name)]
    return all(lower.count(letter) == 1 for letter in POINTS) and all(_JOINT.fullmatch(_bare(name)) for name in joints)


def to_table(
    data: bytes, source: str, machine: Machine, header: Mapping[str, str], plan: Path | None
) -> tuple[Table, list[str]]:
    """The measurement as a table of the contract's columns, and notes; `plan`: the file with the joints, or None."""
    notes: list[str] = []
    points = _text(data, source)
    columns = _columns(points, machine, notes)
    if plan is None and not any(name in columns for name in machine.names):
        raise UserError(
            f"{source}: no column has joints of {machine.name} ({machine.chain}): state their table, --plan"
        )
    if plan is not None:
        joints = _text(read_input(plan, "table of joints"), str(plan))
        own = _columns(joints, machine, notes)
        rows = _joined(points, columns, joints, own, notes)
        twice = sorted((set(own) & set(columns)) - {"point"})
        if twice:
            raise UserError(f"{joints.source}:{joints.line} column {', '.join(twice)} is in {source} too")
        columns = {**{name: [cells[row] for row in rows] for name, cells in own.items()}, **columns}
    missing = [name for name in machine.names if name not in columns]
    if missing:
        raise UserError(
            f"{plan or source}: no column of {', '.join(missing)}; joints are named by axis, or J1, J2, ..."
        )
    entries = given_entries(header, {"instrument": "laser-tracker"})
    return table_of(source, fingerprint(data), entries, columns, points.lines), notes


def _text(data: bytes, source: str) -> _Text:
    lines = [(number, line) for number, line in numbered_lines(data) if line.strip()]
    number, first = lines[0]
    delimiter = _delimiter(first)
    names = _cells(first, delimiter)
    rows = [_cells(line, delimiter) for _, line in lines[1:]]
    for (at, _), row in zip(lines[1:], rows, strict=True):
        if len(row) != len(names):
            raise UserError(f"{source}:{at}: {len(row)} cells, but {len(names)} columns have names")
    return _Text(source, number, names, rows, [at for at, _ in lines[1:]], delimiter in (";", "\t"))


def _columns(text: _Text, machine: Machine, notes: list[str]) -> dict[str, list[str]]:
    """The cells by the contract's columns, in its units; UserError for a column that is not known."""
    found: dict[str, list[str]] = {}
    assumed: dict[str, list[str]] = {}
    for i, cell in enumerate(text.names):
        where, (name, unit) = f"{text.source}:{text.line} column {cell}", _parted(cell)
        column = _column(name, machine)
        if column is None:
            raise UserError(
                f"{where}: not known; known are x, y, z, point, {', '.join(machine.names)} or J1, J2, ..., their read-"
                f"back as actual_J1, and {', '.join(_OTHERS)}"
            )
        if column in found:
            raise UserError(f"{where}: the table has another column of {column}")
        found[column] = text.column(i)
        axis = column.removeprefix("actual_")
        if column not in POINTS and axis not in machine.names:
            continue
        turns = axis in machine.names and machine.axes[machine.index(axis)].rotary
        units = ANGLES if turns else LENGTHS
        if not unit:
            assumed.setdefault("deg" if turns else "mm", []).append(cell)
        size = unit_size(units, _SPELLED.get(unit, unit), where) if unit else 1.0
        found[column] = [
            repr(size * number_at(value, f"{text.source}:{line} column {cell}", _decimal(text, value)))
            for value, line in zip(found[column], text.lines, strict=True)
        ]
    notes += [f"{text.source}: no unit of {', '.join(names)}: taken in {unit}" for unit, names in assumed.items()]
    return found


def _column(name: str, machine: Machine) -> str | None:
    """The contract's column of a name; None for an unknown name."""
    if name.lower() in (*POINTS, *_OTHERS):
        return name.lower()
    if _NAMED.fullmatch(name):
        return "point"
    bare = _bare(name)
    joint = _JOINT.fullmatch(bare)
    if bare in machine.names:
        axis = bare
    elif joint and 0 < int(joint["number"]) <= len(machine.names):
        axis = machine.names[int(joint["number"]) - 1]
    else:
        return None
    return axis if bare == name else f"actual_{axis}"


def _joined(
    points: _Text,
    columns: Mapping[str, list[str]],
    joints: _Text,
    own: Mapping[str, list[str]],
    notes: list[str],
) -> list[int]:
    """Row of the table of joints for each row of points: by name where both have names, otherwise by order."""
    if "point" not in columns or "point" not in own:
        if len(points.rows) != len(joints.rows):
            raise UserError(
                f"{points.source} has {len(points.rows)} rows, {joints.source} {len(joints.rows)}: tables of different "
                "lengths need a column of names, point, in both"
            )
        notes.append(f"{points.source} and {joints.source} are joined row by row")
        return list(range(len(points.rows)))
    rows: dict[str, int] = {}
    for i, name in enumerate(own["point"]):
        if name in rows:
            raise UserError(f"{joints.source}:{joints.lines[i]}: point {name!r} occurs twice")
        rows[name] = i
    for name, line in zip(columns["point"], points.lines, strict=True):
        if name not in rows:
            raise UserError(f"{points.source}:{line}: point {name!r} is not in {joints.source}")
    unused = len(rows) - len(set(columns["point"]))
    notes.append(
        f"{points.source} and {joints.source} are joined by the names of points"
        + (f"; {unused} of {len(rows)} were not measured" if unused else "")
    )
    return [rows[name] for name in columns["point"]]


def _bare(name: str) -> str:
    """The name of a joint without the mark of a read-back."""
    found = _ACTUAL.fullmatch(name)
    return (found["before"] or found["behind"]) if found else name


def _parted(cell: str) -> tuple[str, str]:
    """Name of a column, and its unit; empty without one."""
    found = None if cell.lower() in _OTHERS else _UNIT.fullmatch(cell)
    return (
        (found["name"], (found["square"] or found["round"] or found["behind"] or "").strip()) if found else (cell, "")
    )


def _decimal(text: _Text, cell: str) -> str:
    return "," if text.decimal_comma and "," in cell else "."


def _delimiter(line: str) -> str | None:
    """The separator of cells; None for blanks."""
    return next((each for each in (";", "\t", ",") if each in line), None)


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return re.sub(r"\s+(?=[\[(])", "", line).split()
    return [cell.strip().strip('"') for cell in line.split(delimiter)]
