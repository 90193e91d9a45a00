"""Follow-up designs: the same positions in another order or by another approach, and other set-ups."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.follow_up.design import Data, FollowUpDesign
from calibration.follow_up.extra_setups import from_elsewhere, with_bar, with_other_tools, with_references
from calibration.measurement.measurement import Measurement
from calibration.registration.registration import Registration
from kinematics.state import State
from kinematics.transforms import Array

OTHER_FEED_SHARE = 0.5
QUICK_POSITIONS = 60
"""Positions of a quick measurement."""
FINE_POSITIONS = 60
"""Positions along one axis."""
OFF_LINE = 8
"""Positions off this line, for the pose of a tracker."""
STOPS = 8
"""Positions that are approached by moves of different lengths."""
SHORT_MM, SHORT_RAD = 5.0, np.deg2rad(1.0)
LONG_MOVE_SHARE = 0.4
"""Length of a long move, as a share of the travel that the data cover."""


def follow_up_designs(measurement: Measurement, registration: Registration) -> Iterator[FollowUpDesign]:
    """All designs that make sense after a measurement; none unless a tracker or an interferometer was used."""
    data = Data(measurement, registration)
    if measurement.instrument.FOLLOWED_UP:
        yield from _once_more(data)
        if not data.in_motion:
            yield from _otherwise_approached(data)
            yield from _finer(data)
    if measurement.instrument.STATIONED:
        yield from from_elsewhere(data)
        yield from with_other_tools(data)
        yield from with_references(data)
        yield with_bar(data)
        if not data.in_motion and len(data.index) > 2 * QUICK_POSITIONS:
            yield from _of_fewer(replace(data, most=QUICK_POSITIONS))


def _of_fewer(data: Data) -> Iterator[FollowUpDesign]:
    """Designs with fewer positions."""
    for plan in (*_once_more(data), *with_references(data)):
        yield plan._replace(name=f"{plan.name}, fewer")


def _once_more(data: Data) -> Iterator[FollowUpDesign]:
    """The same positions or the same path in reverse, in shuffled order, at another feed, or after a cold start."""
    index, positions, state = data.index, data.positions, data.measurement.state
    back = index[::-1]
    turned = {} if state.velocity is None else {"velocity": -state.velocity[back]}
    verb = "run" if data.in_motion else "measure"
    retrace = data.plan("retrace", f"{verb} {positions} once more backwards", data.following(back, **turned))
    yield retrace._replace(again=back)
    shuffled = np.random.default_rng(0).permutation(index)
    if data.in_motion:
        yield _at_another_feed(data)
    else:
        order = "in shuffled order"
        plan = data.plan("shuffled", f"measure {positions} once more {order}", data.following(shuffled))
        yield plan._replace(again=shuffled)
    if state.time is not None and not data.in_motion:
        yield from (plan._replace(again=shuffled) for plan in _after_cooling(data, state.time, shuffled))


def _after_cooling(data: Data, time: Array, index: np.ndarray) -> Iterator[FollowUpDesign]:
    """Rows of the data after a cold start, with their temperatures; then with one of several alone, up and down.

    A temperature that only rises looks like the drift of a tracker that was set up again.
    """
    clock, cool, measure = data.clock(index), "let the machine cool down", f"measure {data.positions} in shuffled order"
    warm = data.measurement.state.temperatures
    again = {name: _course(clock, time, kelvin) for name, kelvin in warm.items()}
    cold = data.following(index, time=time.min() + clock, temperatures=again, past=None)
    start = f"{cool}, start it as before, and {measure}"
    yield data.plan("cold start", start, cold)._replace(unknown=data.own_drift)
    for name in warm if len(warm) > 1 else ():
        kept = {other: np.full_like(kelvin, kelvin[0]) for other, kelvin in again.items()}
        kept[name] = _course(np.minimum(clock, clock[-1] - clock), time, warm[name])
        alone = replace(cold, state=replace(cold.state, temperatures=kept))
        does = f"{cool}, and {measure}, while the place of the sensor {name} alone warms, and cools from half time on"
        yield data.plan(f"{name} alone", does, alone)._replace(unknown=data.own_drift)


def _course(clock: Array, time: Array, kelvin: Array) -> Array:
    """Temperatures at times `(n,)`, s, after the start, by their course over the times of the data `(m,)`."""
    order = np.argsort(time, kind="stable")
    return np.asarray(np.interp(clock, time[order] - time[order[0]], kelvin[order]))


def _at_another_feed(data: Data) -> FollowUpDesign:
    index, state = data.index, data.measurement.state
    assert state.velocity is not None
    changes: dict[str, Any] = {"velocity": OTHER_FEED_SHARE * state.velocity[index]}
    if state.acceleration is not None:
        changes["acceleration"] = OTHER_FEED_SHARE**2 * state.acceleration[index]
    if state.time is not None:
        changes["time"] = state.time.max() + data.clock(index) / OTHER_FEED_SHARE
    slower = data.following(index, **changes)
    plan = data.plan("second feed", "run the same path once more at half the feed", slower)
    return plan._replace(again=index)


def _otherwise_approached(data: Data) -> Iterator[FollowUpDesign]:
    """The same positions approached from the other side, and by moves of different lengths."""
    index, axes = data.index, list(data.measurement.moving)
    if data.measurement.state.approach is None or data.measurement.state.last_move is None:
        return
    does = f"measure {data.positions} once more, each axis coming from the other side by {SHORT_MM:g} mm"
    yield data.plan("other side", does, _from_other_side(data, axes))
    stops = np.repeat(index[np.linspace(0, len(index) - 1, min(STOPS, len(index))).astype(int)], 4 * len(axes))
    yield data.plan("move lengths", _lengths_text(data), _by_lengths(data, stops, axes))


def _from_other_side(data: Data, axes: list[str]) -> Measurement:
    """Each position approached from the other side, by a short move of all axes that move in the data."""
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
        far = max(LONG_MOVE_SHARE * float(np.ptp(data.measurement.state.positions[:, i])), 2.0 * short)
        for k, move in enumerate((short, -short, far, -far)):
            rows = slice(4 * number + k, None, 4 * len(axes))
            last[rows, i], approach[rows, i] = move, np.sign(move)
    if data.measurement.axis_rows:
        own = np.tile(np.repeat(axes, 4), len(stops) // (4 * len(axes)))
        there = replace(there, axis=own)
    return replace(there, state=replace(there.state, last_move=last, approach=approach))


def _lengths_text(data: Data) -> str:
    count = min(STOPS, len(data.index))
    return f"reach {count} positions along each axis by moves of {SHORT_MM:g} mm and by long ones, from both sides"


def _finer(data: Data) -> Iterator[FollowUpDesign]:
    """Positions at irregular distances along each axis that moves, the others in the middle.

    A tracker also measures some positions of the data again: points on one line do not determine its pose.
    """
    m = data.measurement
    middle = np.median(m.state.positions[data.index], axis=0)
    rng = np.random.default_rng(1)
    off = data.index[np.linspace(0, len(data.index) - 1, min(OFF_LINE, len(data.index))).astype(int)]
    off, again = (off, f", and {len(off)} of the positions again") if data.set_up else (off[:0], "")
    for axis in m.moving:
        i = m.machine.index(axis)
        line = np.tile(middle, (FINE_POSITIONS, 1))
        line[:, i] = np.sort(rng.uniform(m.state.positions[:, i].min(), m.state.positions[:, i].max(), FINE_POSITIONS))
        own = np.intersect1d(data.index, m.axis_rows[axis]) if m.axis_rows else data.index
        if len(own):
            rows = np.concatenate([np.full(FINE_POSITIONS, own[-1]), off])
            there = data.following(rows, positions=np.concatenate([line, m.state.positions[off]]))
            there = _only_moving(there, i, m.state.rows(own[-1:]))
            does = f"measure {FINE_POSITIONS} positions at irregular, finer spacing along {axis}{again}"
            yield data.plan(f"finer {axis}", does, there)


def _only_moving(measurement: Measurement, axis: int, start: State) -> Measurement:
    """The measurement with one axis that moves in its first rows, the finer ones.

    The others keep the last move and approach of the state `start`.
    """
    state = measurement.state
    own = (np.arange(state.positions.shape[1]) == axis) | (np.arange(len(state))[:, None] >= FINE_POSITIONS)
    columns = {
        name: np.where(own, column, getattr(start, name))
        for name in ("last_move", "approach")
        if (column := getattr(state, name)) is not None
    }
    return replace(measurement, state=replace(state, **columns))
