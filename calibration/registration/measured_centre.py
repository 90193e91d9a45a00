"""The centre of the measured points, about which the error motions of a fit are written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from calibration.registration.observed_points import derivatives_by_errors
from kinematics.transforms import Array

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

MOST_ROWS_OF_CENTRE = 1000
"""Largest number of rows, evenly spread, from which the centre of the measured points is calculated."""


def arms_of(measurement: Measurement) -> Mapping[str, Array]:
    """Displacements `(3, 3)` of the centre of the measured points by the rotations A, B, C of each linear axis, mm/rad.

    They are in the axis' error frame. With them the convention of a fit refers to the points that were measured,
    wherever the origin of the frame lies. The centre is the middle between the ends, so that it does not depend on
    copies of rows. Axes between which and the instrument no target lies are missing.
    """
    few = measurement.rows(
        np.unique(np.linspace(0, len(measurement) - 1, min(len(measurement), MOST_ROWS_OF_CENTRE)).astype(int))
    )
    transform = derivatives_by_errors(few, few.tool)
    found = {}
    for i, axis in enumerate(few.machine.axes):
        shifts, turns = transform[:, :, 6 * i : 6 * i + 3], transform[:, :, 6 * i + 3 : 6 * i + 6]
        seen = shifts.any(axis=(1, 2))
        if not axis.rotary and seen.any():
            arms = np.swapaxes(shifts[seen], 1, 2) @ turns[seen]
            found[axis.name] = (arms.min(axis=0) + arms.max(axis=0)) / 2.0
    return found
