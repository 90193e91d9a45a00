"""Frames: the nominal relation between programmed coordinates and machine axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from kinematics.columns import ChainColumns, rows_of, vector
from kinematics.inverse import linear_positions
from kinematics.machine import Machine, NDArrayBool
from kinematics.touch_off import TouchOff
from kinematics.transforms import Array
from kinematics.user_error import UserError

NORMALS = {"X": "YZX", "Y": "ZXY", "Z": "XYZ"}
"""Plane of a rotation about each axis, by three letters: the last is the axis itself."""
SAME_SCALE = 1e-9
"""Relative difference of two scales below which it is rounding."""
MOVED_MM = 100.0
"""Way of a drilling axis along which its direction is compared."""
SAME_FRAME_MM = 1e-7
"""Difference of two positions below which it is rounding."""


@dataclass(frozen=True)
class Frame:
    """The frame that coordinates are programmed in; positions and offsets in mm and degrees, in chain order.

    Without TCP, axis position = programmed position + offset, a length offset of the tool included. With TCP the
    rotary axes are the same, and X Y Z + offset is the tool point in the workpiece frame, which turns with a table.
    A turn is applied to programmed X Y Z before the offset.
    """

    offset: tuple[float, ...]
    tool_length: float = 0.0
    """Length of the tool in the spindle, mm: the tip is at (0, 0, -length) from the tool reference point."""
    tcp: bool = False
    turn: tuple[float, ...] | None = None
    """Matrix `(9,)`, by rows, that rotates, mirrors and scales X Y Z; None for none."""
    touch_off: TouchOff | None = None
    """Touch-off of the work offset of the frame; None if the offset is true or there is no work offset."""
    work_offset: str = field(default="", compare=False)
    """Name of the work offset in `offset`; empty for machine zero."""
    tool_name: str = field(default="", compare=False)
    """Number or name of the tool with `tool_length`; empty for none."""

    @property
    def couples(self) -> bool:
        """True if a programmed coordinate moves more than the axis of its name."""
        return self.turn is not None and any(self.turn[i] != 0.0 for i in (1, 2, 3, 5, 6, 7))

    @property
    def shares(self) -> NDArrayBool:
        """True `(3, 3)` where machine axis X, Y or Z (row) moves with the programmed X, Y or Z (column).

        Under TCP a turn couples all of them, because the programmed frame rotates with the table.
        """
        if not self.couples:
            return np.eye(3, dtype=bool)
        return np.ones((3, 3), bool) if self.tcp else np.asarray(_matrix(self.turn or ()) != 0.0)

    def keeps_circles(self, letters: str) -> bool:
        """True if a circle in the plane of two axes, of `XYZ`, remains a circle: both axes have the same scale."""
        if self.turn is None:
            return True
        first, second = (_matrix(self.turn)[:, "XYZ".index(letter)] for letter in letters)
        size = float(first @ first)
        return bool(abs(second @ second - size) < SAME_SCALE * size and abs(first @ second) < SAME_SCALE * size)

    def turned(self, vector: Array) -> Array:
        """A direction `(3,)` in programmed coordinates, after the turn."""
        return vector if self.turn is None else np.asarray(_matrix(self.turn) @ vector)

    @property
    def tool(self) -> tuple[float, float, float]:
        """Tool tip seen from the tool reference point, mm."""
        return (0.0, 0.0, -self.tool_length)


def cartesian(machine: Machine) -> tuple[int, int, int]:
    """Columns of the axes X, Y and Z; UserError if the machine lacks one."""
    if machine.rotary.all():
        raise UserError(
            f"machine {machine.name} ({machine.chain}) has rotary axes only: NC programs need linear axes X, Y and Z; "
            "measurements of it can be fitted and diagnosed"
        )
    return machine.index("X"), machine.index("Y"), machine.index("Z")


def other_frame(machine: Machine, frame: Frame) -> Frame:
    """The frame of the same block on the control with TCP switched off, or on."""
    offset, z = list(frame.offset), cartesian(machine)[2]
    offset[z] += frame.tool_length if frame.tcp else -frame.tool_length
    return replace(frame, offset=tuple(offset), tcp=not frame.tcp)


def drills_along(machine: Machine, frame: Frame, program: Sequence[float], axis: int) -> bool:
    """True where TCP does not matter to a drilling axis: it moves the same way by the same numbers without it.

    That is where the tool stands along the axis of the part. program `(axes)`: the position, mm and degrees.
    """
    ends = np.array([program, program], float)
    ends[1, axis] += MOVED_MM
    other = to_program(machine, other_frame(machine, frame), to_machine(machine, frame, ends))
    apart = np.abs(other - ends)[0, axis], np.abs(other[1] - other[0] - (ends[1] - ends[0])).max()
    return bool(max(apart) < SAME_FRAME_MM)


def axes_moved(machine: Machine, before: Frame, frame: Frame) -> list[int]:
    """Columns of the axes whose coordinates change their meaning in another frame."""
    moved = {i for i, (a, b) in enumerate(zip(before.offset, frame.offset, strict=True)) if a != b}
    if (frame.tcp or before.tcp or frame.turn != before.turn) and frame != before:
        moved.update(cartesian(machine))
    return sorted(moved)


def axes_coupled(machine: Machine, frame: Frame, moved: Iterable[int]) -> list[int]:
    """Columns of the axes whose programmed coordinates change if some axes move in machine coordinates."""
    x_y_z = cartesian(machine)
    if frame.tcp:
        return list(x_y_z)
    if not frame.couples:
        return []
    rows = [x_y_z.index(axis) for axis in moved if axis in x_y_z]
    return [x_y_z[i] for i in np.flatnonzero(frame.shares[rows].any(axis=0)).tolist()]


def in_workpiece(machine: Machine, frame: Frame, program: Array) -> Array:
    """Tool points `(n, 3)`, mm, in the workpiece frame, of programmed positions `(n, axes)` under TCP."""
    return np.asarray(_placed(machine, frame, program)[:, cartesian(machine)])


def _placed(machine: Machine, frame: Frame, program: Array) -> Array:
    shifted = program + np.asarray(frame.offset)
    if frame.turn is not None:
        x_y_z = list(cartesian(machine))
        shifted[:, x_y_z] += program[:, x_y_z] @ (_matrix(frame.turn) - np.eye(3)).T
    return np.asarray(shifted)


def to_machine(machine: Machine, frame: Frame, program: Array) -> Array:
    """Axis positions `(n, axes)`, mm and rad, of programmed positions `(n, axes)`, mm and degrees."""
    shifted = _placed(machine, frame, program)
    q = np.asarray(shifted * machine.scale)
    if frame.tcp:
        q = linear_positions(machine, q, shifted[:, cartesian(machine)], frame.tool)
    return q


def to_program(machine: Machine, frame: Frame, q: Array) -> Array:
    """Programmed positions `(n, axes)`, mm and degrees, of axis positions `(n, axes)`, mm and rad."""
    shifted = np.asarray(q / machine.scale)
    if frame.tcp:
        tips = ChainColumns(machine, q).point(vector(frame.tool))
        shifted[:, cartesian(machine)] = rows_of(tips, len(q))
    program = np.asarray(shifted - np.asarray(frame.offset))
    if frame.turn is not None:
        x_y_z = list(cartesian(machine))
        program[:, x_y_z] = program[:, x_y_z] @ np.linalg.inv(_matrix(frame.turn)).T
    return program


def _matrix(turn: tuple[float, ...]) -> Array:
    return np.array(turn).reshape(3, 3)


class Placement(msgspec.Struct, frozen=True):
    """A shift and a turn of programmed X Y Z, one after the other: placed = turn @ programmed + shift."""

    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

    def then(self, inner: Placement) -> Placement:
        """Both placements in sequence: programmed coordinates pass through `inner` first."""
        outer = _matrix(self.turn)
        shift = outer @ np.array(inner.shift) + np.array(self.shift)
        return Placement(tuple(shift.tolist()), tuple((outer @ _matrix(inner.turn)).ravel().tolist()))

    @property
    def frame_turn(self) -> tuple[float, ...] | None:
        """The turn of a Frame; None for the identity."""
        return None if self.turn == Placement().turn else self.turn


def renamed(before: Placement, after: Placement) -> tuple[int, ...]:
    """Axes of X, Y and Z (0, 1, 2) whose coordinates differ between two placements."""
    old, new = (np.linalg.inv(_matrix(placement.turn)) for placement in (before, after))
    origin_moved = ~np.isclose(old @ np.array(before.shift), new @ np.array(after.shift), rtol=0.0, atol=1e-12)
    return tuple(np.flatnonzero((old != new).any(axis=1) | origin_moved).tolist())


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Placement:
    """The origin shifted to a position, mm."""
    return Placement((x, y, z))


def mirrored(axes: str) -> Placement:
    """Mirrored along the given axes."""
    return Placement(turn=_diagonal(*(-1.0 if axis in axes else 1.0 for axis in "XYZ")))


def scaled(x: float, y: float, z: float) -> Placement:
    """Scaled by a factor along each axis."""
    return Placement(turn=_diagonal(x, y, z))


def rotated(degrees: float, plane: str = "XYZ") -> Placement:
    """Rotated in a plane, counter-clockwise seen from the end of its normal: the last of three letters."""
    first, second, _ = ("XYZ".index(letter) for letter in plane)
    c, s = _exact(np.cos, degrees), _exact(np.sin, degrees)
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = c
    turn[first, second], turn[second, first] = -s, s
    return Placement(turn=tuple(turn.ravel().tolist()))


def rotated_in_turn(axes: str, degrees: Iterable[float]) -> Placement:
    """Rotated by angles, degrees, about axes in sequence; each rotation also rotates the axes after it."""
    result = Placement()
    for axis, angle in zip(axes, degrees, strict=True):
        result = result.then(rotated(angle, NORMALS[axis]))
    return result


def spatial(a: float, b: float, c: float) -> Placement:
    """Rotated about X by a, then about Y by b, then about Z by c, all fixed axes; degrees."""
    return rotated_in_turn("ZYX", (c, b, a))


def euler(precession: float, nutation: float, rotation: float) -> Placement:
    """Rotated about Z, then about the rotated X, then about the rotated Z; degrees."""
    return rotated_in_turn("ZXZ", (precession, nutation, rotation))


def _diagonal(x: float, y: float, z: float) -> tuple[float, ...]:
    return (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z)


def _exact(function: np.ufunc, degrees: float) -> float:
    """Sine or cosine, exact at multiples of 90 degrees."""
    value = float(function(np.deg2rad(degrees % 360.0)))
    return round(value) if abs(value - round(value)) < 1e-15 else value
