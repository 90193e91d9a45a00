"""What changes the meaning of ISO coordinates: against LinuxCNC where it has the code, else against plain matrices."""

import dataclasses
import math

import numpy as np
import pytest
from clients.rs274 import Tool
from support.programs import correct, load, random_model, read, shifted
from support.tiers import quick

from kinematics.forward import forward, tool_point
from kinematics.user_error import UserError
from postproc.motion.moves import Kind
from postproc.verification.verify import verify

HEAD = "G21 G90 G54 G17 G94 F500\nG0 X10. Y5. Z20.\n"
OFFSET = {"X": 3.0, "Y": -4.2, "Z": 5.5}
SHIFT = [-0.003, 0.0042, -0.0055]
SETUP = {"offsets": ["G54=100,200,-50", "G55=-7.5,3.25,1"], "tools": ["T1=80.5", "T2=120.25"]}
ENVIRONMENT = {
    "tools": {1: Tool(80.5), 2: Tool(120.25)},
    "work_offsets": {"G54": (100, 200, -50), "G55": (-7.5, 3.25, 1)},
}


def of_family(name, family):
    machine = load(name)
    return dataclasses.replace(machine, control=dataclasses.replace(machine.control, family=family))


LINUXCNC = {
    "G92": "G92 X0. Y1.\nG1 X5. Y5.\nX7. Z3.\nG92 Z0.\nX1. Z-1.\n",
    "G92 ended": "G92 X0.\nG1 X5.\nG92.1\nG1 X5. Y5. Z5.\nY1.\n",
    "G92 suspended": "G92 X0. Y0.\nG1 X5.\nG92.2\nX5. Y5. Z1.\nG92.3\nX1. Y1. Z2.\nG92 X7.\nX8. Y8.\n",
    "G92 while suspended": "G92 X0. Y0.\nG92.2\nX5. Y5. Z1.\nG92 X7.\nX8. Y8.\n",
    "G92 in inches": "G20\nG1 X1. Y.5 Z.1\nG92 X0 Y0\nX.5 Y.1\nG92.1\nX1. Y1. Z1.\n",
    "G92 of a formula": "#1=3\nG92 X#1\nG1 X[#1+1] Y2.\n",
    "G10 L2": "G10 L2 P2 X11. Y-3.\nG55 G1 X1. Y1. Z1.\nG10 L2 P2 Z4.\nX2. Y2. Z2.\nG54 X1. Y1. Z1.\n",
    "G10 L2 of the offset in force": "G90 G10 L2 P1 X5.\nG1 X1. Y1. Z1.\nX2.\n",
    "G10 L2 R": "G10 L2 P1 R30.\nG1 X1. Y1. Z1.\nX9.\nY7.\nG2 X12. I1.5\nG10 L2 P1 R0\nG1 X1. Y2. Z1.\n",
    "G10 L2 R beside the others": "G10 L2 P2 X5. Y6. R-20.5\nG52 X3.\nG52 X0.\nG55\nG1 X1. Y1. Z1.\nG52 X3. Y1.\nX2. Y2.\nZ3.\n",
    "G10 L20": "G10 L20 P1 X0. Y1.\nG1 X5. Y5.\nX7. Z3.\nG10 L20 P0 Z0.\nX1. Z-1.\n",
    "G10 L1": "T1 M6\nG10 L1 P2 Z33.5\nG43 H2 Z5.\nX1. Y1.\n",
    "G43.1": "G43.1 Z12.5\nG1 Z5.\nX1. Y1.\nG49\nZ6. X2.\n",
    "G52": "G52 X3. Z1.\nG1 X1. Y1. Z1.\nG52 X0. Z0.\nX1. Y1. Z1.\n",
    "another offset while G92 is on": "G92 X0. Y1.\nG1 X5. Y5.\nG55 X1. Y2. Z3.\nX2.\nG92.1\nG54 X1. Y1. Z1.\n",
    "another offset while G52 is on": "G52 X3. Z1.\nG1 X1. Y1. Z1.\nG55 X1. Y1. Z1.\nG52 X0. Z0.\nX2. Y2. Z2.\n",
    "another offset that turns, R": "G10 L2 P2 X5. R30\nG52 X3. Y1.\nG55 G1 X1. Y1. Z1.\nX4.\nG54 X1. Y1. Z1.\n",
    "turns": "G2 X10. Y5. Z10. I5. P3\nG18 G3 X12. Z10. I1. K0. P2\n",
    "G5 P and its kin": "G64 P0.01\nG1 X5.\nG61\nX6.\n",
}


@pytest.mark.parametrize("name", quick(LINUXCNC, [*LINUXCNC][::2]))
def test_linuxcnc_goes_the_same_way(linuxcnc, name):
    """Before and after: for a constant error every end moves by just that."""
    machine, text = of_family("gantry", "linuxcnc"), HEAD + LINUXCNC[name] + "M2\n"
    written = correct(text, machine, shifted(machine, **OFFSET), travel_check=False, **SETUP).text
    assert correct(text, machine, travel_check=False, **SETUP).text == text
    ends = []
    for program in (text, written):
        seen = linuxcnc.run(program, **ENVIRONMENT)
        assert seen.exit_status == 0, seen
        motions = read(program, machine, **SETUP)
        rows = motions.kind != Kind.PRESET
        ends.append(np.array([move.machine[:3] for move in seen.moves if move.kind != "none"]))
        np.testing.assert_allclose(ends[-1][-rows.sum() :], motions.machine_target[rows], atol=1e-6)
    np.testing.assert_allclose(
        ends[1] - ends[0], np.broadcast_to(SHIFT, ends[0].shape), atol=8e-5 if "R" in name else 2e-5
    )


@pytest.mark.parametrize("name", quick([name for name in LINUXCNC if name != "turns"], [*LINUXCNC][:-2:2]))
def test_after_them_errors_are_taken_out(name):
    machine, text = of_family("gantry", "linuxcnc"), HEAD + LINUXCNC[name] + "M2\n"
    model = random_model(machine, 8)
    written = correct(text, machine, model, travel_check=False, **SETUP).text
    verdict = verify(read(text, machine, **SETUP), read(written, machine, **SETUP), model)
    assert verdict.before.largest > 10.0
    assert verdict.after.largest < 0.2


# ---- codes that LinuxCNC has not


def about(axis, degrees):
    """A turn about Z (2) or X (0), as 4 x 4."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = np.eye(4)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def moved(*shift):
    matrix = np.eye(4)
    matrix[:3, 3] = shift
    return matrix


TURNED = {
    "G68 X20. Y30. R35.": moved(20, 30, 0) @ about(2, 35) @ moved(-20, -30, 0),
    "G18 G68 X20. Z30. R35.": moved(20, 0, 30) @ about(1, 35) @ moved(-20, 0, -30),
    "G19 G68 Y20. Z30. R-70.5": moved(0, 20, 30) @ about(0, -70.5) @ moved(0, -20, -30),
    "G51 X10. Y20. Z0. P2.5": moved(10, 20, 0) @ np.diag([2.5, 2.5, 2.5, 1]) @ moved(-10, -20, 0),
    "G51.1 X10.": moved(10, 0, 0) @ np.diag([-1, 1, 1, 1]) @ moved(-10, 0, 0),
    "G51.1 X10.\nG51.1 Y5.": moved(10, 5, 0) @ np.diag([-1, -1, 1, 1]) @ moved(-10, -5, 0),
    "G51.1 X10. Y5.\nG50.1 X0": moved(0, 5, 0) @ np.diag([1, -1, 1, 1]) @ moved(0, -5, 0),
    "G68.2 X10. Y20. Z5. I0. J0. K30.\nG53.1": moved(10, 20, 5) @ about(2, 30),
}
ENDS = {"G68": "G69", "G51.": "G50.1", "G51 ": "G50"}
PATH = [(15, 20, 5), (30, 22, 4), (31, 25, 4), (31, 25, -2)]


@pytest.mark.parametrize("code", TURNED)
def test_turned_mirrored_and_scaled(code):
    machine = load("gantry")
    blocks = "\n".join(f"G1 X{x}. Y{y}. Z{z}." for x, y, z in PATH)
    end = next(ENDS[key] for key in ENDS if key in code)
    text = HEAD + f"{code}\n{blocks}\nG17\n".replace("\nG17", "") + f"{end}\nG1 X1. Y2. Z3.\n"
    motions = read(text, machine)
    expected = [*(TURNED[code] @ [*place, 1.0] for place in PATH), np.array([1, 2, 3, 1])]
    np.testing.assert_allclose(motions.machine_target[1:], np.array(expected)[:, :3], atol=1e-9)
    model = random_model(machine, 3)
    written = correct(text, machine, model, travel_check=False).text
    assert all(line in written.splitlines() for line in (*code.splitlines(), end))
    verdict = verify(motions, read(written, machine), model)
    assert verdict.before.largest > 20.0
    assert verdict.after.largest < (0.5 if "P2.5" in code else 0.2)


def test_arcs_are_mirrored_too():
    machine, model = load("gantry"), random_model(load("gantry"), 3)
    text = HEAD + "G51.1 X10.\nG1 X20. Y0. Z0.\nG2 X30. Y10. I10. J0.\nG50.1\nG1 X0. Y0. Z0.\n"
    written = correct(text, machine, model, travel_check=False).text
    nominal, commanded = read(text, machine), read(written, machine)
    assert np.abs(nominal.in_machine(nominal.along(0.5))[2] - [10 - 17.0711, 7.0711, 0]).max() < 1e-3 + 10
    assert verify(nominal, commanded, model).after.largest < 0.2
    middle = [m.in_machine(m.along(0.5))[2] for m in (nominal, commanded)]
    assert np.abs(middle[0] - middle[1]).max() < 0.5


# ---- tilted planes and tool vectors


def test_a_tilted_plane_is_that_of_its_angles():
    """The tool stands along the normal; its tip is where the matrix of the plane puts the coordinates."""
    machine, setup = load("trunnion_ac"), {"offsets": ["G54=1,2,150"], "tools": ["T1=80"]}
    head = "G21 G90 G54 G17 G49\nT1 M6\nG0 G43 H1 Z300.\nG0 X0. Y0. A-30. C40.\n"
    axis = forward(machine, read(head, machine, **setup).machine_target[-1:]).rotation[0, :, 2]
    i, j = math.degrees(math.atan2(axis[0], -axis[1])), math.degrees(math.acos(axis[2]))
    path = [(0, 0, 50), (10, 5, 50), (10, 5, -3), (12, 9, 40)]
    blocks = "".join(f"G1 X{x}. Y{y}. Z{z}. F100\n" for x, y, z in path)
    text = head + f"G68.2 X5. Y6. Z7. I{i:.9f} J{j:.9f} K15.\nG53.1\n{blocks}G81 X20. Y5. Z-9. R2.\nG80\nG69\n"
    text += "G0 X1. Y1. Z300.\n"
    motions = read(text, machine, **setup)
    plane = moved(1 + 5, 2 + 6, 150 + 7) @ about(2, i) @ about(0, j) @ about(2, 15)
    tips = tool_point(machine, motions.machine_target, motions.tool)
    rows = slice(len(motions) - 6, len(motions) - 1)
    np.testing.assert_allclose(tips[rows], [(plane @ [*p, 1])[:3] for p in [*path, (20, 5, -9)]], atol=1e-6)
    model = random_model(machine, 4, 30.0)
    written = correct(text, machine, model, travel_check=False, **setup).text
    verdict = verify(motions, read(written, machine, **setup), model)
    assert verdict.after.largest < 0.2 < verdict.before.largest
    assert "G53.1" in written.splitlines()


@pytest.mark.parametrize("name", ["dmu50", "trunnion_ac", "head_table", "head_head"])
def test_tool_vectors(name):
    """The tool axis is the vector, its tip the programmed place; the vectors stay as they are."""
    machine, setup = load(name), {"offsets": ["G54=0,0,100"], "tools": ["T1=80"]}
    rng = np.random.default_rng(2)
    vectors = rng.normal(size=(12, 3)) * 0.25 + [0.1, -0.05, 1.0]
    places = rng.uniform(-20, 20, (12, 3))
    lines = [
        "G1 " + " ".join(f"{n}{v:.6f}" for n, v in zip("XYZIJK", [*p, *v], strict=True))
        for p, v in zip(places, vectors, strict=True)
    ]
    rotary = " ".join(f"{axis.name}0." for axis in machine.axes if axis.rotary)
    text = f"G21 G90 G54 G17\nG0 X0. Y0. Z100. {rotary}\nG43.5 H1\nG1 X0. Y0. Z50. F500\n" + "\n".join(lines) + "\n"
    motions = read(text, machine, **setup)
    q = motions.machine_target[-12:]
    written = np.round(np.array(vectors), 6)
    axes = forward(machine, q).rotation[:, :, 2]
    np.testing.assert_allclose(axes, written / np.linalg.norm(written, axis=1)[:, None], atol=1e-9)
    np.testing.assert_allclose(tool_point(machine, q, (0, 0, -80)) - [0, 0, 100], np.round(places, 6), atol=1e-9)
    model = random_model(machine, 4, 30.0)
    corrected = correct(text, machine, model, travel_check=False, **setup)
    for before, after in zip(lines, corrected.text.splitlines()[-12:], strict=True):
        assert before[before.index("I") :] == after[after.index("I") :]
    assert corrected.report.after.largest < 0.2 < corrected.report.before.largest
    verdict = verify(motions, read(corrected.text, machine, **setup), model)
    assert verdict.after.largest < 0.2


# ---- polar coordinates

CIRCLE = "G16\nG81 X50. Y0. Z-10. R2. F100\nY60.\nY120.\nX60. Y180.\nX-60.\nY-60.\nG80\nG15\nG0 X0. Y0. Z9.\n"


@pytest.mark.parametrize("plane", ["G17", "G18", "G19"])
def test_polar_coordinates(plane):
    machine, model = load("gantry"), random_model(load("gantry"), 4)
    letters = {"G17": "XYZ", "G18": "ZXY", "G19": "YZX"}[plane]
    body = CIRCLE.translate(str.maketrans("XYZ", letters))
    text = HEAD + f"G98 {plane}\nG0 {letters[2]}100.\n" + body
    motions = read(text, machine)
    columns = [machine.index(letter) for letter in letters]
    holes = np.flatnonzero(motions.kind == Kind.CYCLE)
    polar = [(50, 0), (50, 60), (50, 120), (60, 180), (-60, 180), (-60, -60)]
    expected = [(r * math.cos(math.radians(a)), r * math.sin(math.radians(a)), -10) for r, a in polar]
    np.testing.assert_allclose(motions.machine_target[holes][:, columns], expected, atol=1e-9)
    assert correct(text, machine, travel_check=False).text == text
    written = correct(text, machine, model, travel_check=False).text
    verdict = verify(motions, read(written, machine), model)
    assert verdict.after.largest < 0.3
    assert verdict.before.largest > 20.0


def test_polar_words_that_a_correction_adds():
    machine = load("gantry")
    text = HEAD + "G16\nG1 X50. Y0. Z5. F100\nY90.\nZ4.\nG15\nG1 X1. Y1.\n"
    written = correct(text, machine, shifted(machine, X=10.0, Y=-20.0), travel_check=False).text
    assert written.splitlines()[3:] == [
        "G16", "G1 X49.9900 Y0.0229 Z5. F100", "X50.0200 Y90.0115", "Z4.", "G15", "G1 X0.9900 Y1.0200",
    ]  # fmt: skip
    ends = read(written, machine).machine_target[1:, :2]
    np.testing.assert_allclose(ends, [(49.99, 0.02), (-0.01, 50.02), (-0.01, 50.02), (0.99, 1.02)], atol=2e-4)


# ---- refused

REFUSED = {
    "G92 X0. M8": "G92 cannot share a block with the other words",
    "G92": "G92 needs an axis word",
    "G92.3": "G92.3 restores the G92 of another program",
    "G52 X1.\nX5.\nG92 X0.": "G92 and G52 share one offset on some controls",
    "G92 X0.\nG52 X1.": "G52 and G92 share one offset on some controls",
    "G92 X0.\nG55": "the effect of a new work offset on an active G52, G92, rotation",
    "G68 X0. Y0. R5.\nG92 X0.": "a preset of the present position",
    "G10 L2 P0 X1.": "G10 L2 P0 sets the active offset on LinuxCNC",
    "G10 L2 P1 X1. I5.": "I in a G10 block is not corrected",
    "G10 L2 P1 R5.\nG1 X1. Y1. Z1.\nG92 X0.": "a preset of the present position",
    "G10 L2 P1 R5.\nG68 X1. Y1. R5.": "within a work offset that rotates the coordinates",
    "G52 Y1.\nG10 L2 P1 R5.": "rotates the active work offset under G52 or G92",
    "G10 L20 P1 X1.": "sets different data on FANUC and on LinuxCNC",
    "G10 L10 P1 R1.": "sets different data on FANUC and on LinuxCNC",
    "G10 L50": "G10 needs L and P",
    "G10 L52 P1": "this kind of data is not known",
    "G91\nG10 L2 P1 X1.": "G10 needs G90",
    "T1 M6\nG43 H1 Z5.\nG10 L1 P1 Z5.": "changes the length offset in force",
    "G43.1 X1. Z1.": "G43.1 sets a length on LinuxCNC",
    "G68 X1. Y1. R5.\nG51.1 X1.": "G51.1 while G68 is active",
    "G68 X1. Y1. R5.\nG18": "another plane while the coordinates are rotated or polar",
    "G68 X1. Y1. I1. R5.": "the effect of I in this block",
    "G51 X1. Y1. Z1. P2": "the unit of a scale without decimal point",
    "G51 X1. Y1. Z1. I2. J3. K1.": "the effect of I in this block",
    "G68.2 X1. Y1. Z1. I0. J30. K0.\nG53.1": "the tool is not perpendicular to the tilted plane",
    "G68.2 X1. Y1. Z1. I0. J0. K0.\nG1 X5.": "the tool is not yet perpendicular to the tilted plane",
    "G53.1": "G53.1 needs a tilted plane",
    "G68.2 P1 X1. Y1. Z1. I0. J0. K0.": "G68.2 is corrected only with the Euler angles I J K",
    "G16\nG1 X5.": "need a radius and an angle",
    "G16\nG2 X5. Y30. R5.": "an arc in polar coordinates",
    "G91\nG16": "polar coordinates with G91",
    "G50 X5.": "G50 with axis words",
    "G5 X1. Y1. I1. J1. P1.": "splines are not corrected",
    "G5.1": "splines are not corrected",
    "G41 D1 X20.\nG53 Z5.": "while radius compensation is on",
    "G41 D1 X20.\nG28 Z5.": "while radius compensation is on",
    "G41 D1 X20.\nM6": "while radius compensation is on",
    "G41.2 X5.": "selects radius compensation in space",
}


@pytest.mark.parametrize("block", REFUSED)
def test_refused(block):
    with pytest.raises(UserError) as caught:
        read(HEAD + "G1\n" + block + "\n", load("gantry"), **SETUP)
    assert REFUSED[block] in str(caught.value)


@pytest.mark.parametrize(
    ("block", "family", "z"),
    [
        ("G10 L10 P1 R33.\nG43 H1 Z5.", "fanuc", 38.0),
        ("G10 L11 P1 R.5\nG43 H1 Z5.", "fanuc", 86.0),
        ("G10 L10 P1 R33.\nG10 L11 P1 R.25\nG10 L12 P1 R5.\nG43 H1 Z5.", "fanuc", 38.25),
        ("G10 L1 P1 Z7.\nG43 H1 Z5.", "linuxcnc", 12.0),
    ],
)
def test_lengths_that_the_program_sets(block, family, z):
    motions = read(HEAD + block + "\n", of_family("gantry", family), tools=["T1=80.5"])
    assert motions.machine_target[-1, 2] == pytest.approx(z)


def test_fanuc_work_offsets_by_g10():
    text = HEAD + "G10 L20 P7 X5. Y6.\nG54.1 P7\nG0 X1. Y1. Z1.\n"
    motions = read(text, of_family("gantry", "fanuc"))
    assert motions.machine_target[-1].tolist() == pytest.approx([6, 7, 1])
