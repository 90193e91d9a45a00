"""The three methods of Miller et al. 2017 that restore the straight line of a continuous run, for comparison.

Each takes the errors of single samples about their own least-squares line (3, 4), adds a slope, and shifts them onto
the readings inside the segment (step 5). The slope is that of the quasi-static errors between the ends of the travel
(Fig. 7), or between two targets inside the segment (Fig. 8), or the least-squares slope between the run and all
readings inside (5, Fig. 9), which the paper finds by a simplex search.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from calibration.continuous.error_curve import Course
from calibration.continuous.records import QuasiStatic
from kinematics.transforms import Array


class Line(NamedTuple):
    """Line to add to the errors about their own line: um, and um per mm from position 0."""

    offset: float
    slope: float


class Comparison(NamedTuple):
    """Errors of the samples of one run, um, by method."""

    x: Array
    """Commanded positions `(n,)`, mm."""
    errors: Mapping[str, Array]


def comparisons_of(courses: Sequence[Course], quasi: QuasiStatic, inside: np.ndarray) -> dict[str, Comparison]:
    """Each run, by its name, compared with the readings in its direction; `inside`: those `(m,)` in the segment."""
    same_way = {course.record.direction: quasi.direction == course.record.direction for course in courses}
    return {
        course.record.name: _compared(course, quasi, inside & same_way[course.record.direction]) for course in courses
    }


def _compared(course: Course, quasi: QuasiStatic, inside: np.ndarray) -> Comparison:
    """The three methods on one run; `inside`: the readings `(m,)` within its segment."""
    own = _about_line(course)
    rows = quasi.direction == course.record.direction
    targets, means = _means(quasi.rows(np.flatnonzero(rows)))
    within, values = _means(quasi.rows(np.flatnonzero(rows & inside)))
    missing = values - _at(course.raw_x, own, within)
    lines = {
        "end point": _shifted(_slope(targets, means), within, missing),
        "two points": _shifted(_slope(within, values), within, missing),
        "least squares": _least_squares(within, missing),
    }
    return Comparison(
        course.raw_x, {name: own + line.offset + line.slope * course.raw_x for name, line in lines.items()}
    )


def _about_line(course: Course) -> Array:
    """Errors of the samples about their least-squares line, um; (3), (4)."""
    slope, offset = np.polyfit(course.raw_x, course.raw_error, 1).tolist()
    return np.asarray(course.raw_error - slope * course.raw_x - offset)


def _means(quasi: QuasiStatic) -> tuple[Array, Array]:
    targets, which = np.unique(quasi.target, return_inverse=True)
    return targets, np.bincount(which, quasi.deviation) / np.bincount(which)


def _slope(targets: Array, values: Array) -> float:
    """Slope from the first to the last value, um per mm."""
    return float((values[-1] - values[0]) / (targets[-1] - targets[0]))


def _shifted(slope: float, targets: Array, differences: Array) -> Line:
    """The line of this slope with zero mean distance from the differences."""
    return Line(float(np.mean(differences - slope * targets)), slope)


def _least_squares(targets: Array, differences: Array) -> Line:
    slope, offset = np.polyfit(targets, differences, 1).tolist()
    return Line(offset, slope)


def _at(x: Array, error: Array, targets: Array) -> Array:
    """Errors of the samples nearest to the targets, um; 4.4."""
    order = np.argsort(x)
    after = np.clip(np.searchsorted(x[order], targets), 1, len(x) - 1)
    nearer = after - (targets - x[order][after - 1] < x[order][after] - targets)
    return np.asarray(error[order][nearer])
