"""Derivatives of carried points by the error motions of an axis, written by hand: against difference quotients."""

import numpy as np
import pytest

import machines
from calibration.single_axis.rigid_motions import error_design, outward

AXES = [(name, axis.name) for name in machines.names() for axis in machines.load(name).axes]
STEP = 1e-5


@pytest.mark.parametrize(("name", "letter"), AXES)
def test_derivatives_by_error_motions_are_those_of_the_exact_kinematics(name, letter):
    """Per mm and per rad, at random positions of the axis and of the points on it."""
    machine, rng = machines.load(name), np.random.default_rng(1)
    axis = machine.axes[machine.index(letter)]
    q, body = rng.uniform(-1.0, 1.0, 7) * (1.0 if axis.rotary else 200.0), rng.uniform(-300.0, 300.0, (4, 3))

    def carried(errors):
        pose = outward(axis, q, errors)
        return np.stack([pose.apply(point) for point in body], axis=1)

    found = error_design(axis, q, carried(np.zeros((7, 6))))
    for column, unit in enumerate(np.eye(6)):
        ahead, behind = (carried(np.tile(sign * STEP * unit, (7, 1))) for sign in (1.0, -1.0))
        assert found[..., column] == pytest.approx((ahead - behind) / (2 * STEP), abs=1e-5)
