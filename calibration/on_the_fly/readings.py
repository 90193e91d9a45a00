"""Points of a tracker that follows the machine: rows `time_s,x,y,z[,target]` of a measurement file (contract 4.2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.file import read_instrument
from calibration.measurement.measurement import Target
from calibration.measurement.states import (
    MADE_BY,
    allow_columns,
    check_machine,
    is_simulated,
    note_unknown_keys,
    read_stands_on,
    read_targets,
    read_temperatures,
    refuse_unstated,
)
from calibration.measurement.text_table import Table
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

COLUMNS = ("time_s", "x", "y", "z", "target", "station", "run", "temp_<name>")
ONLY = "1"
"""Station and run if the file names none."""


@dataclass(frozen=True)
class Readings:
    """Readings of a tracker, one row for each, in the order of time."""

    instrument: LaserTracker
    targets: Mapping[str, Target]
    stands_on: Literal["workpiece", "bed"]
    time: Array
    """Time `(n,)`, s."""
    points: Array
    """Points `(n, 3)`, mm, in the instrument's frame."""
    target: np.ndarray
    """Name of the target `(n,)`."""
    station: np.ndarray
    """Name of the station `(n,)`."""
    run: np.ndarray
    """Name of the run `(n,)`."""
    temperatures: Mapping[str, Array]
    """Temperature `(n,)` by sensor, K from 20 degC."""
    lines: np.ndarray
    """Line number in the file `(n,)`."""
    source: str
    fingerprint: str
    notes: tuple[str, ...] = ()
    simulated: bool = False
    """True for readings of a virtual machine."""

    def __len__(self) -> int:
        return len(self.time)

    def passes(self) -> Iterator[slice]:
        """Rows of each pass: consecutive rows of one station, run and target, for which the program runs once."""
        changes = np.zeros(max(len(self) - 1, 0), bool)
        for column in (self.station, self.run, self.target):
            changes |= column[1:] != column[:-1]
        ends = [0, *(np.flatnonzero(changes) + 1).tolist(), len(self)]
        return (slice(a, b) for a, b in pairwise(ends))

    def where(self, rows: slice) -> str:
        """Name of a pass, for messages."""
        at = rows.start
        columns = [("station", self.station), ("run", self.run), ("target", self.target)]
        several = [
            f"{name} {column[at]}" for name, column in columns if column[0] != column[-1] or np.any(column != column[0])
        ]
        return ", ".join([f"{self.source}:{self.lines[at]}", *several])


def read_readings(table: Table, machine: Machine) -> Readings:
    """The readings in a table; UserError with line and column for a value that cannot be used."""
    notes: list[str] = []
    refusal = f"{table.source}: data taken on the fly (--path) need a laser tracker"
    instrument = LaserTracker.expect(read_instrument(table), refusal)
    check_machine(table, machine, notes)
    keys = ["machine", "instrument", "stands_on", MADE_BY, *LaserTracker.uncertainty_keys()]
    note_unknown_keys(table, lambda key: key in keys, notes)
    positions = [name for name in machine.names if name in table.names]
    if positions:
        raise UserError(f"{table.head} column {positions[0]}: the file contains positions of axes; omit --path")
    allow_columns(table, list(COLUMNS))
    table.need_columns(["time_s", "x", "y", "z"], "data taken on the fly")
    numbers = table.numbers(["time_s", "x", "y", "z"])
    time = numbers["time_s"]
    targets, target = read_targets(table, notes)
    refuse_unstated(table, targets, "a path")
    moving = [name for name, each in targets.items() if each.carrier != "tool"]
    if moving:
        raise UserError(
            f"{table.source}: target {moving[0]} is on the {targets[moving[0]].carrier}: only a target on the tool "
            "follows a path"
        )
    texts = table.texts([name for name in ("station", "run") if name in table.names])
    found = Readings(
        instrument, targets, read_stands_on(table), time, np.stack([numbers[name] for name in "xyz"], axis=1), target,
        texts.get("station", np.full(len(table), ONLY)), texts.get("run", np.full(len(table), ONLY)),
        read_temperatures(table), table.lines, table.source, table.fingerprint, tuple(notes), is_simulated(table),
    )  # fmt: skip
    for rows in found.passes():
        back = np.flatnonzero(np.diff(time[rows]) <= 0.0)
        if len(back):
            table.fault(rows.start + int(back[0]) + 1, "time_s", "not later than in the row before")
    return found
