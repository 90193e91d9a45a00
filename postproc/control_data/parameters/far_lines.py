"""Parameters of a control compared with the machine file, before they count as its errors.

Errors of lines are hundredths of a millimetre. Lines that are millimetres off are those of another machine, in inches,
or of a file with other lines, and the first order by which they would become errors does not hold for them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.machine import Axis, Machine
from kinematics.user_error import UserError

FARTHEST_MM = 2.0
"""Largest distance of a line from that of the machine file."""
LARGEST_TILT_DEG = 0.5
INCH_MM = 25.4


def refuse_far_lines(machine: Machine, moved: Machine, name: str) -> None:
    """UserError, naming the file, for a line that is far from that of the machine file."""
    for axis, other in zip(machine.axes, moved.axes, strict=True):
        if not axis.rotary:
            continue
        distance, tilt = _distance(axis, other), _tilt_deg(axis, other)
        if distance <= FARTHEST_MM and tilt <= LARGEST_TILT_DEG:
            continue
        off = f"{distance:.4g} mm" if distance > FARTHEST_MM else f"{tilt:.3g} degrees"
        raise UserError(
            f"{name}: the line of {axis.name} is {off} from that of the machine file, more than the errors of a "
            f"machine ({FARTHEST_MM:g} mm, {LARGEST_TILT_DEG:g} degrees): {_cause(machine, moved, axis)}"
        )


def _cause(machine: Machine, moved: Machine, axis: Axis) -> str:
    if _all_near(machine, moved, INCH_MM):
        return (
            "the numbers are in inches: multiply the lengths by 25.4, or state unit = inch under [control] of the "
            "machine file if its control is in inches"
        )
    point = ", ".join(f"{value:g}" for value in axis.point)
    return (
        "the file is of another machine, its numbers are in inches, one of them is wrong, or the machine file has "
        f"another line (point = [{point}] under [axes.{axis.name}]); give the machine file the lines of the control"
    )


def _all_near(machine: Machine, moved: Machine, factor: float) -> bool:
    pairs = [(axis, other) for axis, other in zip(machine.axes, moved.axes, strict=True) if axis.rotary]
    longer = [(axis, _longer(axis, other, factor)) for axis, other in pairs]
    return all(_distance(axis, other) <= FARTHEST_MM for axis, other in longer)


def _longer(axis: Axis, other: Axis, factor: float) -> Axis:
    """The axis with the numbers of its point times a factor; a point that no number gives stays."""
    point = [value if value == own else factor * value for own, value in zip(axis.point, other.point, strict=True)]
    return replace(other, point=(point[0], point[1], point[2]))


def _distance(axis: Axis, other: Axis) -> float:
    """Distance, mm, of the points of a line across its direction: along it, any point is on the line."""
    step, direction = np.subtract(other.point, axis.point), axis.unit_direction
    return float(np.linalg.norm(step - (step @ direction) * direction))


def _tilt_deg(axis: Axis, other: Axis) -> float:
    return float(np.degrees(np.linalg.norm(np.cross(axis.unit_direction, other.unit_direction))))
