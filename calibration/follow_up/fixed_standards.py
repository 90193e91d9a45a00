"""Fixed targets and a calibrated bar on the part that carries the tracker: steady points and known lengths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import Carrier, Measurement, Target
from calibration.registration.registration import Registration
from kinematics.transforms import Array

BAR_MM, BAR_U_UM = 2000.0, 1.0
"""Length of a bar, mm, and its standard uncertainty, um."""
BAR_DISTANCE_MM = 500.0
"""Distance of the bar from the tracker, mm."""


class Length(NamedTuple):
    """A known distance between two targets."""

    one: str
    other: str
    u_mm: float
    """Standard uncertainty, mm."""


def references(measurement: Measurement, registration: Registration) -> dict[str, Target]:
    """Three targets at the foot of the volume, on the part that carries the tracker, at positions yet unknown."""
    points = _tool_points(measurement, registration)
    low, high = points.min(axis=0), points.max(axis=0)
    corners = [(low[0], low[1]), (high[0], low[1]), ((low[0] + high[0]) / 2, high[1])]
    return {f"fixed {i}": _target(measurement, np.array([x, y, low[2]])) for i, (x, y) in enumerate(corners, start=1)}


def bar(measurement: Measurement, registration: Registration) -> tuple[dict[str, Target], tuple[Length, ...]]:
    """Ends of a bar in two set-ups: in line with the beam behind the tracker, and with the tracker between its ends.

    Ranges are subtracted in the first and added in the second: this separates their offset from their scale.
    """
    tracker = registration.poses[str(measurement.groups[-1])].inverse().translation[0]
    beam = (tracker - _tool_points(measurement, registration).mean(axis=0)) * (1.0, 1.0, 0.0)
    beam = beam / np.linalg.norm(beam) if np.linalg.norm(beam) > 1.0 else np.array([1.0, 0.0, 0.0])
    aside = np.array([-beam[1], beam[0], 0.0])
    ends = {
        "bar in line 1": tracker + BAR_DISTANCE_MM * beam,
        "bar in line 2": tracker + (BAR_DISTANCE_MM + BAR_MM) * beam,
        "bar about 1": tracker - BAR_MM / 2 * aside,
        "bar about 2": tracker + BAR_MM / 2 * aside,
    }
    u = BAR_U_UM * 1e-3
    lengths = (Length("bar in line 1", "bar in line 2", u), Length("bar about 1", "bar about 2", u))
    return {name: _target(measurement, position) for name, position in ends.items()}, lengths


def _tool_points(measurement: Measurement, registration: Registration) -> Array:
    return registration.points(measurement)


def _target(measurement: Measurement, position: Array) -> Target:
    """A target that does not move relative to the tracker."""
    carrier: Carrier = "table" if measurement.stands_on == "workpiece" else "bed"
    x, y, z = position.tolist()
    return Target((x, y, z), carrier)
