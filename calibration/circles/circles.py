"""The circles in a ballbar's measurement: their planes, directions and angles, and the deviations from the radius."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.instruments import Ballbar
from calibration.measurement.measurement import Measurement
from calibration.plausibility.misfit import misfit
from kinematics.transforms import Array
from kinematics.user_error import UserError

LEAST_ROWS = 24
"""Least number of rows of a circle."""
GROSS_MM = 0.5
"""Difference of a row from its circle, mm, from which it is left out."""
AXES = "XYZ"
PLANES = (("X", "Y"), ("Y", "Z"), ("Z", "X"))
"""Planes by the axes that move in them; the angle counts from the first axis to the second."""


@dataclass(frozen=True)
class Circle:
    """One run: a circle, or an arc, in one direction."""

    run: str
    plane: str
    feed: float
    """mm/min."""
    counter_clockwise: bool
    """From the first axis of the plane to the second."""
    rows: np.ndarray
    """Numbers of the rows in the measurement."""
    angles: Array
    """Angles of the tool ball `(n,)` in the plane, rad."""


def ballbar_of(measurement: Measurement) -> Ballbar:
    """The ballbar of a measurement; UserError for another instrument."""
    refusal = f"{measurement.source}: circles need the measurement of a ballbar (# instrument: ballbar)"
    return Ballbar.expect(measurement.instrument, refusal)


def one_way_planes(circles: Sequence[Circle]) -> list[str]:
    """Planes whose circles all run in one direction: there steps at reversals look like smooth error motions."""
    ways: dict[str, set[bool]] = {}
    for circle in circles:
        ways.setdefault(circle.plane, set()).add(circle.counter_clockwise)
    return [plane for plane, found in ways.items() if len(found) == 1]


def circles_of(measurement: Measurement) -> list[Circle]:
    """The circles of a measurement by a ballbar, in their order, without rows with gross errors.

    UserError for a run with few rows.
    """
    ballbar_of(measurement)
    assert measurement.run is not None
    assert measurement.feed is not None
    residual, registration = misfit(measurement)
    good = np.abs(residual[:, 0]) < GROSS_MM
    points = measurement.nominal_points
    centres = registration.sphere_centres
    arms = points - np.array([centres[name] for name in measurement.groups.tolist()])
    runs = list(dict.fromkeys(measurement.run.tolist()))
    found = []
    for run in runs:
        rows = np.flatnonzero((measurement.run == run) & good)
        if len(rows) < LEAST_ROWS:
            raise UserError(f"{measurement.source}: run {run} has {len(rows)} rows, a circle needs {LEAST_ROWS}")
        still = int(np.argmin(np.ptp(points[rows], axis=0)))
        first, second = ((1, 2), (2, 0), (0, 1))[still]
        angles = np.arctan2(arms[rows, second], arms[rows, first])
        turned = float(np.sum(np.sin(np.diff(angles))))
        feed = float(np.median(measurement.feed[rows]))
        found.append(Circle(run, AXES[first] + AXES[second], feed, turned > 0.0, rows, angles))
    return found
