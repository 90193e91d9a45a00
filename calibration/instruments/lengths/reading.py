"""Rows that a ruler and a dial gauge fill: lengths between two positions, and dial readings at one position.

A length has the two positions in `X1,Y1,...,X2,Y2,...` and becomes two observations, one of each end. A dial reading
has the axis that moved, the direction along which the dial reads, the position and the reading. One file may hold both.
The names of the runs that are made here say what a row is: `length`, `gauge Y`, `square X`, `reversed X`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kinematics.files.column_map import SECONDS, TEMPERATURE
from kinematics.machine import Machine
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.text_table import Table

LENGTH_MM, NAME, OWN_U = "length_mm", "name", "u_um"
"""Columns of a length: what was measured, the name of the row, and its own standard uncertainty."""
AXIS, ALONG, POSITION, DIRECTION, READING, SQUARE, RUN = (
    "axis", "along", "position_mm", "direction", "reading_um", "square", "run",
)  # fmt: skip
"""Columns of a dial reading."""
DIAL = (AXIS, ALONG, POSITION, DIRECTION, READING, SQUARE, RUN)
AGAINST: Mapping[str, str] = {"": "gauge", "1": "square", "yes": "square", "reversed": "reversed"}
"""What the dial touches, by the cell of the column `square`."""
SIDES: Mapping[str, int] = {"+": 1, "+1": 1, "1": 1, "-": -1, "-1": -1}
LETTERS = "XYZ"
U_RULER, U_RULER_PER_M, U_GAUGE = "u_um", "u_um_per_m", "u_gauge_um"
OBSERVED = "observed_mm"
"""Column of the observations after conversion."""
SCATTER = "scatter_um"
UNNAMED = "length"
"""Name of a length whose row has none."""
SAME_END_MM = 1e-6
"""Distance below which two ends are the same."""


def columns_known(machine: Machine) -> list[str]:
    """Names of the columns that a file may have, besides those of any file."""
    ends = [f"{axis}{end}" for end in (1, 2) for axis in machine.names]
    return [NAME, *ends, LENGTH_MM, OWN_U, *DIAL]


@dataclass
class Rows:
    """The observations of a file, in the order of its rows."""

    machine: Machine
    positions: list[list[float]] = field(default_factory=list)
    """Positions of the axes, mm and degrees."""
    sides: list[list[int]] = field(default_factory=list)
    """Directions of approach of the axes, -1, 0, 1."""
    texts: list[tuple[str, str]] = field(default_factory=list)
    """Name of the group, and what the row is."""
    values: list[tuple[float, float]] = field(default_factory=list)
    """Observation, mm, and standard uncertainty, um."""
    lines: list[int] = field(default_factory=list)

    def add(
        self, positions: list[float], sides: list[int], texts: tuple[str, str], value: float, u: float, line: int
    ) -> None:
        """Add an observation."""
        self.positions.append(positions)
        self.sides.append(sides)
        self.texts.append(texts)
        self.values.append((value, u))
        self.lines.append(line)

    def columns(self) -> dict[str, list[str]]:
        """The columns of a table with one row for each observation."""
        axes = zip(self.machine.names, zip(*self.positions, strict=True), strict=True)
        sides = zip(self.machine.names, zip(*self.sides, strict=True), strict=True)
        found = {name: list(map(repr, column)) for name, column in axes}
        found |= {f"dir_{name}": list(map(str, column)) for name, column in sides}
        found["station"], found[RUN] = ([text[k] for text in self.texts] for k in (0, 1))
        found[OBSERVED], found[SCATTER] = ([repr(value[k]) for value in self.values] for k in (0, 1))
        return found


def converted(table: Table, machine: Machine, kind: str) -> Table:
    """The table with one row for each observation; UserError for rows that are neither a length nor a reading."""
    if LENGTH_MM not in table.names and READING not in table.names:
        raise UserError(
            f"{table.head} {kind}: expected the column {LENGTH_MM} (with the two positions {machine.names[0]}1, "
            f"{machine.names[0]}2, ...) or {READING} (with {AXIS}, {ALONG}, {POSITION}), found {', '.join(table.names)}"
        )
    clock = [name for name in table.names if name == SECONDS or name.startswith(TEMPERATURE)]
    known = [*columns_known(machine), *machine.names, *clock]
    table.allow_columns(lambda name: name in known, known)
    cells, rows = _Cells(table), Rows(machine)
    before: dict[str, tuple[float, int]] = {}
    for row in range(len(table)):
        filled = bool(cells.text(row, LENGTH_MM)), bool(cells.text(row, READING))
        if filled == (True, True):
            table.fault(row, READING, f"the row has a {LENGTH_MM} too: write two rows")
        if filled == (False, False):
            there = LENGTH_MM if LENGTH_MM in table.names else READING
            table.fault(row, there, "empty: fill in what was measured, or delete the row")
        if filled[0]:
            _add_length(cells, row, rows)
        else:
            _add_reading(cells, row, rows, before)
    of_line = np.searchsorted(table.lines, rows.lines)
    columns = rows.columns() | {name: column[of_line].tolist() for name, column in table.cells(clock).items()}
    return table.with_rows(columns, rows.lines)


class _Cells:
    """Cells of a table as texts and numbers; a column that is missing is empty."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self._texts = {name: column.tolist() for name, column in table.cells(table.names).items()}

    def text(self, row: int, name: str) -> str:
        """The text of a cell."""
        return str(self._texts[name][row]) if name in self._texts else ""

    def number(self, row: int, name: str) -> float | None:
        """The number in a cell; None for an empty one, UserError for another text."""
        text = self.text(row, name)
        if not text:
            return None
        one = self.table.with_rows({name: [text]}, [int(self.table.lines[row])])
        return float(one.numbers([name])[name][0])

    def needed(self, row: int, name: str, meaning: str) -> float:
        """The number in a cell; UserError for an empty one."""
        value = self.number(row, name)
        if value is None:
            self.table.need_columns([name], meaning)
            self.table.fault(row, name, f"empty: {meaning} needs it")
        return value

    def u(self, row: int, keys: Sequence[str], per_m: float, what: str, kind: str) -> float:
        """Standard uncertainty, um, of a row: its own, or that of the header and that per metre times `per_m`."""
        own = self.number(row, OWN_U)
        if own is not None and own <= 0.0:
            self.table.fault(row, OWN_U, f"{own:g} is not above 0: a standard uncertainty in um, k=1")
        given = [self.table.header_numbers(key, 1)[0] if key in self.table.entries else 0.0 for key in keys]
        u = own or sum(value * factor for value, factor in zip(given, (1.0, per_m), strict=False))
        if u > 0.0:
            return u
        raise UserError(
            f"{self.table.source}: the standard uncertainty (k=1) of the {kind} is missing: state {' or '.join(keys)} "
            f"above zero (header line '# {keys[0]}: ...'), or the column {OWN_U}, for {what}"
        )


def _add_length(cells: _Cells, row: int, rows: Rows) -> None:
    """Add the two ends of a length; UserError for one that is none."""
    table, machine = cells.table, rows.machine
    one, two, given = [], [], False
    for axis in machine.axes:
        first, second = (cells.number(row, f"{axis.name}{end}") for end in (1, 2))
        given = given or first is not None or second is not None
        one.append(next(value for value in (first, second, axis.home) if value is not None))
        two.append(next(value for value in (second, first, axis.home) if value is not None))
    if not given:
        table.fault(
            row, f"{machine.names[0]}1", "the row has no positions: fill in where the machine stood at both ends"
        )
    apart = float(np.linalg.norm(np.subtract(two, one)))
    if apart < SAME_END_MM:
        table.fault(row, f"{machine.names[0]}2", "both ends are at the same position: correct one of them")
    length = cells.needed(row, LENGTH_MM, "a length")
    if length <= 0.0:
        table.fault(row, LENGTH_MM, f"{length:g} is not above 0: correct it, or delete the row")
    u = cells.u(row, (U_RULER, U_RULER_PER_M), length * 1e-3, "lengths", "lengths") * 0.5**0.5
    line = int(table.lines[row])
    texts = f"{cells.text(row, NAME) or UNNAMED} (line {line})", "length"
    still = [0] * len(one)
    rows.add(one, still, texts, -length / 2.0, u, line)
    rows.add(two, still, texts, length / 2.0, u, line)


def _add_reading(cells: _Cells, row: int, rows: Rows, before: dict[str, tuple[float, int]]) -> None:
    """Add a reading of a dial gauge; before: the last position and direction of each group."""
    table, machine = cells.table, rows.machine
    axis, along = cells.text(row, AXIS), cells.text(row, ALONG).upper()
    linear = [each.name for each in machine.axes if not each.rotary]
    if axis not in linear:
        table.fault(row, AXIS, f"{axis!r} is none of {', '.join(linear)}: the axis that moved")
    if along not in (*LETTERS,):
        table.fault(row, ALONG, f"{along!r} is none of X, Y and Z: the direction along which the dial gauge reads")
    touched, own = cells.text(row, SQUARE).lower(), machine.index(axis)
    if touched not in AGAINST:
        table.fault(
            row, SQUARE, f"{touched!r} is none of 1 (against a square), reversed (the square turned round) and empty"
        )
    against = AGAINST[touched]
    if against != "gauge" and along == axis[0]:
        table.fault(row, ALONG, "against a square the dial gauge reads across the axis that moves")
    position = cells.needed(row, POSITION, "a reading of a dial gauge")
    positions = [each.home for each in machine.axes]
    for i, each in enumerate(machine.axes):
        positions[i] = next(v for v in (cells.number(row, each.name), positions[i]) if v is not None)
    positions[own] = position
    reading = cells.needed(row, READING, "a dial gauge")
    name = cells.text(row, RUN) or "1"
    group = f"{'square' if against != 'gauge' else 'run'} {name}{' reversed' * (against == 'reversed')} {axis}"
    u = cells.u(row, (U_GAUGE,), 0.0, "readings of a dial gauge", "lengths")
    sides = [0] * len(positions)
    sides[own] = _side(cells, row, position, before.get(group))
    before[group] = position, sides[own]
    rows.add(positions, sides, (group, f"{against} {along}"), reading * 1e-3, u, int(table.lines[row]))


def _side(cells: _Cells, row: int, position: float, before: tuple[float, int] | None) -> int:
    """Direction from which an axis came: as stated, else from the row before in its run; 0 where it is not known."""
    stated = cells.text(row, DIRECTION)
    if stated and stated not in SIDES:
        cells.table.fault(row, DIRECTION, f"{stated!r} is none of + and -: the direction in which the axis came")
    if stated:
        return SIDES[stated]
    if before is None:
        return 0
    return int(np.sign(position - before[0])) or before[1]


def role_of(run: str) -> tuple[str, str]:
    """What a row is (length, gauge, square, reversed), and the direction of its dial gauge, empty for a length."""
    kind, _, along = run.rpartition(":")[2].partition(" ")
    return kind, along


def roles(runs: np.ndarray) -> Iterator[tuple[str, str]]:
    """`role_of` each row."""
    known = {run: role_of(run) for run in np.unique(runs).tolist()}
    return (known[run] for run in runs.tolist())
