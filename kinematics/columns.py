"""The chain as columns of coordinates: a vector is three arrays, with one entry per row.

The poses are those of `kinematics.forward`, without a matrix per row: points and directions walk from the tool to the
workpiece, one axis after the other. The sines and cosines of rotary axes are computed once for all walks.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from kinematics.machine import Machine
from kinematics.transforms import Array, read_only

Vector = tuple[Array, Array, Array]
"""Components x, y and z of n vectors, each `(n,)`, or `(1,)` for all rows."""
FLAT_DIRECTIONS = 1e-9
"""Volume spanned by the directions of the linear axes below which they cannot position the tool."""
SMALL_ANGLE_RAD2 = 1e-4
"""rad^2: the square of an angle below which two terms of the series of a rotation are exact to rounding."""


def vector(rows: ArrayLike) -> Vector:
    """Columns of vectors `(n, 3)` or `(3,)`; one entry where all rows are equal."""
    given = np.atleast_2d(np.asarray(rows, float))
    if len(given) > 1 and (given.strides[0] == 0 or (given == given[0]).all()):
        given = given[:1]
    x, y, z = np.ascontiguousarray(given.T)
    return x, y, z


def rows_of(columns: Vector, n: int) -> Array:
    """Vectors `(n, 3)` of columns."""
    result = np.empty((n, 3))
    for j, column in enumerate(columns):
        result[:, j] = column
    return result


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product, row by row."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def plus(a: Vector, b: Vector) -> Vector:
    """Sum, row by row."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Difference, row by row."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Vector, b: Vector) -> Array:
    """Scalar product `(n,)`."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(a: Vector) -> Array:
    """Length `(n,)`."""
    return np.asarray(np.sqrt(dot(a, a)))


class _Motion:
    """Error motions of n rows."""

    def __init__(self, translation: Vector, rotation: Vector) -> None:
        """Translation, mm, and rotation vectors, rad."""
        self.translation, self._rotation = translation, rotation
        square = dot(rotation, rotation)
        sine, versed = 1.0 - square * (1.0 / 6.0 - square / 120.0), 0.5 - square * (1.0 / 24.0 - square / 720.0)
        large = square >= SMALL_ANGLE_RAD2
        if large.any():
            angle = np.sqrt(square)
            sine = np.where(large, np.sinc(angle / np.pi), sine)
            versed = np.where(large, 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2, versed)
        self._sine, self._versed = sine, versed

    def turned(self, p: Vector) -> Vector:
        """Vectors turned by the rotation (Rodrigues)."""
        once = cross(self._rotation, p)
        twice = cross(self._rotation, once)
        sine, versed = self._sine, self._versed
        return (
            p[0] + sine * once[0] + versed * twice[0],
            p[1] + sine * once[1] + versed * twice[1],
            p[2] + sine * once[2] + versed * twice[2],
        )


class ChainColumns:
    """A machine at axis positions."""

    def __init__(self, machine: Machine, q: Array, like: ChainColumns | None = None) -> None:
        """q `(n, axes)`, mm and rad. like: another with equal positions of the rotary axes, known to the caller."""
        self.machine = machine
        self.columns: Array = np.ascontiguousarray(q.T)
        self._turns: Sequence[tuple[Array, Array] | None] = (
            like._turns
            if like is not None
            else [
                (np.sin(x), np.cos(x)) if axis.rotary else None
                for axis, x in zip(machine.axes, self.columns, strict=True)
            ]
        )
        self._errors: Array | None = None
        self._kept: dict[int, _Motion | None] = {}
        """The motions of these errors, by axis."""

    def __len__(self) -> int:
        return int(self.columns.shape[1])

    def rows(self, rows: np.ndarray) -> ChainColumns:
        """Some of the rows."""
        part = ChainColumns(self.machine, self.columns[:, rows].T, self)
        part._turns = [turn and (turn[0][rows], turn[1][rows]) for turn in self._turns]
        return part

    def point(self, tool: Vector, errors: Array | None = None) -> Vector:
        """Tool points, mm, workpiece frame; tool: from the tool reference point, mm. As `forward(...).apply(tool)`.

        errors `(n, axes, 6)` or `(n, axes + 1, 6)`, as for `forward`; best with the rows of one error motion next to
        each other in memory.
        """
        axes = self.machine.axes
        p = tool
        if (own := self._motion(len(axes), errors)) is not None:
            p = plus(own.turned(p), own.translation)
        for i in range(len(axes) - 1, -1, -1):
            axis, x, motion = axes[i], self.columns[i], self._motion(i, errors)
            if motion is None:
                p = self._about(i, p) if axis.rotary else _shifted(axis.unit_direction.tolist(), x, p)
                continue
            centre, head = axis.point, axis.side == "tool"
            p = _from(centre, p)
            if head:
                p = self._turn(i, p)
            elif not axis.rotary:
                p = _shifted(axis.unit_direction.tolist(), x, p)
            p = plus(motion.turned(p), motion.translation)
            if not head:
                p = self._turn(i, p)
            elif not axis.rotary:
                p = _shifted(axis.unit_direction.tolist(), x, p)
            p = _from((-centre[0], -centre[1], -centre[2]), p)
        return p

    def tool_axis(self, errors: Array | None = None) -> Vector:
        """Directions of the tool axis from the tip, workpiece frame: the third column of the rotation of `forward`."""
        axes = self.machine.axes
        v = _Z
        if (own := self._motion(len(axes), errors)) is not None:
            v = own.turned(v)
        for i in range(len(axes) - 1, -1, -1):
            motion, head = self._motion(i, errors), axes[i].side == "tool"
            if head:
                v = self._turn(i, v)
            if motion is not None:
                v = motion.turned(v)
            if not head:
                v = self._turn(i, v)
        return v

    @cached_property
    def nominal_tool_axis(self) -> Vector:
        """As `tool_axis`, of a machine without errors."""
        return self.tool_axis()

    def _motion(self, i: int, errors: Array | None) -> _Motion | None:
        """The error motions of one axis, or last of the tool, in the directions of the machine; None if there are none.

        Those of the last errors are kept, because a point and a direction are turned alike.
        """
        if errors is None or i == errors.shape[1]:
            return None
        if self._errors is not errors:
            self._errors, self._kept = errors, {}
        if i not in self._kept:
            self._kept[i] = self._acting(i, errors[:, i])
        return self._kept[i]

    def _acting(self, i: int, errors: Array) -> _Motion | None:
        """As `_motion`, of the error motions `(n, 6)` of one axis."""
        if i == len(self.machine.axes):
            return _Motion(vector(errors[:, :3]), vector(errors[:, 3:])) if errors.any() else None
        motion = errors.T
        if not (motion[:, :1].any() or motion.any()):  # the first row is mostly enough to see it
            return None
        frame = self.machine.axes[i].error_frame
        translation: Vector = (motion[0], motion[1], motion[2])
        rotation: Vector = (motion[3], motion[4], motion[5])
        if np.array_equal(frame, _UPRIGHT):
            return _Motion(translation, rotation)
        return _Motion(_in_frame(frame.tolist(), translation), _in_frame(frame.tolist(), rotation))

    def linear_steps(self, displacement: Vector) -> Vector:
        """Steps of `machine.translators`, mm, that move the nominal tool point by a displacement, mm.

        nan where their directions do not span space.
        """
        axes, (first, *_, last) = self.machine.axes, self.machine.translators
        if any(axis.rotary for axis in axes[first:last]):
            x, y, z = (dot(row, displacement) for row in self._linear_inverse)
            return x, y, z
        for i in range(first):  # they turn together
            displacement = self._turn(i, displacement, back=True)
        directions = np.array([axes[k].unit_direction for k in self.machine.translators]).T
        spanning = abs(np.linalg.det(directions)) > FLAT_DIRECTIONS
        steps = np.linalg.inv(directions) if spanning else np.full((3, 3), np.nan)
        return displacement if np.array_equal(steps, _UPRIGHT) else _in_frame(steps.tolist(), displacement)

    @cached_property
    def _linear_inverse(self) -> tuple[Vector, Vector, Vector]:
        """Rows of the inverse of the directions of `machine.translators` in the workpiece frame."""
        lines = []
        for k in self.machine.translators:
            line = vector(self.machine.axes[k].unit_direction)
            for i in range(k - 1, -1, -1):
                line = self._turn(i, line)
            lines.append(line)
        normals = cross(lines[1], lines[2]), cross(lines[2], lines[0]), cross(lines[0], lines[1])
        volume = dot(lines[0], normals[0])
        volume = np.where(np.abs(volume) > FLAT_DIRECTIONS, volume, np.nan)
        x, y, z = ((n[0] / volume, n[1] / volume, n[2] / volume) for n in normals)
        return x, y, z

    def _turn(self, i: int, v: Vector, *, back: bool = False) -> Vector:
        """Vectors turned by one axis, or back from its position to zero."""
        turn = self._turns[i]
        if turn is None:
            return v
        s, c = turn
        d = (-self.machine.axes[i].unit_direction if back else self.machine.axes[i].unit_direction).tolist()
        for k in range(3):
            first, second = (k + 1) % 3, (k + 2) % 3
            if d[first] == d[second] == 0.0:
                sine = s if d[k] > 0 else -s
                turned = [v[k]] * 3
                turned[first] = v[first] * c - v[second] * sine
                turned[second] = v[first] * sine + v[second] * c
                return turned[0], turned[1], turned[2]
        x, y, z = v
        along = (d[0] * x + d[1] * y + d[2] * z) * (1.0 - c)
        return (
            x * c + (d[1] * z - d[2] * y) * s + d[0] * along,
            y * c + (d[2] * x - d[0] * z) * s + d[1] * along,
            z * c + (d[0] * y - d[1] * x) * s + d[2] * along,
        )

    def _about(self, i: int, p: Vector) -> Vector:
        """Points turned by a rotary axis about its line."""
        x, y, z = self.machine.axes[i].point
        return _from((-x, -y, -z), self._turn(i, _from((x, y, z), p)))


def point_deviations(machine: Machine, q: Array, errors: Array, tool: Array) -> Array:
    """Deviations of the tool point `(n, 3)`, mm, workpiece frame, at n positions; as `exact_deviation`."""
    chain, tip = ChainColumns(machine, q), vector(tool)
    return rows_of(minus(chain.point(tip, errors), chain.point(tip)), len(q))


_Z: Vector = (read_only(np.zeros(1)), read_only(np.zeros(1)), read_only(np.ones(1)))
_UPRIGHT = read_only(np.eye(3))


def _in_frame(frame: list[list[float]], v: Vector) -> Vector:
    """Vectors turned by one matrix."""
    x, y, z = (row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in frame)
    return x, y, z


def _from(centre: Sequence[float], p: Vector) -> Vector:
    """Points seen from a centre."""
    x, y, z = (column - shift if shift else column for column, shift in zip(p, centre, strict=True))
    return x, y, z


def _shifted(direction: Sequence[float], distance: Array, p: Vector) -> Vector:
    """Points moved along a direction."""
    x, y, z = (
        column if d == 0.0 else column + (distance if d == 1.0 else distance * d)
        for column, d in zip(p, direction, strict=True)
    )
    return x, y, z
