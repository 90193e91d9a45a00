"""Reports of ISO 230-2 tests by the logger of ecmc (EPICS motion control), in Markdown.

    # ISO 230-2 motion test
    Unit | mm
    ### Data forward direction
    i |tgt_pos(i) [mm]|ref_pos(i,1) [mm]|ref_pos(i,2) [mm]|
    --- |--- |--- |--- |
    1|-20.0|-20.01852|-20.01934|
    ### Data backward direction
    ...

The two tables of data are read: the deviation is ref_pos minus tgt_pos, a cycle is a run. The table of deviations that
the report derives from them must agree with them. Its evaluation is not used: `ncomp iso230` evaluates the data.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from calibration.measurement.readers.iso230_table import cycles_table
from calibration.measurement.readers.text import axis_of
from calibration.measurement.text_table import Table
from kinematics.files.text_cells import ANGLES, LENGTHS, number_at, numbered_lines, unit_size
from kinematics.machine import Machine
from kinematics.user_error import UserError

_TITLE = re.compile(r"^#+\s*ISO\s*230-2 motion test\s*$", re.MULTILINE)
_DIRECTIONS = {"forward": True, "backward": False}
_HEADING = re.compile(r"#+\s*(?P<kind>Data|Positioning deviation) (?P<side>forward|backward) direction.*", re.I)
_TARGET = re.compile(r"tgt_pos\(i\) \[(\w+)\]")
_READING = re.compile(r"ref_pos\(i,(\d+)\) \[(\w+)\]")
_DEVIATION = re.compile(r"x\(i,(\d+)\) \[(\w+)\]")
_GEAR = re.compile(r"Target Position\s*\|\s*Reference\s*\|\s*(\S+)\s*\|\s*(\S+)\s*\|.*")
_COUNT = re.compile(r"(Position|Cycle) count\s*\|\s*(\d+).*")
_ROUNDING = 1.1e-5
"""Largest difference, in the unit of the report, of two numbers with five decimals that agree."""

_Row = tuple[int, list[str]]
"""Line number and cells."""


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    return _TITLE.search(head) is not None


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, cycle by cycle, and notes; `header` may name the axis."""
    lines, header = numbered_lines(data), dict(header)
    axis = axis_of(header.pop("axis", ""), machine, source)
    turns = machine.axes[machine.index(axis)].rotary
    readings: dict[tuple[int, bool], list[tuple[float, float, int]]] = {}
    unit = ""
    for side, forward in _DIRECTIONS.items():
        names, rows = _section(lines, "Data", side, source)
        unit, cycles = _columns(names, f"{source}:{names[0]}", ANGLES if turns else LENGTHS, axis)
        size = unit_size(ANGLES if turns else LENGTHS, unit, f"{source}:{names[0]}")
        micro = size * (17453.292519943295 if turns else 1e3)
        for number, cells in rows:
            where = f"{source}:{number}"
            target = number_at(cells[1], f"{where} column tgt_pos(i)")
            for cycle, cell in zip(cycles, cells[2:], strict=True):
                observed = number_at(cell, f"{where} column ref_pos(i,{cycle})")
                deviation = round(micro * (observed - target), 6)
                readings.setdefault((cycle, forward), []).append((size * target, deviation, number))
        _check_deviations(lines, side, rows, cycles, source)
    _check_counts(lines, readings, source)
    return cycles_table(source, data, header, (axis, turns), readings), [
        *_notes(lines, axis, unit, len({cycle for cycle, _ in readings}))
    ]


def _notes(lines: list[tuple[int, str]], axis: str, unit: str, cycles: int) -> Iterator[str]:
    yield f"read as an ISO 230-2 test of {axis} in {unit}: deviation ref_pos minus tgt_pos, {cycles} cycles"
    yield "the report gives neither times nor the order of readings: cycle after cycle, forward before backward"
    for number, line in lines:
        found = _GEAR.fullmatch(line.strip())
        if found:
            yield (
                f"line {number}: the reference is multiplied by {found[1]} and shifted by {found[2]} {unit} to fit the "
                f"targets: scale and zero of {axis} are not in these data"
            )


def _section(lines: list[tuple[int, str]], kind: str, side: str, source: str) -> tuple[_Row, list[_Row]]:
    """Names of the columns and rows of the table below a heading; UserError without it, and for a row of other length.

    `kind`: Data or Positioning deviation.
    """
    heading = None
    rows: list[_Row] = []
    for number, line in lines:
        found = _HEADING.fullmatch(line.strip())
        if found:
            heading = number if (found["kind"].lower(), found["side"].lower()) == (kind.lower(), side) else None
        elif line.lstrip().startswith("#"):
            heading = None
        elif heading is not None and "|" in line:
            rows.append((number, [cell.strip() for cell in line.strip().strip("|").split("|")]))
    rows = [(number, cells) for number, cells in rows if not all(set(cell) <= set("-: ") and cell for cell in cells)]
    if len(rows) < 2:
        raise UserError(f"{source}: the table below '{kind} {side} direction' is missing")
    for number, cells in rows[1:]:
        if len(cells) != len(rows[0][1]):
            raise UserError(f"{source}:{number}: {len(cells)} cells, but {len(rows[0][1])} columns have names")
    return rows[0], rows[1:]


def _columns(names: _Row, where: str, units: Mapping[str, float], axis: str) -> tuple[str, list[int]]:
    """Unit of a table of data, and the cycles of its columns."""
    target, readings = _TARGET.fullmatch(names[1][1]), [_READING.fullmatch(name) for name in names[1][2:]]
    if target is None or not readings or None in readings:
        raise UserError(f"{where}: expected the columns i, tgt_pos(i) [unit], ref_pos(i,1) [unit], ...")
    found = [reading for reading in readings if reading is not None]
    if {target[1], *(reading[2] for reading in found)} != {target[1]}:
        raise UserError(f"{where}: the columns have different units")
    if target[1] not in units:
        raise UserError(f"{where}: unit {target[1]!r} of {axis} is none of {', '.join(units)}")
    return target[1], [int(reading[1]) for reading in found]


def _check_deviations(
    lines: list[tuple[int, str]], side: str, rows: list[_Row], cycles: list[int], source: str
) -> None:
    """UserError where the table of deviations differs from the data; reports without this table are accepted."""
    headings = [_HEADING.fullmatch(line.strip()) for _, line in lines]
    if not any(found and found["kind"].lower() != "data" and found["side"].lower() == side for found in headings):
        return
    names, derived = _section(lines, "Positioning deviation", side, source)
    columns = {int(found[1]): i for i, name in enumerate(names[1]) if (found := _DEVIATION.fullmatch(name))}
    if len(derived) != len(rows):
        raise UserError(f"{source}:{names[0]}: {len(derived)} rows of deviations, but {len(rows)} rows of data")
    for (_, data), (number, cells) in zip(rows, derived, strict=True):
        for i, cycle in enumerate(cycles, start=2):
            where = f"{source}:{number} column x(i,{cycle})"
            if cycle not in columns:
                raise UserError(f"{source}:{names[0]}: column x(i,{cycle}) is missing")
            expected = float(data[i]) - float(data[1])
            if abs(number_at(cells[columns[cycle]], where) - expected) > _ROUNDING:
                raise UserError(
                    f"{where}: {cells[columns[cycle]]} is not ref_pos minus tgt_pos, {expected:.5f}: one of the two "
                    "tables is wrong"
                )


def _check_counts(
    lines: list[tuple[int, str]], readings: Mapping[tuple[int, bool], list[tuple[float, float, int]]], source: str
) -> None:
    """UserError where the tables have other numbers of positions or cycles than the report states."""
    found = {"Position": len(next(iter(readings.values()))), "Cycle": len({cycle for cycle, _ in readings})}
    for number, line in lines:
        stated = _COUNT.match(line.strip())
        if stated and int(stated[2]) != found[stated[1]]:
            raise UserError(
                f"{source}:{number}: {line.strip()!r}, but the tables have {found[stated[1]]} {stated[1].lower()}s"
            )
