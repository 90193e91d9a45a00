"""Inverse kinematics of any chain: the axis positions that bring tool point and tool axis to a pose.

Up to two rotary axes are solved in closed form. With u the tool axis in the workpiece frame and p = +z the tool axis
at zero pose, u = R1(q1) R2(q2) p is subproblem 2 of Paden and Kahan (Murray, Li, Sastry, A Mathematical Introduction
to Robotic Manipulation, 1994, section 3.2). The directions w1, w2, R2 p span a spherical triangle whose half-angle
formulas give q2 without loss of digits, also where an arc cosine would lose half of them; q1 is then one atan2. Given
the rotary positions, the tool point is affine in the linear axes: a 3 x 3 solution. For the DMU 50 w1 = z and
w2 = (0, 1, -1)/sqrt 2 are 135 deg apart, the triangle's sin^2(B/2) = 2 sin^2(angle(z, u)/2) = 1 - k is thesis
(3.25), the atan2 is (3.26) with R2 p = (sqrt(2(k - k^2)), k - 1, k), and the 3 x 3 solution is (3.27)-(3.29).
Every other chain (three rotary axes, parallel ones, one about the tool's own axis) is searched by damped Newton.

At the pole the tool is parallel to the first rotary axis (B = 0 on the DMU 50, the table level). This axis can turn
without tilting the tool: its position is free, and stays that of the block before. Close to the pole it is not free.
The tool must tilt in a definite direction, and C must turn to this direction, however small the tilt: between two
blocks at B = 0.001 deg it may turn by 180 deg, and X and Y follow to hold the tool point. Each block's pose is exact
there, as everywhere; the distance between the blocks decides the path between them. At the other end (B = 180, the
farthest tilt) the two solutions meet; there B follows from the tilt only to about 1e-7 rad, the pose itself to
rounding.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from kinematics.columns import ChainColumns, Vector, cross, dot, length, minus, vector
from kinematics.error_transform import pose_slopes
from kinematics.forward import forward
from kinematics.machine import TRAVEL_ROUNDING, Machine, NDArrayBool
from kinematics.transforms import TURN_RAD, Array, read_only, turn

POLE = 5e-13  # rad: a tool axis this close to the line of the first rotary axis leaves that axis free
FOLD = 2e-15  # rad: a tool axis within rounding of the farthest tilt is taken to be on it
FLAT_VOLUME = 1e-9  # volume spanned by the directions of the linear axes below which they cannot position the tool
LAST_INVERSE_STEP = 5e-11  # mm: residual at which a damped Newton search ends, orientation at `ROTARY_ARM_MM`
ROTARY_ARM_MM = 100.0  # mm per rad: weighs orientation against position in the damped Newton search
RESTARTS = 8  # damped Newton searches from other rotary positions before a pose is given up
DOUBT = 1e-9  # rad: solutions whose ways differ by less are compared one by one
AHEAD, MOST_AHEAD = 16, 4096  # rows that are compared together: twice as many after rows without doubt
TOOL_AXIS = read_only(np.array([0.0, 0.0, 1.0]))
UNLIMITED = read_only(np.array([[-math.inf], [math.inf]]))


class Inverse(msgspec.Struct, frozen=True):
    """Axis positions of n poses, with the conditions of their use."""

    q: Array
    """`(n, axes)`, mm and rad, chain order. Finite in a row that is not reachable: the pose is exact but outside
    travel. NaN where there is no solution at all."""
    reachable: NDArrayBool
    """`(n,)`: the pose is taken inside travel."""
    singular: NDArrayBool
    """`(n,)`: the tool is parallel to the first rotary axis, whose position was kept (never set by damped Newton)."""


class _Goal(NamedTuple):
    """The target: tool point, unit tool axis, tool vector, each `(n, 3)`, or `(3,)` for a single pose."""

    position: Array
    axis: Array
    tool: Array


def inverse(
    machine: Machine,
    position: ArrayLike,
    tool_axis: ArrayLike,
    tool: ArrayLike = (0.0, 0.0, 0.0),
    *,
    start: ArrayLike | None = None,
    respect_travel: bool = True,
) -> Inverse:
    """Axis positions that put the tool point at `position` with the tool along `tool_axis`.

    position `(n, 3)`, mm, and tool_axis `(n, 3)`, from the tip towards the spindle, any length: workpiece frame, one
    row for all is allowed. tool `(3,)` or `(n, 3)`: the tip from the tool reference point (spindle nose), mm, tool
    frame. start `(axes,)`, mm and rad: positions before the first row (default: zeros, clipped into travel), where
    linear axes that `machine.translators` leaves out stay.

    Of the solutions (two branches, whole turns of rotary axes) each row takes the one inside travel that is nearest
    to the row before, by the sum of squares of rotary movements; one outside travel only when there is no other. A
    first rotary axis that is free stays where it was, even if turning it would bring a linear axis into travel.
    `Inverse.reachable` marks a pose that is not attainable; no exception does. Raises UserError when the linear axes of
    a chain solved in closed form do not span space.

    Source: thesis (3.25)-(3.29) for the DMU 50, Paden-Kahan subproblems in general; see the head of this module.
    """
    if not closed_form(machine):
        return damped_newton(machine, position, tool_axis, tool, start=start, respect_travel=respect_travel)
    goal = _goal(position, tool_axis, tool)
    first, travel = _limits(machine, start, respect_travel)
    candidates, attainable, free = _branches(machine, goal.axis)
    linear_travel = np.where(machine.rotary, UNLIMITED, travel)
    tried = (_on_ends(_completed(machine, candidate, first, goal), linear_travel) for candidate in candidates)
    fits = np.stack([_inside(q, linear_travel) for q in tried])
    angles = _choose(candidates, fits, attainable, free, first[machine.rotary], travel[:, machine.rotary])
    q = _on_ends(_completed(machine, angles, first, goal), travel)
    q[~attainable] = np.nan
    return Inverse(q, _inside(q, travel), attainable & free)


def rotary_solutions(machine: Machine, tool_axis: ArrayLike, start: ArrayLike) -> tuple[list[Array], bool]:
    """Every position of the rotary axes, up to whole turns, with the tool along `tool_axis`, and whether one is free.

    tool_axis `(3,)`, from the tip towards the spindle, workpiece frame. start `(axes,)`, mm and rad. The positions are
    `(rotary axes,)`, rad; none where no position has this orientation. A first rotary axis that is free keeps its
    start. Travel is not looked at. Chains without a closed form are searched from the start and from positions a
    quarter and half a turn beside it.
    """
    first, rotary = np.asarray(start, float), np.flatnonzero(machine.rotary)
    goal = _goal(np.zeros(3), tool_axis, np.zeros(3))
    if closed_form(machine):
        branches, attainable, free = _branches(machine, goal.axis)
        branches[:, free, :1] = first[rotary[:1]]
        return (list(branches[:, 0]) if attainable[0] else []), bool(free[0])
    found: list[Array] = []
    for shift in (0.0, *(sign * angle for angle in (np.pi / 2, np.pi) for sign in (1.0, -1.0))):
        for axis in rotary if shift else rotary[:1]:
            beside = np.where(np.arange(len(first)) == axis, first + shift, first)
            q = damped_newton(machine, goal.position, goal.axis, start=beside, respect_travel=False).q[0, rotary]
            if np.isfinite(q).all() and not any(np.allclose(np.exp(1j * q), np.exp(1j * other)) for other in found):
                found.append(q)
    return found, False


def linear_positions(machine: Machine, q: ArrayLike, position: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Copy of q with the linear axes that position the tool (`machine.translators`) moved to reach `position`.

    q `(n, axes)` or `(axes,)`, mm and rad, chain order: rotary and remaining linear positions are kept. position
    `(n, 3)` or `(3,)`, mm, workpiece frame. tool `(3,)` or `(n, 3)`, mm, tool frame. Returns `(n, axes)`; travel is
    not checked. The translators are NaN in rows where they do not span space (a linear axis behind a rotary one can
    be turned parallel to another). Raises UserError when they never do.

    Source: the tool point is affine in the linear axes, thesis (3.22)-(3.24).
    """
    columns = list(machine.translators)
    given, points, tips = (np.atleast_2d(np.asarray(rows, float)) for rows in (q, position, tool))
    n = np.broadcast_shapes((len(given),), (len(points),), (len(tips),))[0]
    moved = np.array(np.broadcast_to(given, (n, given.shape[1])))
    moved[:, columns] = 0.0
    chain = ChainColumns(machine, moved)
    missing = minus(vector(points), chain.point(vector(tips)))
    for k, steps in zip(columns, chain.linear_steps(missing), strict=True):
        moved[:, k] = steps
    return moved


def damped_newton(
    machine: Machine,
    position: ArrayLike,
    tool_axis: ArrayLike,
    tool: ArrayLike = (0.0, 0.0, 0.0),
    *,
    start: ArrayLike | None = None,
    respect_travel: bool = True,
) -> Inverse:
    """The same task as `inverse`, for any chain, by Levenberg-Marquardt search row after row.

    Arguments, frames and units as in `inverse`, to 1e-10 mm and 1e-12 rad; about 1 ms per row of a smooth path, 0.3 s
    for a pose out of reach. A search starts at the row before and moves every axis, none more than it must, holding
    at the ends of travel; then again without regard to travel, then from other rotary positions, always the same.
    Not every pose inside travel is sure to be found.

    Source: Levenberg-Marquardt with the geometric Jacobian (Murray, Li, Sastry, 1994, section 3.4).
    """
    goal = _goal(position, tool_axis, tool)
    previous, travel = _limits(machine, start, respect_travel)
    q = np.full((len(goal.position), len(machine.axes)), np.nan)
    for i in range(len(q)):
        found = _search_row(machine, _Goal(*(part[i] for part in goal)), previous, travel)
        if found is not None:
            q[i] = previous = found
    return Inverse(q, _inside(q, travel), np.zeros(len(q), bool))


def _goal(position: ArrayLike, tool_axis: ArrayLike, tool: ArrayLike) -> _Goal:
    """Arrays of one length; tool axes of length 1, NaN where they have no direction."""
    given = (np.atleast_2d(np.asarray(rows, float)) for rows in (position, tool_axis, tool))
    points, axis, tips = np.broadcast_arrays(*given)
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    return _Goal(points, axis / np.where(size > 0.0, size, np.nan), tips)


def _limits(machine: Machine, start: ArrayLike | None, respect_travel: bool) -> tuple[Array, Array]:
    """Positions `(axes,)` before the first row, and the travel `(2, axes)` to respect."""
    first = np.clip(0.0, *machine.travel) if start is None else np.asarray(start, float)
    return first, machine.travel if respect_travel else np.broadcast_to(UNLIMITED, machine.travel.shape)


def _rotary_directions(machine: Machine) -> list[Array]:
    return [axis.unit_direction for axis in machine.axes if axis.rotary]


def closed_form(machine: Machine) -> bool:
    """At most two rotary axes, and if two, neither parallel to each other nor the second to the tool."""
    lines = _rotary_directions(machine)
    if len(lines) != 2:
        return len(lines) < 2
    return all(np.linalg.norm(np.cross(lines[1], other)) > 1e-6 for other in (lines[0], TOOL_AXIS))


def _angle_between(a: Vector, b: Vector) -> Array:
    """Angles `(n,)`, rad, 0 to pi, between unit vectors; exact at both ends."""
    return np.asarray(np.arctan2(length(cross(a, b)), dot(a, b)))


def _angle_about(line: Vector, v: Vector, u: Vector) -> Array:
    """Angles `(n,)`, rad, that turn v about `line` into the half-plane of u (subproblem 1); accurate to the pole."""
    a, b = cross(line, v), cross(line, u)
    return np.asarray(np.arctan2(dot(cross(a, b), line), dot(a, b)))


def _branches(machine: Machine, u: Array) -> tuple[Array, NDArrayBool, NDArrayBool]:
    """All solutions, up to whole turns, that bring the tool axis to u `(n, 3)` with at most two rotary axes.

    Rotary positions `(branches, n, rotary axes)`; masks `(n,)`: u is attainable, the first rotary axis is free. Each
    row is calculated by itself, to the last bit.
    """
    lines, p = [vector(line) for line in _rotary_directions(machine)], vector(TOOL_AXIS)
    goal: Vector = (u[:, 0].copy(), u[:, 1].copy(), u[:, 2].copy())
    if not lines:
        return np.empty((1, len(u), 0)), _angle_between(p, goal) <= TRAVEL_ROUNDING, np.zeros(len(u), bool)
    free = length(cross(lines[0], goal)) <= POLE
    tilt = _angle_between(lines[0], goal)
    if len(lines) == 1:
        attainable = np.abs(tilt - _angle_between(lines[0], p)) <= TRAVEL_ROUNDING
        return _angle_about(lines[0], p, goal)[None, :, None], attainable, free
    opening, margin = _opening(tilt, _angle_between(lines[0], lines[1]), _angle_between(lines[1], p))
    second = _angle_about(lines[1], p, lines[0]) + np.stack([opening, -opening])
    once = cross(lines[1], p)
    twice = cross(lines[1], once)
    first = []
    for angle in second:  # Rodrigues: the tool axis turned about the second rotary axis
        sine, versed = np.sin(angle), 2.0 * np.sin(angle / 2.0) ** 2
        x, y, z = (p[i] + sine * once[i] + versed * twice[i] for i in range(3))
        first.append(_angle_about(lines[0], (x, y, z), goal))
    return np.stack([np.stack(first), second], axis=-1), margin >= -TRAVEL_ROUNDING, free


def _opening(tilt: Array, side1: Array, side2: Array) -> tuple[Array, Array]:
    """Angle `(n,)` between two sides of a spherical triangle opposite its third side `tilt` `(n,)`, all rad.

    The second result is the margin `(n,)`, rad, by which the triangle closes; at zero it is flat.
    """
    least, most = np.abs(side1 - side2), np.minimum(side1 + side2, TURN_RAD - side1 - side2)
    sine2 = np.sin((tilt + side1 - side2) / 2) * np.sin((tilt - side1 + side2) / 2)
    cosine2 = np.sin((side1 + side2 + tilt) / 2) * np.sin((side1 + side2 - tilt) / 2)
    opening = 2.0 * np.arctan2(np.sqrt(np.maximum(sine2, 0.0)), np.sqrt(np.maximum(cosine2, 0.0)))
    opening = np.where(most - tilt <= FOLD, np.pi, np.where(tilt - least <= FOLD, 0.0, opening))
    return opening, np.minimum(tilt - least, most - tilt)


def _completed(machine: Machine, angles: Array, start: Array, goal: _Goal) -> Array:
    """Positions `(n, axes)` with rotary axes at `angles`, translators where they must be, others as at the start."""
    q = np.tile(start, (len(angles), 1))
    q[:, machine.rotary] = angles
    return linear_positions(machine, q, goal.position, goal.tool)


def _inside(q: Array, travel: Array) -> NDArrayBool:
    return np.asarray(np.all((q >= travel[0]) & (q <= travel[1]), axis=1))


def _on_ends(q: Array, travel: Array) -> Array:
    """Positions with those outside travel by `TRAVEL_ROUNDING` or less put on its end."""
    clipped = np.clip(q, *travel)
    return np.where(np.abs(q - clipped) <= TRAVEL_ROUNDING, clipped, q)


def _choose(
    candidates: Array, fits: NDArrayBool, attainable: NDArrayBool, free: NDArrayBool, start: Array, travel: Array
) -> Array:
    """Rotary positions `(n, rotary axes)`: in each attainable row the branch and whole turns nearest to the row before.

    fits `(branches, n)`: the linear axes are inside travel. start `(rotary axes,)`, travel `(2, rotary axes)`.
    """
    limits = np.stack([travel[0] - TRAVEL_ROUNDING, travel[1] + TRAVEL_ROUNDING])
    low, high = limits.tolist()
    rows, chosen = np.flatnonzero(attainable), np.zeros(candidates.shape[1:])
    options, fitting, kept = candidates[:, rows], fits[:, rows], free[rows]
    taken, previous, at, ahead = np.empty(options.shape[1:]), start.tolist(), 0, AHEAD
    while at < len(rows):
        best, branch, least = previous, 0, (True, math.inf)
        for number, angles in enumerate(options[:, at].tolist()):
            wound, inside = _wound([previous[0], *angles[1:]] if kept[at] else angles, previous, low, high)
            cost = (not (inside and fitting[number, at]), math.dist(wound, previous))
            if cost < least:
                best, branch, least = wound, number, cost
        taken[at] = previous = best
        part = slice(at, at + 1 + ahead)
        found = _following(options[:, part], fitting[:, part], kept[part], branch, taken[at], limits)
        taken[at + 1 : at + 1 + len(found)] = found
        ahead = min(2 * ahead, MOST_AHEAD) if len(found) == ahead else AHEAD
        at += 1 + len(found)
        previous = taken[at - 1].tolist()
    chosen[rows] = taken
    return _on_ends(chosen, travel)


def _following(
    candidates: Array, fits: NDArrayBool, free: NDArrayBool, branch: int, first: Array, limits: Array
) -> Array:
    """Positions `(k, rotary axes)` of the rows behind the first one that stay in its branch without any doubt.

    candidates `(branches, n, rotary axes)`; first: position of the first row; limits `(2, rotary axes)`: of travel.
    """
    own, later = candidates[branch], candidates[:, 1:]
    turns = np.round((first - own[0]) / TURN_RAD) - np.cumsum(np.round(np.diff(own, axis=0) / TURN_RAD), axis=0)
    wound = own[1:] + TURN_RAD * turns
    wound[:, : int(free[0])] = first[: int(free[0])]
    before = np.concatenate([first[None], wound[:-1]])
    clear = (np.abs(wound - before) < np.pi - DOUBT).all(axis=1) & ~free[1:] & ~free[0]
    for other in np.delete(later, branch, axis=0):
        nearest = other + TURN_RAD * np.round((before - other) / TURN_RAD)
        clear &= np.linalg.norm(nearest - before, axis=1) > np.linalg.norm(wound - before, axis=1) + DOUBT
    unchanged = (later == candidates[:, :-1]).all(axis=(0, 2)) & (free[1:] == free[0])
    best = fits[branch, 1:] | ~fits[:, 1:].any(axis=0)
    sure = (clear | unchanged) & best & ((wound >= limits[0]) & (wound <= limits[1])).all(axis=1)
    return np.asarray(wound if sure.all() else wound[: int(sure.argmin())])


def _wound(angles: list[float], previous: list[float], low: list[float], high: list[float]) -> tuple[list[float], bool]:
    """The angles plus whole turns, nearest to `previous`, inside travel where possible; whether all are inside."""
    wound, inside = [], True
    for angle, before, least, most in zip(angles, previous, low, high, strict=True):
        near = angle + TURN_RAD * round((before - angle) / TURN_RAD)
        if not least <= near <= most:
            turns = math.ceil((least - near) / TURN_RAD) if near < least else math.floor((most - near) / TURN_RAD)
            fitting = near + TURN_RAD * turns
            inside &= least <= fitting <= most
            near = fitting if least <= fitting <= most else near
        wound.append(near)
    return wound, inside


def _search_row(machine: Machine, goal: _Goal, previous: Array, travel: Array) -> Array | None:
    """Positions `(axes,)` for one pose, inside travel if any search ends there; None when none ends at all."""
    rotary, outside = machine.rotary, None
    for seed in _seeds(np.clip(previous, *travel), travel):
        for limits in (travel, UNLIMITED):
            found = _search(machine, goal, seed, limits)
            if found is not None:
                found[rotary], _ = _wound(*(part[rotary].tolist() for part in (found, previous, *travel)))
                found = _on_ends(found, travel)
                if _inside(found[None], travel)[0]:
                    return found
                outside = found if outside is None else outside
    return outside


def _seeds(previous: Array, travel: Array) -> Array:
    """The previous positions, then others inside travel: rotary axes up to half a turn away, linear ones hardly."""
    low, high = np.maximum(travel[0], previous - np.pi), np.minimum(travel[1], previous + np.pi)
    return np.vstack([previous, np.random.default_rng(0).uniform(low, high, (RESTARTS, len(previous)))])


def _search(machine: Machine, goal: _Goal, q: Array, travel: Array) -> Array | None:
    """Levenberg-Marquardt from q `(axes,)` inside travel; None when it does not converge."""
    unit = np.where(machine.rotary, ROTARY_ARM_MM, 1.0)
    residual, jacobian = _linearised(machine, goal, q)
    damping = 1e-3
    for _ in range(100):
        if np.abs(residual).max() <= LAST_INVERSE_STEP:
            return q.copy()
        slope = residual @ jacobian
        held = ((q <= travel[0]) & (slope < 0)) | ((q >= travel[1]) & (slope > 0))
        J = np.where(held, 0.0, jacobian / unit)
        step = np.linalg.solve(J.T @ J + damping * np.eye(len(q)), J.T @ residual)
        trial = np.clip(q + step / unit, *travel)
        trial_residual, trial_jacobian = _linearised(machine, goal, trial)
        if np.linalg.norm(trial_residual) < np.linalg.norm(residual):
            q, residual, jacobian = trial, trial_residual, trial_jacobian
            damping = max(damping / 10.0, 1e-12)
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return None


def _linearised(machine: Machine, goal: _Goal, q: Array) -> tuple[Array, Array]:
    """Deviation of tool point and tool axis from the target at q `(axes,)`, `(6,)` mm, and its decrease per axis, `(6,
    axes)`.
    """
    pose = forward(machine, q[None])
    point, tool_axis = pose.apply(goal.tool)[0], turn(pose.rotation, TOOL_AXIS)[0]
    slopes = pose_slopes(machine, q, goal.tool)[0]
    moves, tilts = slopes[:3].T, np.cross(slopes[3:].T, tool_axis)
    residual = np.concatenate([goal.position - point, ROTARY_ARM_MM * (goal.axis - tool_axis)])
    return residual, np.hstack([moves, ROTARY_ARM_MM * tilts]).T
