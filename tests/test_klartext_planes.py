"""Tilted planes of Klartext: against rotation matrices and a forward kinematics that the tests write anew."""

import io
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.klartext_run import HEAD, TOOLS, Run, tips
from support.programs import WHOLE, load, random_model, setup_of, source_of

import ncomp
from kinematics.forward import forward
from kinematics.user_error import UserError
from postproc.compensation.correction import pose_errors
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.heidenhain.tilted_planes import by_axes
from postproc.motion.frames import euler, spatial
from postproc.motion.motions import merged
from postproc.motion.moves import Kind, Known
from postproc.text.block import Refusal
from postproc.verification.verify import read_motions

KLARTEXT = find_dialect("heidenhain", "", "")
angles = st.floats(-80, 80)


def about(axis, degrees):
    """A rotation matrix."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = [(1, 2), (2, 0), (0, 1)]["XYZ".index(axis)]
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def matrix(placement):
    return np.array(placement.turn).reshape(3, 3)


@given(angles, angles, angles)
def test_spatial_and_euler_angles(a, b, c):
    np.testing.assert_allclose(matrix(spatial(a, b, c)), about("Z", c) @ about("Y", b) @ about("X", a), atol=1e-12)
    np.testing.assert_allclose(matrix(euler(a, b, c)), about("Z", a) @ about("X", b) @ about("Z", c), atol=1e-12)


@given(angles, angles, angles)
def test_a_plane_by_its_axes(a, b, c):
    turn = about("Z", c) @ about("Y", b) @ about("X", a)
    leaning = turn[:, 0] + 0.3 * turn[:, 2]  # the base vector need not lie in the plane
    np.testing.assert_allclose(matrix(by_axes(7 * leaning, 0.2 * turn[:, 2])), turn, atol=1e-9)


def run(text, machine="dmu50", head=HEAD, **options):
    return Run(head + text, machine=machine, lengths=TOOLS, **options)


PLACES = "L X+0 Y+0 Z+0\nL X+30 Y+0 Z+0\nL IY+40\nL IZ-5\n"
SEEN = np.array([[0, 0, 0], [30, 0, 0], [30, 40, 0], [30, 40, -5.0]])


@settings(max_examples=25)
@given(a=st.floats(-25, 25), b=st.floats(-25, 25), c=st.floats(-170, 170))
def test_points_in_a_tilted_plane(a, b, c):
    a, b, c = (round(angle, 3) for angle in (a, b, c))
    if abs(a) + abs(b) < 1.0:
        return
    program = run(
        "CYCL DEF 7.0 DATUM\nCYCL DEF 7.1 X+12\nCYCL DEF 7.2 Z-3\n"
        f"PLANE SPATIAL SPA{a:+} SPB{b:+} SPC{c:+} TURN FMAX SEQ+\n" + PLACES,
        offsets=("0=5,6,7",),
    )
    turn = about("Z", c) @ about("Y", b) @ about("X", a)
    assert program.motions.kind.tolist() == [Kind.RAPID, Kind.MACHINE, *[Kind.LINE] * 4]
    found, axis = tips(program, slice(2, None))
    np.testing.assert_allclose(found, SEEN @ turn.T + [17, 6, 4], atol=1e-6)
    np.testing.assert_allclose(axis, np.broadcast_to(turn[:, 2], (4, 3)), atol=1e-6)
    # turning leaves the linear axes where they were
    np.testing.assert_allclose(program.axes("XYZ")[1], program.axes("XYZ")[0], atol=1e-9)


FORMS = {
    "euler": ("PLANE EULER EULPR+30 EULNU+20 EULROT+10 TURN", about("Z", 30) @ about("X", 20) @ about("Z", 10)),
    "vectors": ("PLANE VECTOR BX+1 BY+0 BZ+0 NX+0 NY-1 NZ+2 TURN", about("X", math.degrees(math.atan(0.5)))),
    "points": ("PLANE POINTS P1X+0 P1Y+0 P1Z+20 P2X+30 P2Y+0 P2Z+20 P3X+0 P3Y+40 P3Z+40 TURN", about("X", math.degrees(math.atan(0.5)))),
    "relative": ("PLANE SPATIAL SPA+10 SPB+0 SPC+30 TURN\nPLANE RELATIV SPB+15 TURN", about("Z", 30) @ about("X", 10) @ about("Y", 15)),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_forms_of_planes(name):
    text, turn = FORMS[name]
    program = run(text + "\n" + PLACES)
    found, axis = tips(program, slice(-4, None))
    np.testing.assert_allclose(found, SEEN @ turn.T, atol=1e-6)
    np.testing.assert_allclose(axis[0], turn[:, 2], atol=1e-6)


@pytest.mark.parametrize("name", ["dmu50", "head_head", "head_table", "trunnion_bc"])
def test_axial_planes_lie_as_the_axes_stand(name):
    machine = load(name)
    rotary = [axis.name for axis in machine.axes if axis.rotary]
    head = HEAD.replace("B+0 C+0", " ".join(f"{axis}+0" for axis in rotary))
    said = " ".join(f"{axis}{angle:+}" for axis, angle in zip(rotary, (20.0, 35.0), strict=True))
    program = run(f"PLANE AXIAL {said} TURN\n{PLACES}", machine=name, head=head)
    q = program.motions.machine_target[-4:]
    pose = forward(program.machine, q)
    found = pose.apply(np.array([0.0, 0.0, -100.0]))
    np.testing.assert_allclose(found, SEEN @ pose.rotation[0].T, atol=1e-6)
    np.testing.assert_allclose(program.axes(rotary)[-1], [20.0, 35.0], atol=1e-9)


def test_angles_for_the_rotary_axes():
    """STAY: the program turns them itself, by what the control has worked out."""
    program = run("PLANE SPATIAL SPA+0 SPB+20 SPC+0 STAY\nL B+Q121 C+Q122 FMAX\n" + PLACES)
    found, _ = tips(program, slice(-4, None))
    np.testing.assert_allclose(found, SEEN @ about("Y", 20).T, atol=1e-6)


def test_cycle_19_where_its_two_readings_are_one():
    head = HEAD.replace("B+0 C+0", "B+0 C+0")
    program = run("CYCL DEF 19.0 PLANE\nCYCL DEF 19.1 B+20\nL B+Q121 FMAX\n" + PLACES, machine="trunnion_bc", head=head)
    pose = forward(program.machine, program.motions.machine_target[-1:])
    np.testing.assert_allclose(pose.apply(np.array([0.0, 0.0, -100.0]))[0], about("Y", 20) @ SEEN[-1], atol=1e-6)
    with pytest.raises(Refusal, match="spatial angles or axis angles by a setting of the control"):
        run("CYCL DEF 19.0 PLANE\nCYCL DEF 19.1 B+20\n")
    with pytest.raises(Refusal, match="about an axis that the machine does not have"):
        run("CYCL DEF 19.0 PLANE\nCYCL DEF 19.1 A+20\n")


def test_a_reset_leads_back():
    program = run("PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\nL X+0 Y+0 Z+30\nPLANE RESET TURN\nL X+1 Y+2 Z+3\n")
    assert program.axes("XYZBC")[-1].tolist() == pytest.approx([1, 2, 103, 0, 0], abs=1e-9)
    program = run("PLANE SPATIAL SPA+0 SPB+20 SPC+0 MOVE\nL X+0 Y+0 Z+30\nPLANE RESET STAY\nL X+1 Y+2 Z+3 B+0 C+0\n")
    assert program.axes("XYZBC")[-1].tolist() == pytest.approx([1, 2, 103, 0, 0], abs=1e-9)


@pytest.mark.parametrize("before", ["L C+30\n", "", "PLANE SPATIAL SPA+0 SPB+20 SPC+40 TURN SEQ+\n"])
def test_a_flat_plane_by_table_rot_takes_the_table_to_0(before):
    """iTNC 530 DIN/ISO 6-2010, p. 404: the table goes to the tilting angle, here 0; TNC7 81762x-17 agrees."""
    program = run(before + "PLANE SPATIAL SPA+0 SPB+0 SPC+0 TURN FMAX SEQ+ TABLE ROT\nL X+1 Y+2 Z+3\n", machine="dmu50")
    assert program.axes("XYZBC")[-1].tolist() == pytest.approx([1, 2, 103, 0, 0], abs=1e-9)


def test_move_leaves_the_linear_axes_unknown():
    program = run("PLANE SPATIAL SPA+0 SPB+20 SPC+0 MOVE DIST50 F1000\n")
    assert [program.known(name) for name in "XYZ"] == [Known.ASSUMED] * 3
    assert program.known("B") == Known.MACHINE


REFUSED = [
    ("trunnion_bc", "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\n", "the program has not given"),
    ("dmu50", "L C+30\nPLANE SPATIAL SPA+0 SPB+0 SPC+30 TURN\n", "the tool is parallel to a rotary axis"),
    ("dmu50", "PLANE SPATIAL SPA+0 SPB+0 SPC+30 TURN TABLE ROT\n", "the tool is parallel to a rotary axis"),
    ("dmu50", "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN SEQ-\n", "SEQ-: no solution has this sign: write the other sign, or no SEQ"),
    ("head_head", "PLANE SPATIAL SPA+180 SPB+0 SPC+0 TURN\n", "no position of the rotary axes"),
    ("dmu50", "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\nL C+5\nL X+0\n", "not perpendicular"),
    ("dmu50", "M128\nPLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\n", "the working plane is tilted while M128 is on"),
    ("dmu50", "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\nM128\n", "M128 in a tilted plane"),
    ("dmu50", "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\nCYCL DEF 7.0 D\nCYCL DEF 7.1 X+5\nPLANE RESET STAY\n", "reset it before the plane ends"),
    ("dmu50", "CYCL DEF 10.0 ROT\nCYCL DEF 10.1 ROT+5\nPLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\n", "a rotation, mirror or scale, or a shift within another plane, is active before PLANE: reset it first"),
    ("dmu50", "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\nCYCL DEF 247 A Q339=1\n", "the preset changes in a tilted plane"),
]  # fmt: skip


@pytest.mark.parametrize(("machine", "text", "reason"), REFUSED)
def test_refused(machine, text, reason):
    rotary = [axis.name for axis in load(machine).axes if axis.rotary]
    said = "" if "not given" in reason else " ".join(f"{axis}+0" for axis in rotary)
    with pytest.raises(Refusal) as fault:
        run(text, machine=machine, head=HEAD.replace("B+0 C+0", said))
    assert reason in fault.value.reason


def test_a_shift_in_the_tilted_plane_is_along_its_axes():
    program = run(
        "PLANE SPATIAL SPA+0 SPB+20 SPC+0 TURN\nCYCL DEF 7.0 D\nCYCL DEF 7.1 X+5\nCYCL DEF 7.2 Z+2\n" + PLACES
    )
    found, _ = tips(program, slice(-4, None))
    np.testing.assert_allclose(found, np.add(SEEN, [5, 0, 2]) @ about("Y", 20).T, atol=1e-6)


@pytest.mark.parametrize("name", ["dmu50", "head_table", "trunnion_ac"])
def test_corrected_in_a_tilted_plane(name):
    machine = load(name)
    rotary = [axis.name for axis in machine.axes if axis.rotary]
    head = HEAD.replace("B+0 C+0", " ".join(f"{axis}+0" for axis in rotary))
    text = (
        head + "PLANE SPATIAL SPA+15 SPB+0 SPC+0 TURN SEQ+\nL X+0 Y+0 Z+30 FMAX\nL Z+0 F500\nL X+30\n"
        "CC X+30 Y+10\nC X+40 Y+10 DR+\nCYCL DEF 200 D Q200=2 Q201=-9 Q203=+0 Q204=50\nL X+5 Y+5 Z+3 M99\n"
        "PLANE RESET TURN\nL X+1 Y+2 Z+60\nEND PGM T MM\n"
    )
    setup, model = setup_of(machine, ("0=10,20,30",), TOOLS), random_model(machine, 4)
    out = io.BytesIO()
    job = Job(source_of(text, "t.h"), KLARTEXT, machine, model, setup, travel_check=False, **WHOLE)
    Pipeline(job).run(out, lambda _: None)
    written = out.getvalue().decode()
    nominal, commanded = (merged(read_motions(source_of(t, "t.h"), KLARTEXT, machine, setup)) for t in (text, written))
    rows = nominal.evaluated
    assert rows.sum() >= 7
    before, after = (
        pose_errors(machine, model, m.machine_target[rows], nominal.machine_target[rows], nominal.tool[rows]).point_um
        for m in (nominal, commanded)
    )
    assert before.max() > 20.0
    assert after.max() < 0.3
    assert "PLANE SPATIAL SPA+15 SPB+0 SPC+0 TURN SEQ+" in written


def test_presets_that_turn_the_coordinates(tmp_path):
    from postproc.control.setup import make_setup
    from postproc.control_data.tool_tables import read_tool_table

    path = tmp_path / "PRESET.PR"
    path.write_text(
        "BEGIN PRESET .PR MM\nNO  SPA   SPB   SPC    X     Y     Z\n3   +0    +0    +30    +1    +2    +3\n[END]\n"
    )
    machine = load("gantry")
    setup = make_setup(machine, table=read_tool_table(path), zero=True)
    text = "BEGIN PGM T MM\nCYCL DEF 247 SET Q339=3\nL X+10 Y+20 Z+5\nEND PGM T MM\n"
    motions = merged(read_motions(source_of(text, "t.h"), KLARTEXT, machine, setup))
    np.testing.assert_allclose(motions.machine_target[0], about("Z", 30) @ [10, 20, 5] + [1, 2, 3], atol=1e-9)


def test_lines_of_a_datum_table(tmp_path):
    from postproc.control.setup import make_setup
    from postproc.control_data.tool_tables import read_tool_table

    path = tmp_path / "ZERO.D"
    path.write_text("BEGIN ZERO .D INCH\nD    X     Y\n4    +1    +2\n[END]\n")
    machine = load("gantry")
    text = "BEGIN PGM T MM\nCYCL DEF 7.0 D\nCYCL DEF 7.1 #4\nL X+10 Y+20 Z+5\nEND PGM T MM\n"
    setup = make_setup(machine, table=read_tool_table(path), zero=True)
    motions = merged(read_motions(source_of(text, "t.h"), KLARTEXT, machine, setup))
    assert motions.machine_target[0].tolist() == pytest.approx([35.4, 70.8, 5.0])
    with pytest.raises(UserError, match="datum #4 is in no datum table"):
        read_motions(source_of(text, "t.h"), KLARTEXT, machine, make_setup(machine, zero=True))


def test_a_flat_plane_needs_no_position_of_the_rotary_axes():
    """Both solutions are one, so the control has no choice between them."""
    text = "BEGIN PGM A MM\nTOOL CALL 1 Z S1\nPLANE SPATIAL SPA+0 SPB+0 SPC+0 STAY\nL X+10 Y+5 Z+30 R0 FMAX\nM30\nEND PGM A MM\n"
    assert ncomp.correct(text, "dmu50", "none", dialect="heidenhain").text == text
