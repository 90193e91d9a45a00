"""HEIDENHAIN TNC: `.COM` tables in both layouts, the `.CMA` that assigns them, KinematicsComp columns."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, increasing, numbers, refusal

_OLD = re.compile(r"BEGIN\s+(\S+)\s+DATUM:\s*(\S+)\s+DISTANCE:\s*(\S+)")
_COLUMN = re.compile(r"\b([XYZABCUVW]\d?)\.\.C([1-6])\b")
_OWN = {"X": "X", "Y": "Y", "Z": "Z", "U": "X", "V": "Y", "W": "Z", "A": "A", "B": "B", "C": "C"}


class _Com(NamedTuple):
    """Rows of a table: positions, and by column the values, of all rows."""

    positions: list[float]
    columns: dict[str, list[float]]


def read(source: Source) -> list[Effect]:
    """The assignments of the active line of the .CMA."""
    found: list[Effect] = []
    sign = source.sign("correction")
    for axis, file in _assigned(source):
        source.machine.index(axis)
        com = _com(source, file)
        backward = com.columns.pop("BACKLASH", None)
        if backward is not None and axis not in com.columns:
            raise UserError(f"{file}: BACKLASH needs a column {axis} for the axis itself")
        for output, values in com.columns.items():
            source.machine.index(output)
            corrections = [sign * v for v in values]
            if output == axis and backward is not None:
                rows = zip(com.positions, corrections, [sign * v for v in backward], strict=True)
                found += source.own(axis, list(rows))
            else:
                found.append(source.table(output, (axis,), (com.positions,), corrections))
    return found


def read_kinematics(source: Source) -> list[Effect]:
    """Error motions of columns C1 ... C6 that the kinematics' rows name, and the positioning errors."""
    named = _named_columns(source)
    sign = source.sign("error")
    found: list[Effect] = []
    for file in (name for name in source.files if name.lower().endswith(".com")):
        axis = file.lower().removesuffix(".com").removeprefix("axis_").upper()
        source.machine.index(axis)
        com = _com(source, file)
        for column, values in com.columns.items():
            if column != axis and (axis, column[1:]) not in named:
                raise UserError(f"{file}: no row of the kinematics names {axis}..{column}")
            component = _OWN[axis[0]] if column == axis else "XYZABC"[int(column[1]) - 1]
            size = math.radians(1.0) * 1e6 if component in "ABC" else 1e3
            um = tuple(sign * size * v for v in values)
            found.append(source.motion(component, axis, com.positions, um))
    return found


def _named_columns(source: Source) -> set[tuple[str, str]]:
    """Axis and number of the columns that rows of the kinematics name, on the side of the axis with its errors."""
    found: set[tuple[str, str]] = set()
    for name, text in source.files.items():
        if name.lower().endswith((".com", ".cma")):
            continue
        passed: set[str] = set()
        for line, row in enumerate(text.splitlines(), 1):
            moved = re.search(r"\bMachAxis\s+(\S+)", row)
            passed |= {moved[1]} if moved else set()
            column = _COLUMN.search(row)
            if column:
                _check_side(source, column[1], column[1] in passed, (name, line, row))
                found.add((column[1], column[2]))
        if passed:
            source.used.add(name)
    return found


def _check_side(source: Source, name: str, behind: bool, location: tuple[str, int, str]) -> None:
    """UserError for an error that the control takes up on the other side of its axis than ISO 230-1 counts it."""
    axis = source.machine.axes[source.machine.index(name)]
    moves_with_tool = (axis.side == "tool" and not axis.rotary) or (axis.side != "tool" and axis.rotary)
    if behind == moves_with_tool:
        side = "before" if moves_with_tool else "after"
        raise refusal(*location, f"on this machine the rows of the errors of {name} must be {side} MachAxis {name}")


def _assigned(source: Source) -> list[tuple[str, str]]:
    """Axis and file by the active line of the assignment."""
    name = source.only(".cma", "HEIDENHAIN", "the assignment of the tables to axes")
    source.used.add(name)
    lines = source.files[name].splitlines()
    starts = _heading(name, lines)
    rows = [(k, _cells(row, starts)) for k, row in enumerate(lines[2:], 3) if row.strip() and row.strip() != "[END]"]
    active = [(k, cells) for k, cells in rows if cells.get("ACTIVE", "*") == "*"]
    if len(active) != 1:
        raise UserError(f"{name}: {len(active)} active lines; expected one")
    by_name = {file.upper(): file for file in source.files}
    found = []
    for axis, file in active[0][1].items():
        if axis in ("NR", "ACTIVE") or not file:
            continue
        if file.upper() not in by_name:
            raise refusal(name, active[0][0], file, "this file is not among the files")
        found.append((axis, by_name[file.upper()]))
    return found


def _heading(name: str, lines: list[str]) -> dict[str, int]:
    """Where each column begins."""
    if len(lines) < 3 or not lines[0].startswith("BEGIN") or not lines[1].startswith("NR"):
        raise UserError(f"{name}: expected a line BEGIN ... and a line of columns NR ...")
    return {match[0]: match.start() for match in re.finditer(r"\S+", lines[1])}


def _cells(row: str, starts: dict[str, int]) -> dict[str, str]:
    ends = [*list(starts.values())[1:], max(len(row), 10_000)]
    return {column: row[start:end].strip() for (column, start), end in zip(starts.items(), ends, strict=True)}


def _com(source: Source, name: str) -> _Com:
    source.used.add(name)
    lines = source.files[name].rstrip().splitlines()
    starts = _heading(name, lines)
    if lines[-1].strip() != "[END]":
        raise UserError(f"{name}: the last line must be [END]")
    if lines[0].split()[-1].upper().startswith("INCH"):
        raise refusal(name, 1, lines[0], "tables in inches are not read")
    old = _OLD.match(lines[0])
    if old is None and "AXISPOS" not in starts:
        raise UserError(f"{name}: expected a column AXISPOS, or DATUM and DISTANCE")
    if old is not None:
        starts = {"NR": 0, "AXISPOS": 8, **{column: at for column, at in starts.items() if column != "NR"}}
    rows: list[tuple[int, list[float]]] = []
    columns: dict[str, list[float]] = {}
    for line, row in enumerate(lines[2:-1], 3):
        cells = _cells(row, starts)
        rows.append((line, numbers([cells["AXISPOS"]], name, line, row)))
        for column, cell in cells.items():
            if cell and column not in ("NR", "AXISPOS"):
                columns.setdefault(column, []).extend(numbers([cell], name, line, row))
        if old is not None:
            datum, distance = numbers([old[2], old[3]], name, 1, lines[0])
            if abs(rows[-1][1][0] - datum - (line - 3) * distance) > 2e-4 * max(1, line - 3):
                raise refusal(name, line, row, "the position differs from DATUM plus a multiple of DISTANCE")
    increasing(rows, name)
    for column, values in columns.items():
        if len(values) != len(rows):
            raise UserError(f"{name}: column {column} has values in {len(values)} of {len(rows)} rows")
    return _Com([row[0] for _, row in rows], columns)
