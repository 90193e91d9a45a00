"""Delimited exports of tracker software (SpatialAnalyzer, PolyWorks, Leica), read by a column map in TOML.

Exports have no common format. The map gives the information that the export lacks: the meaning and unit of each column,
and the uncertainties of the instrument. Nothing is guessed. Maps for some programs are in
`calibration/measurement/readers/maps`:

    delimiter = ","              # form of the file, and columns: kinematics/files/column_map.py
    decimal = "."
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

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.instruments import error_columns
from calibration.measurement.readers.text import given_entries
from calibration.measurement.states import CARRIERS
from calibration.measurement.text_table import Entry, Table, read_table, table_of
from kinematics.files import fingerprint
from kinematics.files.column_map import SECONDS, TIME, ColumnMap, cells_of, delimiter_of, read_column_map
from kinematics.files.mistaken import did_you_mean, none_of
from kinematics.files.text_cells import ANGLE_DEVIATIONS, ANGLES, LENGTH_DEVIATIONS, LENGTHS, numbered_lines
from kinematics.machine import Machine
from kinematics.user_error import UserError

BY_NAME: Mapping[str, tuple[str, Mapping[str, float], str]] = {
    "_mm": ("linear", LENGTHS, "mm"),
    "_deg": ("rotary", ANGLES, "deg"),
    "_um": ("errors", LENGTH_DEVIATIONS, "um"),
    "_urad": ("angles", ANGLE_DEVIATIONS, "urad"),
}
"""Kind of quantity and unit of a column by the end of its name; the map need not state this unit."""
TARGET = "target"
"""Column with the name of the reflector."""
MAPS = Path(__file__).parent / "maps"


def read_map(name: str) -> ColumnMap:
    """The shipped map of this name, or the map in this file; UserError for an invalid map."""
    path = MAPS / f"{name}.toml" if name in map_names() else Path(name)
    if path.suffix != ".toml" and not path.exists():
        raise UserError(f"--columns {none_of(name, map_names())}; or give the path of a .toml file")
    found = read_column_map(path)
    wrong = [each for each in found.reversed if each not in found.columns or not error_columns.NAME.fullmatch(each)]
    if wrong:
        raise UserError(f"column map {path}: reversed {wrong[0]!r} is not one of its columns of error motions")
    return found


def map_names() -> list[str]:
    """Names of the shipped maps."""
    return sorted(path.stem for path in MAPS.glob("*.toml"))


def to_table(
    data: bytes, source: str, machine: Machine, header: Mapping[str, str], columns: ColumnMap, plan: Path | None
) -> tuple[Table, list[str]]:
    """The export as a table of the contract's columns, and notes."""
    read, texts = cells_of(data, source, columns), dict[str, list[str]]()
    lines = read.lines
    for name, requested in columns.columns.items():
        cells = read.column(requested)
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


def names_in(head: str) -> list[str]:
    """The names of the columns in the first line that is no header line, by the separator that it shows."""
    line = next((line for line in head.splitlines() if line.strip() and not line.lstrip().startswith("#")), "")
    return [name.strip() for name in line.split(delimiter_of(line)[1])]


def plain_table(
    data: bytes,
    source: str,
    machine: Machine,
    header: Mapping[str, str],
    named: Callable[[str], str] = lambda name: name,
) -> tuple[Table, list[str]]:
    """A table whose first lines are `# key: value` and names of columns, and notes; `named` gives these their meaning.

    The separator is `,` `;` or a tab; with the latter two a decimal comma is also read.
    """
    lines = [(number, line.strip()) for number, line in numbered_lines(data) if line.strip()]
    (names_line, names), *rows = [(number, line) for number, line in lines if line[0] != "#"]
    delimiter, mark = delimiter_of(names)
    comma = delimiter != "," and any("," in line for _, line in rows)
    entries = {}
    for number, line in lines:
        if line[0] == "#":
            key, _, value = (part.strip() for part in line[1:].partition(":"))
            entries[key] = Entry(value.replace(",", ".") if comma else value, number)
    columns: dict[str, Any] = {named(name.strip()): name.strip() for name in names.split(mark)}
    own = ColumnMap(columns, delimiter, "," if comma else ".", comment="#")
    table, notes = to_table(data, source, machine, header, own, None)
    return replace(table, entries={**entries, **table.entries}, names_line=names_line), notes


def _converter(name: str, machine: Machine, columns: ColumnMap, source: str) -> Callable[[str, str], str]:
    """Conversion of a cell of the export to one of the measurement file; its second argument is for messages."""
    axis = name.removeprefix("actual_")
    if convert := columns.of_time_or_temperature(name, source):
        return convert
    if name in ("x", "y", "z"):
        kind, sizes = "xyz", LENGTHS
    elif axis in machine.names:
        rotary = machine.axes[machine.index(axis)].rotary
        kind, sizes = ("rotary", ANGLES) if rotary else ("linear", LENGTHS)
    elif error := error_columns.NAME.fullmatch(name):
        kind, sizes = ("errors", LENGTH_DEVIATIONS) if error[3] == "um" else ("angles", ANGLE_DEVIATIONS)
    elif by_name := next((unit for ending, unit in BY_NAME.items() if name.endswith(ending)), None):
        kind, sizes, own = by_name
        return columns.converter(columns.size(kind, sizes, name, source) if kind in columns.units else sizes[own])
    else:
        return lambda cell, _: cell
    size = columns.size(kind, sizes, name, source)
    return columns.converter(-size if name in columns.reversed else size)


def _joined(
    texts: Mapping[str, list[str]], key: str, plan_table: Table, lines: list[int], source: str, notes: list[str]
) -> dict[str, list[str]]:
    """The columns, together with those of the plan for the names in the column `key`.

    If both have a column `target`, a row is looked up by its name and its target.
    """
    plan_table.need_columns([key], "a plan")
    planned = [name for name in plan_table.names if name != SECONDS or not {TIME, SECONDS} & set(texts)]
    both = set(planned) & set(texts)
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
    requested = [name for name in planned if name not in keys]
    found = {name: column[order].tolist() for name, column in plan_table.cells(requested).items()}
    if SECONDS in found:
        notes.append(f"the export has no times: those that {plan_table.source} plans stand in for them")
    return {**found, **{name: column for name, column in texts.items() if name != key}}


def _names(columns: Mapping[str, Iterable[str]], keys: list[str]) -> list[str]:
    """The names of rows by their key columns: `P1`, or `P1 t1` with a target."""
    return [" ".join(cells) for cells in zip(*(columns[key] for key in keys), strict=True)]
