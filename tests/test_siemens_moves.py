"""Siemens programs: polar coordinates, arcs by angle and by turns, frames, planes, vectors, cycles, radius compensation."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.programs import load, model_of, random_model, setup_of, shifted, source_of
from support.siemens_programs import SIEMENS, correct, corrected, ends, judged, places, read

from kinematics.effects import Backlash
from kinematics.forward import forward
from kinematics.user_error import UserError
from postproc.correct.check import check
from postproc.motion.moves import Kind
from postproc.siemens.reading.blocks import read_block
from postproc.text.notes import Notes

OFFSET = {"X": 3.0, "Y": -4.2, "Z": 5.5}
HEAD = "G0 X0 Y0 Z0\nG1 F500\n"
angles = st.integers(-1800, 1800).map(lambda tenths: tenths / 10)
lengths = st.integers(-500, 500).map(lambda tenths: tenths / 10)
MODEL = random_model(load("gantry"), 8)


def interpreted(machine, text):
    """The moves with their blocks."""
    interpreter = SIEMENS.interpreter(machine, setup_of(machine), Notes())
    return interpreter.read(read_block(i, line) for i, line in enumerate(text.splitlines(keepends=True), start=1))


# ---- polar coordinates

POLAR = {
    "round the zero": ("AP=90 RP=20", (0, 20)),
    "G111": ("G111 X10 Y5\nAP=0 RP=20", (30, 5)),
    "G110": ("X1 Y2\nG110 X10 Y5\nAP=180 RP=1", (10, 7)),
    "G112": ("G111 X10 Y5\nG112 X1\nAP=0 RP=20", (31, 5)),
    "a pole by polar coordinates": ("G111 AP=90 RP=10\nAP=0 RP=1", (1, 10)),
    "the last radius": ("AP=90 RP=20\nAP=0", (20, 0)),
    "the manual's": ("G111 X43 Y38\nRP=30 AP=18\nG91 AP=72\nAP=IC(72)\nG90", (43 + 30 * math.cos(math.radians(162)), 38 + 30 * math.sin(math.radians(162)))),
    "inch": ("G700\nAP=90 RP=1\nG710", (0, 25.4)),
    "G18": ("G18 AP=90 RP=20", (20, 0)),
}  # fmt: skip


@pytest.mark.parametrize("name", POLAR)
def test_polar_coordinates(name):
    text, (x, y) = HEAD + POLAR[name][0] + "\n", POLAR[name][1]
    written, motions = judged(text, MODEL)
    assert places(motions)[-1, :2] == pytest.approx([x, y], abs=1e-9)
    assert correct(text) == text
    moves = [line for line in written.splitlines() if not line.startswith(("G110", "G111", "G112"))]
    assert not any("AP" in line or "RP" in line for line in moves), written


def test_arcs_round_the_pole():
    written, motions = judged(HEAD + "G111 X10 Y0\nG1 AP=180 RP=20\nG2 AP=90\nG3 AP=180 RP=20 Z5\n", MODEL)
    assert [Kind(kind) for kind in motions.kind[-2:]] == [Kind.ARC] * 2
    assert motions.arcs[2].centre == (10, 0)
    assert re.search(r"^G2 X\S+ Y\S+ \S*.*I\S+ J", written, re.M), written


# ---- arcs

ARCS = {
    "G3 X10 Y10 AR=90": (0, 10),
    "G2 X10 Y10 AR=90": (10, 0),
    "G3 X10 Y10 AR=270": (10, 0),
    "G3 I10 AR=180": (10, 0),
    "G2 J10 AR=90 Z5": (0, 10),
    "G91 G3 X10 Y10 AR=90\nG90": (0, 10),
    "G91 G3 I10 AR=180\nG90": (10, 0),
    "G3 I10 TURN=2 Z-5": (10, 0),
    "G2 X20 I10 TURN=1 Z-5": (10, 0),
    "G2 X0 Y20 Z10 I0 J10 K5": (0, 10),
    "G3 X20 Z-5 I=AC(10) J=AC(0) K=AC(-5)": (10, 0),
}


@pytest.mark.parametrize("block", ARCS)
def test_arcs_by_angle_and_by_turns(block):
    text = f"{HEAD}{block}\nG1 X1 Y1\n"
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    motions, after = read(text), read(written)
    assert motions.arcs[1].centre == pytest.approx(ARCS[block], abs=1e-9)
    assert motions.arcs[1].turns == after.arcs[1].turns == (int(block.split("TURN=")[1][0]) if "TURN" in block else 0)
    np.testing.assert_allclose(places(after) - places(motions), np.tile([-3e-3, 4.2e-3, -5.5e-3], (3, 1)), atol=1e-9)
    assert after.arcs[1].centre == pytest.approx(np.add(ARCS[block], (-3e-3, 4.2e-3)), abs=2e-4)
    assert "AR=" not in written
    assert correct(text) == text


def test_the_centre_of_a_helix_in_space_stays_across_its_plane():
    """The manual gives a helix as G2 X Y Z I J K TURN=; K is a coordinate of the centre that the plane does not need."""
    text = "G1 X0 Y50 Z0 F1000\nG2 X0 Y0 Z10 I0 J-25 K5\n"
    written, notes = corrected(text, model=shifted(load("gantry"), **OFFSET))
    assert written.splitlines()[1] == "G2 X-0.0030 Y0.0042 Z9.9945 I0 J-25 K5"
    assert "K of an arc lies across the plane of its circle: taken as without effect" in str(notes)


# ---- frames against matrices written here


def matrix(statement):
    """4 x 4, of one frame statement."""
    name, values = statement
    name, m = name.removeprefix("A"), np.eye(4)
    if name == "TRANS":
        m[:3, 3] = [values.get(axis, 0.0) for axis in "XYZ"]
    elif name == "MIRROR":
        m[:3, :3] = np.diag([-1.0 if axis in values else 1.0 for axis in "XYZ"])
    elif name == "SCALE":
        m[:3, :3] *= values["X"]
    else:
        for axis in "ZYX":
            i, j = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
            c, s = math.cos(math.radians(values.get(axis, 0.0))), math.sin(math.radians(values.get(axis, 0.0)))
            turn = np.eye(4)
            turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
            m = m @ turn
    return m


some = st.dictionaries(st.sampled_from("XYZ"), lengths, min_size=1)
statements = st.one_of(
    st.tuples(st.sampled_from(["TRANS", "ATRANS", "ATRANS"]), some),
    st.tuples(st.sampled_from(["ROT", "AROT", "AROT"]), st.dictionaries(st.sampled_from("XYZ"), angles, min_size=1)),
    st.tuples(
        st.sampled_from(["MIRROR", "AMIRROR"]), st.dictionaries(st.sampled_from("XYZ"), st.just(0.0), min_size=1)
    ),
    st.tuples(st.just("ASCALE"), st.sampled_from([0.5, 2.0]).map(lambda f: dict.fromkeys("XYZ", f))),
)


@settings(max_examples=30)
@given(st.lists(statements, min_size=1, max_size=4), lengths, lengths, lengths)
def test_frames_are_products_of_matrices(frames, x, y, z):
    text, whole = "G54\nG0 X0 Y0 Z0\n", np.eye(4)
    for name, values in frames:
        text += name + "".join(f" {axis}{value}" for axis, value in values.items()) + "\n"
        whole = (whole if name.startswith("A") else np.eye(4)) @ matrix((name, values))
    text += f"G1 X{x} Y{y} Z{z} F500\n"
    offset = np.array([1.0, 2.0, 3.0])
    reached = read(text, offsets=["G54=1,2,3"]).machine_target[-1]
    np.testing.assert_allclose(reached, (whole @ [x, y, z, 1.0])[:3] + offset, atol=1e-9)
    assert correct(text) == text


# ---- the tool turned: planes and vectors


def pose(motions, machine):
    """Tool points and tool axes in the workpiece frame of all moves, by the exact kinematics."""
    found = forward(load(machine), motions.machine_target)
    return found.apply(motions.tool), found.rotation[:, :, 2]


FIVE = ["dmu50", "trunnion_ac", "trunnion_bc", "head_table", "head_head"]


@pytest.mark.parametrize("machine", FIVE)
@settings(max_examples=10)
@given(st.tuples(*[st.integers(-40, 40)] * 3), lengths, lengths)
def test_tool_vectors(machine, vector, x, y):
    a, b = vector[0] / 100, vector[1] / 100
    text = f"T1 M6 D1\nG0 X0 Y0 Z50\nTRAORI\nROT Z30\nG1 X{x} Y{y} Z20 A3={a} B3={b} C3=1 F500\nX=IC(1) Y1\n"
    points, axes = pose(read(text, machine, tools=["T1=80"]), machine)
    turn = matrix(("ROT", {"Z": 30.0}))[:3, :3]
    np.testing.assert_allclose(points[1], turn @ [x, y, 20.0], atol=1e-8)
    np.testing.assert_allclose(axes[1], turn @ [a, b, 1.0] / math.sqrt(a * a + b * b + 1.0), atol=1e-8)
    np.testing.assert_allclose(axes[2], axes[1], atol=1e-8)


def test_vectors_stay_and_the_point_is_corrected():
    text = "T1 M6 D1\nG0 X0 Y0 Z50\nTRAORI\nG1 X10 Y5 Z20 A3=0.1 B3=0.2 C3=1 F500\nX12 B3=0.3 C3=1\nTRAFOOF\n"
    written, _ = judged(text, random_model(load("trunnion_ac"), 4), "trunnion_ac", tools=["T1=80"])
    assert "A3=0.1 B3=0.2 C3=1 F500" in written
    assert "B3=0.3 C3=1" in written
    alone = [block.text.split()[0] for block in interpreted(load("trunnion_ac"), text).blocks if block.no_insertion]
    assert alone == ["G1", "X12"]


PLANES = {
    '57,0,0,0,30,0,0,0,0,0': (0.0, {"X": 30.0}),
    '57,0,0,0,0,-20,0,0,0,0': (0.0, {"Y": -20.0}),
    '39,10,20,5,30,15,0,0,0,0': (5.0, {"Z": 30.0, "X": 15.0}),
    '57,10,20,5,10,0,0,1,2,3': (0.0, {"X": 10.0}),
}  # fmt: skip


@pytest.mark.parametrize("machine", FIVE)
@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("direction", [-1, 1])
def test_tilted_planes(machine, plane, direction):
    text = f'T1 M6 D1\nG0 X0 Y0 Z50\nCYCLE800(1,"TC1",0,{plane},{direction},100,1)\nG0 X5 Y7\nZ9\nG1 X25 F500\nG2 X35 I5\nCYCLE800()\n'
    turn = np.eye(4)
    for axis, angle in PLANES[plane][1].items():
        turn = turn @ matrix(("ROT", {axis: angle}))
    _, *values = plane.split(",")
    before, behind = np.array(values[:3], float), np.array(values[6:9], float)
    motions = read(text, machine, tools=["T1=80"])
    points, axes = pose(motions, machine)
    np.testing.assert_allclose(axes[-1], turn[:3, 2], atol=1e-8)
    np.testing.assert_allclose(points[-1], before + turn[:3, :3] @ (np.array([35.0, 7.0, 9.0]) + behind), atol=1e-7)


def test_moves_on_a_tilted_plane_are_corrected():
    text = 'T1 M6 D1\nG0 X0 Y0 Z50\nCYCLE800(1,"TC1",0,57,1,2,3,20,-10,0)\nG0 X5 Y7\nZ9\nG1 X25 F500\nG2 X35 I5\nCYCLE800()\n'
    written, _ = judged(text, random_model(load("trunnion_ac"), 4), "trunnion_ac", tools=["T1=80"])
    assert text.splitlines()[2] in written
    assert correct(text, "trunnion_ac", tools=["T1=80"]) == text


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        ('CYCLE800(1,"",0,64,0,0,0,30,0,0)', "CYCLE800 with MODE = 64 is not followed"),
        ('CYCLE800(1,"",100,57,0,0,0,30,0,0)', "ST = 100"),
        ('CYCLE800(1,"",0,57,0,0,0,30,0,0,0,0,0,0)', "CYCLE800 with DIR = 0 is not followed"),
        ('CYCLE800(1,"",0,57,0,0,0,R5,0,0)', "A of CYCLE800: R5 is not set"),
        ('CYCLE800(1,"",0,57,0,0,0,180,0,0)', "no position of the rotary axes"),
        ('CYCLE800(1,"",0,57,0,0,0,20,0,0)\nG0 C5', "a rotary axis moves in a tilted plane of CYCLE800"),
        ('CYCLE800(1,"",0,57,0,0,0,20,0,0) X5', "CYCLE800 must be alone in its block"),
    ],
)
def test_planes_that_are_refused(call, reason):
    with pytest.raises(UserError) as caught:
        read(f"G0 X0 Y0 Z50\n{call}\n", "trunnion_ac")
    assert reason in str(caught.value)


# ---- cycles, radius compensation, corners

DRILLED = "MCALL CYCLE81(10,0,2,-5)\nX10 Y10\nX30\nMCALL\nG0 X50 Y0\nCYCLE83(20,0,1,-9)\nX60\n"


def test_holes():
    written, motions = judged(HEAD + DRILLED, MODEL)
    assert places(motions)[:, 2].tolist() == [0, 0, 10, 10, 10, 10, 20, 20]
    assert re.findall("(?m)^.*CYCLE.*$|^MCALL$", written) == re.findall("(?m)^.*CYCLE.*$|^MCALL$", HEAD + DRILLED)
    assert re.search(r"(?m)^X30\.\d+ Y9\.\d+ Z10\.\d+$", written), written
    notes = corrected(HEAD + DRILLED)[1]
    assert any(note.startswith("CYCLE81 runs from the corrected position; its arguments stay") for note in notes)


def test_check_counts_a_hole_once():
    machine = load("gantry")
    found = check(source_of(HEAD + DRILLED, "test.mpf"), SIEMENS, machine, setup_of(machine))
    assert (found.corrected, found.machine, found.repeated) == ([1, 4, 5, 7, 9], [8], [])


def test_holes_on_a_turned_frame():
    judged(f"{HEAD}AROT Z30\nG0 X0 Y0 Z20\n{DRILLED}", MODEL)


def test_holes_on_a_tilted_plane():
    model = random_model(load("trunnion_ac"), 8)
    text = 'G0 X0 Y0 Z100\nCYCLE800(1,"A",0,57,0,0,0,20,0,0)\nG0 X0 Y0 Z20\n' + DRILLED
    written, _ = judged(text, model, "trunnion_ac")
    assert "MCALL CYCLE81(10,0,2,-5)" in written


def test_patterns_and_pockets_stay_and_are_noted():
    text = (
        HEAD
        + "MCALL CYCLE82(10,0,2,-5,,1)\nHOLES2(0,0,20,0,60,6)\nMCALL\nPOCKET3(10,0,1,-5,20,10,2,5,5,0,2,0,0,100)\nG0 X1 Y1 Z10\n"
    )
    written, notes = corrected(text, model=MODEL)
    assert "HOLES2(0,0,20,0,60,6)\n" in written
    assert "POCKET3(10,0,1,-5,20,10,2,5,5,0,2,0,0,100)\n" in written
    assert {note.partition(":")[0] for note in notes if "not corrected" in note} == {"HOLES2", "POCKET3"}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("MCALL CYCLE81(10,0,2,-5)\nSUPA Z50", "machine coordinates while TRAORI or MCALL"),
        ("MCALL CYCLE81(10,0,2,-5)\nX=IC(5) Y1\nHOLES1(0,0,0,5,5,3)\nX=IC(5)", "an increment of X needs a known start"),
        ("CYCLE81(10) CYCLE82(10)", "a cycle call must be alone in its block"),
        ("MCALL L10", "the file has no subprogram L10"),
    ],
)
def test_cycles_that_are_refused(text, reason):
    with pytest.raises(UserError) as caught:
        read(HEAD + text + "\n")
    assert reason in str(caught.value)


def test_radius_compensation_and_corners():
    text = HEAD + "G41 X10 Y10\nX30\nG3 X40 Y20 CR=10\nG1 X40 Y40 RND=2\nX0\nRNDM=1\nX-10\nRNDM=0\nG40 X-20\n"
    written, _ = judged(text, MODEL)
    notes = corrected(text, model=MODEL)[1]
    assert any("radius compensation: the points of the contour are corrected" in note for note in notes)
    assert any("the corner points are corrected" in note for note in notes)
    assert "RND=2" in written
    blocks = interpreted(load("gantry"), text).blocks
    assert [block.text.strip() for block in blocks if block.no_insertion] == [*text.splitlines()[2:7], "X-10"]


# ---- axes beside the chain


def test_words_of_passive_axes_pass():
    machine = load("gantry")
    machine = dataclasses.replace(machine, control=dataclasses.replace(machine.control, passive_axes=("E", "ELX")))
    motions = interpreted(machine, "G1 X1 Y2 Z3 E=5 F100\nE=IC(2)\nELX=30.5\nX5 E6\n")
    assert motions.target.tolist() == [[1, 2, 3], [5, 2, 3]]


def test_ends_of_conditions_that_read_alike_either_way():
    assert ends("G1 X0\nR1=1 R2=0\nIF R1==1 AND R2==1\nX9\nENDIF\nIF R1==1 AND NOT R2\nX2\nENDIF\n") == [0, 2]


# ---- backlash


PLAY = model_of(load("gantry"), Backlash("X", 20.0), Backlash("Y", 10.0))


def test_pieces_of_a_helix_of_several_turns_do_not_say_how_often_it_turns():
    written, _ = corrected(HEAD + "G3 I10 TURN=2 Z-5\nG1 X5\n", model=PLAY)
    assert "TURN" not in written
    assert written.count("NCOMP ARC") >= 8


def test_no_block_comes_between_holes():
    """Every move would drill."""
    text = HEAD + "X10 Y10\nMCALL CYCLE81(10,0,2,-5)\nG1 X30\nX5\nMCALL\nG1 X1\n"
    written, _ = corrected(text, model=PLAY)
    assert "NCOMP" not in written.partition("MCALL C")[2].partition("MCALL\n")[0]
    assert "NCOMP TAKE-UP" in corrected(HEAD + "G1 X30\nX5\n", model=PLAY)[0]


@pytest.mark.parametrize(
    "block", ["G111 X10 Y0\nG1 AP=180 RP=20\nG2 AP=10\nG3 AP=180 RP=20 Z5", "G3 X10 Y10 AR=270\nG3 I10 AR=200"]
)
def test_arcs_in_other_words_are_cut_where_an_axis_turns_back(block):
    written, motions = judged(f"{HEAD}{block}\nG1 X1 Y1\n", PLAY, least=5.0)
    assert "NCOMP ARC" in written
    assert (motions.kind == Kind.ARC).sum() == 2
