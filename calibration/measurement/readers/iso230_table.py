"""Wide tables of ISO 230-2 tests, as in spreadsheets: a row for each target, a column for each run.

    # axis: X
    # unit: um
    # u_um: 0.3
    target_mm; 1 up; 1 down; 2 up; 2 down
    0;         0,0;  -2,1;   0,4;  -2,4

The first column is `target_mm` or `target_deg`; the others are named by the number of the run and up (+, forward) or
down (-, backward), in either order. Cells are separated by commas, semicolons or tabs; with the latter two a decimal
comma is also read. The header gives the unit of the deviations, measured minus target: um, mm or inch; urad, arcsec,
mrad or deg. An empty cell is a missing reading.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain

from calibration.measurement.readers.text import axis_named, given_entries
from calibration.measurement.text_table import Table, table_of
from kinematics.files import fingerprint
from kinematics.files.text_cells import ANGLE_DEVIATIONS, LENGTH_DEVIATIONS, number_at, numbered_lines, unit_size
from kinematics.machine import Machine
from kinematics.user_error import UserError

_DIRECTION = r"(?P<side>up|down|forward|backward|\+|-|↑|↓)"
_RUN = r"(?:run\s*)?(?P<run>\d+)"
_COLUMN = re.compile(
    rf"{_RUN}\s*{_DIRECTION}|{_DIRECTION.replace('side', 'side2')}\s*{_RUN.replace('<run>', '<run2>')}", re.I
)
_ROW = re.compile(
    r"[-+]?\d+(?:[.,]\d+)?(?: *[;\t](?: *(?:[-+]?\d+(?:[.,]\d+)?|[-+]?[.,]\d+|[-+]))?)+"
    r"|[-+]?\d+(?:\.\d+)?(?:\s*,(?:\s*(?:[-+]?\d+(?:\.\d+)?|[-+]?\.\d+|[-+]))?){2,}"
)
"""A position, and numbers behind it; blanks count in one way only, or empty cells would take exponential time."""
_FORWARD = ("up", "forward", "+", "↑")
_TARGETS = ("target_mm", "target_deg")


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    names = next((line for line in head.splitlines() if line.strip() and not line.lstrip().startswith("#")), "")
    cells = [cell.strip() for cell in names.split(_delimiter(names))]
    return cells[0] in _TARGETS and len(cells) > 1 and all(_COLUMN.fullmatch(cell) for cell in cells[1:])


def meant(head: str) -> str:
    """The names that a table without them lacks; empty where the numbers are no targets with readings by runs."""
    rows = [line for line in head.splitlines()[:-1] if _ROW.fullmatch(line.strip())]
    if len(rows) < 2:
        return ""
    delimiter = _delimiter(rows[0])
    runs = rows[0].count(delimiter)
    names = [f"{1 + k // 2} {'down' if k % 2 else 'up'}" for k in range(min(runs, 2))]
    return (
        f"for targets with a reading in each run, write '{delimiter.join(('target_mm', *names, '...'))}' above the "
        "numbers in place of the other lines, and '# axis: X', '# unit: um', '# u_um: 0.3' at the head"
    )


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, run by run, and notes."""
    lines = numbered_lines(data)
    stated = {}
    for _, line in lines:
        if line.lstrip().startswith("#"):
            key, _, value = (part.strip() for part in line.lstrip()[1:].partition(":"))
            stated[key] = value
    header = {**stated, **header}
    rows = [(number, line) for number, line in lines if line.strip() and not line.lstrip().startswith("#")]
    names_line, names = rows[0]
    delimiter = _delimiter(names)
    decimal = "." if delimiter == "," else ","
    if names.split(delimiter)[0].strip() not in _TARGETS:
        raise UserError(
            f"{source}:{names_line}: expected the names of the columns, as in "
            f"'{delimiter.join(('target_mm', '1 up', '1 down'))}', found {names.strip()!r}"
        )
    columns = [_column(cell.strip(), f"{source}:{names_line}") for cell in names.split(delimiter)[1:]]
    target, axis = names.split(delimiter)[0].strip(), axis_named(header.pop("axis", ""), machine)
    if axis not in machine.names:
        raise UserError(f"{source}: state the axis (# axis: {' | '.join(machine.names)}), got {axis!r}")
    turns = machine.axes[machine.index(axis)].rotary
    if (target == "target_deg") != turns:
        raise UserError(f"{source}:{names_line}: {target} is not for {axis}, a {'rotary' if turns else 'linear'} axis")
    units = ANGLE_DEVIATIONS if turns else LENGTH_DEVIATIONS
    if "unit" not in header:
        raise UserError(f"{source}: state the unit of the deviations (# unit: {' | '.join(units)})")
    size = unit_size(units, header.pop("unit"), source)
    readings: dict[tuple[int, bool], list[tuple[float, float, int]]] = {column: [] for column in columns}
    for number, line in rows[1:]:
        where, cells = f"{source}:{number}", [cell.strip() for cell in line.split(delimiter)]
        if len(cells) != len(columns) + 1:
            raise UserError(f"{where}: {len(cells)} cells, but {len(columns) + 1} columns have names")
        position = _number(cells[0], f"{where} column {target}", decimal)
        for column, cell in zip(columns, cells[1:], strict=True):
            if cell:
                name = f"{column[0]} {'up' if column[1] else 'down'}"
                readings[column].append((position, size * _number(cell, f"{where} column {name}", decimal), number))
    return cycles_table(source, data, header, (axis, turns), readings), []


def cycles_table(
    source: str,
    data: bytes,
    header: Mapping[str, str],
    axis: tuple[str, bool],
    readings: Mapping[tuple[int, bool], Sequence[tuple[float, float, int]]],
) -> Table:
    """Readings of an axis in the contract's columns, run by run: forward by ascending targets, then backward.

    axis: its name, and True for a rotary one. readings: target (mm, deg), deviation (um, urad) and line number, by
    number of the run and True for forward.
    """
    name, turns = axis
    ordered = list(chain.from_iterable(
        ((run, forward, *reading) for reading in sorted(readings[run, forward], reverse=not forward))
        for run, forward in sorted(readings, key=lambda column: (column[0], not column[1]))
    ))  # fmt: skip
    return table_of(
        source,
        fingerprint(data),
        given_entries(header, {"instrument": "interferometer"}),
        {
            "axis": [name] * len(ordered),
            "run": [str(run) for run, *_ in ordered],
            "direction": ["+" if forward else "-" for _, forward, *_ in ordered],
            "target_deg" if turns else "target_mm": [repr(position) for _, _, position, *_ in ordered],
            "deviation_urad" if turns else "deviation_um": [repr(value) for _, _, _, value, _ in ordered],
        },
        [line for *_, line in ordered],
    )


def _delimiter(names: str) -> str:
    return ";" if ";" in names else "\t" if "\t" in names else ","


def _column(name: str, where: str) -> tuple[int, bool]:
    """Number of the run, and True for forward."""
    found = _COLUMN.fullmatch(name)
    if not found:
        raise UserError(f"{where} column {name}: expected a run and its direction, as in '1 up' or '1 down'")
    return int(found["run"] or found["run2"]), (found["side"] or found["side2"]).lower() in _FORWARD


def _number(cell: str, where: str, decimal: str) -> float:
    """A number with a decimal point, or with a decimal comma if commas do not separate cells."""
    return number_at(cell, where, "," if decimal == "," and "," in cell else ".")
