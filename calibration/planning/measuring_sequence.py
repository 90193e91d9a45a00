"""Measuring sequence: order, direction of approach, runs, targets and reference measurements of the positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.measurement.measurement import with_moves
from calibration.measurement.plan import Choices, MeasuringSequence, Plan, Timing
from calibration.planning.patterns import MOST_PLANNED_POINTS
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

LETTERS = 26
"""Largest number of measurements of a point that letters tell apart."""


def measuring_plan(
    laid: MeasuringSequence, machine: Machine, strategy: str, choices: Choices, requested: int | None, reference: Array
) -> Plan:
    """The plan for the positions of a strategy; `reference` `(axes,)`, in file units, is the reference position."""
    observations = len(laid.positions) * len(choices.targets) * choices.runs
    if observations > MOST_PLANNED_POINTS:
        raise UserError(
            f"{observations} observations with all targets and runs are more than the limit of {MOST_PLANNED_POINTS}"
        )
    sequence = _ordered(laid, choices)
    if choices.references:
        sequence = _with_references(sequence, choices.references, reference)
    return _finished(sequence, machine, strategy, choices, requested, len(laid.positions))


def _ordered(sequence: MeasuringSequence, choices: Choices) -> MeasuringSequence:
    """The path with its directions of approach; shuffled, or forward and back."""
    n = len(sequence.positions)
    if choices.approach != "any":
        moves = np.ptp(sequence.positions, axis=0) > 0
        side = moves * (1.0 if choices.approach == "positive" else -1.0)
        sequence = sequence._replace(from_side=np.tile(side, (n, 1)))
    if choices.order == "shuffled":
        sequence = sequence.rows(np.random.default_rng(choices.seed).permutation(n))
    elif choices.order == "retraced":
        sequence = sequence.rows(np.append(np.arange(n), np.arange(n - 1)[::-1]))
    return sequence


def _with_references(sequence: MeasuringSequence, every: int, reference: Array) -> MeasuringSequence:
    """The path with the reference position at its start, after every `every` positions, and at its end."""
    n = len(sequence.positions)
    at = np.unique(np.append(np.arange(0, n, every), n))
    axis = None if sequence.axis is None else np.insert(sequence.axis, at, sequence.axis[np.minimum(at, n - 1)])
    side = (
        None
        if sequence.from_side is None
        else np.insert(sequence.from_side, at, sequence.from_side[0] * (sequence.axis is None), axis=0)
    )
    names = np.insert(sequence.names.astype(object), at, "REF").astype(str)
    return MeasuringSequence(np.insert(sequence.positions, at, reference, axis=0), names, axis, side)


def _finished(
    sequence: MeasuringSequence,
    machine: Machine,
    strategy: str,
    choices: Choices,
    requested: int | None,
    position_count: int,
) -> Plan:
    """The plan of a path: with all runs and targets, and the approach and times that follow from the order."""
    index, run, target = _repeated(len(sequence.positions), choices)
    sequence = sequence.rows(index)
    if sequence.axis is None:
        sequence = sequence._replace(names=_apart(sequence.names, target))
    positions = sequence.positions * machine.scale
    before = None
    if sequence.from_side is not None:
        first = sequence.from_side.any(axis=1)
        first &= np.append(True, np.diff(index) != 0) | (run != np.roll(run, 1))  # no approach between targets
        start = np.where(
            first[:, None], (sequence.positions - sequence.from_side * choices.overrun) * machine.scale, np.nan
        )
        before = start if first.any() else None
    state = _with_approach(State(positions), before)
    time, minutes = times(machine, positions, before, choices.timing)
    state = replace(state, time=time, cycle=run - 1.0, target=np.array(list(choices.targets))[target])
    notes = []
    if machine.rotary.any() and choices.rotary == "fixed" and not np.ptp(positions[:, machine.rotary], axis=0).any():
        fixed = (f"{a.name} {p:g}" for a, p in zip(machine.axes, sequence.positions[0], strict=True) if a.rotary)
        notes.append(f"the rotary axes do not move: {', '.join(fixed)} deg (--rotary moves them)")
    return Plan(
        machine, strategy, state, sequence.names, run.astype(str), choices.targets, sequence.axis, before, minutes,
        requested, position_count, tuple(notes),
    )  # fmt: skip


def _apart(names: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Names `(n,)` that occur once for each target: `R9b` where R9 is measured again, then `R9c`, later `R9_27`.

    An export of the instrument is joined with the plan by these names.
    """
    found, seen = [], dict[tuple[str, int], int]()
    for name, number in zip(names.tolist(), target.tolist(), strict=True):
        times = seen[name, number] = seen.get((name, number), 0) + 1
        again = "" if times == 1 else chr(ord("a") + times - 1) if times <= LETTERS else f"_{times}"
        found.append(f"{name}{again}")
    return np.array(found)


def _repeated(n: int, choices: Choices) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row of the path, number of the run from 1, and number of the target, for every observation."""
    targets, runs = len(choices.targets), choices.runs
    if choices.target_order == "alternating":
        return (
            np.tile(np.repeat(np.arange(n), targets), runs),
            np.repeat(np.arange(1, runs + 1), n * targets),
            np.tile(np.arange(targets), n * runs),
        )
    return (
        np.tile(np.arange(n), runs * targets),
        np.tile(np.repeat(np.arange(1, runs + 1), n), targets),
        np.repeat(np.arange(targets), n * runs),
    )


def _with_approach(state: State, before: Array | None) -> State:
    """The state with approach and last moves, from all positions on the path."""
    if before is None:
        return with_moves(state)
    passed, measured = _passed(state.positions, before)
    return with_moves(State(passed)).rows(measured)


def _passed(positions: Array, before: Array) -> tuple[Array, np.ndarray]:
    """All positions on the path `(m, axes)`, and the indices `(n,)` of the measured ones."""
    extra = ~np.isnan(before[:, 0])
    measured = np.arange(len(positions)) + np.cumsum(extra)
    passed = np.empty((len(positions) + int(extra.sum()), positions.shape[1]))
    passed[measured] = positions
    passed[measured[extra] - 1] = before[extra]
    return passed, measured


def times(machine: Machine, positions: Array, before: Array | None, timing: Timing) -> tuple[Array, float]:
    """Time `(n,)` of each observation, s, from the first; and total duration, min."""
    each = timing.point_s if timing.dwell_s is None else timing.dwell_s
    time = each * np.arange(len(positions))
    if timing.feed is not None:
        passed, measured = (positions, np.arange(len(positions))) if before is None else _passed(positions, before)
        steps = np.diff(passed / machine.scale, axis=0, prepend=passed[:1] / machine.scale)
        # the feed refers to the linear axes together, or to the rotary axes if no linear axis moves
        linear, turned = (np.linalg.norm(steps[:, mask], axis=1) for mask in (~machine.rotary, machine.rotary))
        sequence = np.cumsum(np.maximum(linear, turned) / timing.feed * 60.0)[measured]
        time = time + sequence - sequence[0]
    return np.asarray(time), timing.setup_min + float(time[-1] + each) / 60.0
