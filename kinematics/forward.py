"""Exact forward kinematics of any chain, nominal and with errors.

Every axis contributes a transform M(q) at its position in the machine at zero pose (product of exponentials), so

    T_w^t(q) = M_1(q_1) ... M_n(q_n)          axes in order from the workpiece to the tool.

For the DMU 50 this is T_w^t = Rz(C) . T(d) Rx(45) Rz(-B) Rx(-45) T(-d) . T(X, Y, Z), thesis (3.19)-(3.24) and (3.37).

An axis' error motions E(q) are next to M(q) on the side of the *bed* for a rotary axis (its radial, axial and tilt
motions are those of the axis line, in axes that do not turn with it, so that their constants are its location errors)
and on the side of the *moving* component for a linear axis (measured on the carriage): both are one rigid
displacement about `axis.point`, which travels with a linear axis, written in `axis.error_frame`, tool relative to
workpiece.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kinematics.machine import Axis, Machine
from kinematics.transforms import IDENTITY, Array, Pose, rotation_about, rotation_vector_matrix, turn


def axis_pose(axis: Axis, q: Array) -> Pose:
    """Nominal transform M(q) of one axis at positions `(n,)`, mm or rad."""
    d = axis.unit_direction
    if not axis.rotary:
        return Pose(IDENTITY.rotation, q[:, None] * d)
    rotation = rotation_about(d, q)
    point = np.asarray(axis.point)
    return Pose(rotation, point - turn(rotation, point))


def error_centre(axis: Axis, q: Array) -> Array:
    """Point `(n, 3)` that the axis' error motions displace and turn about, in the frame on their side of the chain."""
    point = np.asarray(axis.point)[None]
    if axis.rotary:
        return point
    sign = 1.0 if axis.side == "tool" else -1.0
    return np.asarray(point + sign * q[:, None] * axis.unit_direction)


def error_pose(axis: Axis, q: Array, errors: Array) -> Pose:
    """Rigid displacement of error motions `(n, 6)`: E_X E_Y E_Z in mm, E_A E_B E_C in rad as a rotation vector."""
    frame = axis.error_frame
    rotation = rotation_vector_matrix(errors[:, 3:] @ frame.T)
    centre = error_centre(axis, q)
    return Pose(rotation, centre - turn(rotation, centre) + errors[:, :3] @ frame.T)


def forward(machine: Machine, q: ArrayLike, errors: Array | None = None) -> Pose:
    """Pose of the tool reference point relative to the workpiece.

    q: axis positions `(n, axes)` or `(axes,)` in chain order, mm and rad. errors: error motions `(n, axes, 6)`,
    mm and rad, or `(n, axes + 1, 6)` with a displacement of the tool in its own frame behind them; None is the nominal
    machine. One row of either serves for all. Returns rotations `(n, 3, 3)` and translations `(n, 3)`, mm, in the
    workpiece frame, which coincides with the machine frame when all axes are at zero.
    """
    positions = np.atleast_2d(np.asarray(q, float))
    pose = IDENTITY
    for i, axis in enumerate(machine.axes):
        link = axis_pose(axis, positions[:, i])
        if errors is not None:
            error = error_pose(axis, positions[:, i], errors[:, i])
            link = error @ link if axis.side == "tool" else link @ error
        pose = pose @ link
    if errors is not None and errors.shape[1] > len(machine.axes):
        pose = pose @ Pose(rotation_vector_matrix(errors[:, -1, 3:]), errors[:, -1, :3])
    n = np.broadcast_shapes((len(positions),), () if errors is None else (len(errors),))[0]
    return Pose(np.broadcast_to(pose.rotation, (n, 3, 3)), np.broadcast_to(pose.translation, (n, 3)))


def axis_frames(machine: Machine, q: Array) -> list[Pose]:
    """Nominal poses in front of each axis, and behind the last the tool reference point's, at positions `(n, axes)`."""
    frames = [IDENTITY]
    for i, axis in enumerate(machine.axes):
        frames.append(frames[-1] @ axis_pose(axis, q[:, i]))
    return frames


def tool_point(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0), errors: Array | None = None) -> Array:
    """Positions `(n, 3)`, mm, workpiece frame, of the point `tool` `(3,)` or `(n, 3)` from the tool reference point."""
    return forward(machine, q, errors).apply(tool)
