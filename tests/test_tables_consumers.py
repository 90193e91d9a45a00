"""Exports for routers and printers in their controls: what they send the axes to, and the error that is left there."""

import re

import numpy as np
import pytest
from support.consumers import BOW, CONSUMERS, IN_LINUXCNC, MACHINE, SKEW, STEPS, linuxcnc_has_matrixkins, outcome
from support.programs import load, model_of

import machines
import ncomp
from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion, LocationError
from kinematics.error_model.model import write_model
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control_data.tables.mesh_moves import KLIPPER_FINEST, Cells, departure, largest_departure
from postproc.control_data.tables.terms import Surface

LEFT = {
    "grbl": (0.75, 0.2, 0.85),
    "marlin": (0.75, 0.45, 0.35),
    "reprap": (0.75, 0.45, 0.35),
    "klipper": (0.75, 0.45, 0.35),
    "linuxcnc-matrix": (0.01, 0.01, 0.9),
    "linuxcnc-calibxyz": (0.01, 0.01, 0.01),
}
"""Share of the error in X, Y and Z that each leaves at most: of skew, scales and a bow of the bed."""


def test_linuxcnc_takes_positions_or_corrections_of_both_ways():
    """COMP_FILE_TYPE 0 has the positions that the machine reaches, 1 what is taken off."""
    machine = load("gantry")
    model = model_of(machine, Backlash("X", 20.0), ErrorMotion("X", "X", Polynomial((0.0, 2000.0), 1), (5.0, 30.0)))
    reached, corrected = (
        np.loadtxt(
            ncomp.export(machine, "linuxcnc", model, settings=(f"type={kind}",)).files["comp_x.txt"].splitlines()
        )
        for kind in (0, 1)
    )
    assert np.ptp(corrected[:, 1] - corrected[:, 2]) == pytest.approx(0.0, abs=2e-6)
    assert abs(corrected[0, 1] - corrected[0, 2]) == pytest.approx(0.02, abs=2e-6)
    np.testing.assert_allclose(reached[:, [1, 2]], reached[:, [0]] - corrected[:, [1, 2]], atol=2e-6)


def rms(errors):
    return np.sqrt(np.mean(errors**2, axis=0))


def check(form, consumer, found):
    assert found.apart.max() < consumer.within
    assert (rms(found.after) < np.array(LEFT[form]) * rms(found.before)).all()
    assert np.linalg.norm(rms(found.before)) > 50.0


@pytest.mark.parametrize("form", CONSUMERS)
def test_the_error_in_its_control_is_that_of_the_page(form, request):
    consumer = CONSUMERS[form]
    if consumer.client:
        request.getfixturevalue(consumer.client)
    found = outcome(form, consumer, 150)
    check(form, consumer, found)
    assert np.linalg.norm(rms(found.after)) == pytest.approx(found.told["rms"], rel=0.1, abs=0.1)
    steps = 1e3 / STEPS / np.sqrt(12) if form == "grbl" else 0.0  # whole steps, which the page does not count
    assert rms(found.before) == pytest.approx(found.along["before"], rel=0.1)
    assert rms(found.after) == pytest.approx(np.hypot(found.along["after"], steps), rel=0.1, abs=0.1)
    assert np.linalg.norm(found.after, axis=1).max() < 1.05 * found.told["max"] + 1e3 * consumer.within


@pytest.mark.statistical
@pytest.mark.usefixtures("linuxcnc_sim")
def test_linuxcnc_moves_its_joints_by_the_matrix():
    if not linuxcnc_has_matrixkins():
        pytest.skip("this LinuxCNC has no matrixkins: it came after 2.9")
    check("linuxcnc-matrix", IN_LINUXCNC, outcome("linuxcnc-matrix", IN_LINUXCNC, 12))


def test_signs_by_hand():
    """Y leans by 40 urad to -X: 40 um at Y 1000, which X goes farther. X travels 30 um/m too far: fewer steps."""
    machine = load(MACHINE)
    leaning = model_of(machine, LocationError("C", "Y", 40.0))
    text = {
        form: "".join(ncomp.export(machine, form, leaning).files.values()) for form in ("marlin", "reprap", "klipper")
    }
    assert text["marlin"] == "G21\nM852 I-0.0000400000 J0.0000000000 K0.0000000000\n"
    assert text["reprap"] == "M556 S100 X0.00400000 Y0.00000000 Z0.00000000 P0\n"
    assert "xy_skew = -0.000040000000\n" in text["klipper"]
    assert "C_xy 4e-05\n" in ncomp.export(machine, "linuxcnc-matrix", leaning).files["matrixkins.hal"]
    calibrated = ncomp.export(machine, "linuxcnc-calibxyz", leaning).files["calibxyzkins.hal"]
    assert float(re.search(r"calib-a\.xy (\S+)", calibrated)[1]) == pytest.approx(-4e-5, abs=1e-12)
    long = model_of(machine, ErrorMotion("X", "X", Polynomial((0.0, 1800.0), 1), (0.0, 54.0), u=(0.0, 0.0)))
    steps = ncomp.export(machine, "grbl", long, settings=("steps=X:250,Y:250,Z:400",)).files["grbl.txt"]
    assert steps == "$100=249.99250\n$101=250.00000\n$102=400.00000\n"
    matrix = ncomp.export(machine, "linuxcnc-matrix", long).files["matrixkins.hal"]
    assert float(re.search(r"C_xx (\S+)", matrix)[1]) == pytest.approx(1 - 30e-6, abs=2e-9)


def test_scale_by_steps_and_the_rest_by_skew_and_mesh():
    """`grbl` for the steps per mm of M92, then `marlin` of what they leave: together in X, Y and Z of the firmware."""
    found = outcome("marlin", CONSUMERS["marlin"], before=("grbl", CONSUMERS["grbl"]))
    assert (rms(found.after) < 1e3 / STEPS / np.sqrt(12) + 0.2).all(), "whole steps alone are left"
    assert np.linalg.norm(rms(found.before)) > 50.0


def test_two_axes_of_one_letter():
    """X follows the squareness of Y and of Y1; the control has one Y."""
    axes = "".join(f"[axes.{axis}]\ntravel = [0, 400]\n" for axis in ("X", "Y", "Z", "Y1"))
    machine = machines.parse(f'name = "two"\nchain = "w Y1 b X Y Z t"\n{axes}', "two")
    model = model_of(machine, LocationError("C", "Y", 40.0), LocationError("C", "Y1", 30.0))
    for form in ("klipper", "marlin", "linuxcnc-matrix"):
        with pytest.raises(UserError, match="machine two: two of its axes are X or Y, and the control has one"):
            ncomp.export(machine, form, model)


def test_klipper_splits_a_corrected_move_within_what_the_page_states(klipper):
    """Skew and mesh together, along moves: the ends of the parts are on the mesh, and between them it is near."""
    machine = load(MACHINE)
    exported = ncomp.export(machine, "klipper", model_of(machine, *SKEW, *BOW))
    mesh = next(term.factors[0] for term in exported.content.terms if isinstance(term.factors[0], Surface))
    settings = {
        "split_delta_z": KLIPPER_FINEST.split_delta_z,
        "move_check_distance": KLIPPER_FINEST.move_check_distance,
    }
    rng = np.random.default_rng(5)
    positions = rng.uniform([0.0, 0.0, 0.0], [1800.0, 1500.0, 400.0], (20, 3))
    moves = klipper.corrected(exported.files["ncomp.cfg"], settings, positions.tolist())
    q, columns = np.zeros((20, 3)), [machine.index(axis) for axis in "XYZ"]
    q[:, columns] = positions
    ends = exported.moves(q, np.zeros_like(q))[:, columns]
    assert max(map(len, moves)) > 3
    limit = 1.05 * largest_departure(mesh, KLIPPER_FINEST)
    for start, end, parts in zip(ends[:-1], ends[1:], moves, strict=True):
        nodes = np.array([start, *parts])
        assert parts[-1] == pytest.approx(end, abs=2e-5)  # Klipper looks the mesh up behind its skew
        at = np.linspace(0.0, 1.0, 200)[:, None]
        wanted = start[:2] + at * (end - start)[:2]
        along = np.linalg.norm(nodes[:, :2] - nodes[0, :2], axis=1)
        length = along[-1] * at[:, 0]
        heights = mesh.at(lambda axis, wanted=wanted: wanted[:, "XY".index(axis)])
        commanded = (start[2] - heights[0]) + at[:, 0] * ((end[2] - heights[-1]) - (start[2] - heights[0]))
        assert np.abs(np.interp(length, along, nodes[:, 2]) - commanded - heights).max() <= limit


def test_marlin_divides_a_move_at_the_lines_of_its_mesh():
    """Lines every 50 mm: a move along X of 30 ... 170 has ends at 50, 100 and 150, and is nowhere off the mesh."""
    nodes = np.linspace(0.0, 200.0, 5)
    mesh = Surface(("X", "Y"), (nodes, nodes), np.outer(nodes % 100.0, np.ones(5)) * 1e-3)
    start, end = np.array([30.0, 10.0]), np.array([170.0, 10.0])
    assert Cells().ends(mesh, start, end) == pytest.approx([0.0, 20.0, 70.0, 120.0, 140.0])
    assert departure(mesh, start, end, Cells()) == pytest.approx(0.0, abs=1e-12)
    assert Cells().ends(mesh, end, start) == pytest.approx([0.0, 20.0, 70.0, 120.0, 140.0])


def test_what_a_format_cannot_hold_is_refused(command, tmp_path):
    machine = load(MACHINE)
    write_model(model_of(machine, LocationError("C", "Y", 40.0), Backlash("X", 12.0)), tmp_path / "cal.json")
    for settings, said in (
        (["steps=X:250,Y:250,Z:400"], r"can hold nothing of this calibration \(E_C0Y, backlash X\)"),
        (["steps=X:250,Y"], "expected the present steps per mm of each axis, as X:250,Y:250,Z:400"),
        (["steps=X:1e9"], "expected the present steps per mm of each axis"),
        ([], "--set steps=VALUE is missing, and the format needs it"),
    ):
        more = [word for setting in settings for word in ("--set", setting)]
        done = command("export", "-m", MACHINE, "-c", "cal.json", "--format", "grbl", "-o", "tables", *more)
        assert done.status == 2
        assert re.search(said, done.err), done.err
        assert not (tmp_path / "tables").exists()
    scale = model_of(machine, ErrorMotion("Y", "Y", Polynomial((0.0, 1500.0), 1), (0.0, 54.0), u=(0.0, 0.0)))
    with pytest.raises(UserError, match="the present steps per mm of Y as well"):
        ncomp.export(machine, "grbl", scale, settings=("steps=X:250",))
    for settings in (("x=10:190:5",), ("x=190:10:5", "y=0:9:3"), ("x=0:9:1", "y=0:9:3"), ("x=0:9:x", "y=0:9:3")):
        with pytest.raises(UserError, match="first and last position and number of the points"):
            ncomp.export(machine, "marlin", model_of(machine, *BOW), settings=settings)
    with pytest.raises(UserError, match="the points of the mesh along X are outside its travel"):
        ncomp.export(machine, "marlin", model_of(machine, *BOW), settings=("x=2000:2100:3", "y=0:1500:3"))
    with pytest.raises(UserError, match="can hold nothing"):
        ncomp.export(machine, "marlin", model_of(machine, *BOW))
    with pytest.raises(UserError, match="Marlin ignores a skew factor beyond 1"):
        ncomp.export(machine, "marlin", model_of(machine, LocationError("C", "Y", 1.2e6)))


GRBL = """\
$0=10 (step pulse, usec)
$13=0 (report inches, bool)
$100=249.993 (x, step/mm)
$101=250.000 (y, step/mm)
$102=400.100 (z, step/mm)
$110=5000.000 (x max rate, mm/min)
"""
M503 = """\
echo:; Linear Units:
echo:  G21 ; (mm)
echo:; Auto Bed Leveling:
echo:  M420 S1 Z0.00 ; Leveling ON
echo:  G29 W I0 J0 Z0.10000
echo:  G29 W I1 J0 Z0.20000
echo:  G29 W I0 J1 Z0.30000
echo:  G29 W I1 J1 Z0.40000
echo:; Bed Skew Factor:
echo:  M852 I0.001000 J-0.002000 K0.000500 ; Skew Factor
echo:; Filament settings:
"""
HAL = """\
loadrt [KINS]KINEMATICS
setp matrixkins.C_xx 1.00003  # X axis scale
setp matrixkins.C_xy 0.00004
net x-pos joint.0.motor-pos-cmd => stepgen.0.position-cmd
"""
PRESENT, POINTS = ("steps=X:250,Y:250,Z:400",), ("x=0:100:2", "y=0:200:2")


def corrections(form, files, positions, settings=()):
    """What a control with these files adds to X, Y and Z `(n, 3)`, mm, at positions `(n, 3)`."""
    machine = load(MACHINE)
    columns = [machine.index(axis) for axis in "XYZ"]
    q = np.zeros((len(positions), 3))
    q[:, columns] = positions
    effects = ncomp.import_tables(files, machine, form, settings=settings).effects
    errors = model_of(machine, *effects).errors(machine, State(q, np.ones_like(q)))
    return -np.stack([errors[:, column, k] for k, column in enumerate(columns)], axis=1)


def test_what_controls_print_is_read(tmp_path):
    """`$$` of grbl, M503 of Marlin, a HAL file: the corrections by the formulas of their sources."""
    for name, text in (("grbl.txt", GRBL), ("m503.log", M503), ("mill.hal", HAL)):
        (tmp_path / name).write_text(text)
    at = np.array([[50.0, 100.0, 300.0], [0.0, 200.0, 0.0]])
    x, y, z = at.T
    found = corrections("grbl", tmp_path / "grbl.txt", at, PRESENT)
    scaled = [x * (249.993 / 250 - 1), 0 * y, (z - 400.0) * (400.1 / 400 - 1)]
    assert found == pytest.approx(np.stack(scaled, axis=1), abs=1e-9)
    found = corrections("marlin", tmp_path / "m503.log", at, POINTS)
    xy, xz, yz = 0.001, -0.002, 0.0005
    skewed = [-y * xy - z * (xz - xy * yz), -z * yz, np.array([0.25, 0.3])]
    assert found == pytest.approx(np.stack(skewed, axis=1), abs=1e-9)
    found = corrections("linuxcnc-matrix", tmp_path / "mill.hal", at)
    assert found == pytest.approx(np.stack([x * 3e-5 + y * 4e-5, 0 * y, 0 * z], axis=1), abs=1e-9)
    (tmp_path / "skew.g").write_text("M556 S100 X0.4 P1\n")
    found = corrections("reprap", tmp_path / "skew.g", at)
    assert found == pytest.approx(np.stack([0 * x, x * 0.004, 0 * z], axis=1), abs=1e-9)


@pytest.mark.parametrize(
    ("form", "text", "settings", "said"),
    [
        ("grbl", GRBL + "$100=1\n", PRESENT, "grbl.txt:7: '$100=1': a second value of X"),
        ("grbl", GRBL, ("steps=X:250",), "grbl.txt:4: '$101=250.000 (y, step/mm)': give the present steps per mm of Y"),
        ("grbl", "$100=0\n", PRESENT, "expected a number of steps per mm above 0"),
        ("grbl", "$110=5000\n", PRESENT, "no table of format grbl in grbl.txt"),
        ("marlin", "G20\n" + M503, POINTS, "marlin.txt:1: 'G20': only mm, M852"),
        ("marlin", M503.replace("Z0.00 ", "Z10 "), POINTS, "the mesh fades out with the height"),
        ("marlin", M503.replace("S1 Z0.00", "S0"), POINTS, "levelling is off"),
        ("marlin", M503, (), "the files have a mesh without its positions"),
        ("marlin", M503.replace("W I", "W I1"), POINTS, "expected I 0 to 1 and J 0 to 1"),
        ("marlin", M503 + "M852 I0\n", POINTS, "marlin.txt:12: 'M852 I0': a second value"),
        ("marlin", M503.partition("echo:  G29")[0].replace("S1", "S0") + "M852\n", (), "no table of format marlin"),
        ("marlin", "M421 I0 J0 Q0.1\n", POINTS, "expected I, J and Z"),
        ("linuxcnc-matrix", "setp matrixkins.C_xq 1\n", (), "a pin of matrixkins that ncomp does not know"),
        ("linuxcnc-matrix", "net a matrixkins.C_xx\n", (), "expected setp PIN VALUE with a number"),
        ("linuxcnc-matrix", HAL + "setp matrixkins.C_xx 1\n", (), "this pin is set twice"),
        ("linuxcnc-matrix", HAL + "setp matrixkins.C_xz 1.0", (), "its number may be cut off"),
    ],
)
def test_what_is_not_understood_is_refused(form, text, settings, said, tmp_path):
    name = "grbl.txt" if form == "grbl" else f"{form}.txt"
    (tmp_path / name).write_text(text)
    with pytest.raises(UserError, match=re.escape(said)):
        ncomp.import_tables(tmp_path / name, load(MACHINE), form, settings=settings)
