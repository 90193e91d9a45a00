"""Single figures of a comparison: location errors of rotary axes, squareness, reversal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.evaluation.comparison.result import Figure, Straightness
from calibration.evaluation.comparison.sides import (
    SIDE_POSITIONS,
    ZERO_ERROR_UM,
    Curve,
    Side,
    along,
    common_range,
    positions_over,
)
from calibration.single_axis.reference_lines import reference_line
from kinematics.basis import Interval
from kinematics.effects import COMPONENTS
from kinematics.effects.base import own_component, own_motion, unit_of
from kinematics.error_transform import error_transform_with_tool, pose_slopes
from kinematics.machine import Machine
from kinematics.transforms import Array


def location_figure(sides: Sequence[Side], name: str, pair: Sequence[Curve], unit: str) -> Figure:
    """The mean of an error motion of a rotary axis."""
    means = [float(curve.values[:-1].mean()) for curve in pair]
    U = [side.U(curve.design[:-1].mean(axis=0)) for side, curve in zip(sides, pair, strict=True)]
    of = f"of the line of {name[3:]}"
    title = f"position {of} in {name[2]}" if name[2] in "XYZ" else f"tilt {of} about {'XYZ'['ABC'.index(name[2])]}"
    return Figure(f"{name[:3]}0{name[3:]}", title, unit, *means, *U)


SQUARENESS = {("Y", "X"): ("C", -1.0), ("Z", "X"): ("B", 1.0), ("Z", "Y"): ("A", -1.0)}
"""Squareness of the second axis to the first: the letter of E_C0Y - E_C0X, and its sign in their scalar product."""


def squareness_figures(machine: Machine, sides: Sequence[Side], straightness: Straightness) -> Iterator[Figure]:
    """E_C0Y - E_C0X, E_B0Z - E_B0X and E_A0Z - E_A0Y, of the first linear axis of each letter, um/m.

    The change of the angle between the lines along which two axes move the tool in the workpiece frame. A rotation
    common to all axes does not change it; neither does a constant angle of an axis that the straightness of the axes on
    it compensates.
    """
    first: dict[str, int] = {}
    for i, axis in enumerate(machine.axes):
        if not axis.rotary:
            first.setdefault(own_component(axis.name), i)
    for (second, other), (letter, sign) in SQUARENESS.items():
        if second not in first or other not in first:
            continue
        i, j = first[second], first[other]
        ends = [common_range(sides, i, COMPONENTS.index(other)), common_range(sides, j, COMPONENTS.index(second))]
        lines = [_direction(machine, i), _direction(machine, j)]
        scale = sign * 1e6 / float(np.linalg.norm(np.cross(lines[0], lines[1])))
        found = []
        for side in sides:
            leans = [_lean(side, a, known, straightness) for a, known in zip((i, j), ends, strict=True)]
            value = scale * (lines[1] @ leans[0].values + lines[0] @ leans[1].values)
            design = scale * (lines[1] @ leans[0].design + lines[0] @ leans[1].design)
            found.append((float(value), side.U(design), design.any()))
        if any(curve for *_, curve in found):
            names = machine.names[i], machine.names[j]
            name = f"E_{letter}0{names[0]} - E_{letter}0{names[1]}"
            title = f"squareness of {names[0]} to {names[1]}"
            yield Figure(name, title, "um/m", found[0][0], found[1][0], found[0][1], found[1][1])


def _direction(machine: Machine, i: int) -> Array:
    """Direction `(3,)` of the tool in the workpiece frame if a linear axis moves along its letter, others at home."""
    home = along(machine, i, np.array([machine.axes[i].home]), 0.0)
    slope = pose_slopes(machine, home.positions)[0, :3, i]
    return np.asarray(own_motion(machine, machine.names[i])[2] * slope / np.linalg.norm(slope))


def _lean(side: Side, i: int, ends: Interval | None, straightness: Straightness) -> Curve:
    """Tilt of the line of a linear axis against its direction: vector `(3,)`, workpiece frame, mm per mm.

    The slope of the reference line through the deviations across the axis over a range, mm. The axis' own angular
    error motions count with their values at home, because their variation bends the line by an amount that depends on
    the tool point.
    """
    machine = side.machine
    axis, direction = machine.axes[i], _direction(machine, i)
    low, high = ends if ends is not None and ends[0] < ends[1] else (axis.home, axis.home + 1.0)
    x = np.linspace(low, high, SIDE_POSITIONS)
    here, home = along(machine, i, x, 0.0), along(machine, i, np.full(SIDE_POSITIONS, axis.home), 0.0)
    across = np.eye(3) - np.outer(direction, direction)
    slope = own_motion(machine, axis.name)[2] * reference_line(straightness, x, np.zeros(SIDE_POSITIONS)).slope_of
    transform = across @ error_transform_with_tool(machine, here.positions)[:, :3]
    own = np.zeros(transform.shape[2])
    own[6 * i + 3 : 6 * i + 6] = 1.0
    parts = ((here, transform * (1.0 - own)), (home, transform * own))
    errors = [side.model.errors(machine, state).reshape(SIDE_POSITIONS, 1, -1) for state, _ in parts]
    values = [np.sum(part * each, axis=2) for (_, part), each in zip(parts, errors, strict=True)]
    designs = [side.model.design(machine, state, part) for state, part in parts]
    return Curve(slope @ (values[0] + values[1]), np.tensordot(slope, designs[0] + designs[1], axes=1))


def reversal_figures(machine: Machine, sides: Sequence[Side]) -> Iterator[Figure]:
    """Mean reversal of each axis, forward minus backward, if either calibration has one."""
    for i, axis in enumerate(machine.axes):
        _, k, forward = own_motion(machine, axis.name)
        ends = common_range(sides, i, k)
        if ends is None or ends[0] >= ends[1]:
            continue
        x = positions_over(machine, i, ends) * machine.scale[i]
        found = []
        for side in sides:
            ahead, behind = side.curve(i, k, x, 1.0), side.curve(i, k, x, -1.0)
            value = forward * float(np.mean(ahead.values - behind.values))
            found.append((value, side.U((ahead.design - behind.design).mean(axis=0))))
        if any(abs(value) > ZERO_ERROR_UM for value, _ in found):
            unit = unit_of(COMPONENTS[k])[0]
            title = "mean reversal, forward minus backward"
            yield Figure(f"B {axis.name}", title, unit, found[0][0], found[1][0], found[0][1], found[1][1])
