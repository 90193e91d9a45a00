"""A robot: six rotary axes, its tables of joints and points, the fit and the diagnosis of them."""

import json
from pathlib import Path

import numpy as np
import pytest
from support import robot

from calibration.fit.calibrate import calibrate
from calibration.measurement.readers import read_any
from calibration.plausibility.checks import sanity
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError

MACHINE = robot.machine()
TARGET = robot.target()
HEADER = {"u_range_um": "10", "u_angle_um": "10", "target.t": " ".join(f"{x:.4f}" for x in TARGET)}


def joints_of(joints, names="J1 J2 J3 J4 J5 J6"):
    return dict(zip(names.split(), joints.T, strict=True))


def points_of(points, names="xyz"):
    return dict(zip(names, points.T, strict=True))


@pytest.fixture
def read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def read_texts(points: str, joints: str = "", machine=MACHINE):
        Path("points.txt").write_text(points)
        Path("joints.txt").write_text(joints)
        return read_any(Path("points.txt"), machine, header=HEADER, plan=Path("joints.txt") if joints else None)

    return read_texts


def test_forward_kinematics_is_that_of_the_links():
    joints = robot.random_joints(40, share=1.0)
    flange = robot.NOMINAL.frames(np.zeros(6))[-1][:3, 3]
    expected = robot.NOMINAL.reflector(joints) - flange
    np.testing.assert_allclose(tool_point(MACHINE, np.radians(joints), TARGET), expected, atol=1e-9)


JOINTS = robot.random_joints(12)
POINTS = robot.measured(JOINTS)


def test_tables_row_by_row(read):
    m = read(robot.table(points_of(POINTS)), robot.table(joints_of(JOINTS)))
    np.testing.assert_allclose(m.observed, POINTS, atol=1e-9)
    np.testing.assert_allclose(np.degrees(m.state.positions), JOINTS, atol=1e-9)
    np.testing.assert_allclose(m.tool, np.tile(TARGET, (12, 1)), atol=1e-4)
    assert m.where(0) == "points.txt:2"
    assert m.notes[:3] == (
        "points.txt: no unit of x, y, z: taken in mm",
        "joints.txt: no unit of J1, J2, J3, J4, J5, J6: taken in deg",
        "points.txt and joints.txt are joined row by row",
    )


def test_tables_joined_by_names(read):
    names, order = np.array([f"P{i}" for i in range(12)]), np.random.default_rng(0).permutation(12)[:10]
    points = robot.table({"Name": names[order], **points_of(POINTS[order], "XYZ")}, delimiter="\t")
    joints = {"point": names, **joints_of(JOINTS, "A1 A2 A3 A4 A5 A6")}
    m = read(points, robot.table(joints, delimiter=";").replace(".", ","))
    np.testing.assert_allclose(m.observed, POINTS[order], atol=1e-9)
    np.testing.assert_allclose(np.degrees(m.state.positions), JOINTS[order], atol=1e-9)
    assert "points.txt and joints.txt are joined by the names of points; 2 of 12 were not measured" in m.notes


def test_one_table_with_units_and_read_back(read):
    columns = {
        **joints_of(np.radians(JOINTS), "q1_rad q2_rad q3_rad q4_rad q5_rad q6_rad"),
        **joints_of(JOINTS + 0.01, "actual_J1_deg actual_J2_deg actual_J3_deg actual_J4_deg actual_J5_deg actual_J6_deg"),
        **points_of(POINTS / 1e3, ["x(m)", "y(m)", "z(m)"]),
    }  # fmt: skip
    m = read(robot.table(columns, decimals=9, delimiter=" "))
    np.testing.assert_allclose(m.observed, POINTS, atol=1e-5)
    np.testing.assert_allclose(np.degrees(m.state.positions), JOINTS, atol=1e-6)
    np.testing.assert_allclose(np.degrees(m.actual), JOINTS + 0.01, atol=1e-6)
    assert not any("no unit" in note for note in m.notes)


@pytest.mark.parametrize(
    ("points", "joints", "words"),
    [
        (robot.table(points_of(POINTS)), "", "no column has joints of robot (w b A1 A2 A3 A4 A5 A6 t): state their table"),
        (robot.table(points_of(POINTS[:9])), robot.table(joints_of(JOINTS)), "points.txt has 9 rows, joints.txt 12"),
        (robot.table(points_of(POINTS)), robot.table(joints_of(JOINTS[:, :5], "J1 J2 J3 J4 J5")), "no column of A6"),
        (robot.table(points_of(POINTS)), robot.table(joints_of(JOINTS)).replace("J6", "E1"), "joints.txt:1 column E1: not"),
        (robot.table(points_of(POINTS, ["x [ft]", "y", "z"])), robot.table(joints_of(JOINTS)), "unit 'ft' is none of mm"),
        (robot.table(points_of(POINTS)), robot.table(joints_of(JOINTS)).replace("J2", "A1"), "has another column of A1"),
        (robot.table({"id": np.arange(12), **points_of(POINTS)}, decimals=3), robot.table({"id": np.arange(3, 15), **joints_of(JOINTS)}, decimals=3), "points.txt:2: point '0.000' is not in joints.txt"),
        (robot.table(points_of(POINTS)), robot.table(joints_of(JOINTS)) + "1,2,3\n", "joints.txt:14: 3 cells, but 6 columns"),
    ],
)  # fmt: skip
def test_refused(read, points, joints, words):
    with pytest.raises(UserError) as fault:
        read(points, joints)
    assert words in str(fault.value)


@pytest.mark.statistical
def test_links_off_by_tenths_are_fitted(read):
    """Links off by 0.3 mm and 0.5 mrad leave 0.55 mm; the fit leaves the tracker's noise, also where it was not used."""
    joints = robot.random_joints(150)
    found = calibrate(read(robot.table(points_of(robot.measured(joints))), robot.table(joints_of(joints))))
    assert found.before_rms_um > 300.0
    assert found.fit.rms_um < 11.0
    assert found.cross_validation.rms_um < 20.0
    unseen = robot.random_joints(200, seed=9)
    flange = robot.NOMINAL.frames(np.zeros(6))[-1][:3, 3]
    errors = found.model.errors(MACHINE, State(np.radians(unseen)))
    corrected = tool_point(MACHINE, np.radians(unseen), TARGET, errors)
    left = rigidly_aligned(corrected, robot.real_arm().reflector(unseen) - flange)
    assert np.sqrt(np.mean(left**2)) < 0.02


@pytest.mark.statistical
def test_nothing_is_named_of_a_robot_whose_links_are_off(command):
    joints = robot.random_joints(100)
    Path("robot.toml").write_text(robot.toml())
    Path("points.csv").write_text(robot.table(points_of(robot.measured(joints))))
    Path("joints.csv").write_text(robot.table(joints_of(joints)))
    header = [part for key, value in HEADER.items() for part in ("--header", f"{key}={value}")]
    done = command(
        "diagnose", "points.csv", "--plan", "joints.csv", "--machine", "robot.toml", *header, "-o", "new.json", "--json", "-"
    )  # fmt: skip
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["accepted"]
    assert found["effects"] == []
    assert found["after"]["rms_um"] < 11.0


def rigidly_aligned(one, other):
    """Differences (n, 3), mm, after the best rigid motion."""
    a, b = one - one.mean(axis=0), other - other.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    return a @ u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt - b


@pytest.mark.integration
def test_a_robot_logged_before_it_had_settled(read):
    """A read-back that lags 0.02 % of the last move, 20 to 100 urad, is far above the rounding of joint angles."""
    joints = robot.random_joints(60)
    moves = np.diff(joints, axis=0, prepend=joints[:1])
    reached = joints - 2e-4 * moves
    columns = {**joints_of(joints), **joints_of(reached, " ".join(f"actual_J{i}" for i in range(1, 7)))}
    found = sanity(read(robot.table({**columns, **points_of(robot.measured(reached))}, decimals=6)))
    messages = [finding.message for finding in found if finding.check == "read-back"]
    assert any("had not settled" in message for message in messages), found


@pytest.mark.statistical
def test_the_nominal_machine_is_registered_without_the_noise_of_the_fit(command):
    """Gravity bends two joints; three reflectors at each pose look like joints that do not repeat."""
    rng = np.random.default_rng(2)
    joints = robot.random_joints(60)
    bent = np.radians(joints)
    bent[:, 1] += 1.2e-3 * np.sin(bent[:, 1])
    bent[:, 2] += 0.9e-3 * np.sin(bent[:, 1] + bent[:, 2])
    home = robot.NOMINAL.frames(np.zeros(6))[-1]
    places = np.array([[60.0, 40.0, 150.0], [-50.0, 30.0, 120.0], [10.0, -60.0, 190.0]])
    seen, nominal = (
        np.array([[robot.NOMINAL.frames(q)[-1] @ np.append(place, 1.0) for place in places] for q in angles])[..., :3]
        for angles in (bent, np.radians(joints))
    )
    seen = seen.reshape(-1, 3) + np.array([3000.0, 500.0, 200.0]) + rng.normal(0.0, 0.005, (180, 3))
    nominal = nominal.reshape(-1, 3)
    a, b = nominal - nominal.mean(axis=0), seen - seen.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    plain_um = 1e3 * np.sqrt(np.mean((b - a @ (u @ v).T) ** 2))
    targets = [f"# target.t{k}: {' '.join(f'{x:.4f}' for x in home[:3, :3] @ place)}" for k, place in enumerate(places)]
    rows = [
        ",".join([*(f"{q:.6f}" for q in joints[i // 3]), f"t{i % 3}", *(f"{x:.5f}" for x in point)])
        for i, point in enumerate(seen)
    ]
    head = ["# instrument: laser-tracker", "# u_range_um: 5", "# u_angle_um: 5", *targets]
    Path("arm.csv").write_text("\n".join([*head, "A1,A2,A3,A4,A5,A6,target,x,y,z", *rows]) + "\n")
    Path("robot.toml").write_text(robot.toml())
    fit = (
        "fit",
        "arm.csv",
        "--machine",
        "robot.toml",
        "--basis",
        "fourier:1",
        "--force",
        "-o",
        "c.json",
        "--json",
        "-",
    )
    done = command(*fit)
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert max(found["estimated_noise"]["non_repeatability"].values()) > 200.0
    assert found["before"]["rms_um"] == pytest.approx(plain_um, rel=0.005)
