"""Gravity on joints and rams against energy and beams."""

import msgspec
import numpy as np
import pytest
from support.effect_examples import BACKWARD, deviation_of

import machines
from kinematics.effects import JointCompliance, RamSag
from kinematics.error_model.model import no_errors
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError

ARM = machines.parse(
    """
name = "arm"
chain = "w b X Y Z C B B2 t"
axes.X = { travel = [0, 1000] }
axes.Y = { travel = [0, 1000] }
axes.Z = { travel = [0, 1000] }
axes.C = { travel = [-180, 180], point = [-1500, 0, 0] }
axes.B = { travel = [-180, 180], point = [-1400, 0, 0] }
axes.B2 = { travel = [-180, 180], point = [-600, 0, 0] }
""",
    "arm",
)


def test_a_joint_turns_by_the_slope_of_the_potential_energy():
    """Torque of a unit weight = -d(height of the tool reference point)/d(angle), for every joint and pose."""
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (30, 6))
    for axis in ("C", "B", "B2"):
        step = np.zeros(6)
        step[ARM.index(axis)] = 1e-5
        torque = -(tool_point(ARM, q + step)[:, 2] - tool_point(ARM, q - step)[:, 2]) / 2e-5
        model = msgspec.structs.replace(no_errors(ARM), effects=(JointCompliance(axis, 25.0),))
        errors = model.errors(ARM, State(q))
        i = ARM.index(axis)
        assert errors[:, i, 3 + "ABC".index(axis[0])] == pytest.approx(25e-6 * torque * 1e-3, abs=1e-12)
        assert (np.abs(torque).max() > 100.0) == (axis != "C")


def test_an_arm_stretched_out_sinks_at_its_tip():
    found = deviation_of(JointCompliance("B", 50.0), ARM, State(np.zeros((1, 6)))).position[0]
    assert found == pytest.approx([0.0, 0.0, -50e-6 * 1.4 * 1400.0], abs=1e-5)


def test_a_ram_is_a_cantilever():
    """End load F on a beam: w = F L^3 / (3 E I), slope = F L^2 / (2 E I)."""
    u = np.array([-40.0, 0.0, 40.0])
    q = np.zeros((3, 5))
    q[:, BACKWARD.index("U")] = u
    for extends in (1, -1):
        errors = msgspec.structs.replace(
            no_errors(BACKWARD), effects=(RamSag("U", 30.0, -extends * 460.0, extends),)
        ).errors(BACKWARD, State(q))[:, BACKWARD.index("U")]
        metres = (460.0 + extends * u) * 1e-3
        assert errors[:, 2] == pytest.approx(-30e-3 * metres**3)
        # about +y a beam along +x dips; one along -x lifts its root side
        assert errors[:, 4] == pytest.approx(extends * 1.5 * 30e-6 * metres**2)
        assert not errors[:, [0, 1, 3, 5]].any()


def test_a_second_axis_lengthens_the_overhang_and_a_vertical_ram_does_not_sag():
    q = np.zeros((2, 5))
    q[1, BACKWARD.index("X")] = -200.0  # X runs against its letter
    model = msgspec.structs.replace(no_errors(BACKWARD), effects=(RamSag("U", 30.0, -300.0, 1, "X"),))
    errors = model.errors(BACKWARD, State(q))[:, BACKWARD.index("U"), 2]
    assert errors == pytest.approx([-30e-3 * 0.3**3, -30e-3 * 0.5**3])
    model = msgspec.structs.replace(no_errors(BACKWARD), effects=(RamSag("Z", 30.0, 300.0, -1),))
    assert not model.errors(BACKWARD, State(q)).any()


def test_an_axis_that_carries_the_workpiece_is_refused():
    with pytest.raises(UserError, match=r"^joint-compliance C: C carries the workpiece"):
        msgspec.structs.replace(no_errors(BACKWARD), effects=(JointCompliance("C", 1.0),)).errors(
            BACKWARD, State(np.zeros((1, 5)))
        )
