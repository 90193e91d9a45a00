"""Corrected programs word by word: what is written, in which style, and what is left alone."""

import dataclasses
import math
import re

import pytest
from hypothesis import strategies as st
from support.programs import WHOLE, correct, load, model_of, random_model, read, shifted
from support.tiers import drawn

from kinematics.basis import BSpline, Polynomial
from kinematics.effects import ErrorMotion
from kinematics.machine import Control
from kinematics.user_error import UserError
from postproc.verification.verify import verify

GANTRY = load("gantry")
SHIFTED = shifted(GANTRY, X=-10.0, Y=20.0, Z=-30.0)
"""Makes the correction X +0.010, Y -0.020, Z +0.030 everywhere."""


def ramp(component, axis, um_per_mm=0.1, machine=GANTRY):
    """An error motion that grows with the position of its axis from 0."""
    high = max(machine.axes[machine.index(axis)].travel[1], 1.0)
    return ErrorMotion(component, axis, Polynomial((0.0, high), 1), (0.0, um_per_mm * high), u=(1.0, 1.0))


Y_BY_X = model_of(GANTRY, ramp("Y", "X"))
"""Makes Y need -0.1 um per mm of X: at X100 Y -0.0100."""
ALL_BY_X = model_of(GANTRY, ramp("X", "X"), ramp("Y", "X"), ramp("Z", "X"))


def written(text, machine=GANTRY, model=SHIFTED, **setup):
    """The corrected program without its mark."""
    output = correct(text, machine, model, travel_check=False, **WHOLE, **setup).text
    return re.sub(r"\(NCOMP [^\n\r]*\)\r*\n?|\(NCOMP [^\r]*\)\r", "", output)


def refusal(text, machine=GANTRY, model=SHIFTED, **setup):
    with pytest.raises(UserError) as caught:
        correct(text, machine, model, **setup)
    return str(caught.value)


CONSTANT_SHIFT = [
    # numbers in every style
    ("G0 X10 Y10. Z10.000", "G0 X10.0100 Y9.9800 Z10.0300"),
    ("g0x10y+10z.5", "g0x10.0100y+9.9800z.5300"),
    ("G0 X - .005 Y.5 Z 0", "G0 X .0050 Y.4800 Z .0300"),
    ("G0 X-.010 Y+.5 Z-0.", "G0 X+.0000 Y+.4800 Z+0.0300"),
    ("G0 X10.123456 Y1 Z1", "G0 X10.133456 Y0.9800 Z1.0300"),
    ("G20 G0 X1 Y1 Z1", "G20 G0 X1.000394 Y0.999213 Z1.001181"),
    # comments, other words and line numbers in between
    ("N10G0X1(X1)Y2F100(Y2)Z3M8", "N10G0X1.0100(X1)Y1.9800F100(Y2)Z3.0300M8"),
    ("G1 F100 (a) X1 S5 Y2 ; X9 etc", "G1 F100 (a) X1.0100 S5 Y1.9800 ; X9 etc"),
    ("N100000 G0 X1\nN100001 X2", "N100000 G0 X1.0100\nN100001 X2.0100"),
    # increments between corrected positions stay; the first one does not
    ("G0 X10 Y10\nG91 X5\nY-3.5\nG90 X0 Y0", "G0 X10.0100 Y9.9800\nG91 X5\nY-3.5\nG90 X0.0100 Y-0.0200"),
    # arcs: the centre goes with the path
    ("G0 X10 Y10\nG2 X20 Y10 I5 J0", "G0 X10.0100 Y9.9800\nG2 X20.0100 Y9.9800 I5 J0"),
    ("G0 X10 Y10\nG2 X20 Y10 R10", "G0 X10.0100 Y9.9800\nG2 X20.0100 Y9.9800 R10"),
    ("G0 X10 Y10\nG91 G2 X10 Y0 I5", "G0 X10.0100 Y9.9800\nG91 G2 X10 Y0 I5"),
    ("G0 X10 Y10\nG90.1 G3 I15 J10", "G0 X10.0100 Y9.9800\nG90.1 G3 I15.0100 J9.9800"),
    ("G0 X10 Y10\nG3 I5", "G0 X10.0100 Y9.9800\nG3 I5"),
    ("G0 Z10 X10\nG18 G2 Z20 X10 K5 I0 Y5", "G0 Z10.0300 X10.0100\nG18 G2 Z20.0300 X10.0100 K5 I0 Y4.9800"),
    ("G0 Y10 Z10\nG19 G90.1 G3 Y20 J15 K10", "G0 Y9.9800 Z10.0300\nG19 G90.1 G3 Y19.9800 J14.9800 K10.0300"),
    # not moves in the program's coordinates
    ("G0 X1 Y1 Z1\nG53 X5 Y5 Z5\nX2", "G0 X1.0100 Y0.9800 Z1.0300\nG53 X5 Y5 Z5\nX2.0100"),
    ("G0 X1 Y1 Z1\nG91 G28 X0 Y0 Z0\nG90 Z1", "G0 X1.0100 Y0.9800 Z1.0300\nG91 G28 X0 Y0 Z0\nG90 Z1.0300"),
    ("G0 X1\nG4 X5.\nG4 P5\nF100\nX2", "G0 X1.0100\nG4 X5.\nG4 P5\nF100\nX2.0100"),
    ("G0 X1\nG92.1\nG50.1 X0\nX2", "G0 X1.0100\nG92.1\nG50.1 X0\nX2.0100"),
    ("G0 X1\nM30\nX2\n%\nX3", "G0 X1.0100\nM30\nX2\n%\nX3") ,
    ("G0 X1\n#1=5\nF#1\n(X5)\nX2", "G0 X1.0100\n#1=5\nF#1\n(X5)\nX2.0100"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), CONSTANT_SHIFT[:-2] + CONSTANT_SHIFT[-1:])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_constant_shift(text, expected, end):
    assert written((text + "\n").replace("\n", end)) == (expected + "\n").replace("\n", end)
    assert written(text.replace("\n", end)) == expected.replace("\n", end)


def test_what_stands_behind_the_end_stays():
    assert written("%\nG0 X1\nM30\nX2\n%\nX3") == "%\nG0 X1.0100\nM30\nX2\n%\nX3"


BY_X = [
    # what the block does not say is added, in the order and the style of the program
    ("G0 X0 Y0 Z0\nX100\nX100\nZ5", "G0 X0 Y0 Z0\nX100 Y-0.0100\nX100\nZ5"),
    ("G0X0Y0Z0\nX100F5", "G0X0Y0Z0\nX100Y-0.0100F5"),
    ("g0 x0 y+0 z0\nz5 x100 (y)", "g0 x0 y+0 z0\nz5 x100 y-0.0100 (y)"),
    ("G0 X+0 Y+1 Z+0\nN5 X+100", "G0 X+0 Y+1 Z+0\nN5 X+100 Y+0.9900"),
    ("G0 X0 Y.5 Z0\nX100.", "G0 X0 Y.5 Z0\nX100. Y.4900"),
    ("G0 X  0 Y  0 Z  0\nX  100.", "G0 X  0 Y  0 Z  0\nX  100. Y -0.0100"),
    ("G20 G0 X0 Y1 Z0\nX4", "G20 G0 X0 Y1 Z0\nX4 Y0.999600"),
    # in increments, each of what is missing
    ("G0 X0 Y0 Z0\nG91 X100\nX-50 Y1\nZ1", "G0 X0 Y0 Z0\nG91 X100 Y-0.0100\nX-50 Y1.0050\nZ1"),
    ("G0 X0 Y0 Z0\nG91 G20 X4", "G0 X0 Y0 Z0\nG91 G20 X4 Y-0.000400"),
    # arcs whose start was moved by a word of ours
    ("G0 X0 Y0 Z0\nX100\nG2 X200 I50", "G0 X0 Y0 Z0\nX100 Y-0.0100\nG2 X200 Y-0.0200 I50 J-0.0050"),
    ("G18 G0 X0 Y0 Z0\nG91 G3 X0 Z100 K50", "G18 G0 X0 Y0 Z0\nG91 G3 X0 Z100 K50"),
    ("G18 G0 X0 Y0 Z0\nG91 G3 X100 I50", "G18 G0 X0 Y0 Z0\nG91 G3 X100 Y-0.0100 I50"),
]


@pytest.mark.parametrize(("text", "expected"), BY_X)
def test_axes_that_a_block_does_not_name(text, expected):
    assert written(text + "\n", model=Y_BY_X) == expected + "\n"


def test_words_are_added_in_the_order_of_the_letters_on_any_chain():
    machine = load("bzt_pfu")  # w b Y X Z t
    model = model_of(machine, ramp("X", "Z", machine=machine), ramp("Y", "Z", machine=machine))
    assert written("G0 X50 Y50 Z0\nZ100\n", machine, model) == "G0 X50 Y50 Z0\nX49.9900 Y49.9900 Z100\n"


HAZARDS = {
    # Each of these ends with a block that names X alone, after something that leaves Y or Z where only the operator
    # knows. A word for them would send the axis there in one go.
    "work offset": "G54 G0 X0 Y5 Z5\nG55\nX1000",
    "work offset, then an increment": "G54 G0 X0 Y5 Z5\nG55\nG91 Y1 Z1\nG90 X1000",
    "extended work offset": "G54.1 P1 G0 X0 Y5 Z5\nG54.1 P2\nX1000",
    "work offset and back": "G54 G0 X0 Y5 Z5\nG55\nG54\nX1000",
    "machine coordinates": "G0 X0\nG53 Y5 Z5\nX1000",
    "machine coordinates, then an increment": "G0 X0\nG53 Y5 Z5\nG91 Y1 Z1\nG90 X1000",
    "reference point": "G0 X0 Y5 Z5\nG91 G28 Y0 Z0\nG90 X1000",
    "reference point of all axes": "G0 X0 Y5 Z5\nG28\nX1000",
    "pallet change": "G0 X0 Y5 Z5\nM60\nX1000",
}
Z_HAZARDS = {
    "length offset on": "G0 X0 Y5 Z5\nG43 H1\nX1000",
    "length offset off": "G43 H1 G0 X0 Y5 Z5\nG49\nX1000",
    "another length offset": "G43 H1 G0 X0 Y5 Z5\nG43 H2\nX1000",
    "tool change": "G0 X0 Y5 Z5\nT1 M6\nX1000",
}


@pytest.mark.parametrize("name", HAZARDS)
def test_no_word_for_an_axis_whose_place_is_not_said(name):
    last = written(HAZARDS[name] + "\n", model=ALL_BY_X).splitlines()[-1]
    assert re.fullmatch(r"(G90 )?X999\.9000", last)


@pytest.mark.parametrize("name", Z_HAZARDS)
def test_no_word_for_z_behind_a_length_that_only_the_control_knows(name):
    assert written(Z_HAZARDS[name] + "\n", model=ALL_BY_X).splitlines()[-1] == "X999.9000 Y4.9000"


def test_no_word_for_x_y_z_behind_a_switch_of_tcp():
    machine = load("dmu50")
    model = random_model(machine, 1)
    for switch in ("G43.4 H1", "G49"):
        start = "G90 G0 X5 Y5 Z5 B10 C0\nG43.4 H1\nX5 Y5 Z5\n" if switch == "G49" else "G90 G0 X5 Y5 Z5 B10 C0\n"
        last = written(f"{start}{switch}\nX50\n", machine, model).splitlines()[-1]
        assert re.fullmatch(r"X\S+", last)


def test_no_word_for_x_y_z_behind_a_machine_move_under_tcp():
    machine = load("dmu50")
    text = "G90 G0 X5 Y5 Z5 B10 C0\nG43.4 H1\nX5 Y5 Z5\nG53 Z390\nX50\nG91 Y1\n"
    lines = written(text, machine, random_model(machine, 1)).splitlines()
    assert re.fullmatch(r"X\S+", lines[-2])
    assert lines[-1] == "G91 Y1" or re.fullmatch(r"G91 X\S+ Y1", lines[-1])


def test_increments_of_an_axis_whose_place_is_not_said_stay():
    text = "G54 G0 X0 Y5 Z5\nG55\nG91 Y10\nX1000\nG90 Y0\nG91 Y10\n"
    assert written(text, model=SHIFTED).splitlines() == [
        "G54 G0 X0.0100 Y4.9800 Z5.0300",
        "G55",
        "G91 Y10",
        "X1000",
        "G90 Y-0.0200",
        "G91 Y10",
    ]


def test_an_arc_from_a_place_that_is_not_said_in_its_frame_is_refused():
    text = "G54 G0 X0 Y0 Z0\nG55 X0\nG2 X10 I5\n"
    assert "no block gives the start of the arc in this frame" in refusal(text, travel_check=False)
    assert correct(text, GANTRY).text == text


# ---- feed moves of rotary axes alone


def turning_lines(text, machine="dmu50", **options):
    machine = load(machine)
    model = model_of(machine, ErrorMotion("X", "B", Polynomial((0.0, 90.0), 1), (0.0, 90.0), u=(1.0, 1.0)))
    return correct(text, machine, model, **options)


TURN = "G21 G90 G17 G0 X10 Y10 Z200 B0 C0\n"


@pytest.mark.parametrize("block", ["G1 B45 F500", "G1 X10 B45 F500", "G91 G1 B45 F500", "G91 G1 X0 B45 F500"])
def test_a_feed_move_of_rotary_axes_keeps_the_linear_axes(block):
    """F is degrees per minute here; beside X by 45 um it would be mm per minute along those, on LinuxCNC: B at rapid."""
    out = turning_lines(TURN + block + "\nG90 G1 X20\n")
    lines = out.text.splitlines()
    assert lines[2] == block
    assert lines[3] == "G90 G1 X19.9550"
    assert any(note.startswith("a feed move of rotary axes only keeps its linear axes") for note in out.report.notes)
    assert out.report.after.largest == pytest.approx(45.0, abs=0.1)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ("G0 B45", "G0 X9.9550 B45"),
        ("G93 G1 B45 F2", "G93 G1 X9.9550 B45 F2"),
        ("G1 X20 B45 F500", "G1 X19.9550 B45 F500"),
        ("G1 Y20 B45 F500", "G1 X9.9550 Y20 B45 F500"),
        ("G0 B45 (X1)", "G0 X9.9550 B45 (X1)"),
    ],
)
def test_other_moves_of_rotary_axes_are_corrected(block, expected):
    out = turning_lines(TURN + block + "\n")
    assert out.text.splitlines()[2] == expected
    assert out.report.after.largest < 0.1


def test_linear_words_next_to_rotary_ones_keep_exactly_what_was_written():
    lines = turning_lines(TURN + "G0 B30\nG1 X10 B45 F500\n").text.splitlines()
    assert lines[2:] == ["G0 X9.9700 B30", "G1 X9.9700 B45 F500"]


# ---- arcs


def test_a_full_circle_closes_whatever_its_decimals():
    text = "G0 X100.00000 Y0 Z0\nG2 X100 I-5\nG1 X100.000000\nG3 X100. Y0 I5\n"
    model = model_of(GANTRY, ErrorMotion("X", "X", Polynomial((0.0, 5000.0), 1), (0.0, 61.7), u=(1.0, 1.0)))
    lines = written(text, model=model).splitlines()
    numbers = [re.search(r"X(\S+)", line)[1] for line in lines]
    assert {float(number) for number in numbers[:2]} == {float(numbers[0])}
    assert {float(number) for number in numbers[2:]} == {float(numbers[2])}
    assert all(arc.full for arc in read("\n".join(lines), GANTRY).arcs.values())


def test_a_full_circle_found_by_sums_of_increments_closes():
    text = "G54 G0 X1 Y1 Z0\nG91 X.1\nX.1\nX.1\nG90 G2 X1.3 I5\nG0 G43 H1 Z0\nG2 X1.3 Y1 I5\nG54 G2 X1.3 J2\n"
    out = correct(text, GANTRY, random_model(GANTRY, 5), offsets=["G54=33.3,77.7,5"], tools=["T1=0.1"], **WHOLE)
    arcs = read(out.text, GANTRY, offsets=["G54=33.3,77.7,5"], tools=["T1=0.1"]).arcs
    assert [arc.full for arc in arcs.values()] == [True, True, True]


SIMILAR = model_of(GANTRY, *(ramp(a, a, 0.235) for a in "XYZ"), ramp("Y", "X", 0.137), ramp("X", "Y", -0.137))
"""Grown and turned about Z: a circle in X Y stays a circle, so that all of it can be corrected."""


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ("G2 X120.001 Y100 R10.001", r"G2 X\S+ Y\S+ I9\.9\S+ J\S+"),
        ("G2 X120.001 Y100 R-10.001", r"G2 X\S+ Y\S+ I9\.9\S+ J\S+"),
        ("G90.1 G2 X120.001 Y100 R10.001", r"G90.1 G2 X\S+ Y\S+ I109\.9\S+ J99\.8\S+"),
        ("G91 G2 X20.001 Y0 R10.001", r"G91 G2 X\S+ Y\S+ I9\.9\S+ J\S+"),
        ("g2x120.001y100r10.001f5", r"g2x\S+y\S+i9\.99\S+j\S+f5"),
        ("G18 G2 X120.001 Z100 R10.001", r"G18 G2 X\S+ Y\S+ Z\S+ I\S+ K\S+"),
    ],
)
def test_half_circles_by_radius_are_written_by_their_centre(block, expected):
    text = f"G0 X100 Y100 Z100\n{block}\n"
    out = written(text, model=SIMILAR)
    assert re.fullmatch(expected, out.splitlines()[1])
    check_path(text, out, SIMILAR, 0.5)


@pytest.mark.parametrize("block", ["G2 X110 Y110 R10", "G3 X105 Y101 R30", "G2 X110 Y110 R-10", "G3 X100.5 Y100 R50"])
def test_other_arcs_by_radius_stay_so(block):
    text = f"G0 X100 Y100 Z100\n{block}\n"
    out = written(text, model=SIMILAR)
    assert re.search(r"R-?\d+\.\d{4}$|R-?\d+$", out.splitlines()[1])
    check_path(text, out, SIMILAR, 0.5)


@pytest.mark.parametrize("gap", [0.5, 0.05, 0.005, 0.001])
@pytest.mark.parametrize("form", ["R-50", "I50 J{}"])
def test_nearly_full_circles(gap, form):
    """Rounding one of two end points that lie side by side would turn their bisector, and the circle with it."""
    half = gap / 2
    centre = math.sqrt(50**2 - half**2)
    if form == "R-50":
        text = f"G0 X100 Y{100 - half:.4f} Z100\nG2 X100 Y{100 + half:.4f} R-50\n".replace("G2", "G3")
    else:
        text = f"G0 X100 Y{100 - half:.4f} Z100\nG3 X100 Y{100 + half:.4f} I{-centre:.6f} J{half:.6f}\n"
    out = written(text, model=SIMILAR)
    (arc,) = read(out, GANTRY).arcs.values()
    assert not arc.full
    check_path(text, out, SIMILAR, 0.5)


@pytest.mark.parametrize(
    ("end", "reason"), [("99.9999", "rounding would reverse this arc"), ("99.9996", "rounding would exchange this arc")]
)
def test_arcs_that_rounding_would_turn_round_are_refused(end, reason):
    """The start is rounded up to Y100.000, and the end, which has more decimals, is not."""
    axes = tuple(dataclasses.replace(axis, resolution=0.001) for axis in GANTRY.axes)
    coarse = dataclasses.replace(GANTRY, axes=axes)
    assert reason in refusal(f"G0 X100 Y100 Z100\nG3 X100 Y{end} I50\n", coarse, shifted(coarse, Y=-0.4))


def check_path(text, out, model, um, machine=GANTRY, **setup):
    """The path as written, seen by the exact model, is the nominal one but for what lies in the shape of the errors."""
    verdict = verify(read(text, machine, **setup), read(out, machine, **setup), model)
    assert verdict.after.largest < 0.1
    assert verdict.path_after.largest < um


@drawn(
    few=20,
    many=60,
    radius=st.floats(0.01, 200),
    first=st.floats(0, 6.28),
    turn=st.floats(0.001, 6.28),
    code=st.sampled_from([2, 3]),
    by_radius=st.booleans(),
    seed=st.integers(0, 9),
)
def test_arcs_of_any_size(radius, first, turn, code, by_radius, seed):
    """Smooth machine: no arc deviates by more than its chord's share of the errors, none changes its direction."""
    centre = (600.0, 500.0)
    start = [round(c + radius * f(first), 3) for c, f in zip(centre, (math.cos, math.sin), strict=True)]
    last = first + (turn if code == 3 else -turn)
    end = [round(c + radius * f(last), 3) for c, f in zip(centre, (math.cos, math.sin), strict=True)]
    if math.dist(start, end) < 0.002 or math.dist(start, end) > 2 * radius:
        return
    circle = (
        f"R{math.copysign(radius, math.pi - turn):.4f}" if by_radius else f"I{600 - start[0]:.3f} J{500 - start[1]:.3f}"
    )
    text = f"G0 X{start[0]} Y{start[1]} Z100\nG{code} X{end[0]} Y{end[1]} {circle}\n"
    model = smooth_model(seed)
    try:
        nominal = read(text, GANTRY)
    except UserError:
        return  # rounded by us to no circle
    out = written(text, model=model)
    verdict = verify(nominal, read(out, GANTRY), model)
    assert verdict.path_after.largest < 1.0 + 0.05 * radius


def smooth_model(seed):
    """Errors whose slopes hardly change over the size of an arc: what is left of them on the arc is second order."""
    rng = __import__("numpy").random.default_rng(seed)
    motions = []
    for axis in "XYZ":
        high = GANTRY.axes[GANTRY.index(axis)].travel[1]
        for component in "XYZABC":
            size = 100.0 if component in "XYZ" else 20.0
            values = tuple((rng.uniform(-1, 1, 3) * size / 3).tolist())
            motions.append(ErrorMotion(component, axis, Polynomial((0.0, high), 2), values, u=(1.0,) * 3))
    return model_of(GANTRY, *motions)


# ---- numbers


def test_integer_words_of_increments():
    machine = dataclasses.replace(GANTRY, control=dataclasses.replace(Control(), integer_words="increments"))
    text = "G0 X1000 Y2. Z0\nG91 X500\nG90 G2 X2500 Y2. I500\nG0 X10\n"
    out = written(text, machine)
    assert out == "G0 X1.0100 Y1.9800 Z0.0300\nG91 X0.5000\nG90 G2 X2.5100 Y1.9800 I0.5000\nG0 X0.0200\n"
    assert read(out, machine).target[:, 0].tolist() == pytest.approx([1.01, 1.51, 2.51, 0.02])


@pytest.mark.parametrize(
    ("resolution", "word", "expected"),
    [
        (1e-4, "X1.5", "X1.5100"),
        (1e-3, "X1.5", "X1.510"),
        (1e-3, "X1.51234", "X1.52234"),
        (1e-5, "X1.5", "X1.51000"),
        (0.1, "X1.5", "X1.5"),
        (0.1, "X1.50", "X1.51"),
    ],
)
def test_decimals(resolution, word, expected):
    axes = tuple(dataclasses.replace(axis, resolution=resolution) for axis in GANTRY.axes)
    machine = dataclasses.replace(GANTRY, axes=axes)
    assert written(f"G0 {word}\n", machine) == f"G0 {expected}\n"


def test_increments_do_not_drift():
    """A thousand increments, each rounded, end where one move ends."""
    text = "G0 X0 Y0 Z0\nG91\n" + "X0.7 Y0.3\n" * 1000 + "G90 X700 Y300\n"
    out = written(text, model=random_model(GANTRY, 8))
    moves = read(out, GANTRY).target
    assert moves[-2] == pytest.approx(moves[-1], abs=1.01e-4)


def test_a_correction_of_millimetres_is_refused():
    message = refusal("G0 X1000 Y100\n", model=model_of(GANTRY, ramp("Y", "X", 6.0)))
    assert "Y would be corrected by 6000 um, more than 500 um" in message
    tall = BSpline((0.0, 5000.0), 1)
    model = model_of(
        GANTRY, ErrorMotion("C", "X", tall, (1e4, 1e4), u=(1.0, 1.0)), ErrorMotion("X", "X", tall, (9e3, 9e3), u=(1, 1))
    )
    assert "check calibration, machine and set-up" in refusal("G0 X1000 Y100\n", model=model)
