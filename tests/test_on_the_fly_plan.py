"""Paths planned for on-the-fly calibration, what they would see, their programs, and virtual readings along them."""

import csv
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.on_the_fly_cases import FIXED, FIXED_TOML, ONE, diagonals, followed, path_of, polyline, program

import machines
from calibration.evaluation.volumetric import aligned, deviation_on
from calibration.fit.calibrate import calibrate
from calibration.fit.problem import Problem
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Target, with_moves
from calibration.observation.full_model import BasisChoice, with_effects
from calibration.on_the_fly.along_path import on_path
from calibration.on_the_fly.drive import PathDynamics, driven, duration
from calibration.on_the_fly.planning import path_search as planner
from calibration.on_the_fly.planning.noise_gain import LARGEST_CELL_MM, PRIOR, Volume
from calibration.on_the_fly.planning.path_search import best_path
from calibration.on_the_fly.planning.predicted_fit import evaluated_path
from calibration.planning.strategies import plan
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.dialects import find_dialect
from postproc.program_path import program_path
from postproc.text.source import open_source

TOOL = ONE["t"].position


def volume():
    return Volume(FIXED, FIXED.travel, ONE, 4.0, 5.0)


def information(volume, path):
    moves = zip(path.positions[:-1], path.positions[1:], path.feed_move[1:], strict=True)
    return sum(volume.information(a, b) for a, b, counts in moves if counts)


# ---- noise gain


def test_the_gain_is_what_many_fits_of_noise_show():
    """RMS over the volume of what fits make of pure noise, against the gain that was predicted."""
    path = polyline(2, 40)
    predicted = volume().noise_gain(information(volume(), path)).noise
    machine, draws, rng = FIXED, [], np.random.default_rng(0)
    readings, _ = followed(path, random_true_model(machine, rng, {}), rate=20.0)
    taken = on_path(readings, path).measurement
    nodes = {"X": BasisChoice("b-spline", 13), "Y": BasisChoice("b-spline", 13), "Z": BasisChoice("b-spline", 10)}
    model, prior = with_effects(taken, nodes, (), PRIOR / 30.0)
    registration = taken.instrument.first_registration(taken, np.ones(len(taken), bool))
    white = np.broadcast_to(1e3 * np.eye(2), (len(taken), 2, 2))
    problem = Problem(taken, model, white, taken.stops, prior)
    at = problem.point(np.array(model.parameters), registration)
    grid = np.random.default_rng(1).uniform(*machine.travel, (300, 3))
    for _ in range(6):
        noise = rng.normal(0.0, 1e-3, (len(taken), 2))
        moved = replace(
            taken, observed=taken.observed + np.einsum("nkx,nk->nx", taken.across.directions, noise - at.residual)
        )
        noisy = replace(problem, measurement=moved)
        solved = noisy.solve(noisy.point(at.parameters, registration), np.ones(len(taken)), 1.0)
        found = model.with_parameters(solved.step[6:])
        errors, points = deviation_on(machine, found, grid, TOOL)
        draws.append(np.mean((aligned(errors, points) * 1e3) ** 2))
    cells = sum(max(np.linalg.norm(b - a) - 10.0, 0.0) for a, b in pairwise(path.positions)) / 4.0
    assert np.sqrt(np.mean(draws) * len(taken) / cells) == pytest.approx(predicted, rel=0.2)


def test_the_diagonals_hide_one_direction_that_matters():
    noise_gain = volume().noise_gain(information(volume(), diagonals()))
    assert noise_gain.hidden == 1
    assert noise_gain.score > 10.0
    whole = volume().noise_gain(information(volume(), polyline(0, 40)))
    assert whole.hidden == 0
    assert whole.noise == pytest.approx(whole.score, rel=1e-3)


def test_the_information_is_that_of_the_design_across_the_path():
    """Products of the design of the model, row by row, for a move of every axis and several targets."""
    machine, targets = machines.load("dmu50"), {"1": Target((0.0, 0.0, -100.0)), "2": Target((40.0, 10.0, -90.0))}
    ends = np.clip(machine.travel, -200.0, 200.0) * machine.scale
    volume = Volume(machine, ends, targets, 4.0, 5.0)
    moves = [
        (ends[0] + a * (ends[1] - ends[0]), ends[0] + b * (ends[1] - ends[0])) for a, b in ((0.1, 0.9), (0.7, 0.3))
    ]
    short = ends[0], ends[0] + 1e-3 * (ends[1] - ends[0])
    for (start_at, end_at), found in zip(moves, volume.informations([*moves, short]), strict=False):
        expected = np.zeros_like(found)
        for tool in (target.position for target in targets.values()):
            share = np.linspace(0.0, 1.0, 9)[:, None]
            length = sum(
                np.linalg.norm(
                    np.diff(tool_point(machine, start_at + share * (end_at - start_at), tool), axis=0), axis=1
                )
            )
            n = int(np.ceil((length - 10.0) / LARGEST_CELL_MM))
            at = (5.0 + (np.arange(n) + 0.5) * (length - 10.0) / n) / length
            q = start_at + at[:, None] * (end_at - start_at)
            way = 1e-6 * (end_at - start_at)
            along = tool_point(machine, q + way, tool) - tool_point(machine, q - way, tool)
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            across = np.eye(3) - along[:, :, None] * along[:, None, :]
            transform = across @ error_transform_with_tool(machine, q, tool)[:, :3]
            rows = volume.model.design(machine, State(q), transform).reshape(3 * n, -1) * PRIOR * 1e3
            expected[6:, 6:] += rows.T @ rows * ((length - 10.0) / 4.0 / n)
        assert found[6:, 6:] == pytest.approx(expected[6:, 6:], rel=1e-6, abs=1e-6 * np.abs(expected).max())
    assert not volume.information(*short).any()


def test_moves_that_corners_swallow_say_nothing():
    assert not volume().information(np.zeros(3), np.array([6.0, 0.0, 0.0])).any()


# ---- planned


def test_a_planned_path_is_better_than_random_ones_and_keeps_its_length(monkeypatch):
    monkeypatch.setattr(planner, "RANDOM_PATHS", 3)
    monkeypatch.setattr(planner, "IMPROVEMENT_TRIES", 40)
    told = []
    found = best_path(volume(), 12_000.0, np.random.default_rng(3), told.append)
    assert sum(told) == 43
    length = sum(np.linalg.norm(b - a) for a, b in pairwise(found.corners))
    assert found.length_mm == pytest.approx(length)
    assert length <= 12_000.0
    low, high = FIXED.travel
    assert np.all((found.corners >= low) & (found.corners <= high))
    on_boundary = np.any((found.corners == low) | (found.corners == high), axis=1)
    assert on_boundary.all()
    random = []
    for seed in range(5):
        path = polyline(seed, 28)
        random.append(
            volume().noise_gain(information(volume(), path)).noise * np.sqrt(path.feed_distance[-1] / 12_000.0)
        )
    assert found.noise_gain.noise < 0.9 * min(random)


def test_a_seed_plans_one_path(monkeypatch):
    monkeypatch.setattr(planner, "RANDOM_PATHS", 2)
    monkeypatch.setattr(planner, "IMPROVEMENT_TRIES", 6)
    one, again = (best_path(volume(), 6_000.0, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.corners, again.corners)


def test_too_short_a_path_is_refused():
    with pytest.raises(UserError, match="too short"):
        best_path(volume(), 200.0, np.random.default_rng(0))


@pytest.mark.statistical
def test_the_fixed_set_up():
    """The bars of the fixed set-up: noise gain 0.165, and with 1 um on each reading 0.55 um on a grid in 21 m of path."""
    found = best_path(volume(), 21_000.0, np.random.default_rng(0))
    assert found.length_mm <= 21_000.0
    assert found.noise_gain.noise <= 0.165
    assert found.noise_gain.hidden == 0


# ---- judged


def test_a_given_path_is_judged():
    bad, good = evaluated_path(diagonals(), ONE), evaluated_path(polyline(3, 16), ONE)
    assert bad.unidentifiable_mode is not None
    assert bad.noise_gain.hidden == 1
    assert {"E_XX", "E_YY", "E_ZZ"} in [set(blind.effects) for blind in bad.unidentifiable]
    assert good.unidentifiable_mode is None
    assert {"E_XX", "E_YY", "E_ZZ"} not in [set(blind.effects) for blind in good.unidentifiable]


@pytest.mark.statistical
def test_three_targets_see_everything():
    three = {"a": Target((0.0, 0.0, -100.0)), "b": Target((80.0, 0.0, -100.0)), "c": Target((0.0, 90.0, -180.0))}
    assert evaluated_path(polyline(3, 30), three).unidentifiable == ()


# ---- programs


def read_back(text, machine, tmp_path):
    path = tmp_path / "path.nc"
    path.write_text(text)
    source = open_source(str(path))
    return program_path(
        source, find_dialect("auto", source.name, source.text_head), machine, make_setup(machine, zero=True)
    )


def test_the_path_of_a_program_is_that_it_was_made_of(tmp_path):
    for made in (polyline(5, 12), diagonals()):
        found = read_back(program(made), FIXED, tmp_path)
        np.testing.assert_allclose(found.positions, made.positions, atol=1e-6)
        np.testing.assert_array_equal(found.counts[1:], made.feed_move[1:])
        np.testing.assert_allclose(found.length, made.feed_distance, atol=1e-4)


def test_circles_and_tcp_are_cut_into_straight_pieces(tmp_path):
    circle = "G21 G90 G17\nG0 X100 Y300 Z200\nG2 X300 Y300 I100 J0 F500\nG1 X400\nM30\n"
    found = read_back(circle, FIXED, tmp_path)
    x, y = (found.positions[:, FIXED.index(name)] for name in "XY")
    inside = (x > 100.0) & (x < 300.0)
    np.testing.assert_allclose(np.hypot(x - 200.0, y - 300.0)[inside], 100.0, atol=1e-9)
    assert np.count_nonzero(inside) > 1000
    assert found.length[-1] == pytest.approx(np.pi * 100.0 + 100.0, rel=1e-6)
    tcp = "G21 G90\nG0 X0 Y0 Z100 B0 C0\nG43.4 H1\nG1 X0 Y0 Z50 B0 C0 F500\nG1 X50 Y20 Z50 B30 C40\nM30\n"
    found = read_back(tcp, machines.load("dmu50"), tmp_path)
    steps = np.abs(np.diff(found.positions[:, :2], axis=0)).max()
    assert np.degrees(steps) <= 0.11


REFUSED = {
    "a canned cycle": "G21 G90\nG0 X10 Y10 Z100\nG81 X20 Y20 Z50 R60 F100\nM30\n",
    "the position of a linear axis is unknown here": "G21 G90\nG0 X10 Y10 Z100\nG1 X20 F100\nT1 M6\nG1 X30\nM30\n",
    "the program has no path": "G21 G90\nG0 X10 Y10\nM30\n",
}


@pytest.mark.parametrize(("said", "text"), REFUSED.items(), ids=REFUSED)
def test_programs_that_no_path_can_be_told_of_are_refused(said, text, tmp_path):
    with pytest.raises(UserError, match=said):
        read_back(text, FIXED, tmp_path)


def test_axes_that_a_program_never_names_stand_at_home_and_are_noted(tmp_path):
    found = read_back("G21 G90\nG0 X10 Y10 Z100\nG1 X20 F100\nM30\n", machines.load("dmu50"), tmp_path)
    assert len(found.notes) == 1
    assert "gives no position of C, B: home is assumed" in found.notes[0]


# ---- driving


def test_a_drive_keeps_feed_and_acceleration():
    path = path_of(FIXED, [[0, 0, 0], [300, 0, 0], [300, 40, 0], [0, 40, 300], [0, 40, 310]])
    dynamics = PathDynamics(6000.0, 400.0, 1000.0, pause_s=0.5)
    ride = driven(path, dynamics)
    speed = np.linalg.norm(ride.velocity, axis=1)
    change = np.linalg.norm(ride.acceleration, axis=1)
    assert speed.max() == pytest.approx(100.0)
    assert np.all(np.isin(np.round(change, 6), [0.0, 400.0]))
    np.testing.assert_allclose(
        np.gradient(ride.positions, ride.time, axis=0)[change == 0.0][5:-5],
        ride.velocity[change == 0.0][5:-5],
        atol=21.0,
    )
    np.testing.assert_allclose(ride.positions[[0, -1]], path.positions[[0, -1]], atol=1e-9)
    assert ride.time[-1] == pytest.approx(duration(path, dynamics), abs=2e-3)
    # 300 mm and 424 mm at 100 mm/s with 0.25 s of ramps; 40 mm with them too; 10 mm without a plateau
    lasting = 3.25 + 0.65 + np.hypot(300, 300) / 100 + 0.25 + 2 * np.sqrt(10 / 400)
    assert duration(path, dynamics) == pytest.approx(lasting + 1.0)


# ---- the commands


@pytest.fixture
def machine_file(tmp_path):
    (tmp_path / "fixed.toml").write_text(FIXED_TOML)
    return tmp_path


@pytest.mark.usefixtures("machine_file")
def test_plan_simulate_fit(command, monkeypatch, tmp_path):
    """All the way: a path, its program, readings along it, a calibration that knows nothing of the truth."""
    monkeypatch.setattr(planner, "RANDOM_PATHS", 2)
    monkeypatch.setattr(planner, "IMPROVEMENT_TRIES", 6)
    fixed = ["--machine", "fixed.toml"]
    done = command(
        "plan",
        *fixed,
        "--strategy",
        "on-the-fly",
        "--target",
        "t=0,0,-100",
        "--length-m",
        "10",
        "-o",
        "path.csv",
        "--nc",
        "path.nc",
    )
    assert done.status == 0, done.err
    assert "noise gain" in done.err
    assert "BLIND" not in done.err
    made = [
        "--path",
        "path.nc",
        "--target",
        "t=0,0,-100",
        "--feed",
        "9000",
        "--rate",
        "30",
        "-u",
        "u_range_um=1",
        "-u",
        "u_angle_um=2",
    ]
    done = command(
        "simulate", *fixed, *made, "--effect", "backlash:axis=Y,width=15", "-o", "points.csv", "--truth", "truth.json"
    )
    assert done.status == 0, done.err
    again = command("simulate", *fixed, *made, "--effect", "backlash:axis=Y,width=15", "-o", "again.csv")
    assert again.status == 0
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "points.csv").read_bytes()
    done = command(
        "fit", "points.csv", *fixed, "--path", "path.nc", "--reversal", "constant", "--basis", "cubic:7", "--no-hold-out",
        "-o", "cal.json", "--json", "-",
    )  # fmt: skip
    assert done.status == 0, done.err
    found = {effect["name"]: effect for effect in json.loads(done.out)["effects"]}["backlash Y"]
    assert found["parameters"]["width_um"] == pytest.approx(15.0, abs=1.0)


@pytest.mark.usefixtures("machine_file")
def test_a_program_is_judged_by_name(command, tmp_path):
    (tmp_path / "diagonals.nc").write_text(program(diagonals()))
    done = command(
        "plan", "--machine", "fixed.toml", "--strategy", "on-the-fly", "--path", "diagonals.nc", "--target", "t=0,0,-100",
        "-o", "judged.csv",
    )  # fmt: skip
    assert done.status == 0, done.err
    assert "HIDDEN       1 direction" in done.err
    assert "HIDDEN MODE  E_XX, E_YY and E_ZZ in proportion to their travels" in done.err


WRONG = {
    "plan points": (
        ["plan", "--strategy", "on-the-fly", "--points", "30", "-o", "p.csv"],
        "--points is an option of ncomp plan points",
    ),
    "plan both": (
        ["plan", "--strategy", "on-the-fly", "--length-m", "5", "--minutes", "3", "-o", "p.csv"],
        "exclude each other",
    ),
    "plan length elsewhere": (
        ["plan", "--strategy", "grid", "--length-m", "5", "-o", "p.csv"],
        "--length-m is an option of ncomp plan path",
    ),
    "plan swept": (
        ["plan", "--strategy", "on-the-fly", "--rotary", "swept", "-o", "p.csv"],
        "expected fixed or simultaneous",
    ),
    "simulate both": (
        ["simulate", "--path", "x.nc", "--strategy", "grid", "-o", "d.csv"],
        "--strategy does not apply to --path",
    ),
    "simulate neither": (["simulate", "-o", "d.csv"], "--strategy NAME, or --path PATH.nc"),
    "simulate laser": (
        ["simulate", "--path", "x.nc", "--instrument", "interferometer", "-o", "d.csv"],
        "--path needs a laser tracker",
    ),
    "simulate no file": (["simulate", "--path", "x.nc", "-o", "d.csv"], "x.nc"),
}


@pytest.mark.parametrize(("arguments", "said"), WRONG.values(), ids=WRONG)
@pytest.mark.usefixtures("machine_file")
def test_what_cant_be_is_refused(command, tmp_path, arguments, said):
    done = command(arguments[0], "--machine", "fixed.toml", *arguments[1:])
    assert done.status == 2
    assert said in done.err
    assert {path.name for path in tmp_path.iterdir()} == {"fixed.toml"}


@pytest.mark.statistical
def test_on_the_fly_agrees_with_points_at_rest():
    """The same virtual machine by both: their deviations in the volume differ by no more than both uncertainties."""
    rng = np.random.default_rng(2)
    truth = random_true_model(FIXED, rng)
    tracker = LaserTracker(u_range_um=0.5, u_angle_um=3.0, u_angle_um_per_m=1.0)
    readings, _ = followed(polyline(0, 40), truth, rate=50.0, tracker=tracker, seed=4)
    moving = calibrate(on_path(readings, polyline(0, 40)).measurement, hold_out=False)
    state = with_moves(State(plan(FIXED, "hexahedron+random", (170, 150)).positions))
    poses = {"1": tracker_pose((-1500.0, -300.0, 200.0), rng)}
    resting = calibrate(observe(FIXED, truth, state, tracker, rng, poses, ONE), hold_out=False)
    grid = rng.uniform(*FIXED.travel, (400, 3))
    found, variance = [], 0.0
    for each in (moving, resting):
        errors, points = deviation_on(FIXED, each.model, grid, TOOL)
        found.append(errors)
        design = each.model.design(FIXED, State(grid), error_transform_with_tool(FIXED, grid, TOOL)[:, :3])
        columns = np.stack([aligned(design[:, :, k], points) for k in range(design.shape[2])], axis=2)
        variance = variance + np.einsum("nip,pq,niq->ni", columns, np.array(each.model.covariance), columns)
    apart = aligned(found[0] - found[1], points) / np.sqrt(variance)
    assert np.mean(np.abs(apart) < 1.96) > 0.85
    assert np.sqrt(np.mean(apart**2)) < 1.5


@pytest.mark.statistical
def test_the_unseen_tilt_of_one_tool_vector_does_not_shift_the_measured_points(command, tmp_path):
    """The correction between positions is known as it errs; the tilt turns about the centre of the measured points."""
    (tmp_path / "mill.toml").write_text(
        'name = "mill"\nchain = "w b Y X Z t"\n'
        + "".join(f"axes.{axis} = {{ travel = [0, {end}] }}\n" for axis, end in (("X", 500), ("Y", 400), ("Z", 300)))
    )
    options = (
        "--path",
        "path.nc",
        "--target",
        "t=40,0,-100",
        "--feed",
        "6000",
        "--rate",
        "50",
        "--tracker=-800,-900,300",
    )
    noise = ("-u", "u_range_um=0.3", "-u", "u_angle_um=1", "-u", "u_angle_um_per_m=1")
    machine = ("--machine", "mill.toml")
    assert not command(
        "plan", *machine, "--strategy", "on-the-fly", "--length-m", 8, "-o", "p.csv", "--nc", "path.nc"
    ).status
    assert not command("simulate", *machine, *options, *noise, "-o", "d.csv", "--truth", "truth.json").status
    done = command(
        "fit", "d.csv", *machine, "--path", "path.nc", "-o", "cal.json", "--no-hold-out", "--json", "fit.json"
    )
    assert not done.status, done.err
    grid = [(x, y, z) for x in (0, 125, 250, 375, 500) for y in (0, 200, 400) for z in (0, 150, 300)]
    rows = "".join(f"{x},{y},{z},t\n" for x, y, z in grid)
    (tmp_path / "grid.csv").write_text(f"# machine: mill\n# target.t: 40 0 -100\nX,Y,Z,target\n{rows}")
    found = [_deviations(command, machine, name) for name in ("cal.json", "truth.json")]
    away = aligned((found[0] - found[1]) * 1e-3, np.array(grid, float)) * 1e3
    done = command("predict", "grid.csv", *machine, "-c", "cal.json", "-o", "o.csv", "--json", "u.json")
    u = json.loads((tmp_path / "u.json").read_text())["u_um"]
    between, shift = np.array(u["between_positions"]), np.array(u["common_shift"])
    assert np.linalg.norm(between) < 3.0 * float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    assert np.linalg.norm(between) > 0.3 * float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    assert shift.max() < between.max()
    own = json.loads((tmp_path / "fit.json").read_text())["u_um"]
    assert np.linalg.norm(own["between_positions"]) < 2.0 * np.linalg.norm(between)


def _deviations(command, machine, calibration):
    done = command("predict", "grid.csv", *machine, "-c", calibration, "-o", "grid_out.csv")
    assert not done.status, done.err
    lines = [line for line in Path("grid_out.csv").read_text().splitlines() if not line.startswith("#")]
    return np.array([[float(row[f"d{xyz}_um"]) for xyz in "xyz"] for row in csv.DictReader(lines)])
