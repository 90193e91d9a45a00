"""The moves of a program in the other kind of coordinates: the tool point's in place of the axes', or the reverse.

With equal positions of the rotary axes, X Y Z of the axes and of the tool point differ by a rotation and a shift, so
that distances are the same in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.machine import TURN_DEG, NDArrayBool
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.motion.along import positions_along
from postproc.motion.frames import cartesian, other_frame
from postproc.motion.motions import Motions

STEP_DEG = 10.0
"""Largest turn of the rotary axes in a segment: the deviation of a shorter one is that of a parabola to 1 %."""
UNSAMPLED_FACTOR = 1.05
"""Factor on the largest sampled deviation, for the deviation between the samples."""
STEPS_OF_SEGMENT = 4
"""Steps in each segment at which the deviation is sampled."""
SUBDIVISION_ROUNDS = 12
MOST_SEGMENTS = 20_000
"""Most segments of a move."""


def with_frames(motions: Motions, rows: NDArrayBool) -> Motions:
    """The moves, those of some rows `(n,)` in the other frame; their arcs keep their plane."""
    if not rows.any():
        return motions
    start, target, frame = motions.copies("start", "target", "frame")
    frames = [*motions.frames, *(other_frame(motions.machine, each) for each in motions.frames)]
    frame[rows] += len(motions.frames)
    some, q = np.flatnonzero(rows), motions.in_machine
    moved = replace(motions.bare.take(some), frames=frames, frame=frame[some])
    start[some] = moved.in_program(q(motions.start)[some])
    target[some] = moved.in_program(q(motions.target)[some])
    columns = np.flatnonzero(motions.machine.rotary)
    for column, own in ((start, motions.start), (target, motions.target)):
        column[np.ix_(some, columns)] = own[np.ix_(some, columns)]
    arcs = {
        row: arc._replace(
            centre=(
                arc.centre[0] + float(start[row, arc.plane[0]] - motions.start[row, arc.plane[0]]),
                arc.centre[1] + float(start[row, arc.plane[1]] - motions.start[row, arc.plane[1]]),
            )
        )
        for row, arc in motions.arcs.items()
    }
    return replace(motions, frames=frames, frame=frame, start=start, target=target, arcs=arcs).with_used_frames


def turns(motions: Motions) -> Array:
    """Turn `(n, axes)` of the rotary axes in each move, degrees; 0 for linear axes."""
    return np.where(motions.machine.rotary, np.abs(motions.target - motions.start), 0.0)


def cuts_within(motions: Motions, rows: np.ndarray, turned: Array, limit_mm: float) -> dict[int, list[float]]:
    """Shares at which moves are cut, by row, so that the path in the other coordinates deviates by the limit at most.

    turned `(n,)`: degrees by which rotary axes, or the arc that a straight line replaces, turn; moves without them are
    straight in both kinds of coordinates.
    """
    rows = rows[turned[rows] > 0.0]
    if not len(rows):
        return {}
    count = np.maximum(np.ceil(turned[rows] / STEP_DEG), 1.0).astype(int)
    todo = np.arange(len(rows))
    for _ in range(SUBDIVISION_ROUNDS):
        deviation = UNSAMPLED_FACTOR * deviations(motions, rows[todo], count[todo])
        beyond = deviation > limit_mm
        if not beyond.any():
            break
        todo = todo[beyond]
        factor = np.maximum(np.sqrt(deviation[beyond] / limit_mm), 1.02)
        count[todo] = np.maximum(np.ceil(count[todo] * factor), count[todo] + 1)
        if (count > MOST_SEGMENTS).any():
            line = int(motions.line[rows[np.argmax(count)]])
            raise UserError(
                f"line {line}: the move needs more than {MOST_SEGMENTS} segments: give a larger --tolerance-um"
            )
    return {
        int(row): [i / n for i in range(1, n)] for row, n in zip(rows.tolist(), count.tolist(), strict=True) if n > 1
    }


def deviations(motions: Motions, rows: np.ndarray, count: np.ndarray) -> Array:
    """Largest distances `(k,)`, mm, of the path of rows `(k,)` from straight segments in the other coordinates.

    count `(k,)`: number of equal segments of each row.
    """
    machine, steps = motions.machine, count * STEPS_OF_SEGMENT
    ends = np.cumsum(steps + 1)
    first = ends - steps - 1
    step = np.arange(int(ends[-1])) - np.repeat(first, steps + 1)
    share = step / np.repeat(steps, steps + 1)
    part = motions.bare.take(np.repeat(rows, steps + 1))
    q = part.in_machine(positions_along(motions, np.repeat(rows, steps + 1), share))
    other = replace(part, frames=[other_frame(machine, each) for each in part.frames])
    points = other.in_program(q)[:, list(cartesian(machine))]
    low = np.arange(len(step)) - step % STEPS_OF_SEGMENT
    high = np.minimum(low + STEPS_OF_SEGMENT, np.repeat(ends - 1, steps + 1))
    weight = (step % STEPS_OF_SEGMENT / STEPS_OF_SEGMENT)[:, None]
    apart = np.linalg.norm(points - (points[low] + weight * (points[high] - points[low])), axis=1)
    return np.asarray(np.maximum.reduceat(apart, first))


def shifts_only(motions: Motions, rows: Sequence[int]) -> list[bool]:
    """True for each row in which the two kinds of coordinates differ by a shift alone, from start to end."""
    if not rows:
        return []
    some = np.array(rows, int)
    part = motions.bare.take(some)
    other = replace(part, frames=[other_frame(motions.machine, each) for each in part.frames])
    x_y_z = list(cartesian(motions.machine))
    shifts = []
    for share in (0.0, 0.3, 0.6, 1.0):
        program = positions_along(motions, some, np.full(len(some), share))
        shifts.append((other.in_program(part.in_machine(program)) - program)[:, x_y_z])
    return [bool(each) for each in (np.ptp(np.array(shifts), axis=0) < 1e-9).all(axis=1)]


def shares(motions: Motions, program: Array) -> NDArrayBool:
    """True `(n, 3, 3)` where X, Y or Z (row) in the other coordinates depends on X, Y or Z (column) of these.

    program `(n, axes)`: positions, mm and degrees.
    """
    other = replace(motions, frames=[other_frame(motions.machine, each) for each in motions.frames])
    x_y_z = list(cartesian(motions.machine))
    at = other.in_program(motions.in_machine(program))[:, x_y_z]
    found = np.zeros((len(program), 3, 3), bool)
    for column, axis in enumerate(x_y_z):
        beside = program.copy()
        beside[:, axis] += TURN_DEG
        moved = other.in_program(motions.in_machine(beside))[:, x_y_z] - at
        found[:, :, column] = np.abs(moved) > 1e-9 * TURN_DEG
    return found
