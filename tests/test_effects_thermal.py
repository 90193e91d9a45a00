"""Drift and growth against their differential equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from support.effect_examples import deviation_of

import machines
from kinematics.effects import (
    DistortionWithSensor,
    DistortionWithTime,
    DriftWithDuty,
    DriftWithSensor,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    QuadraticGrowth,
    ThermalDrift,
    WorkpieceDrift,
)
from kinematics.effects.combined.when import lagged
from kinematics.state import State

GANTRY = machines.load("gantry")
HOUR = 3600.0


def standing(n: int, x: float = 0.0, **columns) -> State:
    """The gantry standing at X = x."""
    return State(np.tile([x, 0.0, 0.0], (n, 1)), **columns)


def test_drift_with_time_is_linear_and_exponential():
    time = np.array([0.0, 1800.0, HOUR, 1e7])
    drift = ThermalDrift(component="Z", rate=-25.0)
    assert deviation_of(drift, GANTRY, standing(4, time=time)).position[:3, 2] == pytest.approx([0, -12.5e-3, -25e-3])
    slow = ThermalDrift(component="X", amplitudes=(10.0, -4.0), time_constants_s=(1800.0, HOUR))
    found = deviation_of(slow, GANTRY, standing(4, time=time)).position[:, 0]
    expected = [10 * (1 - np.exp(-t / 1800)) - 4 * (1 - np.exp(-t / HOUR)) for t in time]
    assert found == pytest.approx(np.array(expected) * 1e-3, abs=1e-12)
    assert found[-1] == pytest.approx(6e-3)


def test_drift_is_in_the_directions_of_the_tool():
    """A spindle that has grown by 20 um, lying along x: the fork head at C = 0, B = 90 deg points to -x."""
    machine, q = machines.load("head_head"), np.zeros((1, 5))
    q[:, machine.index("B")] = np.pi / 2
    state = State(q, time=np.array([HOUR]))
    found = deviation_of(ThermalDrift(component="Z", rate=-20.0), machine, state, (0.0, 0.0, -80.0))
    assert found.position == pytest.approx(np.array([[-20e-3, 0.0, 0.0]]), abs=1e-12)
    assert found.orientation == pytest.approx(np.zeros((1, 3)), abs=1e-15)


@pytest.mark.parametrize("name", ["dmu50", "head_head", "gantry"])
@pytest.mark.parametrize("component", "XYZ")
def test_drift_of_the_workpiece_is_in_its_own_directions_wherever_the_axes_stand(name, component):
    """By the exact matrix product, in the workpiece frame."""
    machine, rng = machines.load(name), np.random.default_rng(3)
    travel = np.where(machine.rotary, np.clip(machine.travel, -np.pi, np.pi), machine.travel)
    state = State(rng.uniform(*travel, (9, len(machine.axes))), time=np.linspace(0.0, 2 * HOUR, 9))
    found = deviation_of(WorkpieceDrift(component=component, rate=-20.0), machine, state, (30.0, 0.0, -80.0))
    expected = np.outer(np.linspace(0.0, -40e-3, 9), np.eye(3)["XYZ".index(component)])
    assert found.position == pytest.approx(expected, abs=1e-10)
    assert found.orientation == pytest.approx(np.zeros((9, 3)), abs=1e-15)


def test_a_tool_that_tilts_does_so_about_its_reference_point():
    state = standing(1, time=np.array([HOUR]))
    found = deviation_of(ThermalDrift(component="B", rate=30.0), GANTRY, state, (0.0, 0.0, -200.0))
    assert found.position == pytest.approx(np.array([[-200 * 30e-6, 0.0, 0.0]]), abs=1e-6)
    assert found.orientation == pytest.approx(np.array([[0.0, 30e-6, 0.0]]), abs=1e-15)


def test_growth_leaves_its_fixed_point_and_goes_too_far_forward_of_it():
    x = np.array([500.0, 1500.0, 0.0])
    state = State(np.column_stack([x, 0 * x, 0 * x]), time=np.full(3, 2 * HOUR))
    found = deviation_of(GrowthWithTime(axis="X", rate=12.0, fixed_point=500.0), GANTRY, state).position
    assert found[:, 0] == pytest.approx([0.0, 24e-3, -12e-3], abs=1e-12)
    assert found[:, 1:] == pytest.approx(np.zeros((3, 2)), abs=1e-12)


def test_growth_with_a_temperature_counts_from_20_degrees():
    """A steel scale, 11.5 um/m/K, 3 K too warm, 2 m from its fixed point."""
    state = standing(2, 2000.0, temperatures={"column": np.array([0.0, 3.0])})
    steel = GrowthWithSensor(axis="X", sensor="column", coefficient=11.5)
    assert deviation_of(steel, GANTRY, state).position[:, 0] == pytest.approx([0.0, 69e-3], abs=1e-12)
    spindle = DriftWithSensor(component="Z", sensor="column", coefficient=-6.0)
    assert deviation_of(spindle, GANTRY, state).position[:, 2] == pytest.approx([0.0, -18e-3], abs=1e-12)


def test_growth_with_the_square_of_a_temperature():
    state = standing(3, 2000.0, temperatures={"column": np.array([0.0, 2.0, -2.0])})
    growth = QuadraticGrowth(axis="X", sensor="column", coefficient=10.0, quadratic=1.5, fixed_point=1000.0)
    found = deviation_of(growth, GANTRY, state).position[:, 0] * 1e3
    assert found == pytest.approx([0.0, 20.0 + 6.0, -20.0 + 6.0])


def test_duty_warms_a_screw_that_cools_at_rest():
    """d growth/dt = coefficient x speed - growth / tau, integrated in small steps."""
    tau, growth = 900.0, 0.5
    time = np.array([0.0, 60.0, 120.0, 300.0, 900.0, 905.0, 2000.0])
    x = np.array([500.0, 4500.0, 500.0, 500.0, 4000.0, 1000.0, 1000.0])
    state = State(np.column_stack([x, 0 * x, 0 * x]), time=time)
    found = deviation_of(GrowthWithDuty("X", growth, tau), GANTRY, state).position[:, 0]
    speed = np.abs(np.diff(x)) * 1e-3 / np.diff(time)
    scale, expected = 0.0, [0.0]
    for v, start, end in zip(speed, time[:-1], time[1:], strict=True):
        steps = 20_000
        for _ in range(steps):
            scale += (end - start) / steps * (growth * v - scale / tau)
        expected.append(scale)
    assert found == pytest.approx(np.array(expected) * x * 1e-6, rel=1e-4, abs=1e-9)


def test_a_spindle_grows_while_it_turns_and_shrinks_at_rest():
    """d drift/dt = (growth x speed - drift) / tau: 8000 rpm for 1.5 tau, a rest of tau, 12,000 rpm for 0.1 tau."""
    tau = 900.0
    state = standing(4, time=np.array([100.0, 1450.0, 2350.0, 2440.0]), spindle_speed=np.array([5e3, 8e3, 0.0, 12e3]))
    found = deviation_of(DriftWithDuty("Z", -3.0, tau), GANTRY, state).position[:, 2] * 1e3
    hot = -24.0 * (1 - np.exp(-1.5))
    cold = hot * np.exp(-1.0)
    assert found == pytest.approx([0.0, hot, cold, -36.0 + (36.0 + cold) * np.exp(-0.1)])


def test_rows_of_one_moment_add_no_duty():
    state = State(np.array([[0.0, 0, 0], [900.0, 0, 0]]), time=np.zeros(2))
    assert not deviation_of(GrowthWithDuty("X", 0.5, 900.0), GANTRY, state).position.any()


def test_a_squareness_that_changes_is_a_turn_of_the_line_about_the_middle_of_the_axis():
    x = np.array([0.0, 2500.0, 5000.0])
    state = State(np.column_stack([x, 0 * x, 0 * x]), time=np.full(3, HOUR), temperatures={"hall": np.full(3, 2.0)})
    lean = DistortionWithTime(component="Y", axis="X", interval=(0.0, 5000.0), degree=1, rate=25.0)
    found = deviation_of(lean, GANTRY, state)
    assert found.position[:, 1] == pytest.approx([-25e-3, 0.0, 25e-3])
    assert found.orientation == pytest.approx(np.zeros((3, 3)), abs=1e-15)
    bow = DistortionWithSensor(
        component="Z", axis="X", interval=(0.0, 5000.0), degree=2, sensor="hall", coefficient=5.0
    )
    assert deviation_of(bow, GANTRY, state).position[:, 2] == pytest.approx([10e-3, -5e-3, 10e-3])


# --- the lag


def test_the_lag_answers_a_step_as_a_first_order_filter():
    """A jump is two rows of the same time."""
    time = np.array([-100.0, 0.0, 0.0, 300.0, 301.0, 900.0, 4500.0])
    late, _ = lagged(np.where(np.arange(7) < 2, 0.0, 5.0), time, 900.0)
    assert late == pytest.approx([0.0, 0.0, *5.0 * (1 - np.exp(-time[2:] / 900.0))], abs=1e-12)


def test_the_lag_answers_a_ramp_as_a_first_order_filter():
    time = np.array([0.0, 10.0, 500.0, 2000.0])
    late, _ = lagged(2.0 + 1e-3 * time, time, 700.0)
    assert late == pytest.approx(2.0 + 1e-3 * (time - 700.0 * (1 - np.exp(-time / 700.0))), abs=1e-12)


def test_the_lag_solves_its_differential_equation_between_any_rows():
    rng = np.random.default_rng(4)
    time, temperature = np.cumsum(rng.uniform(5.0, 900.0, 12)), rng.normal(2.0, 3.0, 12)
    solution = solve_ivp(
        lambda t, y: (np.interp(t, time, temperature) - y) / 400.0,
        (time[0], time[-1]), temperature[:1], t_eval=time, max_step=5.0, rtol=1e-9, atol=1e-9,
    )  # fmt: skip
    assert lagged(temperature, time, 400.0)[0] == pytest.approx(solution.y[0], abs=1e-5)


@given(st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6), st.floats(1e-3, 1e5))
def test_rows_between_change_nothing(shares, lag):
    """A log that is read more often on the same straight pieces gives the same temperatures."""
    time, temperature = np.array([0.0, 600.0, 601.0, 4000.0]), np.array([1.0, 4.0, -2.0, 0.0])
    between = np.array(sorted(shares)) * 600.0
    often = np.concatenate([time[:1], between, time[1:]])
    late, slope = lagged(np.interp(often, time, temperature), often, lag)
    expected = lagged(temperature, time, lag)
    kept = np.r_[0, len(between) + 1 : len(often)]
    assert late[kept] == pytest.approx(expected[0], abs=1e-9)
    assert slope[kept] == pytest.approx(expected[1], rel=1e-6, abs=1e-9)


def test_the_lag_has_a_limit_at_zero():
    time, temperature = np.array([0.0, 100.0, 250.0, 250.0]), np.array([1.0, 3.0, 0.0, 7.0])
    late, slope = lagged(temperature, time, 0.0)
    assert (late == temperature).all()
    assert slope == pytest.approx([0.0, -2.0 / 100.0, 3.0 / 150.0, 0.0])
    short = lagged(temperature[:3], time[:3], 1e-3)
    assert short[0] == pytest.approx(late[:3], abs=1e-4)
    assert short[1] == pytest.approx(slope[:3], abs=1e-6)


def test_a_lag_makes_warming_and_cooling_differ():
    time = np.linspace(0.0, 4 * HOUR, 200)
    warm = 5.0 * np.sin(np.pi * time / time[-1]) ** 2
    state = standing(200, 1000.0, time=time, temperatures={"column": warm})
    growth = GrowthWithSensor(axis="X", sensor="column", coefficient=10.0, lag_s=1200.0)
    found = deviation_of(growth, GANTRY, state).position[:, 0]
    assert (found[1:100] < found[-2:99:-1]).all()
    assert deviation_of(growth, GANTRY, state.rows(slice(0, 0))).position.shape == (0, 3)


def test_time_that_runs_back_does_not_warm_the_past():
    late, _ = lagged(np.array([0.0, 5.0, 5.0]), np.array([0.0, -100.0, 800.0]), 400.0)
    assert late == pytest.approx([0.0, 0.0, 5.0 * (1 - np.exp(-900.0 / 400.0))])
