"""Reach of a laser tracker: limits of its articulation, of its range, and of the angle at the reflector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.registration.observed_points import carried
from calibration.registration.registration import Registration
from kinematics.transforms import Array, Pose, turn


@dataclass(frozen=True)
class Reach:
    """Limits of a laser tracker, degrees and mm; None for no limit."""

    elevation: tuple[float, float] | None = None
    """Range of the beam's angle to the tracker's x y plane; the virtual calibration paper, Table 3, has -59 ... 79."""
    incidence: float | None = None
    """Largest angle between the beam and the axis of the reflector: half the opening that its maker states."""
    range_mm: float | None = None
    """Largest distance of a target from the tracker, mm."""
    nearest_mm: float | None = None
    """Smallest distance of a target from the tracker, mm."""


class InReach(NamedTuple):
    """The rows in reach of a tracker."""

    rows: np.ndarray
    """Mask `(n,)` of the rows in reach."""
    notes: tuple[str, ...]
    """Reasons why others are not, with the numbers of their rows."""


def in_reach(measurement: Measurement, poses: Mapping[str, Pose], reach: Reach) -> InReach:
    """The rows of a planned measurement that a tracker can observe from its poses, at nominal positions.

    Each reflector is mounted so that its axis points to the tracker as well as possible over all its positions.
    """
    points = measurement.nominal_points
    own = Registration(poses).apply(measurement, points)
    length = np.linalg.norm(own, axis=1)
    reasons: dict[str, np.ndarray] = {}
    if reach.elevation is not None:
        elevation = np.degrees(np.arcsin(own[:, 2] / np.maximum(length, 1e-9)))
        low, high = reach.elevation
        reasons[f"elevation not within {low:g}..{high:g} deg"] = (elevation < low) | (elevation > high)
    if reach.range_mm is not None:
        reasons[f"farther than {reach.range_mm:g} mm"] = length > reach.range_mm
    if reach.nearest_mm is not None:
        reasons[f"nearer than {reach.nearest_mm:g} mm"] = length < reach.nearest_mm
    if reach.incidence is not None:
        angle = _incidence(measurement, poses)
        reasons[f"incidence above {reach.incidence:g} deg"] = angle > reach.incidence
    visible = ~np.any([*reasons.values(), np.zeros(len(points), bool)], axis=0)
    notes = [f"{int(rows.sum())} observations left out: {reason}" for reason, rows in reasons.items() if rows.any()]
    return InReach(visible, tuple(notes))


def _incidence(measurement: Measurement, poses: Mapping[str, Pose]) -> Array:
    """Angles `(n,)`, degrees, between beam and reflector."""
    points, groups = measurement.nominal_points, measurement.groups
    angle = np.empty(len(points))
    back = np.swapaxes(carried(measurement), 1, 2)
    for station, pose in poses.items():
        origin = pose.inverse().translation[0]
        beam = origin - points
        beam /= np.linalg.norm(beam, axis=1, keepdims=True)
        own = turn(back, beam)
        for number in range(len(measurement.targets)):
            rows = (groups == station) & (measurement.target_number == number)
            axis = own[rows].mean(axis=0) if rows.any() else np.array([0.0, 0.0, 1.0])
            cosine = own[rows] @ axis / max(float(np.linalg.norm(axis)), 1e-12)
            angle[rows] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return angle
