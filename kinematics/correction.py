"""The correction: the command whose actual pose, under an error model, is the nominal one."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.columns import ChainColumns, Vector, minus, plus, rows_of, vector
from kinematics.error_transform import pose_slopes
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from kinematics.user_error import UserError

LAST_CORRECTION_STEP = 1e-8
"""mm and rad."""
TURNING, LEAST_RATIO = 4.0, 1e-3
"""A step is taken to be as long against the last one as that against the one before, times TURNING because it has
another direction, and at least LEAST_RATIO of it."""
MAX_ROUNDS = 12
MAX_HALVINGS = 24
POLE_DAMPING_RAD = 5e-3
"""rad: the tilt off a pole below which rotary axes give up correcting the orientation (gain 1/2 there)."""


Errors = Callable[[Array], Array]
"""Error motions `(n, axes + 1, 6)` of a machine at axis positions `(n, axes)`, mm and rad."""


class Uncorrected(NamedTuple):
    """A machine at nominal positions, without a correction."""

    chain: ChainColumns
    there: Vector
    """Nominal tool points, mm, workpiece frame."""
    reached: Vector
    """Actual tool points, likewise."""


def correct_position(
    machine: Machine,
    errors: Errors,
    nominal: Array,
    tool: Array,
    movable: NDArrayBool,
    start: Array | None = None,
    shift: ArrayLike = (0.0, 0.0, 0.0),
    precision: float = LAST_CORRECTION_STEP,
    slope: float = np.inf,
    uncorrected: Uncorrected | None = None,
) -> Array:
    """Axis positions `(n, axes)`, mm and rad, whose actual tool point is where the nominal one is at `nominal`.

    tool `(n, 3)` mm; movable `(n, axes)`: axes that may move, of which only the translators do. start `(n, axes)`:
    positions that all other axes take (default: nominal). shift `(n, 3)`, mm, workpiece frame: from the nominal tool
    point to the target. The target of the nominal machine is shifted by the tool point error of the exact model until
    this error vanishes: each step is about the slope of the errors (1e-4) times the one before. A row stops where its
    next step would be below `precision`, mm, whatever the rows beside it need. slope: largest change of the errors by
    way, mm/mm; where it is infinite the errors may jump, and a row stops after such a step. If the target lies in a
    jump, the side with the smaller error is taken. uncorrected: with these errors and tools at `nominal`, if the caller
    has it, and without `start`. UserError if the iteration does not converge.
    """
    n, tip = len(nominal), vector(tool)
    translators = machine.translators
    moving = np.zeros_like(movable)
    moving[:, translators] = movable[:, translators]
    others = nominal if start is None else start
    unmoved = others.copy()
    unmoved[:, translators] = 0.0
    fixed = ChainColumns(machine, unmoved, uncorrected and uncorrected.chain)
    there = (
        uncorrected.there
        if uncorrected is not None
        else ChainColumns(machine, nominal, fixed if start is None else None).point(tip)
    )
    aim = there if start is None else ChainColumns(machine, others, fixed).point(tip)
    target, base, q = plus(there, vector(shift)), fixed.point(tip), np.ascontiguousarray(others.T)
    unsettled, before = np.ones(n, bool), np.full(n, precision)
    reached = uncorrected.reached if uncorrected is not None else _reached(machine, errors, q, fixed, tip)
    for _ in range(MAX_ROUNDS):
        aim = minus(aim, minus(reached, target))
        following, steps = q.copy(), np.zeros(n)
        for k, position in zip(translators, fixed.linear_steps(minus(aim, base)), strict=True):
            following[k] = np.where(moving[:, k] & unsettled, position, q[k])
            steps = np.maximum(steps, np.abs(following[k] - q[k]))
        q = following
        reduced = np.minimum(np.maximum(TURNING * steps / before, LEAST_RATIO), slope) if slope < 1.0 else 1.0
        unsettled &= steps * reduced >= precision
        before = np.maximum(steps, precision)
        if not unsettled.any():
            return np.ascontiguousarray(q.T)
        reached = _reached(machine, errors, q, fixed, tip)
    targets = rows_of(target, n), np.broadcast_to(tool, (n, 3)), moving, others
    return _beside_jumps(machine, errors, np.ascontiguousarray(q.T), targets, unsettled)


def _reached(machine: Machine, errors: Errors, q: Array, like: ChainColumns, tip: Vector) -> Vector:
    """Actual tool points at axis positions `(axes, n)`; like: another chain with equal positions of the rotary axes."""
    return ChainColumns(machine, q.T, like).point(tip, errors(q.T))


def _beside_jumps(
    machine: Machine, errors: Errors, q: Array, targets: tuple[Array, Array, NDArrayBool, Array], unsettled: NDArrayBool
) -> Array:
    """The positions q `(n, axes)`, in the rows `unsettled` `(n,)` those beside a jump with the smallest tool point
    error.

    targets: targets and tools `(n, 3)`, mm; axes that move `(n, axes)`; positions `(n, axes)` of all others. Each axis
    moves towards the target by steps that are halved whenever it reverses, down to its resolution: then it is beside
    the jump, and the best position of both sides along each axis, and of the uncorrected one, is taken.
    """
    target, tool, others = targets[0][unsettled], targets[1][unsettled], targets[3][unsettled]
    moving: NDArrayBool = targets[2][unsettled]
    resolution = np.array([axis.resolution for axis in machine.axes]) * machine.scale

    def pose_error(at: Array) -> Array:
        return np.asarray(tool_point(machine, at, tool, errors_there(at)) - target)

    def errors_there(at: Array) -> Array:
        everywhere = q.copy()
        everywhere[unsettled] = at
        return errors(everywhere)[unsettled]

    at, size, before = q[unsettled], np.full_like(target[:, :1], np.inf), np.zeros_like(others)
    for _ in range(MAX_HALVINGS):
        aim = tool_point(machine, at, tool) - pose_error(at)
        step = np.where(moving, linear_positions(machine, at, aim, tool) - at, 0.0)
        size = np.where(step * before < 0.0, np.abs(before) / 2, size)
        before = np.clip(step, -size, size)
        at = at + before
        if (np.abs(before) < resolution).all():
            break
    else:
        raise UserError("the error model changes so steeply with position that the correction does not converge")
    sides = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
    shifts = np.zeros((len(sides), len(resolution)))
    shifts[:, machine.translators] = sides * resolution[list(machine.translators)]
    candidates = [others, *(at + np.where(moving, shift, 0.0) for shift in shifts)]
    best = np.argmin([np.linalg.norm(pose_error(candidate), axis=1) for candidate in candidates], axis=0)
    result = q.copy()
    result[unsettled] = np.array(candidates)[best, np.arange(len(at))]
    return result


def correct_orientation(machine: Machine, errors: Errors, nominal: Array, movable: NDArrayBool) -> Array:
    """Axis positions `(n, axes)` with the movable rotary axes turned so that the actual tool axis is the nominal one.

    FOR of ISO/TR 16907, as far as the rotary axes reach: about its own axis a tool needs no correction. Damped least
    squares, |tool axis error|^2 + `POLE_DAMPING_RAD`^2 |turn|^2 -> min, Gauss-Newton: beside a pole, where a rotary
    axis would have to turn far to tilt the tool a little, it turns at most error / (2 `POLE_DAMPING_RAD`), and on the
    pole not at all.
    """
    rotary = np.flatnonzero(machine.rotary)
    n = len(nominal)
    target = rows_of(ChainColumns(machine, nominal).tool_axis(), n)
    q = nominal.copy()
    free = movable[:, rotary].astype(float)
    for _ in range(MAX_ROUNDS):
        actual = rows_of(ChainColumns(machine, q).tool_axis(errors(q)), n)
        lines = pose_slopes(machine, q)[:, 3:, rotary]
        slopes = np.cross(lines, actual[:, :, None], axis=1) * free[:, None, :]
        gradient = np.einsum("nci,nc->ni", slopes, actual - target) + POLE_DAMPING_RAD**2 * (q - nominal)[:, rotary]
        hessian = slopes.swapaxes(1, 2) @ slopes + POLE_DAMPING_RAD**2 * np.eye(len(rotary))
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0] * free
        q[:, rotary] -= step
        if np.abs(step).max(initial=0.0) < LAST_CORRECTION_STEP:
            break
    return q
