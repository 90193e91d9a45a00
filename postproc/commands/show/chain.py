"""The chain of a machine as lines in space: axes with travel, pivots and positive directions, the tool lifted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.machine import Axis, Machine
from kinematics.transforms import Array

Kind = Literal["axis", "turn", "line", "pivot", "part", "opposite"]
UNBOUNDED = 1000.0
"""Drawn travel, mm, to each side, of an axis without ends."""
ARROW_SWEEP_PI = 1.6
"""Part of a circle, in units of pi, that the arrow of a rotary axis covers."""
PIECES = 40
LIFTING_SHARE = 0.5
"""Least share of a direction along the tool: such an axis lifts the tool off the workpiece."""


@dataclass(frozen=True)
class Shape:
    """A line in space, mm, workpiece frame."""

    kind: Kind
    axis: str
    """Name of the axis; empty for a part of the machine."""
    points: Array
    """Points `(n, 3)`; an arrow of an axis or a turn points to the last one."""
    label: str = ""
    """Text at the last point."""


def shapes(machine: Machine) -> Iterator[Shape]:
    """The lines of a machine with its tool lifted, and the workpiece where the tool is when it is lowered.

    A machine file counts positions from any zero, so the workpiece lies within the travel, and not at its zero.
    """
    size = size_of(machine)
    base = 0.12 * size
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]) * base
    tool = _shifts(machine, drawn_pose(machine))
    yield Shape("part", "", _shifts(machine, drawn_pose(machine, lowered=True))[-1] + corners, "workpiece w")
    yield Shape("part", "", tool[-1] + np.array([[0, 0, 0], [0, 0, 2.2 * base]]), "tool t")
    for axis, shift in zip(machine.axes, tool, strict=False):
        yield from _rotary(axis, size, shift) if axis.rotary else _linear(axis, size)


def drawn_pose(machine: Machine, *, lowered: bool = False) -> Array:
    """Positions `(axes,)`, mm and rad: axes along the tool at their upper or lower ends, others in the middle."""
    return np.array([0.0 if axis.rotary else _drawn_at(axis, lowered=lowered) for axis in machine.axes])


def _drawn_at(axis: Axis, *, lowered: bool) -> float:
    """Position, mm, of a linear axis in the drawing."""
    low, high = _ends(axis)
    up = axis.unit_direction[2]
    if abs(up) < LIFTING_SHARE:
        return float(low + high) / 2.0
    return float(low if lowered == (up > 0.0) else high)


def _shifts(machine: Machine, pose: Array) -> Array:
    """Displacement `(axes + 1, 3)`, mm, of each axis relative to the workpiece by the linear ones, and of the tool."""
    directions = np.array([axis.unit_direction for axis in machine.axes])
    steps = np.where(machine.rotary, 0.0, pose)[:, None] * directions
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def size_of(machine: Machine) -> float:
    """Size of the drawing, mm: the longest travel, or the farthest pivot."""
    travels = [np.diff(_ends(axis))[0] for axis in machine.axes if not axis.rotary]
    pivots = [float(np.linalg.norm(axis.point)) for axis in machine.axes]
    return float(max([*travels, *pivots, 100.0]))


def _ends(axis: Axis) -> Array:
    """Drawn ends `(2,)` of the travel of a linear axis, mm."""
    return np.where(np.isinf(axis.travel), (-UNBOUNDED, UNBOUNDED), axis.travel)


def travel_of(axis: Axis) -> str:
    """The ends of the travel of an axis."""
    if np.isinf(axis.travel).all():
        return "without ends"
    return f"{axis.travel[0]:g}..{axis.travel[1]:g} {axis.unit}"


def moved(axis: Axis) -> str:
    """The part that an axis moves, and its sense for a positive command."""
    if axis.side == "tool":
        return f"the tool {'turns' if axis.rotary else 'moves'} along the arrow"
    return f"the workpiece {'turns' if axis.rotary else 'moves'} against the arrow"


def _linear(axis: Axis, size: float) -> Iterator[Shape]:
    """The travel of a linear axis, through the origin, to its positive end."""
    low, high = _ends(axis)
    high = max(high, 0.15 * size)
    yield Shape("axis", axis.name, np.outer([low, high], axis.unit_direction), f"+{axis.name}")
    if axis.side == "workpiece":
        ends = np.outer([0.15 * size, -0.1 * size], axis.unit_direction) + 0.05 * size * _across(axis)[0]
        yield Shape("opposite", axis.name, ends, f"table at +{axis.name}")


def _rotary(axis: Axis, size: float, shift: Array) -> Iterator[Shape]:
    """The line of a rotary axis, its pivot, and an arrow of the positive turn of the tool relative to the workpiece.

    shift `(3,)`: its displacement, mm, from zero pose.
    """
    point, along, radius = np.asarray(axis.point, float) + shift, axis.unit_direction, 0.2 * size
    yield Shape("line", axis.name, point + np.outer([-1.5 * radius, 1.5 * radius], along))
    yield Shape("pivot", axis.name, point[None], f"{axis.name} ({', '.join(f'{v:g}' for v in axis.point)})")
    first, second = _across(axis)
    angles = np.linspace(0.0, ARROW_SWEEP_PI * np.pi, PIECES)
    circle = radius * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second))
    yield Shape("turn", axis.name, point + 0.8 * radius * along + circle, f"+{axis.name}")


def _across(axis: Axis) -> tuple[Array, Array]:
    """Two directions that form a right-handed frame with that of the axis."""
    along = axis.unit_direction
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    return first, np.cross(along, first)
