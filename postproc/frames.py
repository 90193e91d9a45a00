"""Frames: what programmed coordinates mean in machine axes, nominally."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import Machine
from kinematics.transforms import Array


@dataclass(frozen=True)
class Frame:
    """The frame that coordinates are programmed in; positions and offsets in mm and degrees, in chain order.

    Without TCP, axis position = programmed position + offset, a length offset of the tool included. With TCP the
    rotary axes are the same, and X Y Z + offset is the tool point in the workpiece frame, which turns with a table.
    """

    offset: tuple[float, ...]
    tool_length: float = 0.0
    """Of the tool in the spindle, mm: the tip is at (0, 0, -length) from the tool reference point."""
    tcp: bool = False

    @property
    def tool(self) -> tuple[float, float, float]:
        """Tool tip seen from the tool reference point, mm."""
        return (0.0, 0.0, -self.tool_length)


def cartesian(machine: Machine) -> tuple[int, int, int]:
    """Columns of the axes X, Y and Z; UserError when the machine lacks one."""
    return machine.index("X"), machine.index("Y"), machine.index("Z")


def to_machine(machine: Machine, frame: Frame, program: Array) -> Array:
    """Axis positions `(n, axes)`, mm and rad, of programmed positions `(n, axes)`, mm and degrees."""
    shifted = program + np.asarray(frame.offset)
    q = np.asarray(shifted * machine.scale)
    if frame.tcp:
        q = linear_positions(machine, q, shifted[:, cartesian(machine)], frame.tool)
    return q


def to_program(machine: Machine, frame: Frame, q: Array) -> Array:
    """Programmed positions `(n, axes)`, mm and degrees, of axis positions `(n, axes)`, mm and rad."""
    shifted = np.asarray(q / machine.scale)
    if frame.tcp:
        shifted[:, cartesian(machine)] = tool_point(machine, q, frame.tool)
    return np.asarray(shifted - np.asarray(frame.offset))
