"""Measurements from files of any known format: each is converted to a table of the contract's columns.

A format is recognised from the text of the file, never from units or numbers. Information that the file lacks
(uncertainties of the instrument, position of the target, an axis) is given in addition, with the header keys of the
measurement file.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from calibration.measurement.file import measurement_of
from calibration.measurement.logged import with_log, with_seconds
from calibration.measurement.measurement import Measurement
from calibration.measurement.measuring_date import MEASURED, date_in
from calibration.measurement.readers import (
    ballbar_angles,
    cmm,
    delimited,
    ecmc_report,
    epics,
    iso230_table,
    protocols,
    renishaw,
    robot_tables,
    target_readings,
    twincat_scope,
)
from calibration.measurement.readers.text import given_entries
from calibration.measurement.text_table import Entry, Table, parse_table, refuse_empty
from kinematics.files import read_input
from kinematics.files.mistaken import kind_of_file, none_of
from kinematics.files.temperature_log import TemperatureLog
from kinematics.files.text_cells import old_text
from kinematics.machine import Machine
from kinematics.user_error import UserError


class Reader(NamedTuple):
    """A format: a test of the beginning of a file, and the conversion to a table, with notes."""

    recognises: Callable[[str], bool]
    to_table: Callable[[bytes, str, Machine, Mapping[str, str]], tuple[Table, list[str]]]


FOREIGN: Mapping[str, Reader] = {
    "rtl": Reader(renishaw.recognises, renishaw.to_table),
    "iso230-table": Reader(iso230_table.recognises, iso230_table.to_table),
    "ecmc-report": Reader(ecmc_report.recognises, ecmc_report.to_table),
    "cmm": Reader(cmm.recognises, cmm.to_table),
    "epics": Reader(epics.recognises, epics.to_table),
    "twincat-scope": Reader(twincat_scope.recognises, twincat_scope.to_table),
    "ballbar-angles": Reader(ballbar_angles.recognises, ballbar_angles.to_table),
    "target-readings": Reader(target_readings.recognises, target_readings.to_table),
}
FORMATS = ("auto", "ncomp", *FOREIGN, "robot", "delimited")
KNOWN = (
    "ncomp (measurement file, '# instrument: ...'), rtl (Renishaw), iso230-table (targets by runs, 'target_mm, 1 up, "
    "1 down, ...'), ecmc-report (Markdown, 'ISO 230-2 motion test'), cmm ('Meas X Meas Y Nom X Nom Y ...'), epics "
    "('NAME date time value'), twincat-scope (CSV, 'Starttime of export'), ballbar-angles ('angle_deg,deviation_um,"
    "run'), target-readings ('target_mm,reading_mm'), robot (points 'x y z', and joints 'J1 J2 ...' in the same file "
    "or as the plan), delimited (any columns, with a column map: --columns MAP.toml)"
)
FORMAT_HEAD_BYTES = 20_000
"""Number of bytes from which a format is recognised."""


def read_any(
    path: Path,
    machine: Machine,
    format: str = "auto",
    *,
    header: Mapping[str, str] | None = None,
    columns: str | None = None,
    plan: Path | None = None,
    log: TemperatureLog | None = None,
) -> Measurement:
    """The measurement in a file of one of FORMATS; UserError with a list of these for another format.

    header: keys of the measurement file that this file lacks or that replace its own. columns: name or path of the
    column map of a delimited export. plan: CSV with the positions for the names of points, or with the positions of the
    standstills in a tracker's log. log: temperatures by time, joined to the rows.
    """
    table, notes = table_in(path, machine, format, header=header, columns=columns, plan=plan, log=log)
    measurement = measurement_of(table, machine)
    return replace(measurement, notes=(*notes, *measurement.notes))


def table_in(
    path: Path,
    machine: Machine,
    format: str = "auto",
    *,
    header: Mapping[str, str] | None = None,
    columns: str | None = None,
    plan: Path | None = None,
    log: TemperatureLog | None = None,
) -> tuple[Table, list[str]]:
    """The table of the contract's columns from a file, and notes; arguments as in `read_any`."""
    data, given = read_input(path, "measurement file"), dict(header or {})
    if format not in FORMATS:
        raise UserError(f"format {none_of(format, FORMATS)}")
    refuse_empty(data, str(path))
    if columns is not None and format == "auto":
        format = "delimited"
    elif format == "auto":
        format = _recognised(data, path)
    table, notes = _table(data, path, machine, format, given, columns, plan)
    if log is None:
        return table, notes
    table, more = with_log(table, log)
    return table, [*notes, *more]


def _table(
    data: bytes,
    path: Path,
    machine: Machine,
    format: str,
    header: Mapping[str, str],
    columns: str | None,
    plan: Path | None,
) -> tuple[Table, list[str]]:
    """The table of the contract's columns, and notes."""
    source = str(path)
    if format == "delimited":
        return _delimited(data, source, machine, header, columns, plan)
    if columns is not None:
        raise UserError(f"{source}: a column map is for delimited exports, not for format {format}")
    if format == "ncomp":
        table = parse_table(data, source)
        table = replace(table, entries={**table.entries, **given_entries(header, {})})
        return _at_standstills(with_seconds(table), machine, plan)
    if format == "robot":
        return robot_tables.to_table(data, source, machine, header, plan)
    if plan is not None:
        raise UserError(f"{source}: a plan is for a tracker's log and for delimited exports, not for format {format}")
    table, notes = FOREIGN[format].to_table(data, source, machine, header)
    date = date_in(old_text(data[:FORMAT_HEAD_BYTES]).replace("\r", "\n"))
    if date is None or MEASURED in table.entries:
        return table, notes
    return replace(table, entries={**table.entries, MEASURED: Entry(str(date))}), notes


def _delimited(
    data: bytes, source: str, machine: Machine, header: Mapping[str, str], columns: str | None, plan: Path | None
) -> tuple[Table, list[str]]:
    """The table of the contract's columns from a file with a column map, and notes."""
    if columns is None:
        raise UserError(
            f"{source}: a delimited export needs a column map: {', '.join(delimited.map_names())}, or a .toml file"
        )
    column_map = delimited.read_map(columns)
    table, notes = delimited.to_table(data, source, machine, header, column_map, plan if column_map.join else None)
    table, more = with_seconds(table), list[str]()
    if ballbar_angles.in_columns(table.names):
        table, more = ballbar_angles.of_angles(table, machine)
    elif any(reading in table.names for _, reading in target_readings.PAIRS):
        table = target_readings.with_deviations(table, machine)
    elif not column_map.join:
        table, more = _at_standstills(table, machine, plan)
    return table, [*notes, *more]


def _at_standstills(table: Table, machine: Machine, plan: Path | None) -> tuple[Table, list[str]]:
    """The table, or the standstills at the plan's positions for a tracker's log with a plan; and notes."""
    if plan is None:
        return table, []
    from calibration.measurement.standstill.reading import is_log, standstills

    if not is_log(table, machine):
        raise UserError(
            f"{table.head}: a plan needs either a tracker's log with the columns time_s, x, y, z, without positions of "
            "axes, or names of points and a column map with 'join'"
        )
    return standstills(table, plan, machine)


def _recognised(data: bytes, path: Path) -> str:
    head = old_text(data[:FORMAT_HEAD_BYTES]).replace("\r\n", "\n")
    names = [line for line in head.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    for name, reader in FOREIGN.items():
        if reader.recognises(head):
            return name
    if robot_tables.recognises(head):
        return "robot"
    if re.search(r"^\s*(Gridpoints|VALUE)\s*=", head, re.MULTILINE) and re.search(
        r"^\s*\[\s*\w+\s*\]", head, re.MULTILINE
    ):
        raise UserError(
            f"{path}: an Etalon exchange file contains errors of the machine, not measurements of it; "
            "ncomp import --format etalon reads it"
        )
    if "# instrument" in head or (names and "," in names[0] and head.lstrip().startswith("#")):
        return "ncomp"
    kind = kind_of_file(data)
    utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    protocol = protocols.refused(data[:FORMAT_HEAD_BYTES].decode("utf-16", "replace") if utf16 else head, str(path))
    if protocol and kind != "an NC program":
        raise UserError(protocol)
    if kind:
        raise UserError(f"{path}: this is {kind}, no measurement: give the data of an instrument")
    if utf16:
        raise UserError(f"{path} is UTF-16 text: save it as plain text (CSV, UTF-8)")
    if b"\0" in data[:FORMAT_HEAD_BYTES]:
        raise UserError(f"{path} is a binary file, no measurement: give the data of an instrument as text")
    named = iso230_table.meant(head)
    cure = f"{named}; otherwise give a column map" if named else "give a column map"
    raise UserError(
        f"{path}: the format of the file is unknown: {cure} (--columns MAP.toml, docs/measurements/formats.md); known "
        f"formats are {KNOWN}"
    )
