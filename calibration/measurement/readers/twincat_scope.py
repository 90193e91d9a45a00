"""Exports of TwinCAT Scope in CSV: the commanded and the observed position of one axis in motion, two of its channels.

    Name;Resolver test;
    Starttime of export;132900081483250000;Tuesday, February 22, 2022;13:55:48.325

    Name;fActPosition (Counter);fActPosition (Resolver)
    Unit;(None);(None)
    Offset;0;0
    ScaleFactor;1;1

    132900081483250000;0;-0.071
    EOF

Rows begin with a time, in ticks of 100 ns from the year 1601, the same for all channels; or each channel has a column
of times before its own (`Name;A;Name;B`). Cells are separated by semicolons, tabs or commas; with the former two a
decimal comma is also read. The export does not contain the meaning of a channel: `command` and `observed` name two of
them, by their Name or SymbolName, and `axis` the axis. The deviation is their difference, observed minus command.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from calibration.measurement.readers.axis_motion import SPAN, AxisMotion, motion_table
from calibration.measurement.readers.text import axis_of
from calibration.measurement.text_table import Table
from kinematics.files.text_cells import ANGLES, LENGTHS, number_at, numbered_lines
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

_GIVEN = ("command", "observed", "axis")
_NAMES = ("Name", "SymbolName")
_START = re.compile(r"^Starttime of export[;\t,]", re.MULTILINE)
_UNCHANGED = {"Offset": 0.0, "ScaleFactor": 1.0, "Unit Offset": 0.0, "Unit ScaleFactor": 1.0}
"""Properties of a channel, with the value at which the exported numbers are the numbers recorded."""
_NO_UNIT = ("(None)", "None", "")
_UNITS = {"°": "deg", "degree": "deg", "degrees": "deg"}
TICK = 1e-7
"""Size of a tick, s."""
_EARLIEST = 1e17
"""Least number of ticks of an absolute time: the year 1917."""


class _Preamble(NamedTuple):
    """Properties of the channels above the data."""

    delimiter: str
    line: int
    """Line of the names."""
    properties: Mapping[str, list[str]]
    """Cells of each property, one per channel."""
    own_times: bool
    """True where each channel has times of its own."""

    def column(self, channel: int) -> int:
        """Index of the cell with the value of a channel."""
        return 2 * channel + 1 if self.own_times else channel + 1


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    return head.startswith("Name") and _START.search(head) is not None


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, and notes; `header` names the channels and the axis."""
    lines = numbered_lines(data)
    preamble, rows = _preamble(lines, source)
    axis = axis_of(header.get("axis", ""), machine, source)
    channels = {key: _channel(preamble, header.get(key, ""), key, source) for key in ("command", "observed")}
    if channels["command"] == channels["observed"]:
        raise UserError(f"{source}: command and observed are both {header['command']}")
    sizes, notes = _units(preamble, channels, axis, machine, source)
    if lines and not any(line.strip() == "EOF" for _, line in lines):
        notes.append("the line EOF is missing at the end: the export may be incomplete")
    time, values = _columns(rows, preamble, list(channels.values()), source)
    numbers = np.array([number for number, _ in rows])
    motion = AxisMotion(axis, time, values[0] * sizes[0], values[1] * sizes[1], numbers, numbers)
    others = {key: value for key, value in header.items() if key not in _GIVEN}
    table, more = motion_table(source, data, others, machine, motion)
    return table, [*more, *notes]


def _preamble(lines: list[tuple[int, str]], source: str) -> tuple[_Preamble, list[tuple[int, str]]]:
    """The properties of the channels, and the rows of data; UserError where one of them is missing."""
    delimiter = next(line for _, line in lines if _START.match(line))[len("Starttime of export")]
    first = next((i for i, (_, line) in enumerate(lines) if re.match(rf"\d{{9,}}{delimiter}", line)), len(lines))
    rows = [(number, line) for number, line in lines[first:] if line.strip() and line.strip() != "EOF"]
    if len(rows) < SPAN:
        raise UserError(f"{source}: {len(rows)} rows of data, 'time{delimiter}value...', are too few for a motion")
    above = [(number, [cell.strip() for cell in line.split(delimiter)]) for number, line in lines[:first]]
    named = [(number, cells) for number, cells in above if cells[0] == "Name"][1:]
    if not named:
        raise UserError(f"{source}: the line with the names of the channels, 'Name{delimiter}...', is missing")
    line, names = named[-1]
    own_times = len(names) > 2 and all(cell == "Name" for cell in names[::2])
    properties = {cells[0]: cells[1::2] if own_times else cells[1:] for number, cells in above if number >= line}
    return _Preamble(delimiter, line, properties, own_times), rows


def _channel(preamble: _Preamble, name: str, key: str, source: str) -> int:
    """Number of the channel of this Name or SymbolName; UserError where none or several have it."""
    listed = ", ".join(filter(None, preamble.properties["Name"]))
    if not name:
        raise UserError(f"{source}: {key} is missing: state --header {key}=NAME, one of {listed}")
    found = {i for of in _NAMES for i, cell in enumerate(preamble.properties.get(of, [])) if cell == name}
    if len(found) > 1:
        raise UserError(f"{source}:{preamble.line}: several channels have the name {name!r}: state their SymbolName")
    if not found:
        raise UserError(f"{source}: {key} {name!r} is no channel: state --header {key}=NAME, one of {listed}")
    return found.pop()


def _units(
    preamble: _Preamble, channels: Mapping[str, int], axis: str, machine: Machine, source: str
) -> tuple[list[float], list[str]]:
    """Factors of the values of the channels to mm or degrees, and notes; UserError for a scaled channel."""
    turns = machine.axes[machine.index(axis)].rotary
    units, sizes, notes = (ANGLES if turns else LENGTHS), [], []
    for key, channel in channels.items():
        for name, unchanged in _UNCHANGED.items():
            cells = preamble.properties.get(name, [])
            cell = cells[channel] if channel < len(cells) else ""
            if cell and number_at(cell, f"{source} {name}", "," if "," in cell else ".") != unchanged:
                raise UserError(
                    f"{source}: {name} of {key} is {cell}: whether the exported values contain it is not known; export "
                    f"the channel with {name} {unchanged:g}"
                )
        cells = preamble.properties.get("Unit", [])
        unit = cells[channel] if channel < len(cells) else ""
        if unit in _NO_UNIT:
            sizes.append(1.0)
            notes.append(f"the export gives no unit of {key}: it is taken in {'deg' if turns else 'mm'}")
        elif _UNITS.get(unit, unit) in units:
            sizes.append(units[_UNITS.get(unit, unit)])
        else:
            raise UserError(f"{source}: unit {unit!r} of {key} is none of {', '.join(units)}, for {axis}")
    return sizes, notes


def _columns(
    rows: list[tuple[int, str]], preamble: _Preamble, channels: Sequence[int], source: str
) -> tuple[Array, list[Array]]:
    """Times `(n,)`, s from the first row, and values `(n,)` of the channels."""
    ticks, values = [], [np.empty(len(rows)) for _ in channels]
    columns = [preamble.column(channel) for channel in channels]
    comma = preamble.delimiter != ","
    for i, (number, line) in enumerate(rows):
        where, cells = f"{source}:{number}", line.split(preamble.delimiter)
        if len(cells) <= max(columns):
            raise UserError(f"{where}: {len(cells)} cells, but the channel is in column {max(columns) + 1}")
        times = {cells[column - 1] for column in columns} if preamble.own_times else {cells[0]}
        if len(times) > 1:
            raise UserError(f"{where}: the times of command and observed differ: export both with the same sample time")
        (tick,) = times
        if not tick.strip().isdigit():
            raise UserError(f"{where}: {tick.strip()!r} is no time in ticks of 100 ns")
        ticks.append(int(tick))
        if i and ticks[i] <= ticks[i - 1]:
            raise UserError(f"{where}: the time does not increase")
        for value, column in zip(values, columns, strict=True):
            cell = cells[column]
            name = preamble.properties["Name"][(column - 1) // (2 if preamble.own_times else 1)]
            value[i] = number_at(cell, f"{where} column {name}", "," if comma and "," in cell else ".")
    if ticks[0] < _EARLIEST:
        raise UserError(
            f"{source}:{rows[0][0]}: {ticks[0]} is no absolute time in ticks of 100 ns, as 132900081483250000 is: "
            "export with absolute times"
        )
    return np.array([tick - ticks[0] for tick in ticks]) * TICK, values
