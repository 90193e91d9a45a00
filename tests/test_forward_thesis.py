"""Forward kinematics of the DMU 50 against thesis (3.19)-(3.24)."""

import numpy as np
from support.thesis_kinematics import thesis_forward

import machines
from kinematics.forward import forward


def test_forward_equals_the_thesis_on_random_poses():
    machine = machines.load("dmu50")
    rng = np.random.default_rng(1)
    q = rng.uniform(*machine.travel, (10_000, 5))
    C, B, X, Y, Z = q.T
    position, axis = thesis_forward(X, Y, Z, B, C)
    pose = forward(machine, q)
    assert machine.names == ("C", "B", "X", "Y", "Z")
    assert np.abs(pose.translation - position).max() < 1e-9
    assert np.abs(pose.rotation[:, :, 2] - axis).max() < 1e-14
