"""A short path through positions, and the plan along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibration.measurement.measurement import Target, with_moves
from calibration.measurement.plan import Plan, Timing
from calibration.planning.measuring_sequence import times
from kinematics.machine import Machine
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
    positions: Array,
    target: np.ndarray,
    targets: Mapping[str, Target],
    timing: Timing,
    change_min: float,
    *,
    shuffled: np.random.Generator | None = None,
) -> Plan:
    """The plan through positions `(n, axes)`, one target after the other: on a short path, or shuffled."""
    order = []
    for name in targets:
        mine = np.flatnonzero(target == name)
        order.append(mine[toured(machine, positions[mine])] if shuffled is None else shuffled.permutation(mine))
    rows = np.concatenate(order)
    found, names = positions[rows], target[rows]
    time, minutes = times(machine, found, None, timing)
    changes = np.cumsum(np.append(False, names[1:] != names[:-1]))
    used = {name: targets[name] for name in targets if name in names}
    state = replace(
        with_moves(State(found)), time=time + 60.0 * change_min * changes, cycle=np.zeros(len(found)), target=names
    )
    return Plan(
        machine, "optimised", state, np.char.add("O", np.arange(1, len(found) + 1).astype(str)),
        np.full(len(found), "1"), used, minutes=minutes + change_min * float(changes[-1]), position_count=len(found),
    )  # fmt: skip
