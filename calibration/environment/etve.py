"""The environmental temperature variation error (ETVE) of ISO 230-3, from a log of displacements and temperatures.

The machine stands still. Sensors in its table, or about it, read the displacement of a mandrel in the spindle: two in X
and two in Y, at different heights, and one in Z. The ETVE of a reading, for a measurement that takes some time, is the
largest range of this reading within any interval of that length; two readings of one direction give that of a tilt.
"""

from __future__ import annotations

import datetime
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calibration.measurement.logged import with_seconds
from calibration.measurement.measuring_date import MEASURED, measuring_date
from calibration.measurement.text_table import Table, read_table
from kinematics.files.column_map import SECONDS, TEMPERATURE, TIME
from kinematics.files.mistaken import did_you_mean
from kinematics.files.time_stamps import SUMMER_TIME_STEP_S, ZONE
from kinematics.transforms import Array
from kinematics.user_error import UserError
from rendering.shown import Shown

SENSORS = ("X_um", "X1_um", "X2_um", "Y_um", "Y1_um", "Y2_um", "Z_um")
"""Columns of displacements: one or two in X and in Y, and one in Z."""
TILTS = {"A": ("Y1_um", "Y2_um"), "B": ("X1_um", "X2_um")}
"""Tilts about X and Y, with the two readings that show them."""
U, DISTANCE = "u_um", "distance_mm"
"""Header keys: standard uncertainty of a reading, um, and distance of the two sensors of a direction, mm."""
FEWEST_LOGGED = 3
"""Fewest readings of a log."""
ROUNDED_H = 1e-9
"""Rounding of times, h."""
URAD_OF_UM_PER_MM = 1e3
"""urad in um per mm."""


class Variation(NamedTuple):
    """The ETVE of a displacement or a tilt."""

    name: str
    """X1, X2, Y1, Y2, Z; A or B for a tilt."""
    unit: str
    """um, or urad of a tilt."""
    value: float
    """Largest range within an interval of the stated length."""
    U: float
    """Expanded uncertainty (k = 2) by that of the readings."""
    begin_h: float
    """Time of the first of both extremes, h from the first reading of the log."""
    end_h: float
    """Time of the other one."""

    @property
    def u_measurement(self) -> float:
        """Standard uncertainty of a measurement of this length by the variation: rectangular (GUM 4.3.7)."""
        return float(self.value / np.sqrt(12.0))


@dataclass(frozen=True, repr=False)
class Etve(Shown):
    """The environmental temperature variation error of a machine."""

    source: str
    """Name of the log."""
    time: Array
    """Times `(n,)`, h from the first reading."""
    readings: dict[str, Array]
    """Displacements `(n,)`, um, and tilts, urad, by name, as they were read."""
    temperatures: dict[str, Array]
    """degC `(n,)` by sensor."""
    period_h: float
    """Length of the measurement for which it is stated, h."""
    variations: tuple[Variation, ...]
    """Of each displacement and tilt."""
    measured: datetime.date | None = None
    """First day of the log, where it states one."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        found = ", ".join(f"{each.name} {each.value:.3g} {each.unit}" for each in self.variations)
        return f"ETVE over {self.period_h:.3g} h: {found}"

    @property
    def columns(self) -> dict[str, Array]:
        """Time, h, readings and temperatures by name `(n,)`."""
        units = {each.name: each.unit for each in self.variations}
        read = {f"{name}_{units[name]}": values for name, values in self.readings.items()}
        warm = {f"{TEMPERATURE}{name}_degC": values for name, values in self.temperatures.items()}
        return {"time_h": self.time, **read, **warm}

    def range_of_temperature(self, sensor: str) -> float:
        """Largest range of a temperature within an interval of the same length, K."""
        return _largest_range(self.time, self.temperatures[sensor], self.period_h)[0]

    def json(self) -> dict[str, Any]:
        """The result for programs; U with k = 2."""
        return {
            "period_h": self.period_h,
            "duration_h": float(self.time[-1]),
            "readings": len(self.time),
            "etve": [{**each._asdict(), "u_measurement": each.u_measurement} for each in self.variations],
            "temperatures": [
                {
                    "sensor": name, "lowest_degC": float(values.min()), "highest_degC": float(values.max()),
                    "range_in_period_K": self.range_of_temperature(name),
                }
                for name, values in self.temperatures.items()
            ],
        }  # fmt: skip


def read_etve(path: Path, period_h: float | None = None) -> Etve:
    """The ETVE of a log; UserError with line and column for one that cannot be used, and for a period beyond it."""
    table = with_seconds(read_table(path, "log of displacements"))
    sensors = _sensors(table)
    u, distance = _entries(table, sensors)
    time = _hours(table)
    if period_h is not None and period_h > time[-1]:
        raise UserError(
            f"--period-h {period_h:g}: {path} covers {time[-1]:.3g} h: state a shorter one, or measure for longer"
        )
    period = float(time[-1]) if period_h is None else period_h
    read = table.numbers(sensors)
    readings = {name.removesuffix("_um"): values for name, values in read.items()}
    units, own_u = dict.fromkeys(readings, "um"), dict.fromkeys(readings, u)
    for tilt, (first, second) in TILTS.items():
        if distance is not None and {first, second} <= read.keys():
            readings[tilt] = (read[second] - read[first]) / distance * URAD_OF_UM_PER_MM
            units[tilt], own_u[tilt] = "urad", float(np.sqrt(2.0)) * u / distance * URAD_OF_UM_PER_MM
    variations = tuple(
        Variation(name, units[name], value, 2.0 * float(np.sqrt(2.0)) * own_u[name], begin, end)
        for name, values in readings.items()
        for value, begin, end in [_largest_range(time, values, period)]
    )
    names = [name for name in table.names if name.startswith(TEMPERATURE)]
    warm = {name.removeprefix(TEMPERATURE): values for name, values in table.numbers(names).items()}
    return Etve(str(path), time, readings, warm, period, variations, measuring_date(table))


def _sensors(table: Table) -> list[str]:
    """The columns of displacements; UserError for unknown columns, and without any."""
    listed = [TIME, SECONDS, *SENSORS, f"{TEMPERATURE}NAME"]
    table.allow_columns(lambda name: name in listed or name.startswith(TEMPERATURE), listed)
    found = [name for name in SENSORS if name in table.names]
    if not found:
        raise UserError(f"{table.head}: a log of displacements has one or more of the columns {', '.join(SENSORS)}")
    if SECONDS not in table.names:
        raise UserError(f"{table.head}: the readings have no times: add the column {TIME} (2026-11-30 09:12:05)")
    return found


def _entries(table: Table, sensors: list[str]) -> tuple[float, float | None]:
    """The standard uncertainty of a reading, um, and the distance of two sensors, mm; UserError where it is missing."""
    known = (U, DISTANCE, ZONE, MEASURED)
    for key in table.entries:
        if key not in known:
            table.header_fault(key, f"is not known{did_you_mean(key, known)}; known are {', '.join(known)}")
    if U not in table.entries:
        raise UserError(
            f"{table.source}: # {U}: is missing: the standard uncertainty (k = 1) of a reading, um, as in # {U}: 0.2"
        )
    pairs = [f"{first} and {second}" for first, second in TILTS.values() if {first, second} <= set(sensors)]
    if pairs and DISTANCE not in table.entries:
        raise UserError(
            f"{table.source}: # {DISTANCE}: is missing: the distance of the sensors {' and of '.join(pairs)}, mm, from "
            f"which the tilt follows, as in # {DISTANCE}: 150"
        )
    (u,) = table.header_numbers(U, 1)
    (distance,) = table.header_numbers(DISTANCE, 1) if pairs else (1.0,)
    for key, value in ((U, u), (DISTANCE, distance)):
        if value <= 0.0:
            table.header_fault(key, "expected a number above 0")
    return u, distance if pairs else None


def _hours(table: Table) -> Array:
    """Times `(n,)`, h from the first reading; UserError for too few, and for times that do not go forward."""
    seconds = table.numbers([SECONDS])[SECONDS]
    if len(seconds) < FEWEST_LOGGED:
        raise UserError(f"{table.source}: {len(seconds)} readings: a variation needs {FEWEST_LOGGED} or more")
    back = np.diff(seconds) <= 0.0
    if back.any():
        row = int(np.argmax(back)) + 1
        table.fault(row, SECONDS, "the time is not after that of the row before: sort the rows by time")
    return np.asarray((seconds - seconds[0]) / SUMMER_TIME_STEP_S)


def _largest_range(time: Array, values: Array, period: float) -> tuple[float, float, float]:
    """Largest range of values `(n,)` within an interval of time not longer than a period, and its begin and end."""
    lows, highs = deque[int](), deque[int]()
    best, begin, first = (0.0, 0.0, 0.0), 0, time.tolist()
    for k, value in enumerate(values.tolist()):
        while first[k] - first[begin] > period + ROUNDED_H:
            begin += 1
        for kept, sign in ((lows, 1.0), (highs, -1.0)):
            while kept and sign * values[kept[-1]] >= sign * value:
                kept.pop()
            kept.append(k)
            while kept[0] < begin:
                kept.popleft()
        size = float(values[highs[0]] - values[lows[0]])
        if size > best[0]:
            best = size, first[min(lows[0], highs[0])], first[max(lows[0], highs[0])]
    return best
