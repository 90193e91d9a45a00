"""Whether machine file, measurement, control and CAM have the same lines of rotary axes, and what a part shows."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.machine import Axis, Machine
from kinematics.transforms import Array
from postproc.control_data.parameters.best_lines import best_lines
from postproc.control_data.parameters.export_parameters import fitted_volume
from postproc.control_data.parameters.rotary_lines import Freedom, across, moved_lines, positions_with
from postproc.control_data.tables.target import positional

SAME_LINE_MM, SAME_LINE_DEG = 1e-3, 1e-3
"""Differences of lines below which two sources agree, as parameters are written."""
TURNS_DEG = (180.0, -180.0, 90.0, -90.0)
"""Turns of one axis between two features of a part, the largest within its travel first."""


class Difference(msgspec.Struct, frozen=True):
    """The line of one axis by two sources."""

    axis: str
    first: str
    second: str
    shift_mm: tuple[float, float, float]
    """Second minus first, across the line, machine frame at zero pose."""
    tilt_deg: float
    same_sense: bool
    """The axis turns the same way."""
    u_mm: float
    """Standard uncertainty of the shift, if one of the sources is measured; else 0."""
    turn_deg: float
    """Turn of the axis between two features of a part."""
    part_mm: tuple[float, float, float]
    """Distance that a part shows between the two features, workpiece frame, if one source positions by the lines of the
    other."""

    @property
    def agrees(self) -> bool:
        """True where the sources agree, within the uncertainty (k = 2) of a measurement."""
        within = max(SAME_LINE_MM, 2.0 * self.u_mm)
        return self.same_sense and self.tilt_deg <= SAME_LINE_DEG and float(np.linalg.norm(self.shift_mm)) <= within

    def json(self) -> dict[str, Any]:
        """The machine-readable form."""
        return {**msgspec.structs.asdict(self), "agrees": self.agrees}


def measured_lines(machine: Machine, model: ErrorModel, tool_mm: float) -> tuple[Machine, dict[str, float]]:
    """The machine with the lines that fit a calibration best, and their standard uncertainties, mm, by axis."""
    part = model.part(positional)
    freedoms = tuple(each for axis in machine.axes if axis.rotary for each in across(axis, tilts=True))
    best = best_lines(fitted_volume(machine, part, np.array([0.0, 0.0, -tool_mm])), part, freedoms)
    return moved_lines(machine, freedoms, best.values), _uncertainties(freedoms, best.u)


def _uncertainties(freedoms: Sequence[Freedom], u: Array) -> dict[str, float]:
    found: dict[str, float] = {}
    for freedom, each in zip(freedoms, u.tolist(), strict=True):
        if not freedom.tilt:
            found[freedom.axis] = float(np.hypot(found.get(freedom.axis, 0.0), each))
    return found


def differences(sources: Mapping[str, Machine], u: Mapping[str, float], measured: str) -> list[Difference]:
    """The lines of all rotary axes, source against source; u: of the measured one, mm, by axis."""
    found = []
    for first, second in itertools.combinations(sources, 2):
        for one, other in zip(sources[first].axes, sources[second].axes, strict=True):
            if one.rotary:
                own = u.get(one.name, 0.0) if measured in (first, second) else 0.0
                found.append(_difference(first, second, sources[first], one, other, own))
    return found


def _difference(first: str, second: str, machine: Machine, one: Axis, other: Axis, u: float) -> Difference:
    """The line of an axis by two sources; the other lines are those of the first source."""
    d, e = one.unit_direction, other.unit_direction
    step = np.subtract(other.point, one.point)
    shift = step - (step @ d) * d
    same = bool(d @ e > 0.0)
    tilt = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(d, e)), abs(d @ e))))
    moved = _with_line(machine, one.name, other)
    turn, part = _on_a_part(machine, moved, one)
    return Difference(one.name, first, second, _vector(shift), tilt, same, u, turn, _vector(part))


def _with_line(machine: Machine, name: str, other: Axis) -> Machine:
    """The machine with the line of one axis by another source."""
    from postproc.control_data.readers.control_source import with_lines

    return with_lines(machine, {name: other.point}, {name: other.direction})


def _on_a_part(machine: Machine, moved: Machine, axis: Axis) -> tuple[float, Array]:
    """Turn, degrees, and the distance `(3,)`, mm, on the part between two features that are cut before and after it."""
    low, high = axis.travel
    turn = next((each for each in TURNS_DEG if low <= each <= high), high if high > -low else low)
    q = np.zeros((2, len(machine.axes)))
    q[1, machine.index(axis.name)] = np.deg2rad(turn)
    tool = np.zeros((2, 3))
    reached = tool_point(machine, positions_with(machine, moved, q, tool), tool)
    apart = reached - tool_point(machine, q, tool)
    return turn, np.asarray(apart[1] - apart[0])


def _vector(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) + 0.0 for value in values)
    return (x, y, z)
