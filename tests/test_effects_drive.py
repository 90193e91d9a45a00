"""Reversal, pitch, table steps and lag against machines that are simulated from first principles."""

import numpy as np
import pytest
from support.effect_examples import BACKWARD, DMU50, deviation_of

from kinematics.effects import (
    Backlash,
    Cyclic,
    FirstCycle,
    FollowingError,
    GrowthWithTime,
    LateReadBack,
    QuantisedCompensation,
    Settling,
)
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array


def along(axis: str, machine: Machine, **columns: Array) -> State:
    """A state in which one axis takes the columns' values and all others stand at zero."""
    i, n = machine.index(axis), len(columns["positions"])
    spread = {"positions": np.zeros((n, len(machine.axes)))}
    for name, values in columns.items():
        if name in ("positions", "approach", "last_move", "velocity", "acceleration"):
            spread[name] = np.zeros((n, len(machine.axes)))
            spread[name][:, i] = values
        else:
            spread[name] = values
    return State(**spread)


FORWARD = {
    "backlash": (lambda axis: Backlash(axis, 20.0), 10.0),
    "saw tooth": (lambda axis: QuantisedCompensation(axis, 40.0, 100.0, 80.0), 10.0),
    "following": (lambda axis: FollowingError(axis, 0.1), 10.0),
    "late read-back": (lambda _: LateReadBack(0.1), -10.0),
    "settling": (lambda axis: Settling(axis, 200.0), 10.0),
    "growth": (lambda axis: GrowthWithTime(axis=axis, rate=-1000.0), 50.0),
}
"""Effect, and how far it leaves the tool behind, um."""


@pytest.mark.parametrize(("make", "behind"), FORWARD.values(), ids=FORWARD)
@pytest.mark.parametrize("axis", ["X", "U", "Y", "Z"])
def test_what_acts_along_an_axis_counts_forward_whichever_way_its_letter_points(make, behind, axis):
    """X runs to -x and Y to -y, Y carrying the workpiece; the tool relative to the workpiece is behind on all."""
    state = along(
        axis, BACKWARD, positions=np.array([50.0]), approach=np.array([1.0]), velocity=np.array([100.0]),
        last_move=np.array([50.0]), time=np.array([3600.0]),
    )  # fmt: skip
    if make is FORWARD["saw tooth"][0]:
        state.positions[:, BACKWARD.index(axis)] = 155.0  # three quarters of a pitch behind the last step
    found = deviation_of(make(axis), BACKWARD, state).position[0]
    direction = BACKWARD.axes[BACKWARD.index(axis)].unit_direction
    assert found == pytest.approx(-behind * 1e-3 * direction, abs=1e-12)


@pytest.mark.parametrize("machine", [DMU50, BACKWARD], ids=["dmu50", "backward"])
def test_a_rotary_axis_counts_forward_too(machine):
    state = along("C", machine, positions=np.array([0.5, 0.5]), approach=np.array([1.0, -1.0]))
    found = deviation_of(Backlash("C", 40.0), machine, state).orientation
    line = machine.axes[machine.index("C")].unit_direction
    assert found == pytest.approx(np.outer([-20e-6, 20e-6], line), abs=1e-12)


def test_backlash_is_the_reversal_value_of_iso_230_2():
    """A nut with backlash, 18 um at 0 and 20 um/m more, driven to five targets forward and backward."""
    targets = np.array([0.0, 100.0, 200.0, 300.0, 400.0])
    commands = np.concatenate([[-5.0], targets, [405.0], targets[::-1], [-5.0]])
    play = (18.0 + 20.0 * np.maximum(commands, 0.0) * 1e-3) * 1e-3
    place, places = -5.0, []
    for command, width in zip(commands, play, strict=True):
        place = min(max(place, command - width / 2), command + width / 2)
        places.append(place)
    deviations = np.array(places) - commands

    approach = np.append(0.0, np.sign(np.diff(commands)))
    effect = Backlash("X", 18.0, 20.0)
    found = deviation_of(effect, DMU50, along("X", DMU50, positions=commands, approach=approach)).position[:, 0]
    assert found[1:6] == pytest.approx(deviations[1:6], abs=1e-12)
    assert found[7:12] == pytest.approx(deviations[7:12], abs=1e-12)
    reversal = found[1:6] - found[7:12][::-1]  # B_i: forward minus backward
    assert reversal == pytest.approx(-(18.0 + 20.0 * targets * 1e-3) * 1e-3, abs=1e-12)
    assert np.abs(reversal).max() == pytest.approx(26e-3)  # B of the axis


def test_an_axis_that_has_not_moved_stands_in_the_middle_of_its_backlash():
    state = along("X", DMU50, positions=np.array([0.0]), approach=np.array([0.0]))
    assert not deviation_of(Backlash("X", 18.0), DMU50, state).position.any()


def test_the_harmonics_of_a_cyclic_error_are_those_of_its_spectrum():
    x = np.arange(0.0, 50.0, 0.5)
    effect = Cyclic("Y", "X", 10.0, (4.0, 0.0, 1.5), (0.0, -2.0, 0.0))
    found = deviation_of(effect, DMU50, along("X", DMU50, positions=x)).position
    spectrum = np.fft.rfft(found[:, 1] * 1e3) / (len(x) / 2)
    expected = np.zeros(len(spectrum), complex)
    expected[[5, 10, 15]] = -4j, -2.0, -1.5j
    assert spectrum == pytest.approx(expected, abs=1e-9)
    assert found[:, [0, 2]] == pytest.approx(np.zeros((100, 2)), abs=1e-12)


def test_the_period_of_a_rotary_axis_is_in_degrees():
    degrees = np.array([0.0, 22.5, 67.5])
    state = along("C", DMU50, positions=np.radians(degrees))
    found = deviation_of(Cyclic("Z", "C", 90.0, (4.0,), (0.0,)), DMU50, state).position[:, 2]
    assert found == pytest.approx([0.0, 4e-3, -4e-3], abs=1e-12)


def test_the_saw_tooth_is_what_a_table_of_increments_leaves_of_a_straight_error():
    """An axis that loses 0.2 um/mm, and a control that gives back 5 um every 25 mm, first at 10 mm."""
    x = np.linspace(-200.0, 200.0, 801) + 1e-3
    left = -0.2 * (x - 10.0) + 5.0 * (np.floor((x - 10.0) / 25.0) + 0.5)
    effect = QuantisedCompensation("X", 5.0, 25.0, 10.0)
    found = deviation_of(effect, DMU50, along("X", DMU50, positions=x)).position[:, 0]
    assert found == pytest.approx(left * 1e-3, abs=1e-12)


def test_following_error_is_that_of_a_servo_of_first_order():
    """tau dx/dt = command - x, command = v t + a t^2 / 2: x settles on command - tau v(t) + tau^2 a."""
    tau, v, a, step = 0.02, 40.0, 300.0, 1e-5
    t = np.arange(0.0, 0.5, step)
    command = v * t + a * t**2 / 2
    keep, middle = np.exp(-step / tau), np.interp(t + step / 2, t, command)
    x = np.zeros(len(t))
    for i in range(1, len(t)):
        x[i] = middle[i - 1] + (x[i - 1] - middle[i - 1]) * keep
    last = len(t) - 1
    state = along(
        "X", DMU50, positions=command[[last]], velocity=v + a * t[[last]], acceleration=np.array([a])
    )  # fmt: skip
    found = deviation_of(FollowingError("X", tau * 1e3, -((tau * 1e3) ** 2)), DMU50, state).position[0, 0]
    assert found == pytest.approx(x[last] - command[last], rel=1e-6)


def test_compliance_is_that_of_a_load_on_a_spring():
    """A constant acceleration holds the load back by a / omega^2."""
    omega, a = 2 * np.pi * 50.0, 2000.0
    state = along("X", DMU50, positions=np.zeros(1), velocity=np.zeros(1), acceleration=np.array([a]))
    found = deviation_of(FollowingError("X", 0.0, 1e6 / omega**2), DMU50, state).position[0, 0]
    assert found == pytest.approx(-a / omega**2)


def test_settling_is_what_a_servo_of_first_order_has_left_after_a_dwell():
    moves, tau, dwell = np.array([100.0, -50.0, 0.0]), 0.05, 0.5
    share = np.exp(-dwell / tau)
    state = along("Y", DMU50, positions=np.cumsum(moves), last_move=moves)
    found = deviation_of(Settling("Y", share * 1e6), DMU50, state).position[:, 1]
    assert found == pytest.approx(-moves * share, abs=1e-12)


def test_late_read_back_is_the_way_made_since_the_position_was_noted():
    """On a path of constant velocity of all axes: observed at q(t), noted is q(t - lag)."""
    velocity, lag = np.array([[0.02, -0.01, 30.0, -20.0, 10.0]]), 0.004
    noted, tool = np.array([[0.3, 0.4, 50.0, -30.0, 200.0]]), (5.0, -10.0, -120.0)
    found = deviation_of(LateReadBack(lag * 1e3), DMU50, State(noted, velocity=velocity), tool)
    way = tool_point(DMU50, noted + velocity * lag, tool) - tool_point(DMU50, noted, tool)
    assert found.position == pytest.approx(way, abs=1e-6)  # second order of 0.15 mm and 0.1 mrad
    assert np.linalg.norm(way) > 0.1


def test_the_first_cycle_alone_differs():
    state = along("X", DMU50, positions=np.zeros(4), cycle=np.array([0.0, 0.0, 1.0, 2.0]))
    found = deviation_of(FirstCycle("Z", "X", 7.0), DMU50, state).position
    assert found == pytest.approx(np.outer([7e-3, 7e-3, 0, 0], [0, 0, 1]), abs=1e-12)
