"""Machines as chains of 4 x 4 matrices from the workpiece to the tool (docs/conventions.md), with finite errors.

The matrix of an axis is its motion, tool relative to workpiece, with its error: a rotation vector and a displacement
about the axis' point. The error of a linear axis belongs to the moving component, that of a rotary axis to the bed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
LINEAR = "XYZ"
COMPONENTS = "XYZABC"
EPSILON = 1e-300


@dataclass(frozen=True)
class Axis:
    """An axis; travel in mm or degrees, its line as a direction and a point in mm."""

    name: str
    carries: str
    """`workpiece` or `tool`."""
    low: float
    high: float
    line: Vector
    point: Vector = (0.0, 0.0, 0.0)

    @property
    def rotary(self) -> bool:
        """True for A, B and C."""
        return self.name not in LINEAR

    @property
    def own(self) -> int:
        """Index among E_X E_Y E_Z E_A E_B E_C of the positioning error."""
        return COMPONENTS.index(self.name)

    def share(self, position: Array) -> Array:
        """Share of the travel, 0 ... 1, at positions in mm or degrees."""
        return np.asarray((position - self.low) / (self.high - self.low))


@dataclass(frozen=True)
class Machine:
    """A machine: its axes in the order from the workpiece to the tool."""

    name: str
    axes: tuple[Axis, ...]
    size: float
    """Size of its errors relative to those of the large gantry."""
    angle_noise_um: float
    """Base of the noise of the tracker's angles in front of this machine."""

    @property
    def names(self) -> list[str]:
        """Names of the axes, in order."""
        return [axis.name for axis in self.axes]

    @property
    def linear(self) -> list[str]:
        """Names of the linear axes, in order."""
        return [axis.name for axis in self.axes if not axis.rotary]

    def column(self, name: str) -> int:
        """Index of an axis."""
        return self.names.index(name)

    def axis(self, name: str) -> Axis:
        """An axis by its name."""
        return self.axes[self.column(name)]


def _straight(letter: str, carries: str, low: float, high: float) -> Axis:
    x, y, z = (1.0 if letter == other else 0.0 for other in LINEAR)
    return Axis(letter, carries, low, high, (x, y, z))


CENTRE = (0.0, 0.0, 154.996)
"""Intersection of B and C of the DMU 50, mm."""
MACHINES = {
    machine.name: machine
    for machine in (
        Machine(
            "gantry",
            (_straight("X", "tool", 0, 5000), _straight("Y", "tool", 0, 3000), _straight("Z", "tool", 0, 1500)),
            1.0,
            5.0,
        ),
        Machine(
            "cframe",
            (_straight("X", "workpiece", 0, 600), _straight("Y", "workpiece", 0, 450), _straight("Z", "tool", 0, 500)),
            0.4,
            2.0,
        ),
        Machine(
            "dmu50",
            (
                Axis("C", "workpiece", 0, 360, (0.0, 0.0, 1.0), CENTRE),
                Axis("B", "workpiece", 0, 180, (0.0, 0.5**0.5, -(0.5**0.5)), CENTRE),
                _straight("X", "tool", -250, 250),
                _straight("Y", "tool", -225, 225),
                _straight("Z", "tool", 0, 400),
            ),
            0.4,
            2.0,
        ),
    )
}


def rotation(vectors: Array) -> Array:
    """Rotation matrices `(n, 3, 3)` of rotation vectors `(n, 3)`, rad, by Rodrigues' formula."""
    angle = np.sqrt(np.sum(vectors**2, axis=1) + EPSILON)
    x, y, z = (vectors / angle[:, None]).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    turn = angle[:, None, None]
    return np.asarray(np.eye(3) + np.sin(turn) * cross + 2.0 * np.sin(turn / 2.0) ** 2 * (cross @ cross))


def matrix(turn: Array, shift: Array, point: Vector = (0.0, 0.0, 0.0)) -> Array:
    """4 x 4 matrices `(n, 4, 4)`: a turn about a point by rotation vectors `(n, 3)`, then a shift `(n, 3)`."""
    result = np.zeros((len(turn), 4, 4))
    result[:, :3, :3] = rotation(turn)
    result[:, :3, 3] = shift + point - result[:, :3, :3] @ np.array(point)
    result[:, 3, 3] = 1.0
    return result


def error_frame(axis: Axis) -> Array:
    """Rotation (3, 3) from the frame of the axis' error motions to that of the machine.

    The smallest rotation that lays the letter's direction (X for A, Y for B, Z for C) on the line of the axis.
    """
    letter = np.eye(3)["XYZ".index(axis.name) if not axis.rotary else "ABC".index(axis.name)]
    line = np.array(axis.line) * (1.0 if letter @ np.array(axis.line) >= 0 else -1.0)
    across = np.cross(letter, line)
    sine = float(np.linalg.norm(across))
    if sine < 1e-12:
        return np.eye(3)
    return np.asarray(rotation((across / sine * np.arctan2(sine, float(letter @ line)))[None])[0])


def tool_points(machine: Machine, positions: Array, errors: Array, tool: Array, targets: Array) -> Array:
    """Points `(n, 3)`, mm, workpiece frame, of targets on the tool.

    positions `(n, axes)` in mm and degrees; errors `(n, axes, 6)` in mm and rad, E_X ... E_C of each axis, tool
    relative to workpiece; tool `(n, 3)`: displacement of the tool in its own directions, mm; targets `(n, 3)`, mm.
    """
    pose = np.tile(np.eye(4), (len(positions), 1, 1))
    none = np.zeros((len(positions), 3))
    for i, axis in enumerate(machine.axes):
        way = positions[:, [i]] * np.array(axis.line)
        moved = matrix(np.radians(way), none, axis.point) if axis.rotary else matrix(none, way)
        frame = error_frame(axis)
        error = matrix(errors[:, i, 3:] @ frame.T, errors[:, i, :3] @ frame.T, axis.point)
        outside = (axis.carries == "workpiece") != axis.rotary
        pose = pose @ error @ moved if outside else pose @ moved @ error
    at_tool = np.concatenate([targets + tool, np.ones((len(positions), 1))], axis=1)
    return np.asarray((pose @ at_tool[:, :, None])[:, :3, 0])


def nominal_points(machine: Machine, positions: Array, targets: Array) -> Array:
    """The same of the machine without errors."""
    return tool_points(machine, positions, no_errors(positions), np.zeros((len(positions), 3)), targets)


def no_errors(positions: Array) -> Array:
    """Errors `(n, axes, 6)` that are zero."""
    return np.zeros((*positions.shape, 6))


def without_rigid_motion(points: Array, displacements: Array, group: NDArray[np.int_] | None = None) -> Array:
    """Displacements `(n, 3)` at points `(n, 3)` less the best rigid motion of each group `(n,)`; of all without one."""
    left = displacements.copy()
    groups = np.zeros(len(points), int) if group is None else group
    for one in np.unique(groups):
        rows = groups == one
        arms = points[rows] - points[rows].mean(axis=0)
        arms /= max(float(np.abs(arms).max()), 1.0)
        turns = np.cross(np.eye(3)[None], arms[:, None])
        columns = np.concatenate([np.tile(np.eye(3), (len(arms), 1, 1)), turns], axis=1)
        design = columns.transpose(0, 2, 1).reshape(-1, 6)
        moved = displacements[rows].reshape(-1)
        left[rows] = (moved - design @ np.linalg.lstsq(design, moved, rcond=None)[0]).reshape(-1, 3)
    return left
