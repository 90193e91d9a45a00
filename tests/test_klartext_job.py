"""The main job on Klartext: real five-axis programs and what Klartext has of its own."""

import io
import re

import pytest
from hypothesis import strategies as st
from support.klartext_programs import FIVE_AXIS, KLARTEXT, MOVES, first_lines_of, numbered_program
from support.tiers import drawn

import machines
from kinematics.error_model.model import read_model
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.motion.motions import merged
from postproc.text.source import Source
from postproc.verification.verify import read_motions, verify

DMU50 = machines.load("dmu50")
MODEL = read_model(machines.default_calibration(DMU50), DMU50)
OFFSETS = ("0=0,0,150", "1=0,0,200")


def setup():
    return make_setup(DMU50, OFFSETS, ("T1=80",), zero=True)


def corrected(source):
    out = io.BytesIO()
    report = Pipeline(Job(source, KLARTEXT, DMU50, MODEL, setup(), travel_check=False)).run(out, lambda _: None)
    return Source("corrected.h", out.getvalue().decode("latin-1"), out.getvalue()), report


def judged(source):
    """The verdict on the corrected program, and its text without the mark."""
    result, _ = corrected(source)
    before, after = (merged(read_motions(s, KLARTEXT, DMU50, setup())) for s in (source, result))
    lines = [line for _, line in result.lines() if "NCOMP" not in line]
    return verify(before, after, MODEL), "".join(lines)


def without_number(line):
    """The mark is a block too: all numbers behind it are higher by one."""
    return re.sub(r"^\d+ ", "", line)


@pytest.mark.parametrize(("name", "lines"), FIVE_AXIS)
def test_real_five_axis_programs(nc_data, name, lines):
    source = first_lines_of(nc_data / "heidenhain" / "five_axis_bc" / name, lines)
    verdict, text = judged(source)
    assert verdict.moves == MOVES[lines]
    assert verdict.before.largest > 40
    assert verdict.after.largest < 0.09  # four decimals: 0.05 um in each axis
    original = [without_number(line) for _, line in source.lines()]
    kept = [
        line for line in original if not (" " + line.split(";")[0]).partition("L ")[2].strip().startswith(tuple("XYZB"))
    ]
    assert len(kept) < len(original) - 0.99 * verdict.moves
    new = [without_number(line) for line in text.splitlines(keepends=True)]
    assert len(new) == len(original)
    unchanged = [a for a, b in zip(original, new, strict=True) if a == b]
    assert set(kept) <= set(unchanged)


def test_numbers_keep_sign_comma_and_blanks():
    _, text = judged(numbered_program("3 L  X+1,5  Y-2,25 R F500 M\r\n4 L Z+40 R0\r\n"))
    line = text.splitlines()[3]
    assert re.fullmatch(r"4 L  X\+1,4\d{3}  Y-2,2\d{3} Z\+\d\d,\d{4} R F500 M", line), line
    assert text.count("\r\n") == 5


def test_an_arc_takes_its_pole_along():
    verdict, text = judged(
        numbered_program("3 L X+20 Y+0\r\n4 CC X+0 Y+0\r\n5 C X+0 Y+20 DR+ R0 F100\r\n6 C X-20 Y+0 DR+\r\n")
    )
    lines = text.splitlines()
    assert re.fullmatch(r"5 CC X-0\.0\d{3} Y\+0\.0\d{3}", lines[4]), lines[4]
    assert re.match(r"6 CP IPA\+\d+\.\d+ Z\+\d+\.\d+ DR\+ R0 F100", lines[5])
    assert lines[6].startswith("7 CC X")  # the second arc has no CC of its own
    assert lines[7].startswith("8 CP IPA+")
    assert verdict.after.largest < 0.09
    assert verdict.path_after.largest < 2


def test_tcp_programs_are_corrected_in_the_workpiece_frame():
    moves = "".join(f"L X{x} Y{2 * x} Z{40 + x} B{20 + x} C{10 * x} F500\r\n" for x in range(0, 9, 2))
    verdict, text = judged(numbered_program(f"L B+0 C+0\r\nM128\r\n{moves}M129\r\n"))
    assert verdict.before.largest > 20
    assert verdict.after.largest < 0.09
    assert "B22 C20 F500" in text


@drawn(
    few=6,
    many=30,
    most=100,
    moves=st.lists(st.tuples(st.sampled_from("XYZ"), st.floats(-60, 60), st.booleans()), min_size=1, max_size=12),
)
def test_modal_and_incremental_blocks_reach_the_nominal_points(moves):
    lines = "".join(f"L {'I' * step}{axis}{value / (9 if step else 1):.3f} F300\r\n" for axis, value, step in moves)
    verdict, _ = judged(numbered_program(lines))
    assert verdict.after.largest < 0.09


def test_a_circle_that_closes_but_for_the_sum_of_increments_is_full():
    """0.1 + 0.2 is not 0.3 in binary: for any control it is."""
    circle = numbered_program("3 L X+0.1 Y+0\r\n4 L IX+0.2\r\n5 CC X+10.3 Y+0\r\n6 C X+0.3 Y+0 DR- F100\r\n")
    (arc,) = merged(read_motions(circle, KLARTEXT, DMU50, setup())).arcs.values()
    assert arc.full
    verdict, _ = judged(circle)
    # cut in two, the second half a CP: it ends on the circle about a pole of four decimals
    assert verdict.after.largest < 0.2
