"""The six error motions of one axis at each of its positions, from three or more points on the component that it moves.

Thesis (3.5): at each position the displacements of P, Q and K are nine equations for six error motions. All nine are
solved, weighted by the instrument's information on each point, with the exact kinematics of the axis instead of first
order. The positions of the points on the component are estimated as well, from all positions of the axis. The thesis
takes them from the first position alone, whose noise would then affect all others.

Points at arbitrary positions on the component leave six directions undetermined, the *gauge*: a displacement of all
points on it. The gauge is fixed so that

- for a linear axis, each of the six error motions has mean zero over the positions;
- for a rotary axis, the six contain as little as possible of the motion that rotates with the component: its axis
  average line (ISO 230-1) is that of a least-squares fit of the circles and of the planes of all points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.forward import axis_pose, error_centre, error_pose
from kinematics.machine import Axis
from kinematics.transforms import Array, Pose, by_turn, read_only

RIGID_MOTION_ROUNDS = 20
LAST_RIGID_STEP = 1e-11
"""Step, mm and rad, below which the iteration ends."""
UNITS = read_only(np.array([1e-3] * 3 + [1e-6] * 3))
"""Factors from um and urad to mm and rad."""


@dataclass(frozen=True)
class RigidMotions:
    """Error motions in the axis' error frame, tool relative to workpiece, um and urad."""

    errors: Array
    """Error motions `(n, 6)`."""
    estimator: Array
    """Derivatives `(6n, 3kn)` of the errors with respect to the points' coordinates in mm, by position, then point."""
    information: Array
    """Information of the points on the errors `(6n, 6n)`; zero along the gauge."""
    gauge: Array
    """Conditions `(6, 6n)` that fix the gauge."""
    location: Array
    """Matrix `(6, 6n)` to the constants of a rotary axis' average line, 0 along the axis; zero for a linear axis."""
    body: Array
    """Points `(k, 3)`, mm, on the component at position zero."""
    body_estimator: Array
    """Derivatives `(3k, 3kn)` of `body` with respect to the points' coordinates."""

    @cached_property
    def whitening(self) -> Array:
        """Matrix `(6n + 6, 6n)` that whitens the error motions, and below it the conditions that fix the gauge."""
        values, vectors = np.linalg.eigh(self.information)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        conditions = self.gauge / np.linalg.norm(self.gauge, axis=1, keepdims=True)
        return np.concatenate([root, np.sqrt(values[-1]) * conditions])


def outward(axis: Axis, q: Array, errors: Array) -> Pose:
    """Poses `(n,)` of the component that the axis moves, from the side of the bed; errors `(n, 6)`, mm and rad."""
    link, error = axis_pose(axis, q), error_pose(axis, q, errors)
    return error @ link if axis.side == "tool" else (link @ error).inverse()


def error_design(axis: Axis, q: Array, points: Array) -> Array:
    """Derivatives `(n, k, 3, 6)` of points `(n, k, 3)` on the moved component by its error motions, at zero errors.

    F e + (F w) x arm is linear in translations e and rotations w: the closed form is the derivation. The modules of
    `kinematics.derived` are for the tool point of a whole chain; this function is for any point on one axis.
    """
    arms = points - error_centre(axis, q)[:, None, :]
    design = np.empty((*points.shape, 6))
    design[..., :3] = axis.error_frame
    design[..., 3:] = np.cross(axis.error_frame.T, arms[..., None, :]).swapaxes(2, 3)
    return design if axis.side == "tool" else -design


def solve(axis: Axis, q: Array, points: Array, weights: Array) -> RigidMotions:
    """Error motions of an axis at positions `(n,)`, mm or rad.

    points `(n, k, 3)`, mm, in the frame at the foot of the axis, on the side of the bed; weights `(n, k, 3, 3)`.
    """
    n, k = points.shape[:2]
    none = np.zeros((n, 6))
    nominal = outward(axis, q, none)
    body = np.mean([nominal.inverse().apply(points[:, j]) for j in range(k)], axis=1)
    gauge, location = _conditions(axis, _free(axis, q, _carried(nominal, body), nominal))
    conditions = np.pad(gauge, ((0, 0), (0, 3 * k)))
    errors = none
    for _ in range(RIGID_MOTION_ROUNDS):
        pose = outward(axis, q, errors * UNITS)
        carried = _carried(pose, body)
        design = _design(axis, q, carried, pose)
        weighted = (weights @ design.reshape(n, k, 3, -1)).reshape(design.shape)
        normal = design.T @ weighted
        estimator = _constrained(normal, conditions) @ weighted.T
        step = estimator @ (points - carried).reshape(-1)
        errors, body = errors + step[: 6 * n].reshape(n, 6), body + step[6 * n :].reshape(k, 3)
        if np.abs(step * np.append(np.tile(UNITS, n), np.ones(3 * k))).max() < LAST_RIGID_STEP:
            break
    ours, theirs = slice(0, 6 * n), slice(6 * n, None)
    cross = normal[ours, theirs]
    information = normal[ours, ours] - cross @ np.linalg.solve(normal[theirs, theirs], cross.T)
    return RigidMotions(errors, estimator[ours], information, gauge, location, body, estimator[theirs])


def _design(axis: Axis, q: Array, carried: Array, pose: Pose) -> Array:
    """Derivatives `(3kn, 6n + 3k)` of the carried points by error motions, um and urad, and by the body, mm.

    Of rotation vectors only the space that the columns span is exact, which decides where the sum of squares is least.
    """
    n, k = carried.shape[:2]
    design = np.zeros((n, k, 3, 6 * n + 3 * k))
    by_error = error_design(axis, q, carried) * UNITS
    rotation = np.broadcast_to(pose.rotation, (n, 3, 3))
    for i in range(n):
        design[i, :, :, 6 * i : 6 * i + 6] = by_error[i]
    for j in range(k):
        design[:, j, :, 6 * n + 3 * j : 6 * n + 3 * j + 3] = rotation
    return design.reshape(3 * n * k, -1)


def _carried(pose: Pose, body: Array) -> Array:
    """Points of the body `(n, k, 3)`, mm, at each pose."""
    return np.stack([pose.apply(point) for point in body], axis=1)


def _free(axis: Axis, q: Array, carried: Array, nominal: Pose) -> Array:
    """The gauge `(6n, 6)`: error motions, um and urad, equivalent to a displacement of all points on the component."""
    n, k = carried.shape[:2]
    back = nominal.inverse()
    centre = back.apply(carried.mean(axis=1))[:, None, :]
    on_body = np.stack([back.apply(carried[:, j]) for j in range(k)], axis=1) - centre
    moved = np.concatenate([np.broadcast_to(np.eye(3), (n, k, 3, 3)), by_turn(on_body)], axis=3)
    moved = nominal.rotation[:, None] @ moved * UNITS
    by_error = (error_design(axis, q, carried) * UNITS).reshape(n, 3 * k, 6)
    return np.concatenate([np.linalg.lstsq(by_error[i], moved[i].reshape(-1, 6), rcond=None)[0] for i in range(n)])


def _conditions(axis: Axis, free: Array) -> tuple[Array, Array]:
    """Linear functions `(6, 6n)` of the errors: conditions of the gauge, and location errors of a rotary axis."""
    n = len(free) // 6
    location = np.zeros((6, 6 * n))
    if not axis.rotary:
        return np.tile(np.eye(6), n) / n, location
    own = "ABC".index(axis.name[0])
    across = [j for j in range(6) if j % 3 != own]
    both = np.concatenate([free, np.tile(np.eye(6)[:, across].T, n).T], axis=1)
    functions = np.linalg.pinv(both)
    location[across] = functions[6:]
    return functions[:6], location


def _constrained(normal: Array, conditions: Array) -> Array:
    """The inverse of a normal matrix that is singular without these conditions."""
    size, k = len(normal), len(conditions)
    spread = 1.0 / np.sqrt(np.diag(normal))
    scaled = normal * np.outer(spread, spread)
    border = conditions * spread
    border /= np.linalg.norm(border, axis=1, keepdims=True)
    matrix = np.block([[scaled, border.T], [border, np.zeros((k, k))]])
    return np.asarray(np.linalg.inv(matrix)[:size, :size] * np.outer(spread, spread))
