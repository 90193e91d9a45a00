"""Runs of a ballbar whose readings are in the reverse order: their centre is the mirror image of that of the others.

No error of the machine shifts the centre by the direction alone: backlash, play, spikes and servo mismatch have even
waves on a full circle, with two periods and more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import Measurement
from kinematics.transforms import Array

LEAST_ROWS_OF_RUN = 12
"""Least number of rows of a run that is compared."""
SAME_PLANE = 0.99
"""Cosine of the angle between the normals of two runs from which they are in one plane."""
FULL = 0.05
"""Length of the mean of the unit vectors from the centre below which a run is a full circle."""
EXAMINED_DISTANCE_MM = 5e-3
"""Distance of the centres of runs, mm, from which their order is examined: less may be a drift."""
AGREE = 0.1
"""Largest distance of the centres in the right order, as a share of that in the order of the file."""
REFUSED_RUNS = 3
"""Least number of runs for a refusal: with two a shift between them may look alike."""


def reversed_runs(measurement: Measurement, arms: Array) -> tuple[str, bool]:
    """Message, and whether it is fatal, for runs with readings in the reverse order; an empty one for none.

    arms `(n, 3)`: from the table ball to the commanded positions, mm. Runs in one plane are compared with each other.
    """
    assert measurement.run is not None
    unit = arms / np.linalg.norm(arms, axis=1)[:, None]
    left = [_Run.of(measurement, name, unit) for name in dict.fromkeys(measurement.run.tolist())]
    while left:
        plane = [run for run in left if abs(run.normal @ left[0].normal) > SAME_PLANE]
        message = _in_one_plane([run for run in plane if run.full])
        if message:
            return message, len(plane) >= REFUSED_RUNS
        left = [run for run in left[1:] if abs(run.normal @ left[0].normal) <= SAME_PLANE]
    return "", False


class _Run(NamedTuple):
    """A run, with the centre by its readings as they are and in the reverse order, mm from the stated one."""

    name: str
    normal: Array
    """Unit vector `(3,)` about which the tool turns."""
    full: bool
    """True for a full circle."""
    as_read: Array
    turned: Array

    @classmethod
    def of(cls, measurement: Measurement, name: str, unit: Array) -> _Run:
        """The run of this name; unit `(n, 3)`: directions of all rows from the centre."""
        rows = np.flatnonzero(measurement.run == name)
        own, readings = unit[rows], measurement.observed[rows, 0]
        normal = np.cross(own[:-1], own[1:]).sum(axis=0)
        full = len(rows) >= LEAST_ROWS_OF_RUN and float(np.linalg.norm(own.mean(axis=0))) < FULL
        length = max(float(np.linalg.norm(normal)), 1e-12)
        return cls(name, normal / length, full, _centre(own, readings), _centre(own, readings[::-1]))


def _in_one_plane(runs: list[_Run]) -> str:
    """The message for runs in one plane; empty for none."""
    if len(runs) < 2:
        return ""
    as_read, turned = np.array([run.as_read for run in runs]), np.array([run.turned for run in runs])
    backwards = np.array([run.normal @ runs[0].normal < 0.0 for run in runs])
    sets = list(np.eye(len(runs), dtype=bool)) if len(runs) > 2 else []
    sets += [backwards] if backwards.any() else []
    before = _spread(as_read)
    found = min(sets, key=lambda some: _spread(np.where(some[:, None], turned, as_read)), default=None)
    if (
        found is None
        or before < EXAMINED_DISTANCE_MM
        or _spread(np.where(found[:, None], turned, as_read)) > AGREE * before
    ):
        return ""
    own, others = (
        ", ".join(run.name for run, mine in zip(runs, part, strict=True) if mine) for part in (found, ~found)
    )
    either = f" (or those of {others})" if 2 * found.sum() == len(runs) else ""
    return (
        f"the readings of run {own}{either} seem to be in the reverse order: their centre is {2e3 * before:.3g} um "
        "from that of the other runs, and at the same point with the last reading first. Write them in the order of "
        "the positions"
    )


def _centre(unit: Array, readings: Array) -> Array:
    """Shift `(3,)`, mm, of the centre that explains the first wave of readings `(n,)` in directions `(n, 3)`."""
    return np.asarray(np.linalg.lstsq(-unit, readings - readings.mean(), rcond=0.1)[0])


def _spread(centres: Array) -> float:
    """Largest distance of centres `(k, 3)` from the middle of their range, mm."""
    middle = (centres.max(axis=0) + centres.min(axis=0)) / 2.0
    return float(np.linalg.norm(centres - middle, axis=1).max())
