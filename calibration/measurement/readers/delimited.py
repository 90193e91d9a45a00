"""Delimited exports of tracker software (SpatialAnalyzer, PolyWorks, Leica), read by a column map in TOML.

Exports have no common format. The map gives the information that the export lacks: the meaning and unit of each column,
and the uncertainties of the instrument. Nothing is guessed. Maps for some programs are in
`calibration/measurement/readers/maps`:

    delimiter = ","              # "," ";" "tab" or "blank" (any number of blanks and tabs)
    decimal = "."                # or ","
    comment = "//"               # lines that begin so are left out; optional
    skip_lines = 0               # lines above the names or the data
    names = true                 # the first line names the columns; default: true if [columns] has a name
    join = "point"               # optional: the column that is looked up in the plan, by its name there
    reversed = ["EYX_um"]        # optional: error motions whose sign is not that of ISO 230-1 in the export

    [columns]                    # column of the measurement file = column of the export: its name, or number from 1
    point = 3
    x = 4
    y = 5
    z = 6

    [units]                      # of the columns: xyz, linear, rotary (positions of axes), time, temperature, errors
                                 # and angles (error motions: um, mm, inch; urad, arcsec, mrad, deg)
    xyz = "mm"

    [header]                     # header keys of the measurement file
    instrument = "laser-tracker"
    u_range_um = 0.5
    u_angle_um = 5
    target.t1 = "0 0 -120"

An export with names of points only takes the positions of the axes from a plan: a CSV with a column of the same name,
the columns `X`, `Y`, ... and any others of the measurement file, in its units. A point may be measured several times.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from calibration.instruments import error_columns
from calibration.measurement.readers.text import (
    ANGLE_DEVIATIONS,
    ANGLES,
    LENGTH_DEVIATIONS,
    LENGTHS,
    TIMES,
    given_entries,
    number_at,
    numbered_lines,
    unit_size,
)
from calibration.measurement.states import CARRIERS
from calibration.measurement.text_table import Table, read_table, table_of
from kinematics.files import fingerprint, read_input, toml_entries
from kinematics.files.mistaken import did_you_mean, none_of
from kinematics.files.toml_entries import at_line, entry, utf8_text
from kinematics.machine import Machine
from kinematics.user_error import UserError

DELIMITERS = {",": ",", ";": ";", "tab": "\t", "blank": None}
KELVIN = 273.15
TARGET = "target"
"""Column with the name of the reflector."""
MAPS = Path(__file__).parent / "maps"


class ColumnMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Information that an export does not contain."""

    columns: dict[str, str | int]
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
        return any(isinstance(each, str) for each in self.columns.values()) if self.names is None else self.names

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


def read_map(name: str) -> ColumnMap:
    """The shipped map of this name, or the map in this file; UserError for an invalid map."""
    path = MAPS / f"{name}.toml" if name in map_names() else Path(name)
    if path.suffix != ".toml" and not path.exists():
        raise UserError(f"--columns {none_of(name, map_names())}; or give the path of a .toml file")
    where = f"column map {path}"
    text = utf8_text(read_input(path, "column map"), where).removeprefix("\ufeff")
    try:
        found = entry(toml_entries.read_table(text, where), ColumnMap)
    except UserError as fault:
        raise fault if str(fault).startswith(where) else at_line(text, where, fault) from None
    if found.delimiter == found.decimal:
        raise UserError(f"column map {path}: a comma cannot be both the separator of cells and the decimal sign")
    wrong = [each for each in found.reversed if each not in found.columns or not error_columns.NAME.fullmatch(each)]
    if wrong:
        raise UserError(f"column map {path}: reversed {wrong[0]!r} is not one of its columns of error motions")
    if found.join and found.join not in found.columns:
        raise UserError(f"column map {path}: join {found.join!r} is not one of its columns")
    return found


def map_names() -> list[str]:
    """Names of the shipped maps."""
    return sorted(path.stem for path in MAPS.glob("*.toml"))


def to_table(
    data: bytes, source: str, machine: Machine, header: Mapping[str, str], columns: ColumnMap, plan: Path | None
) -> tuple[Table, list[str]]:
    """The export as a table of the contract's columns, and notes."""
    names, rows, lines = _cells(data, source, columns)
    texts = {}
    for name, requested in columns.columns.items():
        cells = _column(names, rows, lines, requested, source)
        if name != columns.join:
            convert = _converter(name, machine, columns, source)
            cells = [
                convert(cell, f"{source}:{line} column {requested}") for cell, line in zip(cells, lines, strict=True)
            ]
        texts[name] = cells
    notes, stated = list[str](), dict[str, str]()
    if columns.join:
        if plan is None:
            raise UserError(f"{source}: its column map looks up {columns.join!r} in a plan: give --plan PLAN.csv")
        plan_table = read_table(plan, "plan")
        texts = _joined(texts, columns.join, plan_table, lines, source, notes)
        stated = {key: each.value for key, each in plan_table.entries.items() if key.partition(".")[0] in CARRIERS}
    entries = given_entries(header, {**stated, **columns.keys})
    return table_of(source, fingerprint(data), entries, texts, lines), notes


def _cells(data: bytes, source: str, columns: ColumnMap) -> tuple[list[str], list[list[str]], list[int]]:
    """Names of the columns (empty if the export has none), rows of cells, and their line numbers."""
    lines = [
        (number, line)
        for number, line in numbered_lines(data)[columns.skip_lines :]
        if line.strip() and not (columns.comment and line.lstrip().startswith(columns.comment))
    ]
    delimiter = DELIMITERS[columns.delimiter]
    texts = [line for _, line in lines]
    rows = [line.split() for line in texts] if delimiter is None else list(csv.reader(texts, delimiter=delimiter))
    rows = [[cell.strip() for cell in row] for row in rows]
    numbers = [number for number, _ in lines]
    if not rows:
        raise UserError(f"{source} contains no data")
    return (rows[0], rows[1:], numbers[1:]) if columns.named else ([], rows, numbers)


def _column(names: list[str], rows: list[list[str]], lines: list[int], requested: str | int, source: str) -> list[str]:
    """The cells of a column, given by name or by number from 1."""
    if isinstance(requested, str):
        if names.count(requested) != 1:
            found = ", ".join(names) or "none, because the map has names = false"
            raise UserError(f"{source}: column {requested!r} is missing or occurs twice; the columns are {found}")
        requested = names.index(requested) + 1
    cells = []
    for row, line in zip(rows, lines, strict=True):
        if not 1 <= requested <= len(row):
            raise UserError(
                f"{source}:{line}: column {requested} is missing: the line has {len(row)} columns{_other(row)}"
            )
        cells.append(row[requested - 1])
    return cells


def _other(row: list[str]) -> str:
    """Cure for a line that another delimiter divides."""
    mark = next((mark for name, mark in DELIMITERS.items() if mark and len(row) == 1 and mark in row[0]), "")
    return f", and contains {mark!r}: check delimiter in the column map" if mark else ""


def _converter(name: str, machine: Machine, columns: ColumnMap, source: str) -> Callable[[str, str], str]:
    """Conversion of a cell of the export to one of the measurement file; its second argument is for messages."""
    axis = name.removeprefix("actual_")
    if name in ("x", "y", "z"):
        size, shift = _unit(columns, "xyz", LENGTHS, name, source), 0.0
    elif axis in machine.names:
        rotary = machine.axes[machine.index(axis)].rotary
        kind, sizes = ("rotary", ANGLES) if rotary else ("linear", LENGTHS)
        size, shift = _unit(columns, kind, sizes, name, source), 0.0
    elif name == "time_s":
        size, shift = _unit(columns, "time", TIMES, name, source), 0.0
    elif error := error_columns.NAME.fullmatch(name):
        kind, sizes = ("errors", LENGTH_DEVIATIONS) if error[3] == "um" else ("angles", ANGLE_DEVIATIONS)
        size, shift = _unit(columns, kind, sizes, name, source), 0.0
    elif name.startswith("temp_"):
        size = _unit(columns, "temperature", {"degC": 1.0, "K": 1.0}, name, source)
        shift = KELVIN if columns.units["temperature"] == "K" else 0.0
    else:
        return lambda cell, _: cell
    if name in columns.reversed:
        size = -size
    if size == 1.0 and shift == 0.0:
        return lambda cell, where: repr(number_at(cell, where, columns.decimal))
    return lambda cell, where: repr(number_at(cell, where, columns.decimal) * size - shift)


def _unit(columns: ColumnMap, kind: str, sizes: Mapping[str, float], name: str, source: str) -> float:
    if kind not in columns.units:
        raise UserError(
            f"{source}: its column map does not state the unit of {name}: add [units] {kind} = {'|'.join(sizes)}"
        )
    return unit_size(sizes, columns.units[kind], f"{source}: column map, units.{kind}")


def _joined(
    texts: Mapping[str, list[str]], key: str, plan_table: Table, lines: list[int], source: str, notes: list[str]
) -> dict[str, list[str]]:
    """The columns, together with those of the plan for the names in the column `key`.

    If both have a column `target`, a row is looked up by its name and its target.
    """
    plan_table.need_columns([key], "a plan")
    both = set(plan_table.names) & set(texts)
    keys = sorted(both & {key, TARGET}, key=lambda name: name == TARGET)
    if twice := both - set(keys):
        raise UserError(f"{plan_table.head} column {', '.join(sorted(twice))} occurs in the export too")
    names = _names(plan_table.texts(keys), keys)
    rows = {name: i for i, name in enumerate(names)}
    if len(rows) < len(names):
        again = next(i for i, name in enumerate(names) if name in names[:i])
        cure = "give each observation its own name in plan and export"
        cure += ", or map a column target too" if TARGET in plan_table.names and TARGET not in texts else ""
        plan_table.fault(again, key, f"{names[again]!r} occurs twice: {cure}")
    measured = _names(texts, keys)
    for name, line in zip(measured, lines, strict=True):
        if name not in rows:
            where = f"{source}:{line} column {key}"
            raise UserError(f"{where}: {name!r} is not in the plan {plan_table.source}{did_you_mean(name, rows)}")
    missing = [name for name in names if name not in set(measured)]
    if missing:
        more = ", ..." if len(missing) > 5 else ""
        notes.append(f"points of the plan that were not measured, {len(missing)}: {', '.join(missing[:5])}{more}")
    order = [rows[name] for name in measured]
    requested = [name for name in plan_table.names if name not in keys]
    found = {name: column[order].tolist() for name, column in plan_table.cells(requested).items()}
    return {**found, **{name: column for name, column in texts.items() if name != key}}


def _names(columns: Mapping[str, Iterable[str]], keys: list[str]) -> list[str]:
    """The names of rows by their key columns: `P1`, or `P1 t1` with a target."""
    return [" ".join(cells) for cells in zip(*(columns[key] for key in keys), strict=True)]
