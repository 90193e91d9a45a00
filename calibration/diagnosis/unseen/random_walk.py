"""Errors at unseen states by a random walk of the tool in time, which no calibration holds.

It shifts all poses alike, and a calibration that is compared by its shape misses nothing of it: unless rotary axes turn
the workpiece, so that the same shift of the tool points elsewhere at every pose.
"""

from __future__ import annotations

import msgspec
import numpy as np

from calibration.diagnosis.residual.absorber import steps_of_walk, with_fair_noise, with_walk
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.unseen.unseen_states import moments
from calibration.observation.full_model import ROTARY
from kinematics.effects import Unnamed
from kinematics.error_model.model import no_errors
from kinematics.state import TIME
from kinematics.transforms import Array


def squares_by_walk(linearised: LinearisedFit) -> Array:
    """Mean squares `(3,)` in x, y, z, um^2, of errors at unseen states by the walk that the residuals need, if any.

    Noise of the axes may hold the walk: it is estimated beside even noise, unless the stops shift independently. It is
    as large as it was in the measurement, counted from its start as the model is, with its uncertainty.
    """
    turning = [axis for axis in linearised.measurement.moving if axis[0] in ROTARY]
    if not turning or linearised.measurement.components != 3 or linearised.state.time is None:
        return np.zeros(3)
    walked, squares = with_walk(with_fair_noise(linearised, with_walk)), np.zeros(3)
    steps = steps_of_walk(linearised)
    first, solved = linearised.design.shape[1], walked.linearised
    shifts = [Unnamed(direction, (TIME,), ((0.0, 1.0),), ((0,),), (0.0,)) for direction, _ in walked.walks]
    model = msgspec.structs.replace(no_errors(linearised.measurement.machine), effects=tuple(shifts))
    variances = np.zeros(len(shifts))
    for number, (_, size) in enumerate(walked.walks):
        own = slice(first + number * steps.shape[1], first + (number + 1) * steps.shape[1])
        mean, root = steps @ solved.away[own], steps @ solved.posterior.root[own]
        variances[number] = size**2 * np.mean(mean**2 + np.sum(root**2, axis=1))
    for count, moment in enumerate(moments(linearised.measurement) if shifts else (), start=1):
        squares += (np.mean(moment.design(model) ** 2, axis=0) @ variances - squares) / count
    return squares
