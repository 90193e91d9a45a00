"""Calibration on the fly: paths, alignment in order, what is left out, cells, and what comes of it."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from support.on_the_fly_cases import (
    AT,
    FIXED,
    FIXED_TOML,
    ONE,
    diagonals,
    followed,
    path_of,
    polyline,
    program,
)
from support.tiers import drawn

import machines
from calibration.evaluation.volumetric import aligned, deviation_on
from calibration.fit.calibrate import calibrate
from calibration.fit.fit import fit
from calibration.fit.identifiability import identifiability
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Target
from calibration.observation.full_model import BasisChoice, with_effects
from calibration.on_the_fly.along_path import across_path, on_path
from calibration.on_the_fly.coarse_alignment import in_order, rough
from calibration.on_the_fly.constant_feed import steadiness
from calibration.on_the_fly.corrected_positions import with_corrected_positions
from calibration.on_the_fly.drive import PathDynamics, driven, duration
from calibration.on_the_fly.nominal_path import target_path
from calibration.on_the_fly.path_cells import cell_numbers, correlation, reduced
from calibration.on_the_fly.planning.unidentifiable_mode import common_odd_mode
from calibration.on_the_fly.reversals import reversals
from calibration.on_the_fly.virtual import Vibration, write_readings
from calibration.simulation.true_model import model_of, random_true_model
from kinematics.basis import Legendre
from kinematics.effects import Backlash, Reversal
from kinematics.error_model.model import no_errors, read_model
from kinematics.forward import tool_point
from kinematics.transforms import Pose, rotation_vector_matrix
from kinematics.user_error import UserError

NOTHING = no_errors(FIXED)
EXACT = LaserTracker(u_range_um=1e-3, u_angle_um=1e-3)
TOOL = (0.0, 0.0, -100.0)


def truth_of(seed=0, machine=FIXED):
    return random_true_model(machine, np.random.default_rng(seed))


# ---- the path


def test_the_way_of_a_target_is_that_of_its_machine():
    """On straight moves and where rotary axes turn: points, tangents and positions by exact kinematics."""
    machine = machines.load("dmu50")
    path = path_of(machine, [[-200, -100, 50, 0, 0], [200, 100, 300, 70, 130], [100, -200, 300, 20, 200]])
    target = Target((60.0, -30.0, -150.0))
    way = target_path(path, target)
    s = np.random.default_rng(0).uniform(0, way.length, 500)
    inside = np.min(np.abs(s[:, None] - way.corners), axis=1) > 2 * way.step
    q, place = way.positions_at(s), way.at(s)
    np.testing.assert_allclose(place.points[inside], tool_point(machine, q, target.position)[inside], atol=1e-4)
    ahead = tool_point(machine, way.positions_at(s + 0.02), target.position)
    behind = tool_point(machine, way.positions_at(s - 0.02), target.position)
    chord = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    np.testing.assert_allclose(place.tangents[inside], chord[inside], atol=1e-4)
    chords = np.linalg.norm(np.diff(tool_point(machine, way.positions, target.position), axis=0), axis=1).sum()
    assert way.length == pytest.approx(chords, abs=way.step)
    assert len(way.corners) == 3


def test_corners_are_where_the_path_turns_and_rapid_is_not_used():
    path = path_of(
        FIXED, [[0, 0, 0], [100, 0, 0], [300, 0, 0], [300, 200, 0], [300, 400, 0], [300, 0, 0]],
        np.array([True, True, True, True, False, True]),
    )  # fmt: skip
    way = target_path(path, ONE["t"])
    np.testing.assert_allclose(way.corners, [0, 300, 500, 700, 1100], atol=1e-9)
    np.testing.assert_array_equal(way.usable, [True, True, False, True])


def test_a_repeated_position_takes_no_time():
    vertices = [(0, 0, 0), (0, 0, 0), (400, 0, 0), (400, 0, 0), (400, 300, 0), (400, 300, 0)]
    dynamics = PathDynamics(feed=2500.0)
    once, twice = path_of(FIXED, vertices[::2]), path_of(FIXED, vertices)
    assert duration(twice, dynamics) == pytest.approx(duration(once, dynamics))
    np.testing.assert_allclose(driven(twice, dynamics).positions, driven(once, dynamics).positions, atol=1e-9)


def test_a_target_that_stands_is_no_path():
    with pytest.raises(UserError, match=r"moves by .* mm only"):
        target_path(path_of(FIXED, [[0, 0, 0], [0, 0.5, 0]]), ONE["t"])


# ---- alignment


SYMMETRIC = {
    "closed square": [[0, 0, 0], [400, 0, 0], [400, 400, 0], [0, 400, 0], [0, 0, 0]],
    "there and back": [[0, 0, 0], [500, 100, 0], [500, 400, 300], [500, 100, 0], [0, 0, 0]],
    "straight centroid": [[0, 0, 0], [100, 300, 0], [300, -300, 200], [400, 0, 0]],
}


@pytest.mark.parametrize("vertices", SYMMETRIC.values(), ids=SYMMETRIC)
@drawn(1, 3, turned=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-2000, 2000)] * 3))
def test_any_pose_is_found_also_for_symmetric_paths(vertices, turned, shift):
    path = target_path(path_of(FIXED, vertices), ONE["t"])
    ride = driven(path_of(FIXED, vertices), PathDynamics(4000.0, 800.0, 50.0))
    pose = Pose(rotation_vector_matrix([turned]), np.array([shift]))
    points = pose.apply(tool_point(FIXED, ride.positions, TOOL))
    found = rough(path, points, "points")
    np.testing.assert_allclose(found.pose.rotation, pose.rotation, atol=0.02)
    there = path.at(found.distances).points
    assert np.abs(pose.apply(there) - points).max() < 15.0


def test_places_that_are_passed_twice_are_told_by_the_order():
    there = np.stack([np.arange(200.0), np.zeros(200), np.zeros(200)], axis=1)
    back = np.concatenate([there, there[::-1]])
    np.testing.assert_allclose(in_order(back + np.array([0.0, 0.3, 0.0]), back), np.arange(400), atol=1)
    slower = back[np.sort(np.concatenate([np.arange(400), np.arange(100, 110)]))][:400]
    partner = in_order(slower, back)
    assert np.all(np.diff(partner) >= 0)
    np.testing.assert_allclose(back[partner], slower, atol=1.0)


def test_another_program_and_half_a_recording_are_refused():
    readings, _ = followed(polyline(1), NOTHING, rate=20.0)
    with pytest.raises(UserError, match="or is it another program"):
        on_path(readings, polyline(2, 40))
    half = slice(0, len(readings) // 2)
    part = replace(
        readings,
        **{name: getattr(readings, name)[half] for name in ("time", "points", "target", "station", "run", "lines")},
    )
    with pytest.raises(UserError, match=r"points.csv:5: the points cover .* m, the program .* m: record it from start"):
        on_path(part, polyline(1))
    mirrored = replace(readings, points=readings.points * [-1, 1, 1])
    with pytest.raises(UserError, match="half of the points are more than"):
        on_path(mirrored, polyline(1))


# ---- what is left out


def test_corners_and_changing_speed_are_left_out():
    path = path_of(FIXED, [[0, 0, 0], [500, 0, 0], [500, 500, 0], [100, 500, 400]])
    ride = driven(path, PathDynamics(9000.0, 500.0, 500.0))
    way = target_path(path, ONE["t"])
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ride.positions, axis=0), axis=1))])
    found = steadiness(way, ride.time, s, 5.0, 4.0)
    changing = np.any(ride.acceleration != 0.0, axis=1)
    used = ~found.corner & ~found.unsteady
    # ramps of 22.5 mm: where they end the speed is within 5 % already
    speed = np.linalg.norm(ride.velocity, axis=1)
    assert np.all(speed[used] > 0.94 * 150.0)
    assert np.mean(used[~changing & (speed > 0) & (s > 30) & (s < way.length - 30)]) > 0.97
    assert np.mean(changing[used]) < 0.03
    np.testing.assert_allclose(found.feed[used], 9000.0, rtol=0.06)


# ---- cells


def test_cells_are_means_and_strays_are_left_out():
    way = target_path(path_of(FIXED, [[0, 0, 0], [400, 0, 0]]), ONE["t"])
    rng = np.random.default_rng(0)
    s = np.sort(rng.uniform(0, 400, 5000))
    deviation = rng.normal(0, 2e-3, (5000, 3)) + np.stack([0 * s, 1e-4 * s, -2e-5 * s], axis=1)
    stray = rng.choice(5000, 40, replace=False)
    deviation[stray] += rng.choice([-1, 1], (40, 1)) * [0.0, 0.1, 0.2]
    cells = reduced(cell_numbers(way, s, 4.0), s, deviation, s[:, None])
    assert (len(cells.distances), cells.astray) == (100, 40)
    np.testing.assert_allclose(cells.distances, np.arange(2.0, 400.0, 4.0), atol=0.8)
    np.testing.assert_allclose(cells.columns[:, 0], cells.distances)
    missed = cells.deviation - np.stack([0 * cells.distances, 1e-4 * cells.distances, -2e-5 * cells.distances], axis=1)
    assert np.std(missed * np.sqrt(cells.count)[:, None]) == pytest.approx(2e-3, rel=0.15)
    assert np.all(cells.count == np.bincount(cell_numbers(way, s, 4.0)[np.setdiff1d(np.arange(5000), stray)]))


@pytest.mark.parametrize(("memory", "expected"), [(0.0, 1.0), (0.6, 4.0)])
def test_noise_that_goes_on_in_time_makes_means_less_certain(memory, expected):
    """An AR(1) process: means of many have (1 + a) / (1 - a) times the variance."""
    rng = np.random.default_rng(1)
    white = rng.normal(size=(100_000, 3))
    noise = white.copy()
    for k in range(1, len(noise)):
        noise[k] = memory * noise[k - 1] + white[k]
    start = np.arange(0, 100_000, 100)
    found = correlation(noise, start, np.full(1000, 100.0))
    assert found == pytest.approx(expected, rel=0.25)


def test_directions_across_the_path_are_those_of_the_paper():
    """On-the-fly paper (1), (4): square to path and to one another, and their covariance is diagonal."""
    rng = np.random.default_rng(2)
    along = rng.normal(size=(50, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    points = rng.uniform(-3000, 3000, (50, 3))
    points[0] = 2000.0 * along[0]
    across = across_path(along, points)
    np.testing.assert_allclose(across @ np.swapaxes(across, 1, 2), np.broadcast_to(np.eye(2), (50, 2, 2)), atol=1e-12)
    np.testing.assert_allclose(across @ along[:, :, None], 0.0, atol=1e-12)
    beam = points / np.linalg.norm(points, axis=1, keepdims=True)
    u_beam, u_across = 0.5e-3, 3e-3
    covariance = LaserTracker(u_range_um=0.5, u_angle_um=3.0).covariance(points)
    found = across @ covariance @ np.swapaxes(across, 1, 2)
    share = np.einsum("nkx,nx->nk", across, beam) ** 2
    np.testing.assert_allclose(found[:, 0, 1], 0.0, atol=1e-18)
    for k in (0, 1):
        np.testing.assert_allclose(found[:, k, k], u_beam**2 * share[:, k] + u_across**2 * (1 - share[:, k]), rtol=1e-9)


def test_what_counts_lies_across_the_path():
    readings, _ = followed(polyline(1), truth_of(), rate=20.0)
    m = on_path(readings, polyline(1)).measurement
    registration = m.instrument.first_registration(m, np.ones(len(m), bool))
    path_direction = np.cross(m.across.directions[:, 0], m.across.directions[:, 1])
    slopes = m.state.velocity / np.linalg.norm(m.state.velocity, axis=1, keepdims=True)
    moved = tool_point(FIXED, m.state.positions + slopes, TOOL) - tool_point(FIXED, m.state.positions, TOOL)
    turned = np.einsum("nij,nj->ni", registration.rotations(m), moved)
    np.testing.assert_allclose(np.abs(np.sum(path_direction * turned, axis=1)), 1.0, atol=1e-6)
    np.testing.assert_allclose(m.across.of(turned), 0.0, atol=3e-4)
    whole = replace(m, across=None)
    np.testing.assert_allclose(
        m.instrument.transform(m, registration), m.across.directions @ whole.instrument.transform(whole, registration)
    )
    np.testing.assert_allclose(
        m.instrument.registration_design(m, registration),
        m.across.directions @ whole.instrument.registration_design(whole, registration),
    )


# ---- what comes of it


def test_errors_are_found_within_their_uncertainties():
    truth = truth_of(5)
    readings, _ = followed(polyline(3, 30), truth, rate=25.0, seed=3)
    m = on_path(readings, polyline(3, 30)).measurement
    found = calibrate(m, basis="X=cubic:12,Y=cubic:8,Z=cubic:6", hold_out=False)
    assert found.fit.chi2_reduced == pytest.approx(1.0, abs=0.08)
    assert found.fit.rms_um < 0.3 * found.before_rms_um
    grid = FIXED.travel[0] + np.random.default_rng(0).uniform(0, 1, (200, 3)) * np.diff(FIXED.travel, axis=0)
    wanted, points = deviation_on(FIXED, truth, grid, TOOL)
    got, _ = deviation_on(FIXED, found.model, grid, TOOL)
    assert np.abs(aligned(got - wanted, points)).max() * 1e3 < 4.0
    assert np.abs(aligned(wanted, points)).max() * 1e3 > 30.0


def test_the_remedy_of_the_blind_mode_is_another_path_even_where_angles_are_not_seen():
    """Corner to corner only, bases of different sizes: unseen angles are listed beside the mode, not in it."""
    corners = [
        (0, 0, 0),
        (1, 1, 1),
        (1, 0, 1),
        (0, 1, 0),
        (0, 1, 1),
        (1, 0, 0),
        (0, 0, 0),
        (0, 0, 1),
        (1, 1, 0),
        (0, 1, 0),
    ]
    low, high = FIXED.travel
    path = path_of(FIXED, low + np.array(corners) * (high - low))
    readings, _ = followed(path, truth_of(4), rate=20.0)
    found = calibrate(on_path(readings, path).measurement, basis="X=cubic:12,Y=cubic:4,Z=cubic:3", hold_out=False)
    along = [
        unidentifiable
        for unidentifiable in found.identifiability.unidentifiable
        if {"E_XX", "E_YY", "E_ZZ"} <= set(unidentifiable.effects)
    ]
    assert along
    assert all("lines that are not alike about the middle" in unidentifiable.remedy for unidentifiable in along)


@pytest.mark.statistical
def test_the_diagonals_blind_mode_is_reported_and_a_polyline_has_none():
    readings, _ = followed(diagonals(), truth_of())
    m = on_path(readings, diagonals()).measurement
    nodes = {"X": BasisChoice("b-spline", 13), "Y": BasisChoice("b-spline", 13), "Z": BasisChoice("b-spline", 10)}
    model, prior = with_effects(m, nodes, (), 200.0 / 30.0)
    found = fit(m, model, prior=prior)
    seen = identifiability(found)
    assert (seen.parameters, seen.rank_registered) == (216, 155)
    (mode,) = [
        unidentifiable
        for unidentifiable in seen.unidentifiable
        if set(unidentifiable.effects) == {"E_XX", "E_YY", "E_ZZ"}
    ]
    assert "lines that are not alike about the middle" in mode.remedy
    assert "another tool vector would not" in mode.remedy
    said = common_odd_mode(m, found.registration)
    assert said is not None
    assert said.startswith("E_XX, E_YY and E_ZZ in proportion to their travels, with one common shape that is odd")
    readings, _ = followed(polyline(1), truth_of())
    m = on_path(readings, polyline(1)).measurement
    assert common_odd_mode(m, m.instrument.first_registration(m, np.ones(len(m), bool))) is None


def test_backlash_and_what_differs_forward_and_backward():
    truth = model_of(
        FIXED, [Backlash("X", 18.0), Backlash("Z", 6.0), Reversal("C", "Y", Legendre((0.0, 600.0), 0), (25.0,))]
    )
    readings, _ = followed(polyline(4, 30), truth, rate=20.0, seed=1)
    m = on_path(readings, polyline(4, 30)).measurement
    found = calibrate(m, basis="legendre:3", effects=reversals(m, "constant"), hold_out=False)
    assert found.fit.chi2_reduced == pytest.approx(1.0, abs=0.1)
    by_name = {effect.name: effect for effect in found.model.effects}
    assert by_name["backlash X"].width == pytest.approx(18.0, abs=4 * by_name["backlash X"].u[0])
    assert by_name["backlash Z"].width == pytest.approx(6.0, abs=4 * by_name["backlash Z"].u[0])
    assert by_name["reversal E_CY"].differences[0] == pytest.approx(25.0, abs=4 * by_name["reversal E_CY"].u[0])
    assert by_name["backlash X"].u[0] < 1.0
    assert len(reversals(m, "curves")) == 18
    with pytest.raises(UserError, match="none, constant, curves"):
        reversals(m, "some")


@pytest.mark.statistical
def test_several_feeds_stations_and_targets_are_one_measurement():
    targets = {"a": Target(TOOL), "b": Target((90.0, 40.0, -160.0)), "c": Target((-60.0, 80.0, -120.0))}
    truth = truth_of(6)
    path = polyline(5, 12)
    readings, _ = followed(
        path, truth, targets=targets, feeds=(6000.0, 9000.0), stations=(AT, (2200.0, 900.0, 400.0)), rate=25.0
    )
    taken = on_path(readings, path)
    m = taken.measurement
    assert taken.reduction.passes == 12
    np.testing.assert_allclose(sorted(set(np.round(taken.reduction.feeds, -2))), [6000.0, 9000.0])
    assert set(np.unique(m.state.station)) == {"s1", "s2"}
    assert set(np.unique(m.state.target)) == set(targets)
    found = calibrate(m, basis="cubic:6", hold_out=False)
    assert found.fit.chi2_reduced < 2.5
    assert found.fit.rms_um < 0.4 * found.before_rms_um
    assert (
        found.identifiability.rank_registered == found.identifiability.parameters - found.identifiability.by_convention
    )


# ---- the command


def written(made, path):
    file = io.BytesIO()
    write_readings(made, file)
    path.write_bytes(file.getvalue())


@pytest.fixture
def set_up(tmp_path):
    """A machine, a program and readings along it, as files."""
    path = polyline(8, 16)
    _, made = followed(path, truth_of(8), rate=20.0)
    (tmp_path / "fixed.toml").write_text(FIXED_TOML)
    (tmp_path / "path.nc").write_text(program(path))
    written(made, tmp_path / "points.csv")
    return tmp_path


def test_fit_on_the_fly(command, set_up):
    arguments = [
        "points.csv",
        "--path",
        "path.nc",
        "--machine",
        "fixed.toml",
        "--basis",
        "cubic:5",
        "-o",
        "cal.json",
        "--no-hold-out",
    ]
    done = command("fit", *arguments, "--reversal", "constant", "--json", "-")
    assert done.status == 0, done.err
    report = json.loads(done.out)
    moving = report["on_the_fly"]
    assert moving["readings"] == moving["used"] + sum(moving["left_out"].values())
    assert 0.9 * moving["readings"] < moving["used"]
    assert moving["blind_mode"] is None
    assert report["n_observations"] <= 2 * moving["rows"]
    assert report["after"]["rms_um"] < 0.5 * report["before"]["rms_um"]
    assert {effect["name"] for effect in report["effects"]} >= {"backlash X", "reversal E_YX"}
    assert "readings in 1 pass along" in done.err
    model = read_model(set_up / "cal.json", machines.load(str(set_up / "fixed.toml")))
    assert model.covariance is not None


REFUSED = {
    "axis columns": ("# machine: fixed", "time_s,x,y,z", "time_s,X,y,z", "omit --path"),
    "another machine": ("# machine: fixed", "machine: fixed", "machine: other", "is of 'other', not of fixed"),
    "unknown column": ("", "time_s,x,y,z", "time_s,x,y,w", "column w: not known"),
}


@pytest.mark.parametrize(("_what", "old", "new", "said"), REFUSED.values(), ids=REFUSED)
def test_files_that_cant_be_used_are_refused(command, set_up, _what, old, new, said):
    text = (set_up / "points.csv").read_text()
    (set_up / "points.csv").write_text(text.replace(old, new, 1))
    done = command("fit", "points.csv", "--path", "path.nc", "--machine", "fixed.toml", "-o", "cal.json")
    assert done.status == 2
    assert said in done.err
    assert not (set_up / "cal.json").exists()


def test_time_that_stands_still_is_refused(command, set_up):
    lines = (set_up / "points.csv").read_text().splitlines()
    lines[50] = ",".join([lines[49].split(",")[0], *lines[50].split(",")[1:]])
    (set_up / "points.csv").write_text("\n".join(lines))
    done = command("fit", "points.csv", "--path", "path.nc", "--machine", "fixed.toml", "-o", "cal.json")
    assert done.status == 2
    assert "points.csv:51 column time_s: not later than in the row before" in done.err


@pytest.mark.usefixtures("set_up")
def test_options_of_a_path_need_a_path(command):
    done = command("fit", "points.csv", "--reversal", "curves", "--machine", "fixed.toml", "-o", "cal.json")
    assert done.status == 2
    assert "--path PATH.nc" in done.err
    done = command("fit", "points.csv", "--machine", "fixed.toml", "-o", "cal.json")
    assert done.status == 2
    assert "--path PATH.nc" in done.err


@pytest.mark.statistical
def test_vibration_that_is_fast_does_not_matter():
    readings, _ = followed(polyline(6), truth_of(7), rate=200.0, vibration=Vibration(5.0, 43.0))
    found = calibrate(on_path(readings, polyline(6)).measurement, hold_out=False)
    assert found.fit.rms_um < 2.0


def test_a_path_sweeps_the_turn_between_its_ends():
    machine = machines.load("dmu50")
    corners = [[0.0, 0.0, 100.0, 0.0, 0.0], [50.0, 40.0, 200.0, 30.0, 200.0], [10.0, -40.0, 300.0, 5.0, 300.0]]
    path = path_of(machine, np.array(corners))
    readings, _ = followed(path, truth_of(3, machine), feeds=(3000.0,), rate=20.0)
    low, high = on_path(readings, path).measurement.moving["C"]
    assert low == pytest.approx(0.0, abs=5.0)
    assert high == pytest.approx(300.0, abs=5.0)


@pytest.mark.statistical
def test_five_axes():
    machine = machines.load("dmu50")
    rng = np.random.default_rng(3)
    low, high = [-240, -215, 10, 5, 5], [240, 215, 390, 355, 175]
    path = path_of(machine, rng.uniform(low, high, (30, 5))[:, [0, 1, 2, 4, 3]])
    truth = truth_of(3, machine)
    targets = {"a": Target(TOOL), "b": Target((90.0, 40.0, -180.0)), "c": Target((-60.0, 80.0, -130.0))}
    readings, _ = followed(path, truth, targets=targets, feeds=(3000.0,), rate=100.0)
    found = calibrate(on_path(readings, path).measurement, hold_out=False)
    assert found.fit.chi2_reduced == pytest.approx(1.0, abs=0.1)
    places = rng.uniform(*machine.travel, (500, 5))
    wanted, points = deviation_on(machine, truth, places, TOOL)
    got, _ = deviation_on(machine, found.model, places, TOOL)
    before, after = (np.sqrt(np.mean(aligned(d, points) ** 2)) for d in (wanted, got - wanted))
    assert after < 0.12 * before


@pytest.mark.statistical
def test_the_place_of_a_reading_is_where_the_axes_stood():
    """On a machine with large errors, positions come nearer to those of the axes, but for a motion of the frame."""
    truth = truth_of(9)
    truth = truth.with_parameters(truth.parameters * 5.0)
    path = polyline(2, 40)
    readings, made = followed(path, truth, noise_scale=0.0)
    taken = on_path(readings, path)

    def missed(state):
        real = np.stack([np.interp(state.time, made.state.time, made.state.positions[:, i]) for i in range(3)], axis=1)
        points, there = (tool_point(FIXED, each, TOOL) for each in (state.positions, real))
        return np.median(np.linalg.norm(aligned(points - there, there), axis=1))

    before, after = missed(taken.measurement.state), missed(with_corrected_positions(taken).state)
    assert after < 0.35 * before
