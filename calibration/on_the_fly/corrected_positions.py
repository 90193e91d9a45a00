"""Correction of the axis positions of readings on the fly for the deviation along the path.

A reading is assigned to the foot of its perpendicular on the path. A deviation along the path shifts this foot and has
no other effect; but the errors across the path are those at the true axis positions. A deviation of 0.1 mm along the
path, where errors change by 2 um/mm, causes an error of 0.2 um.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.fit import fit
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice, with_effects
from calibration.on_the_fly.along_path import OnTheFly
from kinematics.error_model.model import Observation
from kinematics.transforms import blocks

PATH_FIT_NODES, PATH_FIT_HARMONICS = 12, 4
"""Size of the bases in the fit that estimates the deviation along the path."""


def with_corrected_positions(taken: OnTheFly) -> Measurement:
    """The measurement with axis positions corrected by a first fit; all other columns stay the same."""
    measurement = taken.measurement
    assert measurement.across is not None
    bases = {
        axis: BasisChoice("fourier", PATH_FIT_HARMONICS) if axis[0] in "ABC" else BasisChoice("cubic", PATH_FIT_NODES)
        for axis in measurement.moving
    }
    model, prior = with_effects(measurement, bases, (), 1.0)
    found = fit(measurement, model, prior=prior)
    effects = found.model.observation(measurement.machine, measurement.state)
    nothing = Observation(np.zeros_like(effects.errors), np.zeros_like(effects.shift))
    ahead = np.empty(len(measurement))
    for rows in blocks(len(measurement)):
        part = measurement.rows(rows)
        assert part.across is not None
        along = np.cross(part.across.directions[:, 0], part.across.directions[:, 1])
        whole = replace(part, across=None)
        points = [
            whole.instrument.expected(whole, found.registration, Observation(each.errors[rows], each.shift[rows]))
            for each in (effects, nothing)
        ]
        ahead[rows] = np.sum(along * (points[0] - points[1]), axis=1)
    positions = measurement.state.positions.copy()
    for name, path in taken.paths.items():
        mine = measurement.state.target == name
        positions[mine] = path.positions_at(measurement.across.distances[mine] - ahead[mine])
    return replace(measurement, state=replace(measurement.state, positions=positions))
