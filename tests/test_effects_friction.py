"""Play across the guide, hysteresis, reversal spikes and servo mismatch against axes simulated from first principles."""

import numpy as np
import pytest
from support.effect_examples import BACKWARD, DMU50, deviation_of

from kinematics.effects import Hysteresis, LateralPlay, ReversalSpike, ServoMismatch
from kinematics.effects.friction import way_since_reversal
from kinematics.state import State

X = DMU50.index("X")


def driven(x, machine=DMU50, axis="X"):
    """An axis that runs through positions, mm, from the first one, which it reached going forward."""
    positions = np.zeros((len(x), len(machine.axes)))
    positions[:, machine.index(axis)] = x
    approach = np.zeros(positions.shape)
    approach[:, machine.index(axis)] = np.sign(np.append(1.0, np.diff(x)))
    return State(positions, approach=approach)


def test_the_way_counts_from_the_last_reversal():
    state = driven(np.array([0.0, 10.0, 30.0, 25.0, 5.0, 6.0, 16.0]))
    assert way_since_reversal(DMU50, state, "X", "") == pytest.approx([np.inf, np.inf, np.inf, 5.0, 25.0, 1.0, 11.0])
    assert way_since_reversal(DMU50, state.rows(slice(0, 0)), "X", "").shape == (0,)


def test_an_axis_that_stands_keeps_its_way():
    state = driven(np.array([0.0, 10.0, 4.0, 4.0, 3.0]))
    state.approach[3, X] = -1.0
    assert way_since_reversal(DMU50, state, "X", "")[2:] == pytest.approx([6.0, 6.0, 7.0])


def test_hysteresis_is_a_backlash_far_from_reversals_and_nothing_just_behind_one():
    width, length = 20.0, 15.0
    state = driven(np.array([0.0, 100.0, 99.99, 85.0, -100.0, 100.0]))
    found = deviation_of(Hysteresis("X", width, length), DMU50, state).position[:, 0] * 1e3
    way = np.array([np.inf, np.inf, 0.01, 15.0, 200.0, 200.0])
    expected = -width / 2 * np.array([1, 1, -1, -1, -1, 1]) * (1 - np.exp(-way / length))
    assert found == pytest.approx(expected, abs=1e-9)
    assert abs(found[2]) < 0.01
    assert found[4] == pytest.approx(10.0, abs=1e-3)


def test_dahl_friction_is_a_hysteresis_with_a_spike_of_half_its_width():
    """Force of a bristle model, dF/ds = (1 - F sign) / length, from -1 at the reversal: it winds up a drive."""
    width, length, s = 20.0, 8.0, np.arange(0.0, 60.0, 0.01)
    force = -1.0
    forces = [force]
    for step in np.diff(s):
        force += step / length * (1.0 - force)
        forces.append(force)
    x = np.concatenate([[0.0, -50.0], -50.0 + s[1:]])
    state = driven(x)
    state.approach[0, X] = -1.0
    effects = Hysteresis("X", width, length), ReversalSpike("X", -width / 2, length)
    found = sum(deviation_of(effect, DMU50, state).position[2:, 0] for effect in effects) * 1e3
    assert found == pytest.approx(-width / 2 * np.array(forces[1:]), abs=0.01)


@pytest.mark.parametrize("axis", ["X", "Y"])
def test_a_spike_counts_forward_and_decays(axis):
    state = driven(np.array([0.0, -10.0, -2.0, 30.0]), BACKWARD, axis)
    found = deviation_of(ReversalSpike(axis, 12.0, 8.0), BACKWARD, state).position * 1e3
    direction = BACKWARD.axes[BACKWARD.index(axis)].unit_direction
    behind = 12.0 * np.array([0.0, -np.exp(-10 / 8), np.exp(-1), np.exp(-5)])
    assert found == pytest.approx(-np.outer(behind, direction), abs=1e-9)


def test_play_shifts_and_tips_the_carriage():
    state = driven(np.array([0.0, 10.0, 5.0]))
    sideways = deviation_of(LateralPlay("Y", "X", 8.0), DMU50, state).position * 1e3
    assert sideways == pytest.approx(np.outer([4.0, 4.0, -4.0], [0, 1, 0]), abs=1e-9)
    rolled = deviation_of(LateralPlay("A", "X", 30.0), DMU50, state, (0.0, 0.0, -200.0)).position * 1e3
    assert rolled == pytest.approx(np.outer([15.0, 15.0, -15.0], [0, 0.2, 0]), abs=1e-3)


def test_mismatch_makes_an_ellipse_at_45_degrees_of_a_circle():
    radius, feed, lag = 100.0, 50.0, 2.0
    angle = np.linspace(0.0, 2 * np.pi, 73)
    positions, velocity = np.zeros((2, 73, 5))
    positions[:, X], positions[:, DMU50.index("Y")] = radius * np.cos(angle), radius * np.sin(angle)
    velocity[:, X], velocity[:, DMU50.index("Y")] = -feed * np.sin(angle), feed * np.cos(angle)
    found = deviation_of(ServoMismatch("X", "Y", lag), DMU50, State(positions, velocity=velocity)).position
    radial = found[:, 0] * np.cos(angle) + found[:, 1] * np.sin(angle)
    assert radial == pytest.approx(feed * lag * 1e-3 / 2 * np.sin(2 * angle), abs=1e-9)
