"""Logs of EPICS process variables (`camonitor`): commands and observations of one axis in motion.

    IOC:Axis1-PosAct      2020-12-08 16:17:33.317076 0.900391
    IOC:Axis1-Resolver    2020-12-08 16:17:33.317076 1.12222

One line per value: name, date, time, value, in mm, or degrees for a rotary axis. The log does not contain the meaning
of a variable, nor its axis: `command` and `observed` name the two variables, `axis` the axis. Values are paired with
the nearest time stamp within half a sample.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibration.measurement.readers.axis_motion import SPAN, AxisMotion, motion_table
from calibration.measurement.readers.text import axis_named
from calibration.measurement.text_table import Table
from kinematics.files.text_cells import number_at, numbered_lines
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

_LINE = re.compile(r"(\S+)\s+(\d{4}-\d\d-\d\d)\s+(\d\d:\d\d:\d\d(?:\.\d+)?)\s+(\S+)\s*")
_GIVEN = ("command", "observed", "axis")


@dataclass(frozen=True)
class _Variable:
    """The values of one process variable, in the order of time."""

    time: Array
    """Time `(n,)`, s from 1970."""
    value: Array
    lines: np.ndarray

    @property
    def sample(self) -> float:
        """Median time between two values, s."""
        return float(np.median(np.diff(self.time)))


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    lines = [line for line in head.splitlines() if line.strip()]
    return bool(lines) and all(_LINE.fullmatch(line) for line in lines[:2])


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, and notes; `header` names the variables and the axis."""
    lines = numbered_lines(data)
    given = {key: header.get(key, "") for key in _GIVEN}
    given["axis"] = axis_named(given["axis"], machine)
    _check_given(given, lines, source, machine)
    command, observed = (_variable(lines, given[key], source) for key in ("command", "observed"))
    first, second, notes = _paired(command, observed, given, source)
    motion = AxisMotion(
        given["axis"],
        command.time[first],
        command.value[first],
        observed.value[second],
        observed.lines[second],
        command.lines[first],
    )
    others = {key: value for key, value in header.items() if key not in _GIVEN}
    table, more = motion_table(source, data, others, machine, motion)
    return table, [*notes, *more]


def _check_given(given: Mapping[str, str], lines: list[tuple[int, str]], source: str, machine: Machine) -> None:
    """UserError unless both variables are in the log, and the axis in the machine."""
    names = dict.fromkeys(found[1] for found in (_LINE.fullmatch(line) for _, line in lines) if found)
    for key in ("command", "observed"):
        if given[key] not in names:
            fault = f"{key} {given[key]!r} is not in the log" if given[key] else f"{key} is missing"
            raise UserError(f"{source}: {fault}: state --header {key}=NAME, one of {', '.join(names)}")
    if given["command"] == given["observed"]:
        raise UserError(f"{source}: command and observed are both {given['command']}")
    if given["axis"] not in machine.names:
        raise UserError(
            f"{source}: axis {given['axis']!r} is none of machine {machine.name} ({machine.chain}): "
            "state --header axis=NAME"
        )


def _variable(lines: list[tuple[int, str]], name: str, source: str) -> _Variable:
    """The values of a variable; UserError for a line without a value, and for a time that does not increase."""
    stamps, values, numbers = [], [], []
    for number, line in lines:
        if line.split(maxsplit=1)[:1] != [name]:
            continue
        where, found = f"{source}:{number}", _LINE.fullmatch(line)
        if found is None:
            raise UserError(f"{where}: {line.strip()!r} is not 'name date time value'")
        values.append(number_at(found[4], where))
        try:
            stamps.append(np.datetime64(f"{found[2]}T{found[3]}", "us"))
        except ValueError:
            raise UserError(f"{where}: {found[2]} {found[3]} is not a time") from None
        numbers.append(number)
    time = np.asarray(np.array(stamps).astype(np.int64) * 1e-6, float)
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        raise UserError(f"{source}:{numbers[back[0] + 1]}: the time of {name} does not increase")
    if len(time) < SPAN:
        raise UserError(f"{source}: {len(time)} values of {name} are too few to determine its motion")
    return _Variable(time, np.array(values), np.array(numbers))


def _paired(
    command: _Variable, observed: _Variable, given: Mapping[str, str], source: str
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Indices of the commands and observations that are nearest to each other in time, and notes."""
    nearest, back = _nearest(command.time, observed.time), _nearest(observed.time, command.time)
    first = np.arange(len(command.time))
    apart = np.abs(command.time - observed.time[nearest])
    pairs = (back[nearest] == first) & (apart <= 0.5 * min(command.sample, observed.sample))
    if np.count_nonzero(pairs) < SPAN:
        raise UserError(
            f"{source}: only {np.count_nonzero(pairs)} values of {given['command']} and {given['observed']} were taken "
            "within half a sample of each other"
        )
    notes = []
    lost = [np.count_nonzero(~pairs), len(observed.time) - np.count_nonzero(pairs)]
    for key, count in zip(("command", "observed"), lost, strict=True):
        if count:
            notes.append(
                f"{count} values of {given[key]} are left out: the other variable has no value within half a sample"
            )
    if apart[pairs].max() > 0.0:
        notes.append(f"the two values of a pair differ in time by up to {apart[pairs].max() * 1e3:.3g} ms")
    return first[pairs], nearest[pairs], notes


def _nearest(times: Array, among: Array) -> np.ndarray:
    """Index `(n,)` of the nearest of ascending times."""
    after = np.clip(np.searchsorted(among, times), 1, len(among) - 1)
    return np.asarray(np.where(times - among[after - 1] <= among[after] - times, after - 1, after))
