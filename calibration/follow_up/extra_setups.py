"""Follow-up designs with an additional or a new set-up: the tracker, a target, fixed targets, a bar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibration.follow_up.design import Data, FollowUpDesign, unused
from calibration.follow_up.fixed_standards import BAR_MM, bar, references
from calibration.measurement.measurement import Target
from kinematics.machine import Vector
from kinematics.transforms import Array, Pose, rotation_about, turn

STATION_MIN, TOOL_MIN = 20.0, 5.0
"""Minutes to set up the instrument again, and to change the tool, a target or a bar."""
TOOL_SHIFT_MM = 150.0
"""Shift of the other tool vector, mm."""
EVERY_MIN, LEAST_READINGS = 10.0, 6
"""Minutes between measurements of the fixed references, and about the least number of these measurements."""
BAR_READINGS = 10
"""Readings of each end of a bar."""


def from_elsewhere(data: Data) -> Iterator[FollowUpDesign]:
    """The tracker at the same distance, on the other side of the volume or a quarter round it."""
    m, registration = data.measurement, data.registration
    there, name = data.following(data.index, STATION_MIN), data.set_up
    assert name is not None
    pose = registration.poses[str(m.groups[-1])]
    centre = registration.points(there).mean(axis=0)
    for where, angle in (("across the volume", np.pi), ("a quarter round the volume", np.pi / 2)):
        round_it = rotation_about((0.0, 0.0, 1.0), angle)
        moved = pose @ Pose(round_it, centre - turn(round_it, centre))
        centres = {**registration.centres, name: moved.apply(centre)[0]}
        both = replace(registration, poses={**registration.poses, name: moved}, centres=centres)
        does = f"measure {data.positions} from a second station, {where}"
        plan = data.plan(f"second station {where}", does, there, both, STATION_MIN)
        yield plan._replace(unknown=data.own_drift)


def with_other_tools(data: Data) -> Iterator[FollowUpDesign]:
    """One target on the tool, shifted to the side or downwards."""
    m = data.measurement
    numbers = m.target_number[data.index]
    on_tool = [i for i, target in enumerate(m.targets.values()) if target.carrier == "tool"]
    rows = np.isin(numbers, on_tool)
    if not rows.any():
        return
    last = numbers[rows][-1]
    index = data.index[numbers == last]
    own, name = list(m.targets.values())[last].position, unused(list(m.targets))
    for words, shift in (("to the side", (TOOL_SHIFT_MM, 0.0, 0.0)), ("below", (0.0, 0.0, -TOOL_SHIFT_MM))):
        x, y, z = (a + b for a, b in zip(own, shift, strict=True))
        position: Vector = (x, y, z)
        there = data.following(index, TOOL_MIN, target=np.full(len(index), name))
        there = replace(there, targets={**m.targets, name: Target(position)})
        does = f"measure {len(index)} positions with a target {TOOL_SHIFT_MM:g} mm farther {words}"
        yield data.plan(f"target {words}", does, there, pause_min=TOOL_MIN)


def with_references(data: Data) -> Iterator[FollowUpDesign]:
    """The same positions with fixed targets between them: all of them at intervals, or one after every position."""
    count = len(data.index)
    fixed = references(data.measurement, data.registration)
    every = max(1, min(round(EVERY_MIN * 60.0 / data.step_s), -(-count // LEAST_READINGS)))
    at = np.append(np.arange(0, count, every), count)
    minutes = max(round(every * data.step_s / 60.0), 1)
    does = f"measure {data.positions} once more, and {len(fixed)} fixed targets every {minutes} min"
    yield _interleaved(data, "fixed references", does, fixed, np.repeat(at, len(fixed)))
    does = f"measure {data.positions} once more, after each of them one of {len(fixed)} fixed targets"
    yield _interleaved(data, "many fixed references", does, fixed, np.arange(1, count + 1))


def _interleaved(data: Data, name: str, does: str, fixed: dict[str, Target], before: np.ndarray) -> FollowUpDesign:
    """Fixed targets in turn, measured before the rows `before`, with the machine at the positions of those rows."""
    index, m = data.index, data.measurement
    assert m.state.target is not None
    rows = np.insert(index, before, index[np.minimum(before, len(index) - 1)])
    turns = np.resize(np.array(list(fixed), object), len(before))
    targets = np.insert(m.state.target[index].astype(object), before, turns).astype(str)
    there = replace(data.following(rows, target=targets), targets={**m.targets, **fixed})
    both = replace(data.registered_again, targets={**data.registration.targets, **_positions(fixed)})
    return data.plan(name, does, there, both)


def with_bar(data: Data) -> FollowUpDesign:
    """A calibrated bar, in line with the beam and with the tracker between its ends."""
    m = data.measurement
    ends, lengths = bar(m, data.registration)
    names = np.repeat(list(ends), BAR_READINGS)
    there = data.following(np.full(len(names), len(m) - 1), 2.0 * TOOL_MIN, target=names)
    both = replace(data.registered_again, targets={**data.registration.targets, **_positions(ends)})
    does = (
        f"measure a calibrated bar of {BAR_MM / 1e3:g} m, in line with the beam and with the tracker between its ends"
    )
    there = replace(there, targets={**m.targets, **ends})
    return data.plan("bar", does, there, both, 2.0 * TOOL_MIN)._replace(lengths=lengths)


def _positions(targets: dict[str, Target]) -> dict[str, Array]:
    return {name: np.array(target.position) for name, target in targets.items()}
