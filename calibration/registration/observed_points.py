"""Points of a machine with errors as seen by an instrument, and their derivatives by the error motions.

The instrument is fixed to the workpiece, to which the machine's deviations refer, or to the bed; a target is on the
tool, the table or the bed. The instrument sees the axes between the two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calibration.registration.derived import derived
from kinematics.error_transform import error_transform_with_tool, pose_slopes
from kinematics.forward import forward
from kinematics.machine import NDArrayBool
from kinematics.transforms import Array

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement


class Sight(NamedTuple):
    """Rows with the same axes between instrument and target."""

    rows: np.ndarray
    between: NDArrayBool
    """Mask `(axes + 1,)` of the axes between instrument and target, and of the tool behind them."""
    against: bool
    """True for a view from the bed to the table, against the direction of the chain."""
    positions: Array
    """Axis positions `(rows, axes)`, mm and rad; zero for axes that are not seen."""


def target_points(measurement: Measurement, errors: Array | None, tool: Array) -> Array:
    """Targets `(n, 3)`, mm, in the frame to which the instrument is fixed, at zero pose of the machine.

    errors `(n, axes + 1, 6)`, mm and rad, of the machine; None for the nominal machine. tool `(n, 3)`, mm: the targets
    on their carriers. Exact matrix product.
    """
    points = np.empty((len(measurement), 3))
    for sight in _sights(measurement):
        mine = None if errors is None else np.where(sight.between[:, None], errors[sight.rows], 0.0)
        pose = forward(measurement.machine, sight.positions, mine)
        points[sight.rows] = pose.inverse().apply(tool[sight.rows]) if sight.against else pose.apply(tool[sight.rows])
    return points


def derivatives_by_errors(measurement: Measurement, tool: Array) -> Array:
    """Derivatives `(n, 3, (axes + 1) * 6)` of `target_points` by the error motions, at zero errors, per mm and rad."""
    machine = measurement.machine
    transform = np.empty((len(measurement), 3, 6 * (len(machine.axes) + 1)))
    for sight in _sights(measurement):
        positions, target = sight.positions, tool[sight.rows]
        if sight.against:
            back = forward(machine, positions).inverse()
            part = -back.rotation @ error_transform_with_tool(machine, positions, back.apply(target))[:, :3]
        else:
            part = error_transform_with_tool(machine, positions, target)[:, :3]
        transform[sight.rows] = part * np.repeat(sight.between, 6)
    return transform


def derivatives_by_positions(measurement: Measurement, tool: Array) -> Array:
    """Derivatives `(n, 3, axes)` of `target_points` by the positions of the axes, without errors; per mm and rad."""
    machine = measurement.machine
    slopes = np.empty((len(measurement), 3, len(machine.axes)))
    for sight in _sights(measurement):
        positions, target = sight.positions, tool[sight.rows]
        if sight.against:
            back = forward(machine, positions).inverse()
            part = -back.rotation @ pose_slopes(machine, positions, back.apply(target))[:, :3]
        else:
            part = pose_slopes(machine, positions, target)[:, :3]
        slopes[sight.rows] = part * sight.between[:-1]
    return slopes


def carried(measurement: Measurement) -> Array:
    """Rotations `(n, 3, 3)` from the directions of the target's carrier to the base frame of the instrument."""
    rotation = np.empty((len(measurement), 3, 3))
    for sight in _sights(measurement):
        pose = forward(measurement.machine, sight.positions)
        rotation[sight.rows] = (pose.inverse() if sight.against else pose).rotation
    return rotation


@derived
def _sights(measurement: Measurement) -> tuple[Sight, ...]:
    """The rows, grouped by the sides of the chain between instrument and target."""
    sides = np.array([axis.side for axis in measurement.machine.axes])
    on_workpiece = measurement.stands_on == "workpiece"
    carriers = np.array([target.carrier for target in measurement.targets.values()])[measurement.target_number]
    sights = []
    for carrier in ("tool", "table", "bed"):
        rows = np.flatnonzero(carriers == carrier)
        tool_side = carrier == "tool"
        workpiece_side = on_workpiece != (carrier == "table")
        seen = np.where(sides == "tool", tool_side, workpiece_side)
        if len(rows):
            between = np.array([*seen, tool_side])
            positions = np.where(between[:-1], measurement.state.positions[rows], 0.0)
            sights.append(Sight(rows, between, not on_workpiece and carrier == "table", positions))
    return tuple(sights)
