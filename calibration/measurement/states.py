"""State columns of a measurement file, independent of the kind of observation (contract 4.2)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NoReturn

import numpy as np

from calibration.instruments import KINDS, instrument_in
from calibration.instruments.axis_columns import axis_columns, read_component
from calibration.measurement.axis_positions import (
    SAME_COLUMN_POSITION,
    observed_zero,
    of_axes,
    of_part,
    of_targets,
)
from calibration.measurement.in_motion import velocities
from calibration.measurement.measurement import SPINDLE_NOSE, Carrier, Target
from calibration.measurement.text_table import Table
from kinematics.files.number_text import rounded
from kinematics.forward import tool_point
from kinematics.machine import Machine, Vector
from kinematics.state import REFERENCE_DEGC, State
from kinematics.transforms import Array
from kinematics.user_error import UserError

CARRIERS: Mapping[str, Carrier] = {"target": "tool", "table": "table", "bed": "bed"}
"""Carrier of a target, by the first part of its header key."""
SET_UPS = tuple(dict.fromkeys(kind.SET_UP for kind in KINDS.values()))
"""Columns with the names of set-ups."""
STANDS_ON: Mapping[str, Literal["workpiece", "bed"]] = {"workpiece": "workpiece", "bed": "bed"}
MADE_BY = "made_by"
"""Header key of the program that wrote the file."""
OF_A_PLAN = ("strategy", "minutes", "station", MADE_BY)
"""First parts of header keys of a plan, which a measurement file made from it may keep."""
FITTED = 6
"""Least number of rows of a target on the tool whose position is fitted because the header does not give it."""
DIRECTIONS = {"+1": 1, "1": 1, "+": 1, "forward": 1, "-1": -1, "-": -1, "backward": -1}
PLAIN_NAME = re.compile(r'[^\s,:"]+')
FASTEST = 1e6
"""Largest accepted speed of a spindle, rpm."""


@dataclass(frozen=True)
class MeasurementStates:
    """Measurement states, one row per observation, in the order of acquisition; fields as in `Measurement`."""

    state: State
    targets: Mapping[str, Target]
    stands_on: Literal["workpiece", "bed"]
    axis: np.ndarray | None
    run: np.ndarray | None
    actual: Array | None
    feed: Array | None
    part_zero: Vector
    component: np.ndarray | None = None

    @property
    def tool(self) -> Array:
        """Positions `(n, 3)`, mm, of the targets on their carriers."""
        return _tool(self.targets, self.state.target)


def state_columns(machine: Machine) -> list[str]:
    """Names of the columns that any file may have; `temp_<name>` represents all sensors; `point` is a comment."""
    axes = machine.names
    directions, actual = (f"dir_{name}" for name in axes), (f"actual_{name}" for name in axes)
    return [
        *axes,
        "time_s",
        "feed",
        "spindle_rpm",
        "target",
        "station",
        "run",
        "point",
        *directions,
        *actual,
        "temp_<name>",
    ]


def allow_columns(table: Table, known: list[str]) -> None:
    """UserError for an unknown column."""
    table.allow_columns(lambda name: name in known or re.fullmatch(r"temp_\S+", name) is not None, known)


def check_machine(table: Table, machine: Machine, notes: list[str]) -> None:
    """UserError if the file belongs to another machine."""
    if "machine" not in table.entries:
        notes.append(f"the file names no machine: it is read as data of {machine.name}")
    elif table.entries["machine"].value != machine.name:
        table.header_fault(
            "machine",
            f"the file is of {table.entries['machine'].value!r}, not of {machine.name}: give its machine, or "
            "correct the file",
        )


def note_unknown_keys(table: Table, known: Callable[[str], bool], notes: list[str]) -> None:
    """Notes on header lines that are not used; UserError for a unit that measurement files do not have."""
    for key in ("unit", "units"):
        if key in table.entries and re.fullmatch(r'in|inch|inches|"', table.entries[key].value.strip().lower()):
            table.header_fault(key, "positions are in mm and degrees: convert them, or correct the unit")
    for remark in table.remarks:
        if known(key := remark.value.partition(" ")[0]) and key != remark.value:
            value = remark.value.removeprefix(key).strip()
            raise UserError(f"{table.source}:{remark.line} {key}: the colon is missing: write '# {key}: {value}'")
    for key, entry in table.entries.items():
        if not known(key) and known(small := key.strip().lower().replace(" ", "_").replace("-", "_")):
            table.header_fault(key, f"header keys are in small letters: write {small}")
        if not known(key) and key.partition(".")[0] not in (*CARRIERS, *OF_A_PLAN):
            where = f"line {entry.line}: header key {key!r}" if entry.line else f"--header {key}"
            notes.append(f"{where} is unknown, and ignored")
    notes += [f"line {remark.line}: {remark.value!r} is not 'key: value', and is ignored" for remark in table.remarks]


def read_states(table: Table, machine: Machine, notes: list[str]) -> MeasurementStates:
    """The states and targets of a table; assumptions are added to the notes."""
    targets, target = read_targets(table, notes)
    kind = instrument_in(table)
    tool = _tool(targets, target)
    part_zero: Vector = (0.0, 0.0, 0.0)
    given = [name for name in machine.names if name in table.names]
    if "axis" in table.names:
        positions = of_targets(table, machine, notes)
    elif "nominal_x" in table.names and not given:
        positions, part_zero = of_part(table, machine, tool, notes)
    elif given:
        positions = of_axes(table, machine, notes)
        if "nominal_x" in table.names:
            part_zero = observed_zero(table, tool_point(machine, positions, tool), notes)
    else:
        _refuse_on_the_fly(table, machine)
    optional = table.numbers([name for name in ("time_s", "feed") if name in table.names])
    texts = table.texts([name for name in (*SET_UPS, "run", "axis") if name in table.names])
    run = texts.get("run")
    state = State(
        positions,
        time=_ordered(table, optional.get("time_s"), notes),
        temperatures=read_temperatures(table),
        spindle_speed=_spindle_speed(table, notes),
        cycle=None if run is None else _in_order(run).astype(float),
        station=texts.get(kind.SET_UP),
        target=target,
    )
    if "nominal_x" not in table.names:
        state = _in_motion(table, machine, state, optional.get("feed"), notes)
    state = replace(state, approach=_approach(table, machine, state.approach))
    note_travel(machine, positions, notes)
    stands_on = read_stands_on(table) if kind.is_header_key("stands_on") else "workpiece"
    actual = _actual(table, machine)
    component = read_component(table, machine) if "axis" in table.names else None
    return MeasurementStates(
        state, targets, stands_on, texts.get("axis"), run, actual, optional.get("feed"), part_zero, component
    )


def _in_motion(table: Table, machine: Machine, state: State, feed: Array | None, notes: list[str]) -> State:
    """The state with the moves and the velocities that follow from the order of its rows."""
    kind = instrument_in(table)
    state = kind.in_order(state)
    velocity = None if feed is None else kind.own_velocities(machine, state, feed)
    if velocity is None:
        velocity = _velocity(table, machine, state.positions, feed, notes)
    return replace(state, velocity=velocity)


def is_simulated(table: Table) -> bool:
    """True for a file of a virtual machine, by its header."""
    return MADE_BY in table.entries and "simulated" in table.entries[MADE_BY].value


def read_targets(table: Table, notes: list[str]) -> tuple[dict[str, Target], np.ndarray]:
    """The targets by name, and the name of the target of each row `(n,)`."""
    if (own := instrument_in(table).read_targets(table)) is not None:
        return own
    targets = _stated_targets(table)
    named = "target" in table.names
    if not targets:
        if named:
            name = table.texts(["target"])["target"][0]
            raise UserError(
                f"{table.head} column target: the header gives the position of no target: write # target.{name}: x y z "
                f"(mm from the spindle nose) into it, or give --header 'target.{name}=x y z'"
            )
        notes.append("the header gives no target: it is assumed in the tool reference point (spindle nose)")
        targets = {"1": SPINDLE_NOSE}
    if not named:
        if len(targets) > 1:
            raise UserError(
                f"{table.head}: the header has several targets ({', '.join(targets)}), but the column target is missing"
            )
        return targets, np.full(len(table), next(iter(targets)))
    column = table.texts(["target"])["target"]
    names, rows, counts = np.unique(column, return_index=True, return_counts=True)
    stated, on_tool = ", ".join(targets), any(target.known for target in targets.values())
    for name, row, count in zip(names.tolist(), rows.tolist(), counts.tolist(), strict=True):
        if name in targets:
            continue
        if count < FITTED or not on_tool:
            table.fault(
                row,
                "target",
                f"{name!r} is not in the header, which has {stated}: state its position (# target.{name}: x y z); "
                f"beside a stated target on the tool, with {FITTED} rows or more, it would be fitted",
            )
        targets[name] = Target((0.0, 0.0, 0.0), free=True)
        notes.append(f"the header does not give the position of target {name}: a fit determines it beside {stated}")
    return targets, column


def refuse_unstated(table: Table, targets: Mapping[str, Target], purpose: str) -> None:
    """UserError for a target on the tool whose position the header does not give, which `purpose` needs."""
    for name, target in targets.items():
        if target.free:
            raise UserError(
                f"{table.source}: the header does not give the position of target {name} (# target.{name}: x y z), "
                f"which {purpose} needs"
            )


def _tool(targets: Mapping[str, Target], names: np.ndarray | None) -> Array:
    """Positions `(n, 3)`, mm, of targets by their names `(n,)`."""
    assert names is not None
    among = list(targets)
    order = np.argsort(among)
    number = order[np.searchsorted(among, names, sorter=order)]
    return np.asarray(np.array([target.position for target in targets.values()])[number])


def _stated_targets(table: Table) -> dict[str, Target]:
    """The targets in the header by name; UserError for a name that is none, or that occurs twice."""
    targets: dict[str, Target] = {}
    for key in table.entries:
        first, dot, name = key.partition(".")
        if first in CARRIERS:
            if not dot or not PLAIN_NAME.fullmatch(name):
                table.header_fault(key, f"expected {first}.<name>, the name without blanks")
            if name in targets:
                table.header_fault(key, f"the name of target {name} occurs twice")
            x, y, z = table.header_numbers(key, 3)
            targets[name] = Target((x, y, z), CARRIERS[first])
    return targets


def read_stands_on(table: Table) -> Literal["workpiece", "bed"]:
    """Base of the instrument; UserError for an unknown one."""
    value = table.entries["stands_on"].value if "stands_on" in table.entries else "workpiece"
    if value not in STANDS_ON:
        table.header_fault("stands_on", f"expected {' or '.join(STANDS_ON)}, got {value!r}")
    return STANDS_ON[value]


def read_temperatures(table: Table) -> dict[str, Array]:
    """Temperatures `(n,)`, K from 20 degC, by sensor."""
    columns = table.numbers([name for name in table.names if name.startswith("temp_")])
    return {name.removeprefix("temp_"): column - REFERENCE_DEGC for name, column in columns.items()}


def _spindle_speed(table: Table, notes: list[str]) -> Array | None:
    """Mean speed of the spindle since the row before `(n,)`, rpm; None without the column."""
    if "spindle_rpm" not in table.names:
        return None
    speed = table.numbers(["spindle_rpm"])["spindle_rpm"]
    if np.any(speed < 0.0):
        table.fault(int(np.argmax(speed < 0.0)), "spindle_rpm", "is below 0: a speed is positive in both directions")
    if np.any(speed > FASTEST):
        table.fault(int(np.argmax(speed > FASTEST)), "spindle_rpm", f"is more than {FASTEST:g}, and no speed in rpm")
    if "time_s" not in table.names:
        notes.append("the speed of the spindle is not used: its heat needs the column time_s")
    return speed


def _actual(table: Table, machine: Machine) -> Array | None:
    columns = table.numbers([name for name in table.names if name.startswith("actual_")])
    if not columns:
        return None
    actual = np.full((len(table), len(machine.axes)), np.nan)
    for name, column in columns.items():
        i = machine.index(name.removeprefix("actual_"))
        actual[:, i] = column * machine.scale[i]
    return actual


def _velocity(table: Table, machine: Machine, positions: Array, feed: Array | None, notes: list[str]) -> Array | None:
    """Velocity `(n, axes)`, mm/s and rad/s; None without a feed."""
    if feed is None:
        return None
    if np.any(feed < 0.0):
        table.fault(int(np.argmax(feed < 0.0)), "feed", "is below 0; a machine at standstill has 0")
    run_starts, programmed = np.zeros(len(table), bool), np.zeros(positions.shape)
    for column in table.texts([name for name in ("run", "axis", "station") if name in table.names]).values():
        run_starts |= np.append(True, column[1:] != column[:-1])
    if "direction" in table.names:
        own = np.arange(len(table)), axis_columns(table, machine)
        programmed[own] = _signs(table)
        run_starts |= np.append(True, np.any(programmed[1:] != programmed[:-1], axis=1))
    velocity, lost = velocities(machine, positions, feed, run_starts, programmed)
    if lost.any():
        line = table.lines[np.argmax(lost)]
        notes.append(
            f"line {line}: the row has a feed, but no axis moves: it is read as a standstill"
            f"{f' ({lost.sum()} such rows)' if lost.sum() > 1 else ''}"
        )
    return velocity


def _signs(table: Table) -> Array:
    """Column `direction` `(n,)`, -1 or 1."""
    words = table.texts(["direction"])["direction"]
    unknown = np.flatnonzero(~np.isin(words, list(DIRECTIONS)))
    if len(unknown):
        row = int(unknown[0])
        table.fault(row, "direction", f"{str(words[row])!r} is none of {', '.join(DIRECTIONS)}")
    return np.array([DIRECTIONS[word] for word in words.tolist()], float)


def _approach(table: Table, machine: Machine, from_order: Array | None) -> Array | None:
    """Direction of approach `(n, axes)`: as given in the file, otherwise from the order of rows.

    The order in which a part is measured does not show the machine's moves: None for a part, unless the file gives it.
    """
    columns = table.numbers([name for name in table.names if name.startswith("dir_")])
    if from_order is None and not columns:
        return None
    approach = np.zeros((len(table), len(machine.axes))) if from_order is None else from_order.copy()
    for name, column in columns.items():
        wrong = np.flatnonzero(~np.isin(column, (-1.0, 0.0, 1.0)))
        if len(wrong):
            table.fault(int(wrong[0]), name, f"{column[wrong[0]]:g} is not -1, 0 or 1")
        approach[:, machine.index(name.removeprefix("dir_"))] = column
    if "direction" in table.names:
        approach[np.arange(len(table)), axis_columns(table, machine)] = _signs(table)
    return approach


def _in_order(names: np.ndarray) -> np.ndarray:
    """Number `(n,)` of each name from 0, in the order of first appearance."""
    _, first, number = np.unique(names, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[number])


def _ordered(table: Table, time: Array | None, notes: list[str]) -> Array | None:
    if time is not None and np.any(np.diff(time) < 0):
        line = table.lines[np.argmax(np.diff(time) < 0) + 1]
        notes.append(f"line {line}: the time decreases; the rows keep the order of the file")
    return time


def note_travel(machine: Machine, positions: Array, notes: list[str]) -> None:
    """Add a note for each axis whose positions `(n, axes)`, mm and rad, leave its travel."""
    for i, axis in enumerate(machine.axes):
        low, high = machine.travel[:, i]
        beyond = float(np.max(np.maximum(low - positions[:, i], positions[:, i] - high)))
        if beyond > SAME_COLUMN_POSITION:
            ends = f"{axis.travel[0]:g}..{axis.travel[1]:g}"
            size = f"{rounded(beyond / machine.scale[i], 4)} {axis.unit}"
            notes.append(f"{axis.name} leaves its travel {ends} {axis.unit} by {size}: are these machine coordinates?")


def _refuse_on_the_fly(table: Table, machine: Machine) -> NoReturn:
    raise UserError(
        f"{table.head}: no column has commanded positions of an axis ({', '.join(machine.names)}); data taken on the "
        "fly need the program that was run, --path PATH.nc, and a tracker's log of standstills needs the plan of its "
        "positions, --plan PLAN.csv"
    )
