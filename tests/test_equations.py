"""The observation equations: derivatives against differences, for every place of instrument and target."""

from dataclasses import replace

import numpy as np
import pytest
from support.virtual_measurements import THREE, measured, pose_of, positions, truth

import machines
from calibration.instruments import Interferometer, LaserTracker, Lengths, Level, Part, Ranging, TouchProbe
from calibration.instruments.of_points import centred_pose
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.registration.registration import PLANAR, RIGID, SHIFTS, Registration, rigid
from kinematics.error_model.model import Observation
from kinematics.state import State
from kinematics.transforms import Pose, rotation_vector_matrix

EVERYWHERE = {
    "tool": Target((30.0, 20.0, -80.0)),
    "table": Target((100.0, 20.0, 30.0), "table"),
    "bed": Target((300.0, -200.0, 10.0), "bed"),
}
STEP = 1e-5


def tracker_case(name, stands_on):
    machine, rng = machines.load(name), np.random.default_rng(0)
    q = positions(machine, 30, rng)
    measurement = measured(machine, q, EVERYWHERE, truth(machine, rng), rng, stations=2, stands_on=stands_on)
    known = {k: np.array(t.position) for k, t in EVERYWHERE.items() if not t.known}
    return measurement, pose_of(["s1", "s2"], known)


def part_case(components):
    machine, rng = machines.load("cframe"), np.random.default_rng(1)
    state = with_moves(State(positions(machine, 20, rng), target=np.full(20, "1")))
    part = Measurement(machine, Part(u_um=2.0, components=components), state, np.ones((20, components)))
    pose = Pose(rotation_vector_matrix([[0.0, 0.0, 0.3]]), np.array([[5.0, 6.0, 0.0]]))
    return part, Registration({"1": pose}, {"1": np.array([100.0, 50.0, 0.0])}, PLANAR if components == 2 else RIGID)


def laser_case():
    machine, rng = machines.load("dmu50"), np.random.default_rng(2)
    state = with_moves(State(positions(machine, 20, rng), target=np.full(20, "1")))
    axis = np.array(["X", "Y", "Z", "B"])[np.arange(20) % 4]
    laser = Measurement(
        machine, Interferometer(u_um=0.1), state, np.zeros((20, 1)), axis=axis, run=np.full(20, "1"),
        targets={"1": Target((0.0, 0.0, -90.0))},
    )  # fmt: skip
    return laser, Registration(zeros=dict.fromkeys(np.unique(laser.groups).tolist(), 0.002))


def level_case():
    machine, rng = machines.load("dmu50"), np.random.default_rng(4)
    state = with_moves(State(positions(machine, 20, rng), target=np.full(20, "1")))
    axis, component = np.array(["X", "Y"])[np.arange(20) % 2], np.array(["A", "B"])[np.arange(20) // 2 % 2]
    level = Measurement(
        machine, Level(u_angle_urad=1.0), state, np.zeros((20, 1)), axis=axis, run=np.full(20, "1"), component=component
    )
    return level, Registration(zeros=dict.fromkeys(np.unique(level.groups).tolist(), 2e-5))


def probe_case():
    machine, rng = machines.load("dmu50"), np.random.default_rng(3)
    sphere = np.array(["s1", "s2"])[np.arange(20) % 2]
    state = with_moves(State(positions(machine, 20, rng), station=sphere, target=np.full(20, "probe")))
    tip = {"probe": Target((0.0, 0.0, -150.0))}
    probe = Measurement(machine, TouchProbe(u_um=1.0), state, np.zeros((20, 3)), tip)
    poses = {name: Pose(np.eye(3)[None], -np.array([centre])) for name, centre in CENTRES.items()}
    return probe, Registration(poses, dict.fromkeys(poses, np.zeros(3)), SHIFTS)


def lengths_case():
    """Two lengths, both legs of a square, also turned round, and a dial gauge along a wire."""
    machine, rng = machines.load("cframe"), np.random.default_rng(5)
    runs = ["length"] * 4 + ["square Y", "square X", "reversed Y", "reversed X", "gauge Z", "gauge Z"]
    legs = ["square 1 X", "square 1 Y", "square 2 reversed X", "square 2 reversed Y"]
    groups = ["a", "a", "b", "b", *legs, "run w X", "run w X"]
    q = positions(machine, 10, rng)
    state = with_moves(State(q, target=np.full(10, "1"), station=np.array(groups)))
    target = {"1": Target((20.0, 10.0, -90.0))}
    own = Measurement(machine, Lengths(u_um=1.0, u_gauge_um=1.0), state, np.zeros((10, 1)), target, run=np.array(runs))
    return own, own.instrument.first_registration(own, np.ones(10, bool))


def ranging_case(stands_on):
    """Two stations, two targets and two runs: the dead lengths of six of their combinations."""
    machine, rng = machines.load("dmu50"), np.random.default_rng(6)
    n = np.arange(24)
    names = {name: np.array([f"{name}1", f"{name}2"]) for name in ("s", "t", "r")}
    state = with_moves(State(positions(machine, 24, rng), station=names["s"][n % 2], target=names["t"][n // 8 % 2]))
    targets = {"t1": Target((60.0, 0.0, -100.0)), "t2": Target((0.0, -50.0, -150.0))}
    own = Measurement(
        machine, Ranging(u_range_um=0.2), state, np.zeros((24, 1)), targets, stands_on, run=names["r"][n // 4 % 2]
    )
    poses = {"s1": centred_pose((900.0, 200.0, 300.0)), "s2": centred_pose((-700.0, 500.0, -100.0))}
    zeros = {name: 0.01 * k for k, name in enumerate(np.unique(own.instrument.zero_names(own)).tolist())}
    return own, Registration(poses, dict.fromkeys(poses, np.zeros(3)), SHIFTS, zeros)


CENTRES = {"s1": (130.0, 20.0, 60.0), "s2": (-110.0, 60.0, 50.0)}
CASES = {
    **{f"{name} {on}": (lambda n=name, o=on: tracker_case(n, o)) for name in ("dmu50", "cframe") for on in ("workpiece", "bed")},
    "part 2": lambda: part_case(2),
    "part 3": lambda: part_case(3),
    "interferometer": laser_case,
    "level": level_case,
    "lengths": lengths_case,
    "ranging workpiece": lambda: ranging_case("workpiece"),
    "ranging bed": lambda: ranging_case("bed"),
    "touch probe": probe_case,
}  # fmt: skip


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]()


def expected(case, errors, registration=None):
    measurement, own = case
    shift = np.zeros((len(measurement), 3))
    return measurement.instrument.expected(measurement, registration or own, Observation(errors, shift))


def test_transform_is_the_derivative_by_the_error_motions(case):
    measurement, registration = case
    places = len(measurement.machine.axes) + 1
    zero = np.zeros((len(measurement), places, 6))
    transform = measurement.instrument.transform(measurement, registration)
    for place in range(places):
        for component in range(6):
            errors = zero.copy()
            errors[:, place, component] = STEP
            slope = (expected(case, errors) - expected(case, -errors)) / (2 * STEP)
            assert transform[:, :, 6 * place + component] == pytest.approx(slope, abs=1e-6)


def test_registration_design_is_the_derivative_by_the_registration(case):
    measurement, registration = case
    zero = np.zeros((len(measurement), len(measurement.machine.axes) + 1, 6))
    design = measurement.instrument.registration_design(measurement, registration)
    assert design.shape == (*measurement.observed.shape, len(registration.names))
    for k in range(design.shape[2]):
        step = np.zeros(design.shape[2])
        step[k] = STEP
        ahead, back = (expected(case, zero, registration.moved(sign * step)) for sign in (1, -1))
        assert design[:, :, k] == pytest.approx((ahead - back) / (2 * STEP), abs=1e-5)


def test_a_fixed_reference_shows_no_axis():
    measurement, registration = tracker_case("dmu50", "bed")
    rows = measurement.state.target == "bed"
    assert not measurement.instrument.transform(measurement, registration)[rows][:, :, :-3].any()


def test_tracker_covariance_is_range_along_and_angles_across_the_beam():
    tracker = LaserTracker(u_range_um=0.5, u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
    covariance = tracker.covariance(np.array([[2000.0, 0.0, 0.0], [0.0, 3.0e3, 4.0e3]]))
    assert covariance[0] == pytest.approx(np.diag([0.001**2, 0.015**2, 0.015**2]))
    beam = np.array([0.0, 0.6, 0.8])
    assert beam @ covariance[1] @ beam == pytest.approx(0.00175**2)
    assert np.linalg.eigvalsh(covariance[1])[1:] == pytest.approx(0.0225**2)


def test_rigid_registration_is_exact_and_proper():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(5, 3)) * 500
    pose = Pose(rotation_vector_matrix([[0.4, -1.0, 2.0]]), np.array([[10.0, 20.0, 30.0]]))
    found = rigid(points, pose.apply(points))
    assert found.apply(points) == pytest.approx(pose.apply(points), abs=1e-9)
    flat = rigid(points[:3], points[:3] * [1, 1, -1])
    assert np.linalg.det(flat.rotation[0]) == pytest.approx(1.0)


def test_targets_come_in_any_order_of_names():
    rng = np.random.default_rng(4)
    machine = machines.load("gantry")
    targets = {"z": THREE["1"], "a": THREE["2"]}
    measurement = measured(machine, positions(machine, 10, rng), targets, truth(machine, rng), rng)
    for row in range(10):
        assert tuple(measurement.tool[row]) == targets[str(measurement.state.target[row])].position


def test_by_axes_against_differences(case):
    """Derivatives by the positions of the axes, for targets on tool, table and bed, seen from the table and the bed."""
    measurement, registration = case
    found, nothing = measurement.instrument.by_axes(measurement, registration), no_effects(measurement)
    if measurement.axis is not None:
        return
    q = measurement.state.positions
    for i in range(q.shape[1]):
        moved = [moved_to(measurement, q + way * STEP * np.eye(q.shape[1])[i]) for way in (1, -1)]
        seen = [each.instrument.expected(each, registration, nothing) for each in moved]
        np.testing.assert_allclose(found[:, :, i], (seen[0] - seen[1]) / (2 * STEP), atol=1e-6)


def moved_to(measurement, positions):
    return replace(measurement, state=replace(measurement.state, positions=positions))


def no_effects(measurement):
    n, axes = measurement.state.positions.shape
    return Observation(np.zeros((n, axes + 1, 6)), np.zeros((n, 3)))
