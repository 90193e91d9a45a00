"""Rows by the clock: their time stamps as seconds, and the temperatures that a logger took at these times."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.measurement.measuring_date import MEASURED
from calibration.measurement.text_table import Entry, Table
from kinematics.files.column_map import SECONDS, TEMPERATURE, TIME
from kinematics.files.temperature_log import TemperatureLog
from kinematics.files.time_stamps import SUMMER_TIME_STEP_S, ZONE, moment, read_times, seconds_between
from kinematics.transforms import Array
from kinematics.user_error import UserError

LARGEST_ZONE_DIFFERENCE_H = 14
"""Largest difference of two time zones from UTC that a clock may be wrong by, h."""


def is_clock(name: str) -> bool:
    """True for a column of times in s, or of temperatures."""
    return name == SECONDS or name.startswith(TEMPERATURE)


def with_seconds(table: Table) -> Table:
    """The table with the column time_s in place of time stamps; the first one is its date."""
    if TIME not in table.names:
        return table
    if SECONDS in table.names:
        raise UserError(f"{table.head} column {TIME}: the table has {SECONDS} too: delete one of them")

    def where(row: int) -> str:
        return f"{table.source}:{table.lines[row]} column {TIME}"

    columns = {name: column.tolist() for name, column in table.cells(table.names).items()}
    zone = table.entries[ZONE].value if ZONE in table.entries else ""
    times = read_times(table.texts([TIME])[TIME].tolist(), where, zone)
    assert times.start is not None
    if MEASURED in table.entries and not table.entries[MEASURED].value.startswith(f"{times.start.date()}"):
        table.header_fault(MEASURED, f"the first time stamp is of {times.start.date()}: correct one of the two dates")
    columns = {SECONDS: [repr(round(second, 6)) for second in times.seconds.tolist()], **columns}
    del columns[TIME]
    return with_columns(table, columns, {MEASURED: times.start.isoformat(" ")})


def with_log(table: Table, log: TemperatureLog) -> tuple[Table, list[str]]:
    """The table with the temperatures of a log at the times of its rows, and notes; UserError for other times."""
    if SECONDS not in table.names:
        raise UserError(
            f"{table.head}: {log.source} is joined by time, and the rows have none: add the column {TIME} "
            f"(2026-11-30 09:12:05) or {SECONDS}"
        )
    names = {f"{TEMPERATURE}{sensor}": course for sensor, course in log.temperatures.items()}
    if not names:
        raise UserError(f"{log.source}: it has no column of temperatures ({TEMPERATURE}NAME)")
    for name in names:
        if name in table.names:
            raise UserError(f"{table.head} column {name}: {log.source} has it too: delete it, or rename one of them")
    shift, clock = _shift(table, log)
    time = table.numbers([SECONDS])[SECONDS] + shift
    _check_overlap(table, log, time)
    seconds = log.times.seconds
    columns = {name: column.tolist() for name, column in table.cells(table.names).items()}
    columns |= {
        name: [repr(t) for t in np.interp(time, seconds, course).round(4).tolist()] for name, course in names.items()
    }
    apart = float(np.abs(time[:, None] - seconds[_around(seconds, time)]).min(axis=1).max())
    notes = [f"{log.source}: {clock}; no row is more than {apart:.3g} s from a reading of the log"]
    if "minutes" in table.entries:
        notes.append(f"the file was made from a plan: its {SECONDS} are planned times unless you replaced them")
    return with_columns(table, columns), notes


def with_columns(table: Table, columns: dict[str, list[str]], entries: dict[str, str] | None = None) -> Table:
    """The table with other columns `(n,)` of texts, and with further header entries."""
    other = table.with_rows(columns, table.lines.tolist())
    return replace(other, entries={**table.entries, **{key: Entry(value) for key, value in (entries or {}).items()}})


def _shift(table: Table, log: TemperatureLog) -> tuple[float, str]:
    """Time of the log at second 0 of the table, s, and a sentence on the clocks."""
    stated, start = table.entries.get(MEASURED), log.times.start
    zone = table.entries[ZONE].value if ZONE in table.entries else ""
    has_time = stated is not None and ":" in stated.value
    if start is None:
        if has_time:
            raise UserError(
                f"{log.source}: the rows of {table.source} have time stamps, and the log {SECONDS}: give the log a "
                f"column {TIME} (2026-11-30 09:12:05), or the rows {SECONDS} alone"
            )
        return 0.0, f"its {SECONDS} and that of the rows are taken as one clock"
    if stated is None or not has_time:
        raise UserError(
            f"{table.head}: {log.source} has time stamps, and the rows {SECONDS}: state the date and time of second 0 "
            f"(--measured '{start.date()} 09:12:05'), or give the rows a column {TIME}"
        )
    first = moment(stated.value, f"{table.source} {MEASURED}", zone)
    if (first.tzinfo is None) != (start.tzinfo is None):
        one = "log" if first.tzinfo is None else "measurement"
        raise UserError(
            f"{log.source}: only the {one} states its zone: state that of the other clock too (# {ZONE}: Europe/Berlin)"
        )
    clock = f"zones {start.tzinfo} and {first.tzinfo}"
    if start.tzinfo is None:
        clock = f"no zone is stated, and its clock is taken as that of the rows (# {ZONE}: Europe/Berlin states it)"
    return seconds_between(start, first), clock


def _check_overlap(table: Table, log: TemperatureLog, time: Array) -> None:
    """UserError for a row before or after the log, by more than from reading to reading of the log."""
    seconds = log.times.seconds
    usual = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    outside = (time < seconds[0] - usual) | (time > seconds[-1] + usual)
    if not outside.any():
        return
    row = int(np.argmax(outside))
    hours = sorted(range(-LARGEST_ZONE_DIFFERENCE_H, LARGEST_ZONE_DIFFERENCE_H + 1), key=abs)
    span = seconds[0] - usual, seconds[-1] + usual
    hour = next(
        (
            h
            for h in hours
            if time.min() + h * SUMMER_TIME_STEP_S >= span[0] and time.max() + h * SUMMER_TIME_STEP_S <= span[1]
        ),
        None,
    )
    cure = "give the log of this measurement, or correct its date"
    if hour is not None and log.times.start is not None:
        cure = (
            f"shifted by {abs(hour)} h it would: if one of the clocks has summer time or another zone, state the zones "
            f"(# {ZONE}: Europe/Berlin in one file, # {ZONE}: UTC in the other)"
        )
    table.fault(row, SECONDS, f"{_when(log, time[row])} is not in {log.source}, {_when(log, seconds[0])} to "
                f"{_when(log, seconds[-1])}: {cure}")  # fmt: skip


def _when(log: TemperatureLog, second: float) -> str:
    if log.times.start is None:
        return f"{second:g} s"
    start, zone = log.times.start, log.times.start.tzinfo
    if zone is None:
        return f"{start + datetime.timedelta(seconds=second):%Y-%m-%d %H:%M:%S}"
    # a sum in a zone with summer time is one of its clock, not of time
    then = (start.astimezone(datetime.UTC) + datetime.timedelta(seconds=second)).astimezone(zone)
    return f"{then:%Y-%m-%d %H:%M:%S%z}"


def _around(seconds: Array, time: Array) -> Sequence[int] | np.ndarray:
    """Indices `(n, 2)` of the readings before and after each time."""
    after = np.clip(np.searchsorted(seconds, time), 0, len(seconds) - 1)
    return np.stack([np.maximum(after - 1, 0), after], axis=1)
