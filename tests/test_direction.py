"""Backlash in NC correction: take-ups and arcs in pieces, against a backlash that is worked out here by itself."""

import math
import re

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from support.backlash_paths import (
    ARC_RADIUS_UM,
    BAND,
    HEAD,
    ROUNDING,
    TOO_SMALL,
    Path,
    largest_error,
    played,
    with_backlash,
)
from support.programs import WHOLE, RandomProgram, correct, load, model_of, random_model, random_setup, read
from support.real_programs import ACCEPTED, FEW, LINES_OF_REAL_PROGRAMS, first_lines, machine_for, real_programs, run
from support.tiers import drawn

from kinematics.effects import Backlash
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.motion.segments import like
from postproc.text.source import ENCODING
from postproc.verification.verify import verify

GANTRY, DMU50 = load("gantry"), load("dmu50")
WIDTHS = {"X": 20.0, "Y": 40.0, "Z": -12.0}
seeds = st.integers(0, 2**32 - 1)


PLAYED = played(GANTRY, **WIDTHS)


def written(text, model=PLAYED, machine=GANTRY, **options):
    """The corrected program behind its mark and head."""
    lines = correct(HEAD + text, machine, model, **options).text.splitlines()
    return lines[4:]


@drawn(
    few=10,
    many=30,
    seed=seeds,
    blocks=st.integers(1, 25),
    widths=st.tuples(*[st.sampled_from((0.0, 1.5, 20.0, 45.0))] * 3),
)
def test_the_machine_with_play_follows_the_nominal_path(seed, blocks, widths):
    text = Path(seed).text(blocks)
    widths = dict(zip("XYZ", widths, strict=True))
    try:
        result = correct(text, GANTRY, played(GANTRY, **widths))
    except UserError as refusal:  # an arc of 10 um with a backlash of 20 um
        assume(not TOO_SMALL.search(str(refusal)))
        raise
    ends, along = largest_error(text, result.text, GANTRY, widths)
    # back by the band from the last end, and by the band from the farthest point between the two: the tolerance
    assert ends <= ROUNDING + 2 * BAND
    assert along <= ROUNDING + 2 * BAND + ARC_RADIUS_UM


def test_lines_by_hand():
    """X behind by 10 um, Y by 20, Z ahead by 6, whichever way they came."""
    assert written("G1 Z120\nX120 F300\nX105 F200 (back)\nX100\nY100 Z100\n") == [
        "G1 Z119.9940",
        "X120.0100 F300",
        "G1 X119.9900 F200 (NCOMP TAKE-UP)",
        "X104.9900 F200 (back)",
        "X99.9900",
        "G1 Y109.9800 Z120.0060 (NCOMP TAKE-UP)",
        "Y99.9800 Z100.0060",
    ]


def test_rapids_take_play_up_on_their_way():
    assert written("G0 X105\nX106\nG1 X107\nX106\n") == [
        "G0 X104.9900",
        "X106.0100",
        "G1 X107.0100",
        "G1 X106.9900 (NCOMP TAKE-UP)",
        "X105.9900",
    ]


def test_modes_said_in_the_block_are_said_before_it_too():
    assert written("G1 X120\nG91 G1 X-5\nX5\nN9 G90 X10 F1\n") == [
        "G1 X120.0100",
        "G91 G1 X-0.0200 (NCOMP TAKE-UP)",
        "G91 G1 X-5",
        "G1 X0.0200 (NCOMP TAKE-UP)",
        "X5",
        "G90 G1 X119.9900 F1 (NCOMP TAKE-UP)",
        "N9 G90 X9.9900 F1",
    ]


def test_inches():
    assert written("G20\nG1 X5\nX4\n")[1:] == ["G1 X5.000394", "G1 X4.999606 (NCOMP TAKE-UP)", "X3.999606"]


def test_an_arc_says_again_that_it_is_one():
    assert written("G1 X120\nG2 X130 I5\nX120 I-5 F9\n") == [
        "G1 X120.0100",
        "G2 X125.0100 Y115.0200 I5",
        "G1 Y114.9800 (NCOMP TAKE-UP)",
        "G2 X130.0100 Y109.9800 I0.0000 J-5.0000 (NCOMP ARC)",
        "G1 X129.9900 F9 (NCOMP TAKE-UP)",
        "G2 X124.9900 Y104.9800 I-5 F9",
        "G1 Y105.0200 (NCOMP TAKE-UP)",
        "G2 X119.9900 Y110.0200 I0.0000 J5.0000 (NCOMP ARC)",
    ]


AT_A_TURNING_POINT = {
    "rightmost, clockwise": (
        "G1 X130\nG2 X120 Y100 I-10\n",
        ["G1 X130.0100", "G1 X129.9900 Y109.9800 (NCOMP TAKE-UP)", "G2 X119.9900 Y99.9800 I-10"],
    ),
    "rightmost, counterclockwise": (
        "G1 X130\nG3 X120 Y120 I-10\n",
        ["G1 X130.0100", "G1 X129.9900 (NCOMP TAKE-UP)", "G3 X119.9900 Y120.0200 I-10"],
    ),
    "leftmost": (
        "G1 X80\nG2 X90 Y120 I10\n",
        ["G1 X109.9900 (NCOMP TAKE-UP)", "G1 X79.9900", "G1 X80.0100 (NCOMP TAKE-UP)", "G2 X90.0100 Y120.0200 I10"],
    ),
}


@pytest.mark.parametrize("case", AT_A_TURNING_POINT)
def test_an_arc_that_begins_where_an_axis_turns(case):
    text, expected = AT_A_TURNING_POINT[case]
    assert written(text) == expected


def test_an_arc_that_ends_just_behind_a_turning_point_is_not_divided_there():
    """X goes back by 0.2 um at its end, which is less than the play can be known."""
    lines = written("G1 X120\nG2 X129.9998 Y109.95 I5\nG1 Y100\n")
    assert [line for line in lines if "NCOMP" in line and "X129.9" in line and "TAKE-UP" in line] == []
    assert sum("NCOMP ARC" in line for line in lines) == 1


def test_each_arc_piece_keeps_its_time():
    """G93: the pieces together take as long as the arc did."""
    lines = written("G1 X120\nG93 G2 X130 I5 F4\n")
    feeds = [float(re.search(r"F([\d.]+)", line)[1]) for line in lines[1:] if "TAKE-UP" not in line]
    assert len(feeds) == 2
    assert sum(1 / feed for feed in feeds) == pytest.approx(1 / 4, rel=1e-4)
    take_up = next(line for line in lines if "TAKE-UP" in line)
    assert float(re.search(r"F([\d.]+)", take_up)[1]) == pytest.approx(4 * math.pi * 5 / 0.040, rel=1e-3)


def test_idle_axes_do_not_chatter():
    steps = "".join(f"G1 X{120 + i} Y{110 + 0.0004 * (i % 2):.4f}\n" for i in range(8))
    assert not [line for line in written(steps) if "NCOMP" in line]
    assert [line for line in written(steps, tolerance_um=0.2) if "TAKE-UP" in line]


def test_a_reversal_in_small_steps_counts_when_it_is_more_than_the_dead_band():
    steps = "G1 X120\n" + "".join(f"X{120 - 0.0003 * i:.4f}\n" for i in range(1, 5))
    assert written(steps) == [
        "G1 X120.0100", "X120.0097", "G1 X119.9897 (NCOMP TAKE-UP)", "X119.9894", "X119.9891", "X119.9888",
    ]  # fmt: skip


NOTED = {
    "a new frame": ("G1 X120\nG43 H1 G1 X100", "X .*its block changes the frame"),
    "another frame": ("G1 X120\nG55 G1 X100", "X .*the program has not given the position of the axis"),
    "after an unknown M function": ("G1 X120\nM77\nX100", "X .*the program has not given the position of the axis"),
    "an M function in an arc": (
        "G2 X130 I10 M5",
        "an arc is not cut .*an M function in its block may run before or after the move",
    ),
    "first moves": ("G1 X120", "X is assumed in the middle of its backlash until it moves"),
    "no F under G93": ("G1 X120\nG93 X100", "X .*has no F under G93"),
}


@pytest.mark.parametrize("name", NOTED)
def test_what_is_not_taken_up_is_noted(name):
    text, pattern = NOTED[name]
    result = correct(HEAD + text + "\n", GANTRY, played(GANTRY, X=20.0, Y=40.0), tools=["T1=50"])
    assert [note for note in result.report.notes if re.search(pattern, note)], result.report.notes
    nothing = [line for line in result.text.splitlines() if line.startswith("G1 X1") and "TAKE-UP" in line]
    assert not nothing or name == "first moves"


def test_a_tool_change_leaves_only_z_unknown():
    lines = written("G1 X120 Y120 Z120\nM6 T1\nG0 X100\nZ50\nG1 X130\nZ40\n")
    assert lines[2:] == [
        "G0 X99.9900", "Z50", "G1 X100.0100 (NCOMP TAKE-UP)", "G1 X130.0100", "G1 Z50.0060 (NCOMP TAKE-UP)", "Z40.0060",
    ]  # fmt: skip


def test_without_play_nothing_is_added():
    model = random_model(GANTRY, 5)
    text = Path(7).text(20)
    result = correct(text, GANTRY, model, **WHOLE)
    assert result.report.added_blocks == 0
    assert "TAKE-UP" not in result.text
    assert result.text.count("\n") == text.count("\n") + 1
    assert correct(text, GANTRY, no_errors(GANTRY)).text == text


@pytest.mark.parametrize(
    "name", ["gantry", *(pytest.param(name, marks=pytest.mark.statistical) for name in ("dmu50", "head_table"))]
)
@drawn(few=1, many=4, also={"seed": 144, "tcp": True}, seed=seeds, tcp=st.booleans())
def test_random_programs_are_verified_and_do_not_depend_on_chunks(name, seed, tcp):
    machine = load(name)
    tcp &= name != "gantry"
    text = RandomProgram(machine, seed, tcp=tcp).text(30)
    setup, model = random_setup(machine), with_backlash(machine, seed)
    try:
        whole = correct(text, machine, model, **setup, travel_check=False)
    except UserError as refusal:  # an arc smaller than the backlash
        assume(not TOO_SMALL.search(str(refusal)))
        raise
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", 4)
        part = correct(text, machine, model, **setup, travel_check=False)
    assert part.text == whole.text
    assert part.report.notes == whole.report.notes
    verdict = verify(read(text, machine, **setup), read(whole.text, machine, **setup), model)
    assert verdict.moves == whole.report.moves
    assert verdict.before.count == verdict.after.count
    if not tcp:
        assert whole.report.after.largest == pytest.approx(verdict.after.largest, abs=2e-3)
        assert whole.report.before.largest == pytest.approx(verdict.before.largest, abs=2e-3)
    rotary = machine.rotary
    nominal, commanded = read(text, machine, **setup), read(whole.text, machine, **setup)
    own = like(nominal, commanded)
    away = np.abs(own.machine_target - commanded.machine_target)[:, rotary]
    inside = np.append(
        own.start_fraction[1:] > 0.0, False
    )  # ends of segments inside a move are rounded to the resolution
    steps = np.radians([axis.resolution for axis in machine.axes if axis.rotary])
    assert (away <= np.where(inside[:, None], 0.5 * steps, 0.0) + 1e-12).all()
    assert np.abs(own.machine_target - commanded.machine_target).max() < 1.0


def test_texts_that_do_not_belong_together():
    good = correct(HEAD + "G1 X120\nX100\nG2 X110 I5\n", GANTRY, PLAYED).text
    other = HEAD + "G1 X120\nX100\nG1 X110\n"
    for nominal, text in ((other, good), (HEAD, good), (good.replace("G2 X", "G3 X"), other)):
        with pytest.raises(UserError, match="do not make the same moves"):
            verify(read(nominal, GANTRY), read(text, GANTRY), PLAYED)


@LINES_OF_REAL_PROGRAMS
def test_real_programs(nc_data, lines, tmp_path):
    seen, accepted = set(), ACCEPTED if lines is None else FEW
    for path in first_lines(real_programs(nc_data), lines, tmp_path):
        if path.name not in accepted:
            continue
        seen.add(path.name)
        machine = machine_for(path)
        widths = {"X": 20.0, "Y": 30.0, "Z": 8.0}
        model = played(machine, **widths)
        data, report = run(path, machine, model)
        text, corrected = path.read_bytes().decode(ENCODING), data.decode(ENCODING)
        assert corrected != text
        nominal, commanded = read(text, machine), read(corrected, machine)
        verdict = verify(nominal, commanded, model)
        assert verdict.moves == report.moves
        if not any(frame.tcp for frame in nominal.frames):
            assert verdict.after.rms < 0.5 * verdict.before.rms
    assert seen == accepted


def test_the_orientation_too():
    """A program of both: nothing breaks, and the tool axis is no worse."""
    text = "G21 G90 F500\nG0 X10 Y10 Z50 B10 C10\nX11 Y11 Z51 B11 C11\nG1 X20 B20\nX10 B15 C20\nX12 B12 C12\n"
    model = played(DMU50, X=20.0, B=50.0, C=30.0)
    result = correct(text, DMU50, model, classes=frozenset(("L-POS", "R-POS", "FOR")), travel_check=False)
    assert result.report.tilt_after.rms < result.report.tilt_before.rms
    assert any("B is taken up along a feed move" in note for note in result.report.notes)


@pytest.mark.parametrize(
    ("cycle", "to", "expected"),
    [
        ("G99 G81 X120. Z90. R109.", "G0 Z100.", "Z100.0060"),  # down from R
        ("G98 G81 X120. Z90. R105.", "G0 Z107.", "Z107.0060"),  # down from the level before
        ("G99 G81 X120. Z90. R105.", "G0 Z107.", "Z106.9940"),  # up from R
    ],
)
def test_a_drill_returns_before_the_next_move(cycle, to, expected):
    """Its axis comes from where the cycle has left it, not from the bottom of the hole."""
    assert written(f"{cycle}\nG80\n{to}\n")[-1].split()[1] == expected


def test_a_feed_move_that_turns_back_behind_a_cycle_is_noted():
    text = HEAD + "G99 G81 X120. Y100. Z90. R105.\nG1 X150. Z95.\nM2\n"
    notes = correct(text, GANTRY, PLAYED).report.notes
    assert any("the backlash of Z is taken up along a feed move" in note and "line 5" in note for note in notes), notes


def test_a_rapid_of_the_tool_point_that_turns_an_axis_back_inside():
    """Under TCP an axis may come to the end of a rapid from the other side than its start lies: found by `verify`."""
    machine = load("head_head")
    model = model_of(machine, *(Backlash(axis, 20.0) for axis in "XYZ"))
    text = (
        "G21 G90 G54\nG0 X0.406 Y-10.053 Z18.118 C22.080 B-14.332\nG43.4 H1\nG0 X0.4 Y-10. Z18. C22. B-14.\n"
        "G0 X38.702 Y-5.958 Z35.226 C-9.831 B12.768\nG0 Y-10.564\nG0 Z32.208\nM30\n"
    )
    setup = {"offsets": ["G54=2000,1250,500"], "tools": ["T1=80"]}
    done = correct(text, machine, model, **setup, travel_check=False)
    verdict = verify(read(text, machine, **setup), read(done.text, machine, **setup), model)
    assert verdict.after.largest == pytest.approx(done.report.after.largest, abs=0.05)
    assert verdict.after.largest < 0.2
