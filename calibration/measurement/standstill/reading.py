"""A tracker's log and its plan as rows of a measurement: one for each standstill at a position of the plan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement
from calibration.measurement.plan import Plan
from calibration.measurement.plan_file import read_plan
from calibration.measurement.standstill.detection import STANDSTILL_RADIUS_MM, Found, Stream, find_standstills
from calibration.measurement.standstill.matching import Matched, Positions, match
from calibration.measurement.states import CARRIERS, read_stands_on
from calibration.measurement.text_table import Table, read_table, table_of
from calibration.registration.observed_points import carried, target_points
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

COLUMNS = ("time_s", "x", "y", "z", "target", "station")
"""Columns of a log, in addition to temperatures; the plan contains the other columns."""
SHORT_DURATION_SHARE = 0.5
"""Share of the median duration below which a standstill is listed."""
LISTED_STANDSTILLS = 12
"""Largest number of lines of each kind in the notes."""
LEAST_SHARE = 0.5
"""Least share of the standstills that belong to the plan; below it the log is of another plan."""
SCALES = {"inch": 1 / 25.4, "m": 1e-3, "um": 1e3}
"""Size of 1 mm in units in which a log may be written."""


@dataclass(frozen=True)
class _Station:
    """The standstills of one station and their positions in the plan."""

    name: str
    rows: np.ndarray
    """Rows of the log."""
    in_plan: np.ndarray
    """Rows of the plan."""
    found: Found
    matched: Matched
    used: np.ndarray
    """Numbers `(r,)` of the standstills that become rows."""

    @property
    def plan_rows(self) -> np.ndarray:
        """Rows of the plan `(r,)` of the standstills that become rows."""
        return np.asarray(self.in_plan[self.matched.position[self.used]])

    @property
    def log_rows(self) -> np.ndarray:
        """First rows of the log `(r,)` of the standstills that become rows."""
        return np.asarray(self.rows[self.found.standstills.reading[self.used]])


class _Log(NamedTuple):
    """Columns of a log."""

    stream: Stream
    target: np.ndarray | None
    station: np.ndarray
    temperatures: Mapping[str, Array]


def is_log(table: Table, machine: Machine) -> bool:
    """True for a table with the columns of a log and without positions of axes."""
    names = set(table.names)
    return {"time_s", "x", "y", "z"} <= names and not names & {*machine.names, "axis", "nominal_x"}


def standstills(log: Table, path: Path, machine: Machine) -> tuple[Table, list[str]]:
    """The standstills of a log at the positions of a plan, as a table of a measurement file, and notes.

    UserError if log and plan do not belong together, or if several assignments are possible.
    """
    plan = read_plan(path, machine)
    log = _with_targets(log, path)
    columns = _columns(log, plan)
    notes = [f"{path}: {note}" for note in plan.notes]
    stations = [_station(log, name, columns, plan) for name in dict.fromkeys(columns.station.tolist())]
    for station in stations:
        notes += _notes(log, station, plan)
    return _table(log, columns, plan, stations, notes), notes


def _with_targets(log: Table, path: Path) -> Table:
    """The log with the targets of the plan in its header; UserError if log and plan differ in a target."""
    entries = dict(log.entries)
    for key, entry in read_table(path, "plan").entries.items():
        if key.partition(".")[0] not in CARRIERS:
            continue
        if key in entries and entries[key].value.split() != entry.value.split():
            log.header_fault(key, f"the plan {path} has {entry.value}")
        entries.setdefault(key, entry)
    return replace(log, entries=entries)


def _columns(log: Table, plan: Plan) -> _Log:
    temperatures = [name for name in log.names if name.startswith("temp_")]
    log.allow_columns(lambda name: name in (*COLUMNS, *temperatures), [*COLUMNS, "temp_<name>"])
    numbers = log.numbers(["time_s", "x", "y", "z", *temperatures])
    texts = log.texts([name for name in ("target", "station") if name in log.names])
    target = texts.get("target")
    if target is not None:
        unknown = np.flatnonzero(~np.isin(target, list(plan.targets)))
        if len(unknown):
            row = int(unknown[0])
            log.fault(row, "target", f"{str(target[row])!r} is not in the plan, which has {', '.join(plan.targets)}")
    return _Log(
        Stream(numbers["time_s"], np.stack([numbers[name] for name in "xyz"], axis=1)),
        target,
        texts.get("station", np.full(len(log), "1")),
        {name: numbers[name] for name in temperatures},
    )


def _station(log: Table, name: str, columns: _Log, plan: Plan) -> _Station:
    rows = np.flatnonzero(columns.station == name)
    where = log.source if len(rows) == len(log) else f"{log.source}: station {name}"
    in_plan = _in_plan(plan, name)
    positions = _positions(log, plan, in_plan)
    found = find_standstills(Stream(columns.stream.time[rows], columns.stream.points[rows]), where, _radius(positions))
    if not len(found.standstills):
        raise UserError(f"{where}: no standstill of the target; data taken on the fly need --path, not --plan")
    allowed = np.ones((len(found.standstills), len(in_plan)), bool)
    if columns.target is not None:
        assert plan.state.target is not None
        observed = columns.target[rows[found.standstills.reading]]
        allowed = observed[:, None] == plan.state.target[in_plan][None, :]
    matched = match(found.standstills.points, positions, allowed)
    if matched is None:
        raise UserError(f"{where}: {_no_match(found, positions)}")
    _refuse_doubtful(where, plan, in_plan, found, matched)
    used = np.flatnonzero((matched.position >= 0) & matched.certain)
    return _Station(name, rows, in_plan, found, matched, used)


def _in_plan(plan: Plan, station: str) -> np.ndarray:
    """Rows of the plan for a station: its own, or all rows of a plan without stations; UserError without rows."""
    stations = plan.state.station
    rows = np.arange(len(plan)) if stations is None else np.flatnonzero(stations == station)
    if not len(rows):
        raise UserError(f"the plan has no position of station {station}")
    return rows


def _positions(log: Table, plan: Plan, in_plan: np.ndarray) -> Positions:
    """The plan's positions, as seen by the tracker on the machine without errors."""
    nothing = np.zeros((len(plan), 3))
    stands_on = read_stands_on(log)
    blank = Measurement(plan.machine, LaserTracker(), plan.state, nothing, plan.targets, stands_on).rows(in_plan)
    assert blank.state.target is not None
    assert blank.state.approach is not None
    target = blank.target_number
    state = np.concatenate([np.round(blank.state.positions, 7), blank.state.approach, target[:, None]], axis=1)
    return Positions(
        target_points(blank, None, np.zeros((len(blank), 3))),
        carried(blank),
        target,
        np.unique(state, axis=0, return_inverse=True)[1].reshape(-1),
        {number: np.array(own.position) for number, own in enumerate(plan.targets.values())},
        frozenset(number for number, own in enumerate(plan.targets.values()) if not own.known),
    )


def _radius(positions: Positions) -> float:
    """Radius of a standstill, mm: at most a quarter of the shortest step of the plan."""
    steps = np.linalg.norm(np.diff(positions.points, axis=0), axis=1)
    steps = steps[steps > 1e-6]
    return float(min(STANDSTILL_RADIUS_MM, steps.min() / 4.0)) if len(steps) else STANDSTILL_RADIUS_MM


def _no_match(found: Found, positions: Positions) -> str:
    """The reason why no standstill could be assigned."""
    text = (
        f"{len(found.standstills)} standstills and {len(positions.target)} positions of the plan have fewer than four "
        "pairs: check that log, plan and machine belong together, and check stands_on and the targets."
    )
    nominal = np.median(np.linalg.norm(np.diff(positions.points, axis=0), axis=1))
    observed = (
        np.median(np.linalg.norm(np.diff(found.standstills.points, axis=0), axis=1))
        if len(found.standstills) > 1
        else 0.0
    )
    for unit, size in SCALES.items():
        if nominal > 0.0 and abs(observed / nominal / size - 1.0) < 0.05:
            return f"{text} The lengths would fit if the log were in {unit}: mm are expected"
    return text


def _refuse_doubtful(where: str, plan: Plan, in_plan: np.ndarray, found: Found, matched: Matched) -> None:
    """UserError if the log belongs to another plan, or may begin at another position of this one."""
    count = int(np.count_nonzero(matched.position >= 0))
    if count < LEAST_SHARE * len(found.standstills):
        raise UserError(
            f"{where}: only {count} of {len(found.standstills)} standstills are near a position of the plan: check "
            "that log, plan and machine belong together"
        )
    if matched.other is not None:
        standstill, other = matched.other
        raise UserError(
            f"{where}: the log has several possible assignments to the plan: the standstill at "
            f"{found.standstills.start[standstill]:.2f} s may be "
            f"{_name(plan, in_plan[matched.position[standstill]])} or {_name(plan, in_plan[other])}; delete the "
            "positions that were not measured from the plan"
        )


def _name(plan: Plan, row: int) -> str:
    """Text of a position, for messages."""
    machine = plan.machine
    text = " ".join(
        f"{axis.name}{value:g}"
        for axis, value in zip(machine.axes, np.round(plan.positions[row] / machine.scale, 4), strict=True)
    )
    target = "" if len(plan.targets) == 1 or plan.state.target is None else f", target {plan.state.target[row]}"
    return f"position {plan.names[row]} ({text}{target}, run {plan.run[row]})"


def _notes(log: Table, station: _Station, plan: Plan) -> Iterator[str]:
    """Notes on the assigned standstills and, one by one, on all others."""
    found, standstills = station.found, station.found.standstills
    head = f"{log.source}, station {station.name}" if "station" in log.names else log.source
    yield (
        f"{head}: {len(station.used)} of {len(station.in_plan)} positions of the plan found in {len(standstills)} "
        f"standstills; one reading scatters by {found.noise * 1e3:.1f} um, means by "
        f"{_typical(standstills.scatter[station.used]):.2f} um (median); {found.breaks} interruptions of the beam"
    )
    if found.dropped:
        yield f"{found.dropped} readings without a beam (zero, or frozen) are left out"
    kinds = {
        "position without a standstill": _without_standstill(station, plan),
        "not certain, left out": _uncertain(station, plan),
        "standstill that is not in the plan": _foreign(station),
        "slow motion, no standstill": found.creeping,
        "short standstill, used": _short(station, plan),
    }
    for kind, lines in kinds.items():
        yield from (f"{kind}: {line}" for line in lines[:LISTED_STANDSTILLS])
        if len(lines) > LISTED_STANDSTILLS:
            yield f"{kind}: ... and {len(lines) - LISTED_STANDSTILLS} more"


def _typical(values: Array) -> float:
    return float(np.median(values)) * 1e3 if len(values) else 0.0


def _without_standstill(station: _Station, plan: Plan) -> list[str]:
    missing = np.setdiff1d(np.arange(len(station.in_plan)), station.matched.position)
    return [_name(plan, row) for row in station.in_plan[missing].tolist()]


def _uncertain(station: _Station, plan: Plan) -> list[str]:
    doubtful = np.flatnonzero((station.matched.position >= 0) & ~station.matched.certain)
    return [
        f"{_name(plan, station.in_plan[station.matched.position[i]])}, standstill at "
        f"{station.found.standstills.start[i]:.2f} s: another standstill or another position fits equally well"
        for i in doubtful.tolist()
    ]


def _foreign(station: _Station) -> list[str]:
    standstills = station.found.standstills
    return [
        f"at {standstills.start[i]:.2f} s for {standstills.end[i] - standstills.start[i]:.2f} s, "
        f"{station.matched.distance[i]:.3f} mm from the nearest position"
        for i in np.flatnonzero(station.matched.position < 0).tolist()
    ]


def _short(station: _Station, plan: Plan) -> list[str]:
    standstills, used = station.found.standstills, station.used
    lasts = standstills.end[used] - standstills.start[used]
    short = np.flatnonzero(lasts < SHORT_DURATION_SHARE * np.median(lasts)) if len(used) else used
    return [f"{_name(plan, station.plan_rows[i])}, {lasts[i]:.2f} s" for i in short.tolist()]


def _table(log: Table, columns: _Log, plan: Plan, stations: list[_Station], notes: list[str]) -> Table:
    """The rows of all stations, in the order in which they are in the log."""
    machine, state = plan.machine, plan.state
    assert state.target is not None
    rows = np.concatenate([station.plan_rows for station in stations])
    first = np.concatenate([station.log_rows for station in stations])
    standstills = [(station.found.standstills, station.used) for station in stations]
    points = np.concatenate([own.points[used] for own, used in standstills])
    numbers = {"time_s": np.concatenate([own.time[used] for own, used in standstills])}
    numbers |= dict(zip(machine.names, (state.positions[rows] / machine.scale).T, strict=True))
    numbers |= dict(zip("xyz", points.T, strict=True))
    numbers["scatter_um"] = np.concatenate([own.scatter[used] for own, used in standstills]) * 1e3
    numbers |= {name: column[first] for name, column in columns.temperatures.items()}
    texts = {name: [repr(value) for value in np.round(column, 9).tolist()] for name, column in numbers.items()}
    several = len(stations) > 1
    texts |= {f"dir_{name}": signs for name, signs in _approach(plan, stations, notes).items()}
    texts["target"] = state.target[rows].astype(str).tolist()
    texts["station"] = np.repeat([s.name for s in stations], [len(s.used) for s in stations]).tolist()
    runs = plan.run[rows].astype(str).tolist()
    texts["run"] = [f"{at}:{run}" for at, run in zip(texts["station"], runs, strict=True)] if several else runs
    texts["point"] = plan.names[rows].astype(str).tolist()
    return table_of(log.source, log.fingerprint, log.entries, texts, log.lines[first].tolist())


def _approach(plan: Plan, stations: list[_Station], notes: list[str]) -> dict[str, list[str]]:
    """Direction of approach, by axis: the plan's; 0 if the machine may have come from another position."""
    found = [_approaches(plan, station) for station in stations]
    assert plan.state.approach is not None
    in_plan = np.concatenate([plan.state.approach[station.plan_rows] for station in stations])
    unknown = int(np.count_nonzero((np.concatenate(found) != in_plan).any(axis=1)))
    if unknown:
        notes.append(
            f"{unknown} rows follow a position without a standstill, or a standstill that is not in the plan: the "
            "direction of approach of an axis is not known (dir_ 0)"
        )
    return {
        name: [str(int(sign)) for sign in column]
        for name, column in zip(plan.machine.names, np.concatenate(found).T.tolist(), strict=True)
    }


def _approaches(plan: Plan, station: _Station) -> Array:
    """Directions of approach `(r, axes)` of the rows of a station."""
    assert plan.state.approach is not None
    approach = plan.state.approach[station.plan_rows].copy()
    for i, standstill in enumerate(station.used.tolist()):
        own = int(station.matched.position[standstill])
        before = int(station.matched.position[standstill - 1]) if standstill else own - 1
        if before == own - 1:
            continue
        if before < 0:
            approach[i] = 0.0
            continue
        moves = np.sign(np.round(plan.positions[station.in_plan[own]] - plan.positions[station.in_plan[before]], 9))
        approach[i, (moves != 0.0) & (moves != approach[i])] = 0.0
    return np.asarray(approach)
