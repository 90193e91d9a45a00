"""Lines of rotary axes as a control's kinematics have them, and the axis positions that follow from them.

A control that positions the tool point knows the line of each rotary axis at zero pose. Moved lines are a machine with
other points and directions: its workpiece frame and its spindle nose at zero pose are those of the nominal machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import Axis, Machine, Vector
from kinematics.transforms import Array, rotation_vector_matrix
from kinematics.user_error import UserError


@dataclass(frozen=True)
class Freedom:
    """One freedom of the line of a rotary axis in a control's parameters."""

    axis: str
    vector: Vector
    """Machine frame, at zero pose: direction of the shift, or line of the tilt."""
    tilt: bool = False

    @property
    def name(self) -> str:
        """`C along X`, `B about Z`; for a slanting direction its vector."""
        letters = [letter for letter, part in zip("XYZ", self.vector, strict=True) if part == 1.0]
        direction = letters[0] if letters else "({:.4g}, {:.4g}, {:.4g})".format(*self.vector)
        return f"{self.axis} {'about' if self.tilt else 'along'} {direction}"

    @property
    def unit(self) -> str:
        """Unit of its values on screens."""
        return "urad" if self.tilt else "um"


def rotary_axes(machine: Machine, side: str) -> list[Axis]:
    """The rotary axes of a side, the one nearest to the bed first; UserError if a linear axis is beyond one of them.

    Kinematics of controls have the rotary axes of the table next to the workpiece and those of the head next to the
    tool.
    """
    axes = [axis for axis in machine.axes if axis.side == side]
    from_bed = axes[::-1] if side == "workpiece" else axes
    kinds = [axis.rotary for axis in from_bed]
    if kinds != sorted(kinds):
        raise UserError(
            f"machine {machine.name} ({machine.chain}): a linear axis between a rotary axis and its end of the chain: "
            "the kinematics of this format have rotary axes only there"
        )
    return [axis for axis in from_bed if axis.rotary]


def across(axis: Axis, *, tilts: bool) -> list[Freedom]:
    """The shifts of a line across itself, and its tilts: along the machine's axes where the line is along one."""
    d = axis.unit_direction
    nearest = int(np.argmax(np.abs(d)))
    if abs(d[nearest]) > 1.0 - 1e-9:
        vectors = [tuple(np.eye(3)[k].tolist()) for k in range(3) if k != nearest]
    else:
        letter = int(np.argmin(np.abs(d)))
        first = np.cross(d, np.eye(3)[letter])
        vectors = [tuple(v.tolist()) for v in (np.eye(3)[letter], np.asarray(first / np.linalg.norm(first)))]
        vectors[0] = tuple((np.eye(3)[letter] - d[letter] * d).tolist())
    shifts = [Freedom(axis.name, vector) for vector in vectors]
    return shifts + [replace(shift, tilt=True) for shift in shifts] if tilts else shifts


def moved_lines(machine: Machine, freedoms: Sequence[Freedom], values: Array) -> Machine:
    """The machine with lines changed by values `(k,)`, mm and rad; tilts turn a line about the axis' point."""
    axes = list(machine.axes)
    for freedom, value in zip(freedoms, values.tolist(), strict=True):
        i = machine.index(freedom.axis)
        step = value * np.asarray(freedom.vector)
        if freedom.tilt:
            direction = rotation_vector_matrix(step[None])[0] @ axes[i].unit_direction
            axes[i] = replace(axes[i], direction=tuple(direction.tolist()))
        else:
            axes[i] = replace(axes[i], point=tuple((np.asarray(axes[i].point) + step).tolist()))
    return replace(machine, axes=tuple(axes))


def positions_with(machine: Machine, moved: Machine, q: Array, tool: Array, frame: Array | None = None) -> Array:
    """Axis positions `(n, axes)`, mm and rad, of a control with moved lines for tool points programmed at q.

    Rotary positions stay as they are programmed. frame: displacement `(6,)` of the programmed points, mm and rad about
    the origin of the workpiece frame, that a shifted and aligned work offset gives them.
    """
    tip = tool_point(machine, q, tool)
    if frame is not None:
        tip = tip + frame[:3] + np.cross(frame[3:], tip)
    return linear_positions(moved, q, tip, tool)


def reflected(machine: Machine, moved: Machine) -> Machine:
    """Lines with the changes of `moved` reversed."""
    axes = []
    for axis, other in zip(machine.axes, moved.axes, strict=True):
        point = tuple((2.0 * np.asarray(axis.point) - np.asarray(other.point)).tolist())
        direction = tuple((2.0 * axis.unit_direction - other.unit_direction).tolist())
        axes.append(replace(axis, point=point, direction=direction) if axis.rotary else axis)
    return replace(machine, axes=tuple(axes))
