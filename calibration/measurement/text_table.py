"""Tables in text: header lines `# key: value`, column names, and cells by column, with line numbers for messages."""

from __future__ import annotations

import codecs
import csv
import difflib
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from kinematics.files import fingerprint, read_input
from kinematics.files.mistaken import not_utf8, number_hint
from kinematics.files.text_cells import LARGEST_NUMBER, number_of
from kinematics.transforms import Array
from kinematics.user_error import UserError

MOST_LINE_CHARACTERS = 100_000
"""Most characters of a line; one cell of a CSV file may not have many more."""
EMPTY = "empty: fill it in, or delete the row"
NO_NUMBER = f"is no number within ±{LARGEST_NUMBER:g}: correct it, or delete the row"


class Entry(NamedTuple):
    """The value of a header key, and its line; 0 for a key given in addition to the file."""

    value: str
    line: int = 0


@dataclass(frozen=True)
class Table:
    """The text of a table, whose cells are read on request."""

    source: str
    fingerprint: str
    entries: Mapping[str, Entry]
    """Header values by key."""
    remarks: tuple[Entry, ...]
    """Header lines that are not `key: value`."""
    names: tuple[str, ...]
    """Names of the columns, in order."""
    names_line: int
    rows: Sequence[str]
    lines: np.ndarray
    """Line number in the file `(n,)` of each row."""
    delimiter: str = ","
    above: Sequence[str] = ()
    """Lines of the file up to the names of columns."""

    def __len__(self) -> int:
        return len(self.rows)

    def numbers(self, names: Sequence[str]) -> dict[str, Array]:
        """Columns `(n,)` of numbers up to `LARGEST_NUMBER`; UserError with line and column of the first other cell."""
        if not names:
            return {}
        try:
            values = self._load(names, float)
        except ValueError:
            values = np.array([[math.nan]])
        if not np.all(np.abs(values) <= LARGEST_NUMBER):
            self._find_bad(names)
        return dict(zip(names, values.T.copy(), strict=True))

    def texts(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Columns `(n,)` of texts without surrounding blanks; UserError with line and column for an empty cell."""
        columns = self.cells(names)
        for name, column in columns.items():
            empty = np.flatnonzero(column == "")
            if len(empty):
                self.fault(int(empty[0]), name, EMPTY)
        return columns

    def cells(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Columns `(n,)` of texts without surrounding blanks; cells may be empty."""
        return {name: np.char.strip(column) for name, column in zip(names, self._load(names, str).T, strict=True)}

    @property
    def head(self) -> str:
        """Source and line of the column names, for messages."""
        return f"{self.source}:{self.names_line}" if self.names_line else self.source

    def fault(self, row: int, name: str, reason: str) -> NoReturn:
        """Raise a UserError for a cell."""
        raise UserError(f"{self.source}:{self.lines[row]} column {name}: {reason}")

    def header_fault(self, key: str, reason: str) -> NoReturn:
        """Raise a UserError for a header line."""
        line = self.entries[key].line
        raise UserError(f"{self.source}{f':{line}' if line else ''} {key}: {reason}")

    def header_numbers(self, key: str, count: int) -> tuple[float, ...]:
        """`count` numbers up to `LARGEST_NUMBER` in a header line, separated by blanks or commas; else UserError."""
        cells = self.entries[key].value.replace(",", " ").split()
        values = [number_of(cell) for cell in cells]
        if len(values) != count or None in values:
            label = "a number" if count == 1 else f"{count} numbers"
            self.header_fault(
                key, f"expected {label}, got {self.entries[key].value!r}{number_hint(self.entries[key].value)}"
            )
        return tuple(value for value in values if value is not None)

    def allow_columns(self, known: Callable[[str], bool], listed: Sequence[str]) -> None:
        """UserError for the first unknown column; it lists the known ones."""
        for name in self.names:
            if not known(name):
                near = difflib.get_close_matches(name, listed, n=1)
                meant = f" (did you mean {near[0]}?)" if near else ""
                raise UserError(f"{self.head} column {name}: not known{meant}; known are {', '.join(listed)}")

    def with_rows(self, columns: Mapping[str, Sequence[str]], lines: Sequence[int]) -> Table:
        """The table with other columns `(n,)` of texts, and the line in the file of each row; its header stays."""
        other = table_of(self.source, self.fingerprint, self.entries, columns, lines)
        return replace(other, remarks=self.remarks, names_line=self.names_line)

    def need_columns(self, names: Sequence[str], label: str) -> None:
        """UserError for missing columns."""
        missing = [name for name in names if name not in self.names]
        if missing:
            columns = f"column{'s' if len(missing) > 1 else ''} {', '.join(missing)}"
            raise UserError(f"{self.head} {label}: {columns} missing, found {', '.join(self.names)}")

    def _load(self, names: Sequence[str], kind: type) -> np.ndarray:
        """Cells `(n, names)` of the given type."""
        where = [self.names.index(name) for name in names]
        return np.loadtxt(
            self.rows, dtype=kind, delimiter=self.delimiter, usecols=where, ndmin=2, comments=None, quotechar='"'
        )

    def _find_bad(self, names: Sequence[str]) -> NoReturn:
        for row, cells in enumerate(csv.reader(self.rows, delimiter=self.delimiter)):
            for name in names:
                cell = cells[self.names.index(name)].strip()
                if number_of(cell) is None:
                    self.fault(
                        row,
                        name,
                        f"{cell!r} {NO_NUMBER}{number_hint(cell)}" if cell else EMPTY,
                    )
        raise AssertionError("every cell is a number")


def read_table(path: Path, label: str) -> Table:
    """The table in a file; UserError, naming the kind of file, if it cannot be read."""
    return parse_table(read_input(path, label), str(path))


def parse_table(data: bytes, source: str) -> Table:
    """The table in UTF-8 text with commas between cells; `source` is its name in messages."""
    lines = text_lines(data, source)
    refuse_empty(data, source)
    entries: dict[str, Entry] = {}
    remarks: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        content = line.strip()
        if content.startswith("#"):
            _take_header(content[1:].strip(), number, entries, remarks, source)
        elif content:
            break
    else:
        raise UserError(f"{source}: the line with the names of columns is missing")
    names = tuple(name.strip() for name in next(csv.reader([line])))
    if 2 * sum(number_of(name) is not None for name in names) > len(names):
        raise UserError(f"{source}:{number}: the line with the names of columns above the numbers is missing")
    if len(names) == 1 and (";" in line or "\t" in line):
        raise UserError(f"{source}:{number}: separate cells by commas, and write numbers with a decimal point")
    for name in names:
        if not name or names.count(name) > 1:
            reason = "twice: delete or rename one of them" if name else "without a name: name it, or delete it"
            raise UserError(f"{source}:{number} column {name}: {reason}")
    table = Table(source, fingerprint(data), entries, tuple(remarks), names, number, (), np.empty(0, int))
    return body(replace(table, above=lines[:number]), lines)


def table_of(
    source: str, digest: str, entries: Mapping[str, Entry], columns: Mapping[str, Sequence[str]], lines: Sequence[int]
) -> Table:
    """A table from columns `(n,)` of texts without line ends; UserError without rows."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(zip(*columns.values(), strict=True))
    rows = text.getvalue().split("\n")[:-1]
    if not rows:
        raise UserError(f"{source} contains no observations")
    return Table(source, digest, entries, (), tuple(columns), 0, rows, np.array(lines))


def body(table: Table, lines: Sequence[str]) -> Table:
    """The table with the rows below its column names, without blank ones; UserError for a row of the wrong length."""
    first = table.names_line
    filled = [(number, line) for number, line in enumerate(lines[first:], start=first + 1) if line and line.strip()]
    if not filled:
        raise UserError(f"{table.source}: there are no rows below the names of columns: export it again with its rows")
    numbers, rows = zip(*filled, strict=True)
    expected, delimiter = len(table.names), table.delimiter
    for number, row in filled:
        if row.count(delimiter) != expected - 1 or '"' in row:
            _check_row(row, f"{table.source}:{number}", expected, delimiter)
    return replace(table, rows=rows, lines=np.array(numbers))


def _check_row(row: str, where: str, expected: int, delimiter: str) -> None:
    if row.lstrip().startswith("#"):
        raise UserError(f"{where}: header lines must be above the names of columns: move it there, or delete it")
    try:
        count = len(next(csv.reader([row], delimiter=delimiter, strict=True)))
    except csv.Error as fault:
        reason = "a cell begins with a quote and has no end" if "unexpected end" in str(fault) else str(fault)
        raise UserError(f"{where}: {reason}: correct the row, or delete it") from None
    if count != expected:
        hint = " (a decimal comma?)" if count > expected and delimiter == "," else ""
        raise UserError(
            f"{where}: {count} cells, but {expected} columns have names{hint}: complete the row, or delete it"
        )


def refuse_empty(data: bytes, source: str) -> None:
    """UserError for a file with nothing but blanks."""
    if not data.removeprefix(codecs.BOM_UTF8).strip():
        raise UserError(f"{source} is empty: export it again from the instrument")


def text_lines(data: bytes, source: str) -> list[str]:
    """Lines of UTF-8 text, with any line ends, with or without a byte order mark; UserError for other content."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise UserError(f"{source}:{line}: {not_utf8(data)}") from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise UserError(f"{source}:{line}: a zero byte, so the file is damaged or no text: export it again")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if long := next((number for number, line in enumerate(lines, start=1) if len(line) > MOST_LINE_CHARACTERS), None):
        raise UserError(
            f"{source}:{long}: a line of more than {MOST_LINE_CHARACTERS} characters: this is no table; export it again"
        )
    return lines


def _take_header(text: str, line: int, entries: dict[str, Entry], remarks: list[Entry], source: str) -> None:
    key, colon, value = (part.strip() for part in text.partition(":"))
    if not colon:
        remarks.append(Entry(text, line))
    elif key in entries:
        raise UserError(f"{source}:{line} {key}: given before, in line {entries[key].line}: delete one of them")
    else:
        entries[key] = Entry(value, line)
