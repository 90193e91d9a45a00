"""Measurements of an interferometer along one axis of the gantry."""

import numpy as np

import machines
from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement, Target, with_moves
from kinematics.state import State

GANTRY = machines.load("gantry")


def runs(error, positions, rng, u_um=0.5):
    """Three bidirectional runs of an interferometer along X, with noise."""
    q = np.zeros((6 * len(positions), 3))
    q[:, 0] = np.tile(np.concatenate([positions, positions[::-1]]), 3)
    n = len(q)
    state = with_moves(State(q, target=np.full(n, "1")))
    observed = (error(q[:, 0]) + u_um * rng.normal(size=n))[:, None] * 1e-3
    axis, run = np.full(n, "X"), np.repeat(["1", "2", "3"], n // 3)
    return Measurement(
        GANTRY,
        Interferometer(u_um=u_um),
        state,
        observed,
        {"1": Target((0.0, 0.0, 0.0))},
        axis=axis,
        run=run,
        source="runs",
    )
