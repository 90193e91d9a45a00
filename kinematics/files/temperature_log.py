"""Temperatures by time, as a logger writes them: in s or by time stamps, by its own names or by a column map.

    # zone: Europe/Berlin
    time;temp_air;temp_spindle
    2026-11-30 09:12:05;20,4;24,1

Without a map the columns are `time_s`, or `time` with stamps in ISO 8601, and `temp_NAME`, degC.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kinematics.files import read_input
from kinematics.files.column_map import (
    SECONDS,
    TEMPERATURE,
    TIME,
    Cells,
    ColumnMap,
    cells_of,
    delimiter_of,
    read_column_map,
)
from kinematics.files.mistaken import CURES, kind_of_file, not_utf8
from kinematics.files.text_cells import checked_degrees, number_at, old_text
from kinematics.files.time_stamps import ZONE, Times, read_times
from kinematics.transforms import Array
from kinematics.user_error import UserError


@dataclass(frozen=True)
class TemperatureLog:
    """Temperatures at the instants of a log, in the order of time."""

    source: str
    times: Times
    """Times `(n,)`."""
    temperatures: Mapping[str, Array]
    """Temperatures `(n,)` by sensor, degC."""
    unread: tuple[str, ...] = ()
    """Columns that are neither time nor temperature."""


def read_log(path: Path, columns: Path | None = None) -> TemperatureLog:
    """The log in a file, by a column map if it has names of its own; UserError with line and column."""
    source, data = f"log {path}", read_input(path, "log")
    if kind_of_file(data) in CURES or b"\0" in data:
        raise UserError(f"{source}: {not_utf8(data)}")
    map_ = _own_map(old_text(data), source) if columns is None else read_column_map(columns)
    names = [name for name in map_.columns if name in (TIME, SECONDS) or name.startswith(TEMPERATURE)]
    times = [name for name in names if not name.startswith(TEMPERATURE)]
    if len(times) != 1:
        raise UserError(f"{source}: its column map needs one of the columns {SECONDS} and {TIME}, beside temp_NAME")
    cells = cells_of(data, source, map_)
    if not cells.rows:
        raise UserError(f"{source} has no rows of values")
    for row, line in zip(cells.rows, cells.lines, strict=True):
        if cells.names and len(row) != (count := len(cells.names)):
            raise UserError(f"{source}:{line}: the row has {len(row)} values, and the header {count} columns")
    texts = {name: _texts(cells, map_, name) for name in names}
    stated = re.findall(rf"^#\s*{ZONE}:\s*(\S+)", old_text(data), re.MULTILINE)
    zone = map_.keys.get(ZONE) or next(iter(stated), "")
    courses = {name.removeprefix(TEMPERATURE): _degrees(cells, name, texts[name]) for name in names if name != times[0]}
    unread = tuple(name for name in cells.names if name and name not in map_.columns) if columns is None else ()
    return TemperatureLog(source, _times(cells, times[0], texts[times[0]], zone), courses, unread)


def read_given_log(path: str | Path | None, columns: str | Path | None) -> TemperatureLog | None:
    """The log that a user gave, if any; UserError for a column map without a log."""
    if path is not None:
        return read_log(Path(path), None if columns is None else Path(columns))
    if columns is not None:
        raise UserError(f"--log-columns {columns}: this is the column map of a log: give --log FILE too")
    return None


def neither(names: tuple[str, ...]) -> str:
    """Part of a message on columns of a log that are not read; empty for none."""
    if not names:
        return ""
    verb = "is" if len(names) == 1 else "are"
    return f"; the columns of a log are {SECONDS} or {TIME}, and temp_NAME, and {', '.join(names)} {verb} neither"


def _own_map(text: str, source: str) -> ColumnMap:
    """The map of a log with names of ncomp; UserError for names that are not."""
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    number, head = lines[0] if lines else (1, "")
    delimiter, mark = delimiter_of(head)
    names = [name.strip().strip('"') for name in head.split(mark)]
    known = [name for name in names if name in (TIME, SECONDS) or name.startswith(TEMPERATURE)]
    unread = tuple(name for name in names if name and name not in known)
    time = TIME if TIME in names and SECONDS not in names else SECONDS
    for name in (time, *(name for name in known if name.startswith(TEMPERATURE))):
        if names.count(name) != 1:
            found = names.count(name) or "none"
            lacks = f"{neither(unread)}; or give a column map (--log-columns MAP.toml)" if name not in names else ""
            raise UserError(f"{source}:{number}: expected one column {name}, found {found}{lacks}")
    comma = delimiter != "," and any("," in line for _, line in lines[1:])
    units = {"temperature": "degC"} | ({"time": "s"} if time == SECONDS else {})
    return ColumnMap({name: name for name in known}, delimiter, "," if comma else ".", units, comment="#")


def _texts(cells: Cells, map_: ColumnMap, name: str) -> list[str]:
    """A column in the units of ncomp."""
    convert = map_.of_time_or_temperature(name, cells.source)
    assert convert is not None
    place = map_.columns[name]
    return [convert(cell, _where(cells, row, place)) for row, cell in enumerate(cells.column(place))]


def _where(cells: Cells, row: int, name: str | int | tuple[str | int, ...]) -> str:
    label = " ".join(map(str, name)) if isinstance(name, tuple) else name
    return f"{cells.source}:{cells.lines[row]}, column {label}"


def _degrees(cells: Cells, name: str, texts: list[str]) -> Array:
    return np.array([checked_degrees(float(text), _where(cells, row, name)) for row, text in enumerate(texts)])


def _times(cells: Cells, name: str, texts: list[str], zone: str) -> Times:
    """The times of the rows; UserError where they go back."""
    if name == TIME:
        return read_times(texts, lambda row: _where(cells, row, name), zone)
    seconds = np.array([number_at(text, _where(cells, row, name)) for row, text in enumerate(texts)])
    if np.any(np.diff(seconds) < 0.0):
        row = int(np.argmax(np.diff(seconds) < 0.0)) + 1
        raise UserError(f"{_where(cells, row, name)}: the time is before that of the last row: sort the rows by time")
    return Times(seconds)
