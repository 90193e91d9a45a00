"""What a program sets on the control holds from there on, in that run alone: in every dialect, with and without loops."""

import copy
import io

import pytest
from hypothesis import strategies as st
from support.programs import model_of, source_of
from support.three_dialects import WRITERS, parts
from support.tiers import drawn

import machines
from kinematics.basis import BSpline
from kinematics.effects import ErrorMotion
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import ENCODING

GANTRY = machines.load("gantry")
SCALE = model_of(GANTRY, ErrorMotion("X", "X", BSpline((-5e3, 5e3), 1), (-5e3, 5e3), u=(0.0, 0.0)))
"""E_XX = 1 um/mm."""
LOOPS = {
    "iso": "#1=0\nWHILE[#1LT2]DO1\n#1=#1+1\nEND1\n",
    "siemens": "FOR R90=1 TO 2\nG4 F0.1\nENDFOR\n",
    "heidenhain": "LBL 99\nCALL LBL 99 REP1\n",
}
OFFSETS = ("G54=10,20,30", "G55=40,50,60", "0=10,20,30", "1=40,50,60")
LENGTHS = ("T1=80", "T2=0")
number = st.integers(-90, 90).map(str)


def job_of(dialect, text, **options):
    setup = make_setup(GANTRY, OFFSETS, LENGTHS)
    language = find_dialect(dialect, "", "")
    return Job(source_of(text), language, GANTRY, SCALE, setup, travel_check=False, **options)


def run(job):
    out = io.BytesIO()
    report = Pipeline(job).run(out, lambda _: None)
    lines = out.getvalue().decode(ENCODING).splitlines(keepends=True)
    return "".join(line for line in lines if "NCOMP" not in line), report.json()


def head_alone_and_with_loop(dialect, head):
    alone, _ = run(job_of(dialect, head))
    followed, _ = run(job_of(dialect, head + LOOPS[dialect]))
    return alone, followed[: len(alone)]


STATEMENTS = {
    "iso": st.one_of(
        st.builds("G10 L2 P{} X{} Z{}\nG90 G1 X1.5 Y2. Z3. F500".format, st.sampled_from("12"), number, number),
        st.builds("G{} G0 X{}. Y{}. Z1.".format, st.sampled_from(["54", "55"]), number, number),
        st.builds("G52 X{}.\nG1 X3. Y4. Z5. F500\nG52 X0.".format, number),
        st.builds("T{0} M6\nG43 H{0} X1. Y1. Z{1}.".format, st.sampled_from("12"), number),
    ),
    "siemens": st.one_of(
        st.builds("$P_UIFR[{},{},{}]={}".format, st.sampled_from("12"), st.sampled_from("XYZ"),
                  st.sampled_from(["TR", "FI"]), number),
        st.builds("G{} G0 X{} Y{} Z1".format, st.sampled_from(["54", "55"]), number, number),
        st.builds("TRANS X{}\nG1 X3 Y4 Z5 F500\nTRANS".format, number),
        st.builds("$TC_DP3[{0},1]={1}\nT{0} D1 M6\nG1 X1 Y1 Z2 F500".format, st.sampled_from("12"), number),
    ),
    "heidenhain": st.one_of(
        st.builds("TOOL DEF {} L{}".format, st.sampled_from("12"), number),
        st.builds("TOOL CALL {} Z S2000\nL X+1 Y+2 Z+3 FMAX".format, st.sampled_from("12")),
        st.builds("CYCL DEF 247 DATUM SETTING ~\n Q339={} ;NUMBER\nL X{} Y+2 Z+3 F500".format, st.sampled_from("01"),
                  number),
    ),
}  # fmt: skip
BEGINS = {"iso": "G21 G90 G17 G94\nG54 G0 X0. Y0. Z0.\n", "siemens": "G54 G0 X0 Y0 Z0\n", "heidenhain": ""}


@st.composite
def programs(draw):
    dialect = draw(st.sampled_from(list(STATEMENTS)))
    lines = draw(st.lists(STATEMENTS[dialect], min_size=1, max_size=8))
    return dialect, BEGINS[dialect] + "\n".join(lines) + "\n"


@drawn(few=20, many=60, program=programs())
def test_a_head_becomes_the_same_with_a_loop_behind_it(program):
    alone, followed = head_alone_and_with_loop(*program)
    assert followed == alone


@drawn(few=15, many=40, program=programs(), with_loop=st.booleans())
def test_a_job_runs_twice_alike_and_leaves_its_setup(program, with_loop):
    dialect, text = program
    job = job_of(dialect, text + LOOPS[dialect] * with_loop)
    before = copy.deepcopy(job.setup)
    assert run(job) == run(job)
    assert job.setup == before


@drawn(few=8, many=20, part=parts(), writer=st.sampled_from(WRITERS))
def test_a_part_in_three_dialects_runs_twice_alike(part, writer):
    job = job_of(writer.name, writer().program(part), tolerance_um=1e3)
    assert run(job) == run(job)


def test_a_work_offset_set_later_does_not_hold_from_the_first_line():
    head = "G54 G0 X0 Y0 Z0\n$P_UIFR[1,X,TR]=7\nG54 X0\n"
    alone, followed = head_alone_and_with_loop("siemens", head)
    moves = [line for line in alone.splitlines() if line.startswith("G54")]
    assert moves == ["G54 G0 X-0.0100 Y0 Z0", "G54 X-0.0070"]
    assert followed == alone


def test_a_tool_length_defined_later_does_not_hold_for_an_earlier_call():
    head = "TOOL CALL 2 Z\nL X+0 Y+0 Z+0 FMAX\nTOOL DEF 2 L100\n"
    alone, followed = head_alone_and_with_loop("heidenhain", head)
    assert "L X-0.0100 Y+0 Z+0 FMAX" in alone
    assert followed == alone


@pytest.mark.parametrize("part", ["TR", "FI"])
def test_an_offset_that_is_set_acts_when_it_is_called_and_not_with_the_next_frame(part):
    text = f"$P_UIFR[1,X,{part}]=7\nG54 G0 X0 Y0 Z0\n$P_UIFR[1,X,{part}]=90\nTRANS X1\nG0 X0\nG54 X0\n"
    written, _ = run(job_of("siemens", text))
    at_first = 7.0 if part == "TR" else 17.0
    later = 90.0 if part == "TR" else 100.0
    corrections = [float(line.split("X-")[1].split()[0]) for line in written.splitlines() if "X-" in line]
    expected = [at_first / 1e3, (at_first + 1.0) / 1e3, (later + 1.0) / 1e3]
    assert corrections == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("loop", ["", LOOPS["siemens"]])
def test_fine_offsets_do_not_add_up(loop):
    text = "$P_UIFR[1,X,FI]=0.5\nG54 G0 X0 Y0 Z0\nG54 X1\nG54 X2\n" + loop
    written, report = run(job_of("siemens", text))
    assert [line for line in written.splitlines() if line.startswith("G54")] == [
        "G54 G0 X-0.0105 Y0 Z0", "G54 X0.9885", "G54 X1.9875"
    ]  # fmt: skip
    assert report["work_offsets"]["G54"] == "X 10.5, Y 20, Z 30"
