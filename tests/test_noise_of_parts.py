"""The noise of a part measured in two coordinates: that of its axes cannot be told from that of the measuring machine."""

import numpy as np
from support.diagnosis_cases import CFRAME, fitted
from support.virtual_measurements import ONE, positions

from calibration.fit.noise import with_estimated_noise
from calibration.measurement.instruments import Part
from calibration.simulation.simulate import observe
from kinematics.error_model.model import no_errors
from kinematics.state import State


def test_what_cannot_be_divided_stays_as_specified():
    rng = np.random.default_rng(1)
    q = positions(CFRAME, 200, rng)
    q[:, 2] = 100.0
    state = State(q, target=np.full(200, "1"))
    part = Part(1.0, components=2)
    data = observe(CFRAME, no_errors(CFRAME), state, part, rng, None, ONE, noise_scale=2.0)
    assert with_estimated_noise(fitted(data)).noise is None
