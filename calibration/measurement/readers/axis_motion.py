"""One axis in motion, from logs of its commanded and its observed position: direction, runs, speed and deviation.

Direction, runs and speed (over SPAN samples) are those of the commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibration.measurement.readers.text import given_entries
from calibration.measurement.text_table import Table, table_of
from kinematics.files import fingerprint
from kinematics.machine import Machine
from kinematics.transforms import Array

SPAN = 10
"""Number of samples for a speed."""
STANDSTILL_SPEED_SHARE = 0.01
"""Share of the largest speed below which the axis is at standstill."""
STEADY_SPEED = 0.02
"""Largest relative difference of a constant speed from the median speed in motion."""


@dataclass(frozen=True)
class AxisMotion:
    """Commands and observations of an axis, one row per instant, in the order of time."""

    axis: str
    time: Array
    """Time `(n,)`, s."""
    command: Array
    """Commanded position `(n,)`, mm or degrees."""
    observed: Array
    """Observed position `(n,)`, mm or degrees."""
    lines: np.ndarray
    """Line number `(n,)` of the observation in the file."""
    command_lines: np.ndarray
    """Line number `(n,)` of the command in the file."""


def motion_table(
    source: str, data: bytes, header: Mapping[str, str], machine: Machine, motion: AxisMotion
) -> tuple[Table, list[str]]:
    """The table of the contract's columns, and notes on units, speed, and rows at standstill or changing speed."""
    time, target = motion.time, motion.command
    speed = _speeds(time, target)
    moving, steady, usual = _regimes(speed)
    directions = _directions(speed, moving)
    notes = _motion_notes(motion.axis, machine, time, moving, steady, usual, motion.command_lines)
    turns = machine.axes[machine.index(motion.axis)].rotary
    deviation = (motion.observed - target) * (1e6 * np.pi / 180.0 if turns else 1e3)
    columns = {
        "time_s": _texts(np.round(time - time[0], 6)),
        "axis": [motion.axis] * len(time),
        "run": [str(run) for run in _runs(directions).tolist()],
        "direction": ["+" if direction > 0 else "-" for direction in directions.tolist()],
        "target_deg" if turns else "target_mm": _texts(target),
        "deviation_urad" if turns else "deviation_um": _texts(np.round(deviation, 6)),
        "feed": _texts(np.where(moving, np.round(np.abs(speed) * 60.0, 4), 0.0)),
    }
    entries = given_entries(header, {"instrument": "interferometer"})
    return table_of(source, fingerprint(data), entries, columns, motion.lines.tolist()), notes


def _speeds(time: Array, position: Array) -> Array:
    """Signed speeds `(n,)`, mm/s or deg/s, over SPAN samples about each, fewer at the ends."""
    low = np.maximum(np.arange(len(time)) - SPAN // 2, 0)
    high = np.minimum(np.arange(len(time)) + SPAN // 2, len(time) - 1)
    return np.asarray((position[high] - position[low]) / (time[high] - time[low]))


def _regimes(speed: Array) -> tuple[np.ndarray, np.ndarray, float]:
    """Masks `(n,)` of motion and of constant speed, and this speed, the median in motion."""
    sizes = np.abs(speed)
    moving = sizes > STANDSTILL_SPEED_SHARE * sizes.max()
    usual = float(np.median(sizes[moving])) if moving.any() else 0.0
    return moving, moving & (np.abs(sizes - usual) <= STEADY_SPEED * usual), usual


def _directions(speed: Array, moving: np.ndarray) -> Array:
    """Directions `(n,)`, 1 or -1; at standstill that of the last motion, or before it that of the first."""
    if not moving.any():
        return np.ones(len(speed))
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speed)), 0))
    return np.sign(speed[np.where(moving[last], last, np.argmax(moving))])


def _runs(directions: Array) -> np.ndarray:
    """Numbers `(n,)` of runs from 1: a motion in the first direction, and its return."""
    return 1 + np.cumsum(np.append(False, (directions[1:] == directions[0]) & (directions[:-1] != directions[0])))


def _motion_notes(
    axis: str, machine: Machine, time: Array, moving: np.ndarray, steady: np.ndarray, usual: float, lines: np.ndarray
) -> list[str]:
    """Notes on the units, the speed and the rows at standstill or changing speed."""
    turns = machine.axes[machine.index(axis)].rotary
    unit, small = ("deg", "urad") if turns else ("mm", "um")
    notes = [f"values taken in {unit} of {axis}, deviation observed minus command in {small}"]
    if not moving.any():
        return [*notes, f"{axis} does not move"]
    notes.append(f"{axis} moves at {usual * 60.0:.4g} {unit}/min: {np.count_nonzero(steady)} of {len(time)} rows")
    for rows, fault in (
        (~moving, f"{axis} is at standstill"),
        (moving & ~steady, f"{axis} accelerates, brakes or moves at another speed"),
    ):
        if rows.any():
            first = int(np.argmax(rows))
            notes.append(
                f"{fault} in {np.count_nonzero(rows)} rows, the first on line {lines[first]} "
                f"({time[first] - time[0]:.2f} s): they are used like the others"
            )
    return notes


def _texts(column: Array) -> list[str]:
    return [repr(value) for value in column.tolist()]
