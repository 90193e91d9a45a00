"""Column maps: what a delimited file does not say of itself, in TOML, and its cells by such a map.

delimiter = ","              # "," ";" "tab" or "blank" (any number of blanks and tabs)
decimal = "."                # or ","
comment = "//"               # lines that begin so are left out; optional
skip_lines = 0               # lines above the names or the data
names = true                 # the first line names the columns; default: true if [columns] has a name
[columns]                    # name in ncomp = column of the file: its name, its number from 1, or several as one
time = ["Date", "Time"]
temp_air = 3
[units]
time = "%d.%m.%Y %H:%M:%S"   # time stamps: their form; of seconds: s, ms, min
temperature = "degC"
"""

from __future__ import annotations

import csv
import datetime
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import msgspec

from kinematics.files import read_input, toml_entries
from kinematics.files.text_cells import (
    TEMPERATURES,
    TIMES,
    ZERO_DEGC,
    number_at,
    numbered_lines,
    unit_size,
)
from kinematics.files.time_stamps import ISO
from kinematics.files.toml_entries import at_line, entry, utf8_text
from kinematics.user_error import UserError

DELIMITERS = {",": ",", ";": ";", "tab": "\t", "blank": None}
TIME, SECONDS, TEMPERATURE = "time", "time_s", "temp_"
"""Columns of time stamps and of times in s, and the prefix of columns of temperatures."""


class ColumnMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Information that a file does not contain."""

    columns: dict[str, str | int | tuple[str | int, ...]]
    delimiter: Literal[",", ";", "tab", "blank"]
    decimal: Literal[".", ","]
    units: dict[str, str] = {}
    header: dict[str, str | int | float | dict[str, str]] = {}
    skip_lines: Annotated[int, msgspec.Meta(ge=0)] = 0
    comment: str = ""
    names: bool | None = None
    reversed: tuple[str, ...] = ()
    join: str = ""

    @property
    def named(self) -> bool:
        """True if the first line names the columns."""
        if self.names is not None:
            return self.names
        return any(not isinstance(each, int) for each in self.columns.values())

    @property
    def keys(self) -> dict[str, str]:
        """The header as keys of the measurement file; TOML reads `target.t1` as a table."""
        flat: dict[str, str] = {}
        for key, value in self.header.items():
            if isinstance(value, dict):
                flat |= {f"{key}.{name}": text for name, text in value.items()}
            else:
                flat[key] = str(value)
        return flat

    def size(self, kind: str, sizes: Mapping[str, float], name: str, source: str) -> float:
        """Size of the unit of a kind of quantity; UserError if the map does not state it. `name` is the column."""
        if kind not in self.units:
            raise UserError(
                f"{source}: its column map does not state the unit of {name}: add [units] {kind} = {'|'.join(sizes)}"
            )
        return unit_size(sizes, self.units[kind], f"{source}: column map, units.{kind}")

    def of_time_or_temperature(self, name: str, source: str) -> Callable[[str, str], str] | None:
        """Conversion of cells to time stamps, s or degC; None for a column of another quantity."""
        if name == TIME:
            return self._stamp
        if name == SECONDS:
            return self.converter(self.size("time", TIMES, name, source))
        if name.startswith(TEMPERATURE):
            size = self.size("temperature", TEMPERATURES, name, source)
            return self.converter(size, ZERO_DEGC[self.units["temperature"]])
        return None

    def converter(self, size: float, shift: float = 0.0) -> Callable[[str, str], str]:
        """Conversion of the text of a number in a unit of this size; its second argument is for messages."""
        if size == 1.0 and shift == 0.0:
            return lambda cell, where: repr(number_at(cell, where, self.decimal))
        return lambda cell, where: repr(number_at(cell, where, self.decimal) * size - shift)

    def _stamp(self, cell: str, where: str) -> str:
        """The time stamp in a cell, as in ISO 8601."""
        form = self.units.get("time", ISO)
        if form == ISO:
            return cell
        if "%" not in form:
            raise UserError(f"column map, units.time: {form!r} is no form of time stamps, such as '%d.%m.%Y %H:%M:%S'")
        try:
            return datetime.datetime.strptime(cell, form).isoformat(" ")
        except ValueError:
            raise UserError(f"{where}: {cell!r} has not the form {form!r} of the column map (units.time)") from None


def read_column_map(path: Path) -> ColumnMap:
    """The map in a file; UserError for an invalid map."""
    where = f"column map {path}"
    text = utf8_text(read_input(path, "column map"), where).removeprefix("\ufeff")
    try:
        found = entry(toml_entries.read_table(text, where), ColumnMap)
    except UserError as fault:
        raise fault if str(fault).startswith(where) else at_line(text, where, fault) from None
    if found.delimiter == found.decimal:
        raise UserError(f"column map {path}: a comma cannot be both the separator of cells and the decimal sign")
    if found.join and found.join not in found.columns:
        raise UserError(f"column map {path}: join {found.join!r} is not one of its columns")
    return found


class Cells(NamedTuple):
    """The cells of a delimited file."""

    source: str
    names: list[str]
    """Names of the columns; empty if the file has none."""
    rows: list[list[str]]
    lines: list[int]
    """Line number of each row."""

    def column(self, requested: str | int | tuple[str | int, ...]) -> list[str]:
        """The cells of a column, given by name or by number from 1, or of several, joined by a blank."""
        if isinstance(requested, tuple):
            return [" ".join(cells) for cells in zip(*map(self.column, requested), strict=True)]
        if isinstance(requested, str):
            if self.names.count(requested) != 1:
                found = ", ".join(self.names) or "none, because the map has names = false"
                raise UserError(
                    f"{self.source}: column {requested!r} is missing or occurs twice; the columns are {found}"
                )
            requested = self.names.index(requested) + 1
        cells = []
        for row, line in zip(self.rows, self.lines, strict=True):
            if not 1 <= requested <= len(row):
                raise UserError(
                    f"{self.source}:{line}: column {requested} is missing: the line has {len(row)} columns{_other(row)}"
                )
            cells.append(row[requested - 1])
        return cells


def cells_of(data: bytes, source: str, columns: ColumnMap) -> Cells:
    """The cells of a file by a column map; UserError for a file without rows."""
    lines = [
        (number, line)
        for number, line in numbered_lines(data)[columns.skip_lines :]
        if line.strip() and not (columns.comment and line.lstrip().startswith(columns.comment))
    ]
    delimiter = DELIMITERS[columns.delimiter]
    numbers, texts = [number for number, _ in lines], [line for _, line in lines]
    rows = [line.split() for line in texts] if delimiter is None else _quoted(texts, numbers, delimiter, source)
    rows = [[cell.strip() for cell in row] for row in rows]
    if not rows:
        raise UserError(f"{source} contains no data")
    return Cells(source, rows[0], rows[1:], numbers[1:]) if columns.named else Cells(source, [], rows, numbers)


def delimiter_of(head: str) -> tuple[Literal[";", "tab", ","], str]:
    """The delimiter of a line of names, by its name and as a character."""
    return (";", ";") if ";" in head else ("tab", "\t") if "\t" in head else (",", ",")


def _quoted(texts: list[str], numbers: list[int], delimiter: str, source: str) -> list[list[str]]:
    """The cells of lines, with quotes; UserError for a quote without an end, which would join lines."""
    with suppress(csv.Error):
        rows = list(csv.reader(texts, delimiter=delimiter, strict=True))
        if len(rows) == len(texts):
            return rows
    for number, text in zip(numbers, texts, strict=True):
        try:
            next(csv.reader([text], delimiter=delimiter, strict=True))
        except csv.Error as fault:
            raise UserError(f"{source}:{number}: a quote has no end, or a text behind it: {fault}") from None
    raise AssertionError("a line has a wrong quote")


def _other(row: list[str]) -> str:
    """Cure for a line that another delimiter divides."""
    mark = next((mark for name, mark in DELIMITERS.items() if mark and len(row) == 1 and mark in row[0]), "")
    return f", and contains {mark!r}: check delimiter in the column map" if mark else ""
