"""A short path through positions, and the plan along it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from calibration.instruments import Instrument
from calibration.measurement.measurement import Target, with_moves
from calibration.measurement.plan import Plan, Timing
from calibration.planning.measuring_sequence import times
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array


def toured(machine: Machine, positions: Array) -> np.ndarray:
    """Order `(n,)` of positions `(n, axes)`: the nearest one comes next, from the lowest corner on."""
    scaled = positions / machine.scale
    left, order = np.arange(len(scaled)), []
    here = scaled.min(axis=0) if len(scaled) else np.zeros(0)
    while len(left):
        nearest = int(np.argmin(np.sum((scaled[left] - here) ** 2, axis=1)))
        order.append(left[nearest])
        here = scaled[left[nearest]]
        left = np.delete(left, nearest)
    return np.array(order, int)


def plan_of(
    machine: Machine,
    instrument: Instrument,
    state: State,
    set_ups: tuple[Mapping[str, Vector], Mapping[str, Target]],
    timing: Timing,
    change_min: float,
    *,
    shuffled: np.random.Generator | None = None,
) -> Plan:
    """The plan through states, station by station and target by target: on a short path, or shuffled.

    set_ups: the stations, mm, and the targets; each further station starts with the target that is mounted. The time of
    the set-up counts for each station.
    """
    stations, targets = set_ups
    state = state.rows(_in_turn(machine, state, stations, list(targets), shuffled))
    found, target, station = state.positions, state.target, state.station
    assert target is not None
    assert station is not None
    time, minutes = times(machine, found, None, timing)
    waits = change_min * np.append(False, target[1:] != target[:-1])
    waits += timing.setup_min * np.append(False, station[1:] != station[:-1])
    planned = replace(
        with_moves(State(found)),
        time=time + 60.0 * np.cumsum(waits),
        cycle=np.zeros(len(found)),
        target=target,
        station=station,
    )
    return Plan(
        machine, "optimised", planned, np.char.add("O", np.arange(1, len(found) + 1).astype(str)),
        np.full(len(found), "1"), {name: own for name, own in targets.items() if name in target},
        minutes=minutes + float(waits.sum()), position_count=len(found),
        stations={name: own for name, own in stations.items() if name in station}, instrument=instrument,
    )  # fmt: skip


def _in_turn(
    machine: Machine, state: State, stations: Iterable[str], targets: list[str], shuffled: np.random.Generator | None
) -> np.ndarray:
    """Order `(n,)` of the states: station by station, the targets forward and back."""
    assert state.target is not None
    assert state.station is not None
    order = []
    for station in stations:
        for name in targets:
            mine = np.flatnonzero((state.station == station) & (state.target == name))
            path = toured(machine, state.positions[mine]) if shuffled is None else shuffled.permutation(len(mine))
            order.append(mine[path])
        targets = targets[::-1]
    return np.concatenate(order)
