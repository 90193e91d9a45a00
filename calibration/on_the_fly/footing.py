"""Where on the path a reading was taken: not at its foot, but as far from it as the machine is ahead or behind there.

A deviation along the path moves the foot of a point and shows in nothing else; yet the errors across it are those of
the place where the axes stood. With 0.1 mm along the path and errors that change by 2 um per mm that is 0.2 um.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.fit import fit
from calibration.measurement.measurement import Measurement
from calibration.observation import equations
from calibration.observation.full_model import BasisChoice, moving_axes, with_effects
from calibration.on_the_fly.along_path import OnTheFly
from kinematics.error_model.model import Observation
from kinematics.transforms import blocks

NODES, HARMONICS = 12, 4
"""Of the fit that says how far the machine is ahead."""


def with_footing(taken: OnTheFly) -> Measurement:
    """The measurement with positions where a first fit has the axes stand; its rows are otherwise the same."""
    measurement = taken.measurement
    assert measurement.across is not None
    bases = {
        axis: BasisChoice("fourier", HARMONICS) if axis[0] in "ABC" else BasisChoice("cubic", NODES)
        for axis in moving_axes(measurement)
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
        seen = [
            equations.expected(whole, found.registration, Observation(each.errors[rows], each.shift[rows]))
            for each in (effects, nothing)
        ]
        ahead[rows] = np.sum(along * (seen[0] - seen[1]), axis=1)
    positions = measurement.state.positions.copy()
    for name, way in taken.ways.items():
        mine = measurement.state.target == name
        positions[mine] = way.positions_at(measurement.across.way[mine] - ahead[mine])
    return replace(measurement, state=replace(measurement.state, positions=positions))
