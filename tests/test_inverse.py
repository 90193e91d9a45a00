"""Inverse kinematics: the thesis' formulas, round trips on every five-axis machine, the pole, damped Newton."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.tiers import quick

import machines
from kinematics.forward import forward
from kinematics.inverse import damped_newton, inverse, linear_positions
from kinematics.user_error import UserError

FIVE_AXIS = ["dmu50", "trunnion_bc", "trunnion_ac", "head_head", "head_table"]
TWO_PI = 2 * math.pi

REDUNDANT = {
    "three rotary": ("w C A b X Y Z B t", {"C": (-400, 400), "A": (-60, 30), "B": (-100, 100)}),
    "parallel rotary": ("w A b X Y Z A2 t", {"A": (-90, 90), "A2": (-90, 90)}),
    "about the tool": ("w B b X Y Z C t", {"B": (-100, 100), "C": (-180, 180)}),
}


def chain(text, rotary, extra=""):
    """A machine of the given chain, rotary axes 100 mm off the origin, linear axes +-2000 mm."""
    lines = ['name = "test"', f'chain = "{text}"']
    for name in set(text.split()) - set("wbt"):
        travel = rotary.get(name, (-2000, 2000))
        point = "\npoint = [10, -20, 100]" if name in rotary else ""
        lines.append(f"[axes.{name}]\ntravel = [{travel[0]}, {travel[1]}]{point}")
    return machines.parse("\n".join(lines) + extra, "test")


def random_positions(machine, n, seed, turns=1.0):
    """Positions inside travel, unlimited axes within some turns."""
    low, high = np.clip(machine.travel, -turns * TWO_PI, turns * TWO_PI)
    travel = np.where(machine.rotary, [low, high], machine.travel)
    return np.random.default_rng(seed).uniform(*travel, (n, len(machine.axes)))


def smooth_path(machine, n, turns):
    """A path inside travel on which unlimited axes go round several times; rotary axes keep off the pole."""
    t = np.linspace(0.0, 1.0, n)[:, None]
    low, high = np.where(np.isfinite(machine.travel), machine.travel, [[0.0], [turns * TWO_PI]])
    share = 0.1 + 0.35 * t + 0.04 * np.sin(6 * t + np.arange(len(machine.axes)))
    share[:, ~machine.rotary] += 0.2
    return low + share * (high - low)


def pose_of(machine, q, tool):
    pose = forward(machine, q)
    return pose.apply(tool), pose.rotation[:, :, 2]


def assert_pose(machine, q, tool, position, axis, mm=1e-9, rad=1e-12):
    point, direction = pose_of(machine, q, tool)
    assert np.abs(point - position).max() < mm
    assert np.linalg.norm(direction - axis, axis=1).max() < rad


def thesis_inverse(position, axis, d=154.996):
    """Thesis (3.25)-(3.29), B in 0..180 deg; errata: C = atan2(first bracket, second bracket)."""
    (x, y, z), (i, j, k) = position.T, axis.T
    root = np.sqrt(2 * (k - k**2))
    B = np.arccos(2 * k - 1)
    C = np.arctan2((1 - k) * i + root * j, root * i + (k - 1) * j)
    cC, sC = np.cos(C), np.sin(C)
    X = (-y * root - x + 2 * x * k) * cC + (x * root + 2 * y * k - y) * sC + (d - z) * root
    Y = (x * root + y * k) * cC + (y * root - x * k) * sC - z + d - d * k + z * k
    Z = (x * root + y * k - y) * cC + (y * root - x * k + x) * sC + d - d * k + z * k
    return np.stack([C % TWO_PI, B, X, Y, Z], axis=1)


def test_the_dmu50_equals_the_thesis_on_random_poses():
    machine = machines.load("dmu50")
    q = random_positions(machine, 10_000, seed=1)
    q[:, 1] = np.radians(np.random.default_rng(2).uniform(1.0, 179.0, len(q)))  # the thesis' arc cosine fails beyond
    position, axis = pose_of(machine, q, np.zeros(3))
    found = inverse(machine, position, axis)
    gap = found.q - thesis_inverse(position, axis)
    gap[:, 0] = (gap[:, 0] + math.pi) % TWO_PI - math.pi
    assert found.reachable.all()
    assert not found.singular.any()
    assert np.abs(gap[:, 2:]).max() < 1e-9
    assert np.abs(gap[:, :2]).max() < 1e-12
    assert_pose(machine, found.q, np.zeros(3), position, axis)


@pytest.mark.parametrize("name", FIVE_AXIS)
def test_forward_of_inverse_is_the_pose(name):
    machine = machines.load(name)
    q = random_positions(machine, 5_000, seed=3)
    tool = np.random.default_rng(4).uniform(-200, 200, (len(q), 3))
    position, axis = pose_of(machine, q, tool)
    found = inverse(machine, position, axis, tool)
    assert found.reachable.all()
    assert np.all((found.q >= machine.travel[0]) & (found.q <= machine.travel[1]))
    assert_pose(machine, found.q, tool, position, axis)


@pytest.mark.parametrize("name", quick(FIVE_AXIS, ["dmu50", "head_table"]))
def test_poses_at_the_ends_of_travel_are_reachable(name):
    machine = machines.load(name)

    @settings(max_examples=150, deadline=None)
    @given(st.lists(st.sampled_from([0, 50, 100]) | st.integers(0, 100), min_size=5, max_size=5))
    @example([0] * 5)
    @example([100] * 5)
    def check(percent):
        low, high = np.clip(machine.travel, -4000.0, 4000.0)
        q = np.clip(low + np.array(percent) / 100 * (high - low), *machine.travel)[None]
        position, axis = pose_of(machine, q, (5.0, 0.0, -100.0))
        found = inverse(machine, position, axis, (5.0, 0.0, -100.0), start=q[0])
        assert found.reachable[0]
        assert_pose(machine, found.q, (5.0, 0.0, -100.0), position, axis, mm=2e-9, rad=2e-9)

    check()


@pytest.mark.parametrize("name", FIVE_AXIS)
def test_a_smooth_path_comes_back_without_jumps_or_lost_turns(name):
    machine = machines.load(name)
    q = smooth_path(machine, 2_000, turns=20)
    tool = np.array([3.0, -4.0, -150.0])
    position, axis = pose_of(machine, q, tool)
    near = q[0] + 0.05
    found = inverse(machine, position, axis, tool, start=near)
    assert found.reachable.all()
    assert np.abs(found.q - q).max() < 1e-9
    unlimited = np.isinf(machine.travel[0])
    assert np.all(np.ptp(found.q[:, unlimited], axis=0) > 4 * TWO_PI)


def test_an_unlimited_axis_passes_full_turns_and_a_limited_one_goes_back():
    C = np.radians(np.arange(0.0, 1500.0, 10.0))
    for name, turns in (("trunnion_bc", True), ("dmu50", False)):
        machine = machines.load(name)
        q = np.column_stack([C, np.full_like(C, 0.5), np.zeros((len(C), 2)), np.full_like(C, 150.0)])
        found = inverse(machine, *pose_of(machine, q, np.zeros(3)), start=q[0])
        assert found.reachable.all()
        expected = C if turns else C % TWO_PI
        gap = found.q[:, 0] - expected
        assert np.abs(gap - TWO_PI * np.round(gap / TWO_PI)).max() < 1e-12
        assert (np.abs(np.diff(found.q[:, 0])).max() < 0.2) == turns


def test_travel_wins_over_nearness_and_can_be_waived():
    machine = machines.load("trunnion_ac")  # A from -120 to +30 deg
    position, axis = pose_of(machine, np.array([[0.0, np.radians(-60.0), 0.0, 0.0, 200.0]]), np.zeros(3))
    start = np.array([math.pi, np.radians(60.0), 0.0, 0.0, 200.0])  # the other branch, outside travel
    found = inverse(machine, position, axis, start=start)
    assert found.reachable[0]
    assert found.q[0, 1] == pytest.approx(np.radians(-60.0), abs=1e-12)
    waived = inverse(machine, position, axis, start=start, respect_travel=False)
    assert waived.reachable[0]
    assert waived.q[0, :2] == pytest.approx(start[:2], abs=1e-12)
    assert_pose(machine, waived.q, np.zeros(3), position, axis)


def test_a_branch_whose_linear_axes_fit_wins_over_a_nearer_one():
    machine = chain("w C B b X Y Z t", {"C": (-360, 360), "B": (-110, 110)})
    tight = chain("w C B b X Y Z t", {"C": (-360, 360), "B": (-110, 110), "X": (0, 2000)})
    q = np.array([[0.2, 0.7, 500.0, 0.0, 0.0]])
    position, axis = pose_of(machine, q, np.zeros(3))
    other = np.array([0.2 + math.pi, -0.7, 0.0, 0.0, 0.0])
    free = inverse(machine, position, axis, start=other)
    assert free.q[0, :2] == pytest.approx(other[:2], abs=1e-12)
    assert free.q[0, 2] < 0.0
    assert inverse(tight, position, axis, start=np.abs(other)).q[0] == pytest.approx(q[0], abs=1e-9)


def test_a_pose_outside_travel_is_told_with_the_positions_it_would_take():
    machine = machines.load("dmu50")
    q = np.array([[1.0, 0.5, 0.0, 0.0, 100.0], [1.0, 0.5, 262.0, 0.0, 100.0], [1.1, 0.5, 0.0, 0.0, 100.0]])
    found = inverse(machine, *pose_of(machine, q, np.zeros(3)))
    assert found.reachable.tolist() == [True, False, True]
    assert np.abs(found.q - q).max() < 1e-9


def test_a_direction_beyond_the_farthest_tilt_has_no_solution_and_does_not_stop_the_next():
    machine = machines.load("dmu50")
    q = np.array([[1.0, 0.5, 0.0, 0.0, 100.0]] * 5)
    position, axis = (part.copy() for part in pose_of(machine, q, np.zeros(3)))
    axis[1], axis[2] = (0.6, 0.0, -0.8), (0.0, 0.0, 0.0)
    position[3, 0] = np.nan
    found = inverse(machine, position, axis)
    assert found.reachable.tolist() == [True, False, False, False, True]
    assert np.isnan(found.q[1:3]).all()
    assert np.abs(found.q[[0, 4]] - q[[0, 4]]).max() < 1e-9


def test_the_tool_axis_may_have_any_length_and_one_row_may_serve_all():
    machine = machines.load("dmu50")
    q = random_positions(machine, 20, seed=5)
    q[:, :2] = 1.0, 0.8
    position, axis = pose_of(machine, q, np.zeros(3))
    found = inverse(machine, position, 7.0 * axis[:1], start=q[0])
    assert found.reachable.all()
    assert np.abs(found.q - q).max() < 1e-9


def test_no_poses_give_no_rows():
    for name in ("cframe", "dmu50"):
        assert inverse(machines.load(name), np.empty((0, 3)), np.empty((0, 3))).q.shape[0] == 0


def test_at_the_pole_the_first_rotary_axis_stays():
    machine = machines.load("dmu50")
    q = np.array([[1.0, 0.5, 0.0, 0.0, 100.0], [1.0, 0.0, 10.0, 0.0, 100.0], [2.5, 0.0, 0.0, 20.0, 100.0]])
    position, axis = pose_of(machine, q, np.zeros(3))
    found = inverse(machine, position, axis)
    assert found.singular.tolist() == [False, True, True]
    assert found.reachable.all()
    assert found.q[:, 0] == pytest.approx([1.0, 1.0, 1.0], abs=1e-12)
    assert found.q[1:, 1].tolist() == [0.0, 0.0]
    assert_pose(machine, found.q, np.zeros(3), position, axis)
    first = inverse(machine, position[1:], axis[1:], start=[4.0, 0.3, 0.0, 0.0, 0.0])
    assert first.q[:, 0].tolist() == [4.0, 4.0]


@pytest.mark.parametrize("name", ["dmu50", "trunnion_bc", "head_head", "head_table"])
def test_towards_the_pole_the_pose_stays_exact(name):
    machine = machines.load(name)
    B = np.concatenate([np.geomspace(1e-2, 1e-9, 400), np.geomspace(1e-9, 1e-15, 100), [0.0]])
    C = np.linspace(0.5, 2.0, len(B))
    q = np.tile(machine.travel.mean(axis=0), (len(B), 1)) if name == "dmu50" else np.zeros((len(B), 5))
    q[:, machine.index("C")], q[:, machine.index("B")] = C, B
    q[:, machine.index("X")] = q[:, machine.index("Y")] = q[:, machine.index("Z")] = 50.0
    position, axis = pose_of(machine, q, (0.0, 0.0, -80.0))
    found = inverse(machine, position, axis, (0.0, 0.0, -80.0), start=q[0])
    assert found.reachable.all()
    assert found.singular[-1]
    assert not found.singular[:400].any()
    assert_pose(machine, found.q, (0.0, 0.0, -80.0), position, axis)
    assert np.abs(found.q[:400] - q[:400]).max() < 1e-4  # C itself is known to rounding over B, 1e-16 / 1e-9


def test_a_three_axis_machine_only_takes_an_upright_tool():
    machine = machines.load("cframe")
    found = inverse(machine, [[10.0, 20.0, 30.0]] * 2, [[0.0, 0.0, 1.0], [0.0, 0.1, 1.0]], (0.0, 0.0, -50.0))
    assert found.reachable.tolist() == [True, False]
    assert found.q[0].tolist() == [10.0, 20.0, 80.0]
    assert np.isnan(found.q[1]).all()


def test_one_rotary_axis_takes_the_directions_on_its_cone():
    machine = chain("w A b X Y Z t", {"A": (-200, 200)})
    q = random_positions(machine, 500, seed=6)
    tool = np.array([1.0, 2.0, -90.0])
    position, axis = pose_of(machine, q, tool)
    found = inverse(machine, position, axis, tool)
    assert found.reachable.all()
    assert_pose(machine, found.q, tool, position, axis)
    assert not inverse(machine, position[:1], axis[:1] + np.array([0.1, 0.0, 0.0])).reachable[0]


def test_a_table_that_turns_about_the_upright_tool_stays():
    machine = chain("w C b X Y Z t", {"C": (-400, 400)})
    found = inverse(machine, [[10.0, 20.0, 30.0]], [[0.0, 0.0, 1.0]], start=[1.0, 0.0, 0.0, 0.0])
    assert found.singular[0]
    assert found.q[0, 0] == 1.0
    assert_pose(machine, found.q, np.zeros(3), [[10.0, 20.0, 30.0]], [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("name", FIVE_AXIS)
def test_damped_newton_finds_the_closed_form(name):
    machine = machines.load(name)
    q = smooth_path(machine, 40, turns=2)
    position, axis = pose_of(machine, q, (0.0, 0.0, -100.0))
    searched = damped_newton(machine, position, axis, (0.0, 0.0, -100.0), start=q[0])
    solved = inverse(machine, position, axis, (0.0, 0.0, -100.0), start=q[0])
    assert searched.reachable.all()
    assert np.abs(searched.q - solved.q).max() < 1e-9
    assert_pose(machine, searched.q, (0.0, 0.0, -100.0), position, axis, mm=1e-10)


@pytest.mark.parametrize("kind", sorted(REDUNDANT))
def test_other_chains_are_searched(kind):
    machine = chain(*REDUNDANT[kind])
    q = random_positions(machine, 60, seed=7)
    q[:, ~machine.rotary] *= 0.2
    tool = np.array([5.0, 0.0, -120.0])
    position, axis = pose_of(machine, q, tool)
    found = inverse(machine, position, axis, tool)
    assert found.reachable.all()
    assert np.all((found.q >= machine.travel[0]) & (found.q <= machine.travel[1]))
    assert_pose(machine, found.q, tool, position, axis, mm=1e-10)


def test_damped_newton_tells_what_is_outside_travel_and_what_is_nowhere():
    machine = chain(*REDUNDANT["parallel rotary"])
    position, axis = [[0.0, 0.0, 0.0], [5000.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[0, 0.6, 0.8], [0, 0.6, 0.8], [1, 0, 0]]
    found = inverse(machine, position, axis)
    assert found.reachable.tolist() == [True, False, False]
    assert_pose(machine, found.q[:2], np.zeros(3), np.array(position[:2]), np.array(axis[:2]))
    assert np.isnan(found.q[2]).all()


def test_damped_newton_unwinds_a_limited_axis():
    machine = machines.load("dmu50")
    q = np.column_stack([np.radians([350.0, 358.0, 6.0, 14.0]), np.tile([0.5, 0.0, 0.0, 150.0], (4, 1))])
    position, axis = pose_of(machine, q, np.zeros(3))
    found = damped_newton(machine, position, axis, start=q[0])
    assert found.reachable.all()
    assert np.abs(found.q - q).max() < 1e-9


@pytest.mark.parametrize(
    ("text", "rotary"),
    [
        ("w X C b Y Z B t", {"C": (-80, 80), "B": (-80, 80)}),
        ("w X Y C B b Z t", {"C": (-80, 80), "B": (-60, 60)}),
        ("w b C X B Y A Z t", {"C": (-50, 50), "B": (-50, 50), "A": (-50, 50)}),
        ("w C B b X Y Z W t", {"C": (-360, 360), "B": (-110, 110)}),
        ("w X Y b Z t", {}),
    ],
)
def test_linear_positions_of_any_chain(text, rotary):
    machine = chain(text, rotary)
    q = random_positions(machine, 1_000, seed=8)
    tool = np.random.default_rng(9).uniform(-200, 200, (len(q), 3))
    position, _ = pose_of(machine, q, tool)
    astray = q.copy()
    astray[:, machine.translators] = 17.0
    found = linear_positions(machine, astray, position, tool)
    assert np.abs(forward(machine, found).apply(tool) - position).max() < 1e-9
    assert np.abs(found - q).max() < 1e-8
    assert np.all(astray[:, machine.translators] == 17.0)


@pytest.mark.parametrize("name", machines.names())
def test_linear_positions_of_every_shipped_machine(name):
    machine = machines.load(name)
    q = random_positions(machine, 1_000, seed=10)
    position, _ = pose_of(machine, q, (1.0, 2.0, -90.0))
    assert np.abs(linear_positions(machine, q, position, (1.0, 2.0, -90.0)) - q).max() < 1e-9


def test_linear_axes_turned_parallel_can_not_place_the_tool():
    machine = chain("w X C b Y Z B t", {"C": (-180, 180), "B": (-80, 80)})
    q = np.zeros((2, 5))
    q[1, machine.index("C")] = math.pi / 2  # X lies along Y
    found = linear_positions(machine, q, [10.0, 20.0, 30.0])
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1, machine.translators]).all()
    position, axis = pose_of(machine, np.array([[0.0, math.pi / 2, 0.0, 0.0, 0.3]]), np.zeros(3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not inverse(machine, position, axis).reachable[0]


def test_a_redundant_linear_axis_stays_at_the_start():
    machine = chain("w C B b X Y Z W t", {"C": (-360, 360), "B": (-110, 110)})
    start = np.zeros(6)
    start[machine.index("W")] = 55.0
    found = inverse(machine, [[10.0, 20.0, 30.0]] * 2, [[0.3, 0.1, 1.0]] * 2, start=start)
    assert found.q[:, machine.index("W")].tolist() == [55.0, 55.0]


def test_a_machine_that_can_not_place_a_tool_is_refused():
    machine = chain("w C B b X Y t", {"C": (-360, 360), "B": (-110, 110)})
    with pytest.raises(UserError, match="do not span space"):
        inverse(machine, [[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("name", FIVE_AXIS)
@pytest.mark.parametrize("path", ["smooth", "random", "repeated", "across the pole"])
def test_rows_together_are_the_rows_one_after_the_other(name, path):
    machine, n, rng = machines.load(name), 120, np.random.default_rng(5)
    t = np.linspace(0.0, 25.0, n)
    tilt = 0.3 * np.sin(t)
    axes = {
        "smooth": np.stack([np.sin(0.3) * np.cos(t), np.sin(0.3) * np.sin(t), np.full(n, np.cos(0.3))], axis=1),
        "random": rng.normal(size=(n, 3)) * [1.0, 1.0, 0.3] + [0.0, 0.0, 1.0],
        "repeated": np.repeat(np.round(rng.normal([0.0, 0.0, 2.0], 1.0, (n // 10, 3)), 1), 10, axis=0),
        "across the pole": np.stack([np.zeros(n), np.sin(tilt), np.cos(tilt)], axis=1),
    }[path]
    axes[: n // 4] = [0.0, 0.0, 1.0]
    points = np.stack([400 * np.sin(t), 50 * np.cos(t), np.full(n, 100.0)], axis=1)
    together = inverse(machine, points, axes, (0.0, 0.0, -120.0))
    start, rows = np.clip(0.0, *machine.travel), []
    for point, axis in zip(points, axes, strict=True):
        rows.append(inverse(machine, point, axis, (0.0, 0.0, -120.0), start=start))
        start = rows[-1].q[0] if np.isfinite(rows[-1].q).all() else start
    for part, of in (("q", together.q), ("reachable", together.reachable), ("singular", together.singular)):
        np.testing.assert_array_equal(of, np.concatenate([getattr(row, part) for row in rows]))
