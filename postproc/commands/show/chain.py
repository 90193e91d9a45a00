"""The chain of a machine as lines in space: axes with travel, pivots and positive directions, at zero pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.machine import Axis, Machine
from kinematics.transforms import Array

Kind = Literal["axis", "turn", "line", "pivot", "part", "opposite"]
UNBOUNDED = 1000.0
"""Drawn travel, mm, of an axis without ends."""
TURN = 1.6
"""Part of a circle, in units of pi, that the arrow of a rotary axis covers."""
PIECES = 40


@dataclass(frozen=True)
class Shape:
    """A line in space, mm, machine frame."""

    kind: Kind
    axis: str
    """Name of the axis; empty for a part of the machine."""
    points: Array
    """Points `(n, 3)`; an arrow of an axis or a turn points to the last one."""
    label: str = ""
    """Text at the last point."""


def shapes(machine: Machine) -> Iterator[Shape]:
    """The lines of a machine at zero pose of its axes, where the tool reference point is in the workpiece's origin."""
    size = size_of(machine)
    base = 0.12 * size
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]) * base
    yield Shape("part", "", corners, "workpiece w")
    yield Shape("part", "", np.array([[0, 0, 0], [0, 0, 2.2 * base]]), "tool t")
    for axis in machine.axes:
        yield from _rotary(axis, size) if axis.rotary else _linear(axis, size)


def size_of(machine: Machine) -> float:
    """Size of the drawing, mm: the longest travel, or the farthest pivot."""
    travels = [np.diff(np.clip(axis.travel, -UNBOUNDED, UNBOUNDED))[0] for axis in machine.axes if not axis.rotary]
    pivots = [float(np.linalg.norm(axis.point)) for axis in machine.axes]
    return float(max([*travels, *pivots, 100.0]))


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
    low, high = np.clip(axis.travel, -UNBOUNDED, UNBOUNDED)
    high = max(high, 0.15 * size)
    yield Shape("axis", axis.name, np.outer([low, high], axis.unit_direction), f"+{axis.name}")
    if axis.side == "workpiece":
        ends = np.outer([0.15 * size, -0.1 * size], axis.unit_direction) + 0.05 * size * _across(axis)[0]
        yield Shape("opposite", axis.name, ends, f"table at +{axis.name}")


def _rotary(axis: Axis, size: float) -> Iterator[Shape]:
    """The line of a rotary axis, its pivot, and an arrow of the positive turn of the tool relative to the workpiece."""
    point, along, radius = np.asarray(axis.point, float), axis.unit_direction, 0.2 * size
    yield Shape("line", axis.name, point + np.outer([-1.5 * radius, 1.5 * radius], along))
    yield Shape("pivot", axis.name, point[None], f"{axis.name} ({', '.join(f'{v:g}' for v in axis.point)})")
    first, second = _across(axis)
    angles = np.linspace(0.0, TURN * np.pi, PIECES)
    circle = radius * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second))
    yield Shape("turn", axis.name, point + 0.8 * radius * along + circle, f"+{axis.name}")


def _across(axis: Axis) -> tuple[Array, Array]:
    """Two directions that form a right-handed frame with that of the axis."""
    along = axis.unit_direction
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    return first, np.cross(along, first)
