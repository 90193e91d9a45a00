"""Measurements that could follow the one at hand: the same positions in other ways, and what else a workshop can do.

Each is a measurement of the same machine by the same instrument, its observations those of the machine without errors,
and the registration of both together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from calibration.diagnosis.standards import BAR_MM, Length, bar, references
from calibration.fit import Fit
from calibration.instruments import Interferometer, LaserTracker
from calibration.measurement import Measurement, Target, with_moves
from calibration.models import moving_axes
from calibration.registration import Registration
from calibration.sight import seen_points
from kinematics.effects import Effect, TrackerDrift
from kinematics.machine import Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose, rotation_about, turn

MOST_ROWS = 400
POINT_S = 15.0
"""Time of a row where the data do not say it; the virtual calibration paper, 3.2."""
STATION_MIN, TOOL_MIN = 20.0, 5.0
"""To set up the instrument anew, and to change the tool, a target or a bar."""
OTHER_FEED = 0.5
TOOL_MM = 150.0
"""By so much another tool vector differs."""
EVERY_MIN, LEAST_VISITS = 10.0, 6
"""Fixed references are measured so often."""
BAR_READINGS = 10
"""Of each end of a bar."""
FINER = 60
"""Positions along one axis."""
STOPS = 8
"""Positions that are approached by moves of different lengths."""
SHORT_MM, SHORT_RAD = 5.0, np.deg2rad(1.0)
LONG = 0.4
"""Of the travel that the data cover."""
NEW = "next"
"""Name of a station, a target or a run that the data do not have."""


class Planned(NamedTuple):
    """A measurement that could follow."""

    name: str
    does: str
    """In the imperative."""
    minutes: float
    measurement: Measurement
    registration: Registration
    """Of the data and of this measurement."""
    lengths: tuple[Length, ...] = ()
    """Distances between its targets that are known."""
    unknown: tuple[Effect, ...] = ()
    """What else nobody knows of it, and is found along with the registration."""


def plans(fit: Fit) -> Iterator[Planned]:
    """All measurements that make sense after the data of a fit; none after a part's."""
    data = Data(fit.measurement, fit.registration)
    if isinstance(data.measurement.instrument, LaserTracker | Interferometer):
        yield from _once_more(data)
        if not data.in_motion:
            yield from _otherwise_approached(data)
            yield from _finer(data)
    if isinstance(data.measurement.instrument, LaserTracker):
        yield from _from_elsewhere(data)
        yield from _other_tools(data)
        yield from _with_references(data)
        yield _with_bar(data)


@dataclass(frozen=True)
class Data:
    """The data at hand, and what of them is measured again."""

    measurement: Measurement
    registration: Registration

    @cached_property
    def index(self) -> np.ndarray:
        """Rows that are measured again: those of the last run at the last station, evenly at most `MOST_ROWS`."""
        m = self.measurement
        last = np.ones(len(m), bool) if m.axis is not None else m.groups == m.groups[-1]
        if m.axis is not None and m.run is not None:
            for axis in np.unique(m.axis).tolist():
                own = m.axis == axis
                last[own] = m.run[own] == m.run[own][-1]
        elif m.state.cycle is not None:
            last &= m.state.cycle == m.state.cycle[last][-1]
        rows = np.flatnonzero(last)
        return rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_ROWS)).astype(int)] if len(rows) else rows

    @cached_property
    def in_motion(self) -> bool:
        """True where most rows were taken in motion."""
        velocity = self.measurement.state.velocity
        return velocity is not None and float(np.mean(np.any(velocity[self.index] != 0.0, axis=1))) > 0.5

    @cached_property
    def step_s(self) -> float:
        """Time of a row."""
        time = self.measurement.state.time
        steps = np.diff(time) if time is not None else np.zeros(0)
        steps = steps[steps > 0.0]
        return float(np.median(steps)) if len(steps) else POINT_S

    @property
    def own_drift(self) -> tuple[Effect, ...]:
        """Of an instrument that was set up anew, or on another day: what it did before says nothing of it."""
        tracker = isinstance(self.measurement.instrument, LaserTracker)
        return (TrackerDrift(),) if tracker and self.measurement.state.time is not None else ()

    @property
    def positions(self) -> str:
        """What is measured again, for people."""
        return "the same path" if self.in_motion else _counted(len(self.index))

    def clock(self, index: np.ndarray) -> Array:
        """Times `(n,)`, s, of rows in a new order, from one step after the start on."""
        time = self.measurement.state.time
        if not self.in_motion or time is None:
            return np.asarray(self.step_s * np.arange(1, len(index) + 1))
        return np.asarray(np.abs(time[index] - time[index[0]]) + self.step_s)

    def following(self, index: np.ndarray, pause_min: float = 0.0, **changes: Any) -> Measurement:
        """Rows of the data once more, in this order, after their end; `changes` of the columns of the state.

        The machine goes on from where it stood last, at the temperatures that it had then.
        """
        m = self.measurement
        before, state = m.state, m.state.rows(index)
        n, clock = len(index), self.clock(index)
        columns: dict[str, Any] = {
            "past": before,
            "time": None if before.time is None else before.time.max() + 60.0 * pause_min + clock,
            "temperatures": {name: np.full(n, kelvin[-1]) for name, kelvin in before.temperatures.items()},
            "cycle": None if before.cycle is None else np.full(n, before.cycle.max() + 1.0),
        }
        state = replace(state, **(columns | changes))
        if before.last_move is not None:
            last, approach = _moves_after(before, state.positions)
            state = replace(state, last_move=last, approach=None if before.approach is None else approach)
        run = None if m.run is None else np.full(n, NEW)
        return replace(m.rows(index), state=state, run=run)

    def plan(
        self,
        name: str,
        does: str,
        measurement: Measurement,
        registration: Registration | None = None,
        pause_min: float = 0.0,
    ) -> Planned:
        """What the machine without errors would show of it, and how long it takes."""
        registration = registration or self.registration
        n = len(measurement)
        if measurement.axis is not None:
            zeros = dict(registration.zeros) | dict.fromkeys(np.unique(measurement.groups).tolist(), 0.0)
            registration = replace(registration, zeros=zeros)
            done = replace(measurement, observed=np.zeros((n, 1)))
        else:
            points = seen_points(measurement, None, registration.tool(measurement))
            observed = registration.seen(measurement, points)
            done = replace(measurement, observed=observed, state=replace(measurement.state, observed=observed))
        time = measurement.state.time
        seconds = n * self.step_s if time is None or not self.in_motion else float(np.ptp(time)) + self.step_s
        return Planned(name, does, pause_min + seconds / 60.0, done, registration)


def _once_more(data: Data) -> Iterator[Planned]:
    """The same positions, or the same path, in another order, at another feed, from cold."""
    index, what, state = data.index, data.positions, data.measurement.state
    back = index[::-1]
    turned = {} if state.velocity is None else {"velocity": -state.velocity[back]}
    verb = "run" if data.in_motion else "measure"
    yield data.plan("retrace", f"{verb} {what} once more backwards", data.following(back, **turned))
    shuffled = np.random.default_rng(0).permutation(index)
    if data.in_motion:
        yield _at_another_feed(data)
    else:
        order = "in shuffled order"
        yield data.plan("shuffled", f"measure {what} once more {order}", data.following(shuffled))
    if state.time is not None and not data.in_motion:
        again = {name: kelvin[index] for name, kelvin in state.temperatures.items()}
        cold = data.following(shuffled, time=state.time[0] + data.clock(index), temperatures=again, past=None)
        does = f"let the machine cool down, start it as before, and measure {what} in shuffled order"
        yield data.plan("cold start", does, cold)._replace(unknown=data.own_drift)


def _at_another_feed(data: Data) -> Planned:
    index, state = data.index, data.measurement.state
    assert state.velocity is not None
    changes: dict[str, Any] = {"velocity": OTHER_FEED * state.velocity[index]}
    if state.acceleration is not None:
        changes["acceleration"] = OTHER_FEED**2 * state.acceleration[index]
    if state.time is not None:
        changes["time"] = state.time.max() + data.clock(index) / OTHER_FEED
    slower = data.following(index, **changes)
    return data.plan("second feed", "run the same path once more at half the feed", slower)


def _otherwise_approached(data: Data) -> Iterator[Planned]:
    """From the other side, and by moves of different lengths."""
    index, axes = data.index, list(moving_axes(data.measurement))
    if data.measurement.state.approach is None or data.measurement.state.last_move is None:
        return
    does = f"measure {data.positions} once more, each axis coming from the other side by {SHORT_MM:g} mm"
    yield data.plan("other side", does, _from_other_side(data, axes))
    stops = np.repeat(index[np.linspace(0, len(index) - 1, min(STOPS, len(index))).astype(int)], 4 * len(axes))
    yield data.plan("move lengths", _lengths_text(data), _by_lengths(data, stops, axes))


def _from_other_side(data: Data, axes: list[str]) -> Measurement:
    """Each position passed by a little, and come back to, by the axes that move."""
    machine, there = data.measurement.machine, data.following(data.index)
    before, last, approach = data.measurement.state.approach, there.state.last_move, there.state.approach
    assert before is not None
    assert last is not None
    assert approach is not None
    moving = np.isin(machine.names, axes)
    side = np.where(before[data.index] > 0.0, -1.0, 1.0)
    short = side * np.where(machine.rotary, SHORT_RAD, SHORT_MM)
    state = replace(there.state, last_move=np.where(moving, short, last), approach=np.where(moving, side, approach))
    return replace(there, state=state)


def _by_lengths(data: Data, stops: np.ndarray, axes: list[str]) -> Measurement:
    """Each stop reached along each axis by a short and a long move, from both sides."""
    machine = data.measurement.machine
    there = data.following(stops)
    last, approach = there.state.last_move, there.state.approach
    assert last is not None
    assert approach is not None
    last, approach = last.copy(), approach.copy()
    for number, axis in enumerate(axes):
        i = machine.index(axis)
        short = SHORT_RAD if machine.rotary[i] else SHORT_MM
        far = max(LONG * float(np.ptp(data.measurement.state.positions[:, i])), 2.0 * short)
        for place, move in enumerate((short, -short, far, -far)):
            rows = slice(4 * number + place, None, 4 * len(axes))
            last[rows, i], approach[rows, i] = move, np.sign(move)
    if data.measurement.axis is not None:
        own = np.tile(np.repeat(axes, 4), len(stops) // (4 * len(axes)))
        there = replace(there, axis=own)
    return replace(there, state=replace(there.state, last_move=last, approach=approach))


def _lengths_text(data: Data) -> str:
    count = min(STOPS, len(data.index))
    return f"reach {count} positions along each axis by moves of {SHORT_MM:g} mm and by long ones, from both sides"


def _finer(data: Data) -> Iterator[Planned]:
    """Positions at irregular distances along each axis that moves, the others in the middle."""
    m = data.measurement
    middle = np.median(m.state.positions[data.index], axis=0)
    rng = np.random.default_rng(1)
    for axis in moving_axes(m):
        i = m.machine.index(axis)
        line = np.tile(middle, (FINER, 1))
        line[:, i] = np.sort(rng.uniform(m.state.positions[:, i].min(), m.state.positions[:, i].max(), FINER))
        own = data.index if m.axis is None else data.index[m.axis[data.index] == axis]
        if len(own):
            there = _only_moving(data.following(np.full(FINER, own[-1]), positions=line), i, m.state.rows(own[-1:]))
            does = f"measure {FINER} positions at irregular, finer spacing along {axis}"
            yield data.plan(f"finer {axis}", does, there)


def _only_moving(measurement: Measurement, axis: int, start: State) -> Measurement:
    """The other axes count as come to where they stand as they came to a row of the data: one move tells nothing."""
    own, state = np.arange(measurement.state.positions.shape[1]) == axis, measurement.state
    columns = {
        name: np.where(own, column, getattr(start, name))
        for name in ("last_move", "approach")
        if (column := getattr(state, name)) is not None
    }
    return replace(measurement, state=replace(state, **columns))


def _from_elsewhere(data: Data) -> Iterator[Planned]:
    """The tracker as far away, on the other side of the volume or at its side."""
    m, registration = data.measurement, data.registration
    index = data.index
    name = _unused(list(registration.poses))
    there = data.following(index, STATION_MIN, station=np.full(len(index), name))
    pose = registration.poses[str(m.groups[-1])]
    centre = seen_points(there, None, registration.tool(there)).mean(axis=0)
    for place, angle in (("across the volume", np.pi), ("a quarter round the volume", np.pi / 2)):
        round_it = rotation_about((0.0, 0.0, 1.0), angle)
        moved = pose @ Pose(round_it, centre - turn(round_it, centre))
        centres = {**registration.centres, name: moved.apply(centre)[0]}
        both = replace(registration, poses={**registration.poses, name: moved}, centres=centres)
        does = f"measure {data.positions} from a second station, {place}"
        plan = data.plan(f"second station {place}", does, there, both, STATION_MIN)
        yield plan._replace(unknown=data.own_drift)


def _other_tools(data: Data) -> Iterator[Planned]:
    """One target on the tool farther to the side, or lower."""
    m = data.measurement
    numbers = m.target_number[data.index]
    on_tool = [i for i, target in enumerate(m.targets.values()) if target.carrier == "tool"]
    rows = np.isin(numbers, on_tool)
    if not rows.any():
        return
    last = numbers[rows][-1]
    index = data.index[numbers == last]
    place, name = list(m.targets.values())[last].position, _unused(list(m.targets))
    for words, shift in (("to the side", (TOOL_MM, 0.0, 0.0)), ("below", (0.0, 0.0, -TOOL_MM))):
        x, y, z = (a + b for a, b in zip(place, shift, strict=True))
        position: Vector = (x, y, z)
        there = data.following(index, TOOL_MIN, target=np.full(len(index), name))
        there = replace(there, targets={**m.targets, name: Target(position)})
        does = f"measure {len(index)} positions with a target {TOOL_MM:g} mm farther {words}"
        yield data.plan(f"target {words}", does, there, pause_min=TOOL_MIN)


def _with_references(data: Data) -> Iterator[Planned]:
    """The same positions, and fixed targets between them: all of them now and then, or one after every position."""
    count = len(data.index)
    fixed = references(data.measurement, data.registration)
    every = max(1, min(round(EVERY_MIN * 60.0 / data.step_s), -(-count // LEAST_VISITS)))
    at = np.append(np.arange(0, count, every), count)
    minutes = max(round(every * data.step_s / 60.0), 1)
    does = f"measure {data.positions} once more, and {len(fixed)} fixed targets every {minutes} min"
    yield _interleaved(data, "fixed references", does, fixed, np.repeat(at, len(fixed)))
    does = f"measure {data.positions} once more, after each of them one of {len(fixed)} fixed targets"
    yield _interleaved(data, "many fixed references", does, fixed, np.arange(1, count + 1))


def _interleaved(data: Data, name: str, does: str, fixed: dict[str, Target], visits: np.ndarray) -> Planned:
    """Fixed targets in turn, measured before the rows `visits`, where the machine stands just then."""
    index, m = data.index, data.measurement
    assert m.state.target is not None
    rows = np.insert(index, visits, index[np.minimum(visits, len(index) - 1)])
    turns = np.resize(np.array(list(fixed), object), len(visits))
    targets = np.insert(m.state.target[index].astype(object), visits, turns).astype(str)
    there = replace(data.following(rows, target=targets), targets={**m.targets, **fixed})
    both = replace(data.registration, targets={**data.registration.targets, **_places(fixed)})
    return data.plan(name, does, there, both)


def _with_bar(data: Data) -> Planned:
    """A calibrated bar, as far as the tracker can see it whole."""
    m = data.measurement
    ends, lengths = bar(m, data.registration)
    names = np.repeat(list(ends), BAR_READINGS)
    there = data.following(np.full(len(names), len(m) - 1), 2.0 * TOOL_MIN, target=names)
    both = replace(data.registration, targets={**data.registration.targets, **_places(ends)})
    does = (
        f"measure a calibrated bar of {BAR_MM / 1e3:g} m, in line with the beam and with the tracker between its ends"
    )
    there = replace(there, targets={**m.targets, **ends})
    return data.plan("bar", does, there, both, 2.0 * TOOL_MIN)._replace(lengths=lengths)


def _moves_after(before: State, positions: Array) -> tuple[Array, Array]:
    """Last move and approach `(n, axes)` at positions after a state; those that it ended with until an axis moves."""
    assert before.last_move is not None
    moved = with_moves(State(np.concatenate([before.positions[-1:], positions]))).rows(slice(1, None))
    assert moved.last_move is not None
    assert moved.approach is not None
    still = moved.last_move == 0.0
    ended = np.sign(before.last_move[-1]) if before.approach is None else before.approach[-1]
    return np.where(still, before.last_move[-1], moved.last_move), np.where(still, ended, moved.approach)


def _counted(count: int) -> str:
    return f"all {count} positions" if count < MOST_ROWS else f"{count} of the positions"


def _places(targets: dict[str, Target]) -> dict[str, Array]:
    return {name: np.array(target.position) for name, target in targets.items()}


def _unused(names: list[str]) -> str:
    return next(name for name in (NEW, *(f"{NEW}{i}" for i in range(len(names) + 1))) if name not in names)
