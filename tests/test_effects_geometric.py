"""Racking, wobble and cross terms against the exact kinematics."""

import numpy as np
import pytest
from numpy.polynomial import legendre
from support.effect_examples import BACKWARD, deviation_of

import machines
from kinematics.basis import BSpline, Polynomial
from kinematics.effects import CrossAxis, LocationError, LocationJump, Racking, Scale, Wobble
from kinematics.forward import forward, tool_point
from kinematics.state import State
from kinematics.transforms import turn

LEAD = 50.0
CONSTANT = Polynomial((0.0, 1.0), 0)


@pytest.mark.parametrize("first", [0.0, -150.0])
def test_racking_displaces_a_gantry_in_proportion_to_the_distance_from_its_first_side(first):
    gantry, y = machines.load("gantry"), np.array([0.0, 1000.0, 3000.0])
    state = State(np.column_stack([np.full(3, 2500.0), y, np.full(3, 700.0)]))
    tool = np.array([80.0, -40.0, -120.0])
    found = deviation_of(Racking("X", "Y", 3000.0, CONSTANT, (LEAD,), first), gantry, state, tool)
    angle = LEAD * 1e-3 / 3000.0
    assert found.position[:, 0] == pytest.approx(angle * (y + tool[1] - first), abs=1e-6)  # second order
    assert found.position[:, 1] == pytest.approx([-angle * tool[0]] * 3, abs=1e-6)
    assert found.position[:, 2] == pytest.approx([0.0] * 3, abs=1e-15)
    assert found.orientation == pytest.approx(np.array([[0, 0, -angle]] * 3), abs=1e-12)


def test_racking_goes_forward_on_an_axis_against_its_letter_whatever_its_carriage_point():
    """X runs to -x, its carriage point lies at y = 120; Y carries the workpiece to +y, so the tool goes to -y of it."""
    state = State(np.zeros((3, 5)))
    state.positions[:, BACKWARD.index("X")] = 300.0
    tool = np.column_stack([np.zeros(3), -np.array([0.0, 120.0, 400.0]), np.zeros(3)])
    found = deviation_of(Racking("X", "Y", 400.0, CONSTANT, (LEAD,)), BACKWARD, state, tool)
    assert found.position[:, 0] == pytest.approx([0.0, -LEAD * 1e-3 * 0.3, -LEAD * 1e-3], abs=1e-5)


def test_the_lead_of_a_gantry_is_a_function_of_its_position():
    gantry = machines.load("gantry")
    state = State(np.array([[0.0, 3000.0, 0.0], [2500.0, 3000.0, 0.0], [5000.0, 3000.0, 0.0]]))
    found = deviation_of(Racking("X", "Y", 3000.0, BSpline((0.0, 5000.0), 1), (0.0, LEAD)), gantry, state)
    assert found.position[:, 0] == pytest.approx([0.0, 0.025, 0.05], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "axis", "first", "second"),
    [("trunnion_ac", "A", 1, 2), ("trunnion_bc", "B", 2, 0), ("head_head", "C", 0, 1)],
)
@pytest.mark.parametrize("sense", [1, -1])
def test_a_wobble_runs_from_the_first_direction_to_the_second(name, axis, first, second, sense):
    """Y Z of A, Z X of B, X Y of C: an outer axis, so that the bed's directions are the machine's at zero pose."""
    machine = machines.load(name)
    q = np.zeros((4, 5))
    q[:, machine.index(axis)] = np.radians([0, 45, 90, 180])
    expected = np.zeros((4, 3))
    expected[:, first], expected[:, second] = [1, 0, -1, 1], [0, sense, 0, 0]
    for motion, part in (("radial", "position"), ("tilt", "orientation")):
        effect = Wobble(axis, motion, 2, sense, 5.0, 0.0)
        values = np.zeros((4, 6))
        for _, component, contribution in effect.contributions(machine, State(q)):
            values[:, component] += contribution
        half, other, size = (slice(0, 3), slice(3, 6), 5e-3) if motion == "radial" else (slice(3, 6), slice(0, 3), 5e-6)
        assert values[:, half] == pytest.approx(size * expected, abs=1e-17)
        assert not values[:, other].any()
        assert np.linalg.norm(getattr(deviation_of(effect, machine, State(q)), part), axis=1) == pytest.approx(
            [size] * 4, rel=1e-6
        )


@pytest.mark.parametrize("axis", ["A", "B", "C"])
def test_the_sine_amplitude_is_the_cosine_amplitude_a_quarter_later(axis):
    machine = machines.load("trunnion_ac" if axis == "A" else "head_head")
    q = np.zeros((9, 5))
    q[:, machine.index(axis)] = np.linspace(-1.0, 1.0, 9)
    later = q.copy()
    later[:, machine.index(axis)] += np.pi / 2 / 3
    sine = Wobble(axis, "radial", 3, -1, 0.0, 4.0).contributions(machine, State(later))
    cosine = Wobble(axis, "radial", 3, -1, 4.0, 0.0).contributions(machine, State(q))
    for a, b in zip(sine, cosine, strict=True):
        assert a[:2] == b[:2]
        assert a[2] == pytest.approx(b[2], abs=1e-17)


def test_a_first_harmonic_that_turns_with_the_head_is_a_shift_of_the_tool():
    machine, q = machines.load("head_head"), np.zeros((7, 5))
    q[:, machine.index("C")], q[:, machine.index("B")] = 0.4, np.linspace(-1.5, 1.5, 7)
    found = deviation_of(Wobble("B", "radial", 1, 1, 3.0, -2.0), machine, State(q)).position
    in_tool = turn(forward(machine, q).rotation.swapaxes(1, 2), found)
    assert in_tool == pytest.approx(np.array([[2e-3, 0.0, 3e-3]] * 7), abs=1e-12)


@pytest.mark.parametrize(("machine", "sense"), [(machines.load("dmu50"), -1), (BACKWARD, 1)], ids=["dmu50", "backward"])
def test_a_first_harmonic_that_turns_with_the_table_is_a_shift_of_the_workpiece(machine, sense):
    """The other way round on a table whose C runs against its letter."""
    q = np.zeros((7, 5))
    q[:, machine.index("C")] = np.linspace(0.0, 3.0, 7)
    found = deviation_of(Wobble("C", "radial", 1, sense, 3.0, 0.0), machine, State(q)).position
    assert found == pytest.approx(np.array([[3e-3, 0.0, 0.0]] * 7), abs=1e-12)


@pytest.mark.parametrize("machine", [machines.load("gantry"), BACKWARD], ids=["gantry", "backward"])
def test_an_axis_with_a_large_scale_goes_farther_than_commanded(machine):
    q = np.zeros((3, len(machine.axes)))
    q[:, machine.index("X")] = [-200.0, 0.0, 300.0]
    commanded = tool_point(machine, State(q).positions, np.zeros(3))
    found = deviation_of(Scale("X", 50.0), machine, State(q)).position
    assert found == pytest.approx((commanded - commanded[1]) * 50e-6, abs=1e-9)


def test_a_cross_term_is_the_product_of_legendre_polynomials_and_holds_its_end_values():
    gantry = machines.load("gantry")
    effect = CrossAxis("Z", "Y", "X", (0.0, 3000.0), (0.0, 5000.0), 1, 2, (3.0, -1.0, 2.0, 0.5))
    x, y = np.array([0.0, 1200.0, 5000.0, 5000.0]), np.array([0.0, 2500.0, 100.0, 3000.0])
    ((_, _, found),) = effect.contributions(gantry, State(np.column_stack([x, y, 0 * x])))
    coefficients = np.array([[0.0, 3.0, 2.0], [0.0, -1.0, 0.5]])  # by degree in y, then in x
    assert found == pytest.approx(1e-3 * legendre.legval2d(y / 1500 - 1, x / 2500 - 1, coefficients), abs=1e-15)
    ((_, _, beyond),) = effect.contributions(gantry, State(np.array([[6000.0, 3500.0, 0.0]])))
    assert beyond == pytest.approx(found[3:], abs=1e-15)


@pytest.mark.parametrize(("component", "axis"), [("X", "X"), ("C", "Y"), ("Y", "C"), ("A", "C")])
def test_a_jump_is_a_location_error_from_its_moment_on_and_ever_after_in_a_calibration(component, axis):
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (6, 5)) * [1.0, 200.0, 200.0, 20.0, 200.0]
    state = State(q, time=np.arange(6) * 100.0)
    always = deviation_of(LocationError(component, axis, 40.0), BACKWARD, state).position
    assert np.abs(always).max() > 1e-3
    late = deviation_of(LocationJump(component, axis, 40.0, 300.0), BACKWARD, state).position
    assert late == pytest.approx(np.where((state.time >= 300.0)[:, None], always, 0.0))
    permanent = deviation_of(LocationJump(component, axis, 40.0), BACKWARD, State(q)).position
    assert permanent == pytest.approx(always)


@pytest.mark.parametrize(("component", "axis"), [("C", "Y"), ("B", "Z"), ("B", "X")])
def test_a_line_that_turns_about_a_position_of_its_axis_stays_there(component, axis):
    q = np.zeros((3, 5))
    q[:, BACKWARD.index(axis)] = [0.0, 120.0, 300.0]
    always = deviation_of(LocationJump(component, axis, 40.0), BACKWARD, State(q)).position
    found = deviation_of(LocationJump(component, axis, 40.0, None, 120.0), BACKWARD, State(q)).position
    assert found == pytest.approx(always - always[1], abs=1e-9)
    assert np.abs(always).max() > 1e-3
