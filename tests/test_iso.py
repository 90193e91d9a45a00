"""Meaning of ISO programs: moves in machine axes worked out by hand, and everything that is refused."""

import dataclasses
import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.programs import load, read, setup_of

import machines
from kinematics.forward import tool_point
from kinematics.machine import Control
from kinematics.user_error import UserError
from postproc.iso.codes import HARMLESS_G, REFUSED_G, REFUSED_M
from postproc.iso.interpreter import IsoInterpreter
from postproc.iso.reading.lines import read_block
from postproc.motion.moves import Kind, Known
from postproc.text.block import Refusal
from postproc.text.notes import Notes
from postproc.text.source import CHUNK_BLOCKS

RAPID, LINE, ARC, MACHINE = Kind.RAPID, Kind.LINE, Kind.ARC, Kind.MACHINE
ROOT = math.sqrt(0.5)


def with_control(machine, **settings):
    return dataclasses.replace(machine, control=dataclasses.replace(Control(), **settings))


def rows(text, machine="gantry", **setup):
    """(kind, machine positions of X Y Z) of every move."""
    machine = load(machine) if isinstance(machine, str) else machine
    motions = read(text, machine, **setup)
    xyz = motions.machine_target[:, [machine.index(axis) for axis in "XYZ"]]
    return [(Kind(kind), *np.round(q, 9).tolist()) for kind, q in zip(motions.kind, xyz, strict=True)]


G54 = {"offsets": ["G54=100,200,300"]}
BOTH = {"offsets": ["G54=100,200,300", "G55=-1,-2,-3"]}

GOLDEN = {
    "absolute and increments": (
        "G90 G0 X10 Y20 Z30\nG91 G1 X1 Y-2\nZ.5\nG90 X0\nG91\nX-1\n",
        {},
        [(RAPID, 10, 20, 30), (LINE, 11, 18, 30), (LINE, 11, 18, 30.5), (LINE, 0, 18, 30.5), (LINE, -1, 18, 30.5)],
    ),
    "distance mode holds for its own block": (
        "G90 G0 X1 Y1 Z1\nX5 G91\nG90 X5\n",
        {},
        [(RAPID, 1, 1, 1), (RAPID, 6, 1, 1), (RAPID, 5, 1, 1)],
    ),
    "inches, and back": (
        "G20 G0 X1 Y2 Z-1\nG21 X10\nG20 G91 Y.1\n",
        {},
        [(RAPID, 25.4, 50.8, -25.4), (RAPID, 10, 50.8, -25.4), (RAPID, 10, 53.34, -25.4)],
    ),
    "words in any order, lower case, blanks": (
        "g0z - 3 y+.5x1.\ny2\n",
        {},
        [(RAPID, 1, 0.5, -3), (RAPID, 1, 2, -3)],
    ),
    "blocks without moves": (
        "G0 X1 Y1 Z1\nG4 X5.\nG4 P500\nF200\nN5\nM8 S100;\n(X9)\nX2 (X9) ; X9 etc\n/ (skip)\n/M8 F5\n/G4 P1\n#1=5\nF#1\n; X7",
        {},
        [(RAPID, 1, 1, 1), (RAPID, 2, 1, 1)],
    ),
    "axis words that are no move": (
        "G0 X1 Y1 Z1\nG50.1 X0 Y0\nG5.1 Q1 X0 Y0 Z0\nG5.1 Q0\nG91 X1\n",
        {},
        [(RAPID, 1, 1, 1), (RAPID, 2, 1, 1)],
    ),
    "work offset": ("G54 G0 X1 Y2 Z3\nX0\n", G54, [(RAPID, 101, 202, 303), (RAPID, 100, 202, 303)]),
    "work offset without motion": (
        "G54 G0 X1 Y2 Z3\nG55\nX0\nG91 X1\n",
        BOTH,
        [(RAPID, 101, 202, 303), (RAPID, -1, 202, 303), (RAPID, 0, 202, 303)],
    ),
    "extended work offsets": (
        "G54.1 P7 G0 X1 Y1 Z1\nG54 P8 X1\nG59.3 X1\nG54 X1\n",
        {"offsets": ["G54.1P7=X=10", "G54.1 P8=X=20", "G59.3=X=30", "g54=X=40"]},
        [(RAPID, 11, 1, 1), (RAPID, 21, 1, 1), (RAPID, 31, 1, 1), (RAPID, 41, 1, 1)],
    ),
    "tool length": (
        "G0 X0 Y0 Z5\nG43 H2 Z5\nZ6\nG49 Z5\nT1 M6\nG43 Z5\n",
        {"tools": ["T1=10", "T2=20"]},
        [(RAPID, 0, 0, 5), (RAPID, 0, 0, 25), (RAPID, 0, 0, 26), (RAPID, 0, 0, 5), (RAPID, 0, 0, 15)],
    ),
    "tool length without motion": (
        "G0 X0 Y0 Z5\nG43 H2\nX1\nG49\nX2\nG43 H0 Z1\n",
        {"tools": ["T2=20"]},
        [(RAPID, 0, 0, 5), (RAPID, 1, 0, 5), (RAPID, 2, 0, 5), (RAPID, 2, 0, 1)],
    ),
    "machine coordinates": (
        "G54 G0 X1 Y2 Z3\nG53 Z-5\nX2\nG53 G1 X7 Y8\nZ0\n",
        G54,
        [(RAPID, 101, 202, 303), (MACHINE, 101, 202, -5), (RAPID, 102, 202, -5), (MACHINE, 7, 8, -5), (LINE, 7, 8, 300)],
    ),
    "machine coordinates in inches": ("G20 G0 G53 X1 Y1 Z1\n", G54, [(MACHINE, 25.4, 25.4, 25.4)]),
    "reference point, then absolute": (
        "G0 X1 Y1 Z1\nG91 G28 Z0\nG90 X5\nG28\nX1\nG30 P2 Y0\nX2\n",
        {},
        [(RAPID, 1, 1, 1), (RAPID, 5, 1, 1500), (RAPID, 1, 0, 1500), (RAPID, 2, 0, 1500)],
    ),
    "tool change leaves Z": (
        "G0 X1 Y1 Z1\nT3 M6\nX5\nZ9\n", {}, [(RAPID, 1, 1, 1), (RAPID, 5, 1, 1500), (RAPID, 5, 1, 9)]
    ),
    "blocks after the end": ("G0 X1 Y1 Z1\nM30\nX50\n#1=2\n%\n", {}, [(RAPID, 1, 1, 1)]),
    "tape": ("(a)\n%\nO1 (B)\nG0 X1 Y1 Z1\nM30\n%\n\0\0\nX5\n", {}, [(RAPID, 1, 1, 1)]),
    "mark that only closes": ("G0 X1 Y1 Z1\n%\n(end)\n", {}, [(RAPID, 1, 1, 1)]),
    "feed modes": ("G93 G1 X1 Y1 Z1 F10\nG94 X2\n", {}, [(LINE, 1, 1, 1), (LINE, 2, 1, 1)]),
    "arc words without motion": ("G2\nG0 X1 Y1 Z1\n", {}, [(RAPID, 1, 1, 1)]),
    "dwell in a motion block's mode": ("G1 X1 Y1 Z1\nG4 P1\nX2\n", {}, [(LINE, 1, 1, 1), (LINE, 2, 1, 1)]),
}  # fmt: skip


@pytest.mark.parametrize("name", GOLDEN)
def test_moves_in_machine_axes(name):
    text, setup, expected = GOLDEN[name]
    assert rows(text, **setup) == [(kind, *map(float, position)) for kind, *position in expected]


# Start (10, 0) of the plane's own first and second axis, a quarter turn about the origin, third axis at 3.
PLANES = {"G17": ("XYZ", "IJ"), "G18": ("ZXY", "KI"), "G19": ("YZX", "JK")}
FORMS = {
    "incremental": "{0}-10 {1}0",
    "one word": "{0}-10",
    "absolute": "G90.1 {0}0 {1}0",
    "radius": "R10",
}


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("sense", "end"), [("G3", (0, 10)), ("G2", (0, -10))])
def test_quarter_turns(plane, form, sense, end):
    (first, second, third), letters = PLANES[plane]
    circle = FORMS[form].format(*letters)
    text = f"{plane} G0 {first}10 {second}0 {third}3\n{sense} {first}{end[0]} {second}{end[1]} {third}7 {circle}\n"
    machine = load("gantry")
    motions = read(text, machine)
    assert motions.kind.tolist() == [RAPID, ARC]
    arc = motions.arcs[1]
    assert [machine.names[i] for i in arc.plane] == [first, second, third]
    assert (arc.sense, arc.full) == (1 if sense == "G3" else -1, False)
    assert arc.centre == pytest.approx((0, 0), abs=1e-12)
    assert arc.form == (form if form in ("absolute", "radius") else "incremental")
    assert [motions.target[1, machine.index(axis)] for axis in (first, second, third)] == [*end, 7]


@pytest.mark.parametrize(("sense", "sign"), [("G2", 1), ("G3", -1)])
def test_radius_short_and_long_way(sense, sign):
    """From (0, 0) to (6, 0) with radius 5: the centres are (3, -4) and (3, 4)."""
    for radius, side in (("R5", -1), ("R-5", 1)):
        arc = read(f"G0 X0 Y0 Z0\n{sense} X6 Y0 {radius}\n", load("gantry")).arcs[1]
        assert arc.centre == pytest.approx((3, 4 * sign * side))


def test_radius_of_a_half_circle_may_be_rounded():
    arc = read("G0 X0 Y0 Z0\nG2 X10.001 Y0 R5\n", load("gantry")).arcs[1]
    assert arc.centre == pytest.approx((5.0005, 0))


def test_arcs_in_increments_inches_and_work_offsets():
    text = "G54 G0 X1 Y1 Z0\nG91 G3 X-.5 Y.5 I-.5\nG90 G0 X5.08 Y2.54\nG20 G90.1 G2 X.1 Y0 I.1 J.1\n"
    motions = read(text, load("gantry"), **G54)
    first, second = motions.arcs.values()
    assert first.centre == pytest.approx((0.5, 1))
    assert second.centre == pytest.approx((2.54, 2.54))
    assert motions.machine_target[1].tolist() == pytest.approx([100.5, 201.5, 300])


@pytest.mark.parametrize(
    "text",
    [
        "G2 X10 Y0 I-5\n",
        "G2 I-5\n",
        "G2 X10 I-5 J0\n",
        "G2 Z5 I-5\n",
        "G91 G3 X0 Y0 J3\n",
        "G90.1 G3 X10 I5 J0\n",
        "G55 X10 Y0\nG54 X10 Y0\nG2 X10 Y0 I-5\n",  # position through other frames, not exact any more
        "G43 H1 Z5\nG2 X10 Y0 I-5\n",
        "G91 X.1\nX.1\nX.1\nX-.3\nG90 G2 X10 I-5\n",
    ],
)
def test_full_circles(text):
    setup = {"offsets": ["G54=0.1,0.2,0.3", "G55=1e3,1e3,77.7"], "tools": ["T1=33.3"]}
    motions = read("G0 X10 Y0 Z0\n" + text, load("gantry"), **setup)
    (arc,) = motions.arcs.values()
    assert arc.full


@pytest.mark.parametrize("end", ["X10 Y.001", "X10.001 Y0"])
def test_nearly_full_circles_are_not_full(end):
    (arc,) = read(f"G0 X10 Y0 Z0\nG2 {end} I-5\n", load("gantry")).arcs.values()
    assert not arc.full


def test_modal_arcs():
    motions = read("G0 X0 Y0 Z0\nG2 X10 Y0 I5\nX0 Y0 I-5\nX0 Y0 R5\n".replace("X0 Y0 R5", "X6 Y0 R5"), load("gantry"))
    assert motions.kind.tolist() == [RAPID, ARC, ARC, ARC]


def test_machine_that_reads_absolute_centres():
    machine = with_control(load("gantry"), arc_centres="absolute")
    arcs = read("G0 X10 Y0 Z0\nG3 X0 Y10 I0 J0\nG91.1 X-10 Y0 I0 J-10\n", machine).arcs
    assert [arc.centre for arc in arcs.values()] == [(0, 0), (0, 0)]


def test_integer_words():
    machine = with_control(load("dmu50"), integer_words="increments", increment=0.001)
    motions = read("G0 X10 Y10. Z-0 B90000 C45.\nG91 X5\nG90 G2 X1000 Y10. R500\n", machine)
    x, y, z, b, c = (machine.index(axis) for axis in "XYZBC")
    assert motions.target[0, [x, y, z, b, c]].tolist() == [0.01, 10, 0, 90, 45]
    assert motions.target[1, x] == pytest.approx(0.015)
    assert motions.target[2, x] == 1.0
    assert motions.arcs[2].centre[1] == pytest.approx(10 + math.sqrt(0.25 - (0.985 / 2) ** 2) * -1, abs=1e-6)
    units = read("G0 X10 Y10. Z-0\n", load("dmu50"))
    assert units.target[0, x] == 10


# ---- five axes


def test_rotary_axes_and_their_offsets():
    machine = load("dmu50")
    motions = read("G0 X1 Y2 Z3 B10 C20\nG91 C-30\nG90 G20 B5\n", machine, offsets=["G54=10,20,30,B=1,C=2"])
    degrees = np.round(motions.machine_target / machine.scale, 9)
    names = [machine.index(axis) for axis in "XYZBC"]
    assert degrees[:, names].tolist() == [[11, 22, 33, 11, 22], [11, 22, 33, 11, -8], [11, 22, 33, 6, -8]]


def test_tool_centre_point_on_the_dmu50():
    """With the table level and turned by C = 90 the machine stands where the thesis' (3.23) puts it."""
    machine = load("dmu50")
    text = "G54 G0 X0 Y0 Z300 B0 C0\nG43.4 H1\nX10 Y0 Z20 C90\nB90 C0\nG49 Z250\n"
    motions = read(text, machine, offsets=["G54=0,0,154.996"], tools=["T1=100"])
    x, y, z = (machine.index(axis) for axis in "XYZ")
    q = motions.machine_target
    # by C = +90 the tool turns by +90 deg about z over the table: the table turns by -90, and brings (10, 0) to (0, -10)
    assert q[1, [x, y, z]] == pytest.approx([0, -10, 154.996 + 20 + 100], abs=1e-9)
    tip = tool_point(machine, q, motions.tool)
    assert tip[1:3] - [0, 0, 154.996] == pytest.approx(np.array([[10, 0, 20], [10, 0, 20]]), abs=1e-9)
    turned = rotation_about_slanting(math.radians(90)) @ [10, 0, 20] + [0, 0, 154.996 + 100]
    assert q[2, [x, y, z]] == pytest.approx(turned, abs=1e-9)
    assert q[3, [x, y, z]] == pytest.approx([turned[0], turned[1], 250 + 154.996], abs=1e-9)
    assert motions.known[3, [x, y, z]].tolist() == [Known.MACHINE, Known.MACHINE, Known.PROGRAM]


def rotation_about_slanting(angle):
    """The DMU 50's table turned by B about (0, -1, 1)/sqrt 2: Rodrigues' formula."""
    k = np.array([0, -ROOT, ROOT])
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def test_plain_length_offset_ends_tcp():
    machine = load("trunnion_bc")
    setup = {"offsets": ["G54=0,0,100"], "tools": ["T1=50"]}
    text = "G0 X10 Y0 Z20 B30 C0\nG43.4 H1 X10 Y0 Z20\n{} X10 Y0 Z20\n"
    plain = read("G0 X10 Y0 Z20 B30 C0\nG43 H1 X10 Y0 Z20\n", machine, **setup).machine_target[1]
    for code in ("G43 H1", "G49 G0"):
        motions = read(text.format(code), machine, **setup)
        length = 50 if code.startswith("G43") else 0
        assert motions.frames[motions.frame[2]].tcp is False
        assert motions.machine_target[2] == pytest.approx(plain - [0, 0, 0, 0, 50 - length], abs=1e-9)


def test_machine_with_tcp_from_the_start():
    machine = with_control(load("trunnion_ac"), tcp_at_start=True)
    motions = read("G0 X10 Y0 Z20 A-90 C0\n", machine)
    tip = tool_point(machine, motions.machine_target, (0, 0, 0))
    assert tip[0] == pytest.approx([10, 0, 20])


def test_tool_change_moves():
    for moves, expected in (
        (("Z",), (1, 1, 1500)),
        (("X", "Y", "Z"), (0, 0, 1500)),
        ((), (1, 1, 1)),
        (("A", "Y"), (1, 0, 1)),
    ):
        machine = with_control(load("gantry"), tool_change_moves=moves)
        motions = read("G0 X1 Y1 Z1\nT1 M6\nG55 G0 F5 X1\n".replace("X1\n", "\n") + "G53 G0\nG4 P1\nM8\nG0\n", machine)
        assert len(motions) == 1
        after = read("G0 X1 Y1 Z1\nT1 M6\nG53 G0 X1\n", machine)
        assert after.target[1].tolist() == [1, *expected[1:]]


# ---- what the program has said


def known(text, machine="gantry", row=-1, **setup):
    motions = read(text, load(machine), **setup)
    return [Known(k).name[0] for k in motions.known[row]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G0 X1\n", "PAA"),
        ("G0 X1 Y1 Z1\nG28 Z0\nX1\n", "PPA"),
        ("G0 X1 Y1 Z1\nG28\nX1\n", "PAA"),
        ("G0 X1 Y1 Z1\nM6\nX1\n", "PPA"),
        ("G0 X1 Y1 Z1\nM60\nX1\n", "PAA"),
        ("G0 X1 Y1 Z1\nM8\nX1\n", "PPP"),
        ("G0 X1 Y1 Z1\nM123\nX1\n", "PMM"),  # a maker's function: nobody knows what it moves
        ("G0 X1 Y1 Z1\nG53 Z1\nX1\n", "PPM"),
        # an offset that nobody has entered is zero here, and what it is on the machine: nothing said before holds
        ("G54 G0 X1 Y1 Z1\nG55 X1\n", "PMM"),
        ("G54 G0 X1 Y1 Z1\nG54 X1\n", "PPP"),
        # what the program has not said before it moved may have been something else
        ("G0 X1 Y1 Z1\nG54 X1\n", "PMM"),
        ("G0 X1 Y1 Z1\nG49\nX1\n", "PPM"),
        ("G49 G0 X1 Y1 Z1\nG49\nX1\n", "PPP"),
        ("G0 X1 Y1 Z1\nG21 X1\n", "PMM"),
        ("G0 X1 Y1 Z1\nG90 X1\n", "PMM"),
        ("G0 X1 Y1 Z1\nG91 X1\n", "PPP"),
        ("G0 X1 Y1 Z1\nG91\nG90 X1\n", "PPP"),
        ("G0 X1 Y1 Z1\nG17 X1\n", "PPP"),
        ("G21 G90 G0 X1 Y1 Z1\nG21 G90 X1\n", "PPP"),
        ("G54 G0 X1 Y1 Z1\nG55\nG54 X1\n", "PMM"),
        ("G54.1 P1 G0 X1 Y1 Z1\nG54.1 P2 X1\n", "PMM"),
        ("G0 X1 Y1 Z1\nG43 H1\nX1\n", "PPM"),
        ("G0 X1 Y1 Z1\nG43 H1 Z1\nX1\n", "PPP"),
        ("G43 H1 G0 X1 Y1 Z1\nG43 H1 X1\n", "PPP"),
        ("G43 H1 G0 X1 Y1 Z1\nG43 H2 X1\n", "PPM"),
        ("G43 H1 G0 X1 Y1 Z1\nG49 X1\n", "PPM"),
        ("G0 X1 Y1 Z1\nG43 H0 X1\n", "PPM"),
        ("G43 H0 G0 X1 Y1 Z1\nG49 X1\n", "PPP"),
        # an increment says nothing about where it starts
        ("G0 X1 Y1 Z1\nG55 G91 X1\n", "MMM"),
        ("G0 X1 Y1 Z1\nG53 X1\nG91 X1 Y1\n", "MPP"),
        ("G0 X1 Y1 Z1\nG20 G91 X1\n", "PPP"),
    ],
)
def test_what_is_known_of_x_y_z(text, expected):
    assert "".join(known(text)) == expected


def test_what_is_known_under_tcp():
    """On a turned table a machine move of one axis moves all coordinates of the tool point."""
    start = "G43.4 H1\nG0 X1 Y1 Z1 B10 C0\n"
    for text, expected in (("G53 Z300\nX1", "PMM"), ("G28 Z0\nX1", "PAA"), ("T2 M6\nX1", "PAA"), ("B20", "PPP")):
        motions = read(start + text + "\n", load("dmu50"))
        names = "XYZ" if expected[0] == "P" else ""
        states = [Known(motions.known[-1, motions.machine.index(axis)]).name[0] for axis in names]
        assert "".join(states) == expected


def test_positions_before_and_after():
    motions = read("G1 X1 Y1 Z1 F9\nG28 Z0\nZ5\nZ6\n", load("gantry"))
    assert motions.known_start[:, 2].tolist() == [Known.ASSUMED, Known.ASSUMED, Known.PROGRAM]
    assert motions.evaluated.tolist() == [True, True, True]
    assert motions.evaluated_paths.tolist() == [False, False, True]


# ---- notes


def notes_of(text, machine="gantry", **setup):
    machine, notes = load(machine), Notes()
    interpreter = IsoInterpreter(machine, setup_of(machine, **setup), notes)
    interpreter.read([read_block(i, line) for i, line in enumerate(text.splitlines(keepends=True), start=1)])
    return notes.texts()


SAID = "G17 G21 G90\nG0 X1.0 Y1.0 Z1.0\n"


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("G0 X1.0\nX2.0\n", "no G20 or G21 before it: coordinates are taken in mm (line 1)"),
        ("G0 X1.0\nX2.0\n", "no G90 or G91 before it: coordinates are taken as absolute (line 1)"),
        ("G0 X0 Y0\nG2 I1.0\n", "no G17, G18 or G19 before it: arcs are taken in X Y (line 2)"),
        (SAID + "X10\nX10\n", "coordinates without decimal point are taken in mm, inches or degrees, not in increments (line 3, 2 times)"),
        (SAID + "M123\n", "M123 is not known to ncomp and is taken to move nothing and to set no variable (line 3)"),
        (SAID + "M21\n", "M21 is not known to ncomp and is taken to move nothing and to set no variable (line 3)"),  # mirrors on some controls
        (SAID + "G28 Z0\n", "G28/G30 passes its intermediate point uncorrected (line 3)"),
        (SAID + "G43 Z0\n", "G43 without H is taken to select the length of the tool in the spindle, which is taken to be empty before the first tool change (line 3)"),
        (SAID + "T1 M6\nT2 M6\n", "a tool change is taken to move Z (machine file: tool_change_moves) (line 3, 2 times)"),
        (SAID + "M30\nX5\nX6\n", "blocks after the end of the program do not run and stay as programmed (line 4, 2 times)"),
    ],
)  # fmt: skip
def test_assumptions_are_noted(text, note):
    assert note in notes_of(text)


def test_no_notes_for_a_program_that_says_everything():
    assert notes_of(SAID + "G2 I1.5 J0\nG0 G43 H1 Z1.0\nM30\n") == []


def test_a_tool_change_may_leave_all_linear_axes_elsewhere():
    """Unless the machine file says otherwise: a word of ours would send X and Y back to the part, beside Z."""
    motions = read("G0 X1 Y1 Z1\nM6\nG43 H1 Z1\n", machines.load("gantry"))
    assert [Known(k).name[0] for k in motions.known[-1]] == ["A", "A", "P"]


# ---- refusals

SAY = "G90 G0 X1 Y1 Z1\n"
WHOLE_TABLE = [f"G{code:g}" for code in REFUSED_G] + [f"M{code:g}" for code in REFUSED_M]
REFUSED = {
    # axes and values
    "A5": "machine gantry (w b X Y Z t) has no axis A",
    "U5": "machine gantry (w b X Y Z t) has no axis U",
    "X1 X2": "two X words",
    "X1 F5 F6": "two F words",
    "X" + "9" * 400: "X has a number that no control reads",
    "T1.5": "T has a number that is not whole",
    "T" + "9" * 400: "T has a number that no control reads",
    "G43 H1.5": "H has a number that is not whole",
    "X1 E6": "the effect of E in a move depends on the control",  # the rest of X1E6
    "X1 L3": "L calls a subprogram on some controls and repeats the block on others",
    "L340": "L calls a subprogram on some controls",
    "X1 R5": "the block is no arc and has R",
    "G1 X9 ,C2 ,R1\nY9": "the corner has a chamfer and a rounding",
    "G1 X9 ,C2 ,C1\nY9": "two ,C words",
    "X9 ,C2\nG1 Y9": "a chamfer or rounding behind this block needs two moves in the plane of X and Y",
    "G1 X9 ,C2\nG0 Y9": "a chamfer or rounding before this block needs two moves in the plane",
    "G1 X9 ,C2\nZ9": "a chamfer or rounding before this block needs two moves in the plane",
    "G1 X9 Z2 ,C2\nY9": "a chamfer or rounding behind this block needs two moves in the plane",
    "G1 X9 ,R2\nM8": "a chamfer or rounding before this block needs two moves in the plane",
    "G1 X9 ,R2\nG28 Z9": "a chamfer or rounding before this block needs two moves in the plane",
    "G1 X9 ,R2\nG18 X5": "the plane changes at a chamfer or rounding",
    "G1 ,A30\nX9 Y9 ,A60": "the angle of a line (,A) is followed in G1 and G90 beside one coordinate",
    "G1 X9 Y9 ,A30": "the angle of a line (,A) is followed in G1 and G90 beside one coordinate",
    "G91 G1 X9 ,A30": "the angle of a line (,A) is followed in G1 and G90 beside one coordinate",
    "X9 ,A30": "the angle of a line (,A) is followed in G1 and G90 beside one coordinate",
    "G1 X9 ,A120": "a line at 120 degrees does not lead to this coordinate",
    "G1 X9 ,A90": "a line at 90 degrees does not lead to this coordinate",
    "G28 X0\nG1 X9 ,A30": "needs a known start",
    "X1 I5": "the block is no arc and has I",
    "X#1": "X#1: #1 is not set by the program",
    "F#1 X#2": "X#2: #2 is not set by the program",
    "#1=#5041\nX#1": "X#1: #1 is not known: #5041 is not set by the program",
    "#1=2 X#1": "variable assigned and used in the same block",
    "#1=1/0\nX#1": "#1 is not known: / has no value for 1, 0",
    "#1=ROUND[2.5]\nX#1": "#1 is not known: the rounding of 2.5 depends on the control",
    "#1=[2 AND 3]\nX#1": "AND of numbers other than 0 and 1 is logical on some controls and bit by bit on others",
    "#1=[0.1 EQ 0.10001]\nX#1": "whether 0.1 equals 0.10001 depends on the control",
    "#5221=10": "is a system variable of the control",
    "#1=5 #5221=10": "is a system variable of the control",
    "#0=5": "#0 is the empty variable on some controls only",
    "X1 0.5": "the number has no address before it",
    # arcs
    "G2 X5": "the arc has no centre and no radius",
    "G18 G2 X5 J1": "J gives no centre in the plane of Z and X",
    "G2 X5 Y1 K1": "K gives no centre in the plane of X and Y",
    "G2 X5 Y1 R1": "no circle of this radius joins start and end",
    "G2 X1 Y1 R1": "no circle of this radius joins start and end",
    "G2 X1.01 Y1 R0": "no circle of this radius joins start and end",
    "G2 R5": "no circle of this radius joins start and end",
    "G2 I0 J0": "the arc has the radius 0",
    "G2 X5 Y1 I2.1 J0": "the arc is no circle: its radius is",
    "G2 X2 Y2 I2 J1": 'With an absolute centre it is a circle: for such a control set arc_centres = "absolute"',
    "G2 X5 Y1 I2 R2": "the arc has a radius and a centre",
    "G2 X5 Y1 I2 P0": "P of the arc must be 1 or more",
    "G2 X5 Y1 R2 P2": "needs a centre: write I J K instead of R",
    "G90.1 G2 X5 Y1 I3": "an absolute centre needs both words: write I and J",
    # two codes of which controls take one or the other
    "G90 X5 G91 Y5": "G90 and G91 in one block",
    "G0 G1 X5": "G0 and G1 in one block",
    "G17 G18": "G17 and G18 in one block",
    "G20 G21": "G20 and G21 in one block",
    "G54 G55": "G54 and G55 in one block",
    "G54 G54.1 P1": "G54 and G54.1 in one block",
    "G43 G49 H1": "G43 and G49 in one block",
    "G93 G94": "G93 and G94 in one block",
    "G4 G53 X1": "G4 and G53 in one block",
    "G28 G53 X1": "G28 and G53 in one block",
    "G54 G4 P1": "two G codes of the block can use P",
    "G54.1": "G54.1 needs P, the number of the work offset",
    # lengths
    "H2": "H without G43: some controls take the new length at once",
    "X1 H2": "H without G43",
    "G43 H1 Z1\nT2 M6\nG43 Z1": "G43 without H while tool 2 is in the spindle and H1 in force",
    # machine coordinates, unknown positions
    "G91 G53 X1": "G53 needs G90",
    "G2\nG53 X1": "G53 needs G90 and G0 or G1",
    "G28 Z0\nG91 Z1": "an increment of Z needs a known start",
    "G30 X0\nG91 X1": "an increment of X needs a known start",
    "M6\nG91 Z1": "an increment of Z needs a known start",
    "G28 X0\nG2 X5 Y1 I2": "the arc starts at a position that the program has not given",
    # block skip
    "/X1": "the block-skip switch decides whether this block runs",
    "N5 /2 M6": "the block-skip switch decides whether this block runs",
    "/#1=5": "the block-skip switch decides whether this block runs",
    "/M98 P5": "the block-skip switch decides whether this block runs",
    "/M30": "the block-skip switch decides whether this block runs",
    "/M123": "the block-skip switch decides whether this block runs",
    "/G4 X1": "the block-skip switch decides whether this block runs",
    "/G4 P1 M6": "the block-skip switch decides whether this block runs",
    "/T2": "the block-skip switch decides whether this block runs",
    "X1 /Y1": "the block-skip switch decides whether this block runs",
    # several programs, tape marks
    "O2": "a second program in one file is not corrected",
    "M30\nO2": "a second program in one file is not corrected",
    "M30\n%\nO2\nX1": "a second program in one file is not corrected",
    "%\nX5": "text follows the only tape mark",
    "X10 %": "the tape mark shares its line with other text",
    "/%": "the tape mark shares its line with other text",
    # the next block, where a semicolon ends one
    "X5; Y5": "words after a semicolon",
    "X5 ;G1 y5 ": "words after a semicolon",
    "X5;G91": "words after a semicolon",
    "M8 ; M6": "words after a semicolon",
    # control flow and other constructs
    "IF[#1 EQ 2] GOTO 10": "#1 is not set by the program",
    "GOTO10": "the program has no block with the label 10",
    "N5\nGOTO5\nN5": "2 blocks have the label 5",
    "o100 call": "the file has no subprogram O100",
    "M98 P100": "the file has no subprogram O100",
    "M98 P20100": "some controls read P with more than four digits",
    "M99": "M99 outside of a subprogram repeats the program without end",
    "WHILE[1 EQ 1]DO1": "the end of this loop, branch or subprogram is missing",
    "END1": "ends a loop, branch or subprogram that does not begin before it",
    "o100 break": "leaves or continues a loop and is in none",
    "O100 sub\no100 call\nO100 endsub\nO100 call": "the subprograms call each other more than 100 deep",
    "[5]": "the expression has no address before it",
    # coordinates that are a move for one code and none for the other
    "G1 G50.1 X5": "two G codes of the block can use its coordinates",
    "G5.1 Q1 G0 X5": "two G codes of the block can use its coordinates",
    # splines or not, by what else is there
    "G5.1 X2 I1 J1": "G5.1 without Q",
    # codes nobody knows
    "G999": "G999 is not known",
    "G0.5 X1": "G0.5 is not known",
    "G500": "G500 is not known",
    "G1 X1 G68.2": "two G codes of the block can use its coordinates",
}  # fmt: skip


def refusal(text, machine="gantry", **setup):
    with pytest.raises(UserError) as caught:
        read(text, load(machine), **setup)
    return str(caught.value)


@pytest.mark.parametrize("block", REFUSED)
def test_refused(block):
    message = refusal(SAY + block + "\n")
    assert REFUSED[block] in message
    line, shown = int(message.split(":")[1]), message.split("'")[1]
    assert (SAY + block).split("\n")[line - 1].strip().startswith(shown.removesuffix("..."))


@pytest.mark.parametrize("code", WHOLE_TABLE)
@pytest.mark.parametrize("rest", ["", " X5 Y5 Z-5 R2 H1", " P1000"])
def test_every_refused_code(code, rest):
    assert code in refusal(SAY + code + rest + "\n")


@pytest.mark.parametrize("code", sorted(HARMLESS_G))
def test_every_harmless_code(code):
    words = {5.1: " Q1", 5.0: " P10000"}.get(code, "")
    assert len(read(SAY + f"G{code:g}{words}\nX5\n", load("gantry"))) == 2


def test_no_code_is_both_harmless_and_refused():
    assert HARMLESS_G.isdisjoint(REFUSED_G)


def test_long_comments_take_no_longer_than_their_length():
    """What stands behind a semicolon is tried for words."""
    start = time.perf_counter()
    padded = "".join(f"{letter}{' ' * 9}1" for letter in "XYZABCIJKRFSTHDNOPQLE")
    assert len(read(SAY + f"X5 ; {padded} !\n", load("gantry"))) == 2
    assert time.perf_counter() - start < 0.5


def test_before_any_motion_code():
    assert "the coordinates have no G0, G1, G2 or G3 before them" in refusal("X1\n")
    assert "G53 needs G90 and G0 or G1" in refusal("G53 X1\n")
    assert "an increment of X needs a known start" in refusal("G91 G0 X1\n")
    assert "the arc starts at a position" in refusal("G0 X1\nG2 X5 I2\n")


def test_integers_in_an_inch_program_have_no_known_increment():
    machine = with_control(load("gantry"), integer_words="increments")
    with pytest.raises(UserError, match="an inch coordinate without decimal point"):
        read("G20 G0 X10\n", machine)


def test_a_program_without_end(monkeypatch):
    monkeypatch.setattr("postproc.text.flow.MOST_RUN_BLOCKS", 1000)
    assert "the program does not end within 1000 blocks" in refusal("#1=0\nN5 #1=#1+1\nGOTO5\n")


def test_long_blocks_are_shown_short():
    message = refusal(SAY + "G33 " + "X1 (" + "a" * 200 + ")\n")
    assert len(message) < 200
    assert "..." in message


# ---- chunks


def as_tables(motions):
    return [motions.kind.tolist(), motions.target.tolist(), motions.start.tolist(), motions.known.tolist()]


@pytest.mark.parametrize("size", [1, 2, 3])
def test_chunks_read_as_the_whole(monkeypatch, size):
    names = ("work offset without motion", "machine coordinates", "tool length", "absolute and increments")
    text = "G90\n".join(GOLDEN[name][0] for name in names)
    whole = read(text, load("gantry"), **G54)
    assert len(text) < CHUNK_BLOCKS
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    assert as_tables(read(text, load("gantry"), **G54)) == as_tables(whole)


@given(st.lists(st.sampled_from([*REFUSED, *(row[0] for row in GOLDEN.values()), *WHOLE_TABLE]), max_size=6))
def test_any_mixture_is_read_or_refused(parts):
    try:
        motions = read("\n".join(parts) + "\n", load("gantry"))
    except UserError as fault:
        assert not isinstance(fault, Refusal)
        assert str(fault).startswith("test.nc:")
        return
    assert np.isfinite(motions.machine_target).all()
