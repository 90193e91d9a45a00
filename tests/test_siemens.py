"""Siemens 840D programs: blocks, formulas, the run of the program, frames, and what is written."""

import io
import itertools
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.programs import WHOLE, load, random_model, setup_of, shifted, source_of
from support.programs import read as read_iso

from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.motion.moves import Kind, Known
from postproc.siemens.reading.blocks import _read_plain, parse_block, read_block
from postproc.text.block import Refusal
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions, verify

SIEMENS = find_dialect("siemens", "", "")
OFFSET = {"X": 3.0, "Y": -4.2, "Z": 5.5}
SHIFT = [-0.003, 0.0042, -0.0055]


def read(text, machine="gantry", offsets=(), tools=()):
    machine = load(machine)
    return merged(read_motions(source_of(text, "test.mpf"), SIEMENS, machine, setup_of(machine, offsets, tools)))


def correct(text, machine="gantry", model=None, **setup):
    machine, out = load(machine), io.BytesIO()
    job = Job(
        source_of(text, "test.mpf"),
        SIEMENS,
        machine,
        model or no_errors(machine),
        setup_of(machine, **setup),
        travel_check=False,
        **WHOLE,
    )
    Pipeline(job).run(out, lambda _: None)
    return re.sub("; NCOMP .* PROGRAM .*\n", "", out.getvalue().decode(ENCODING))


def ends(text, axis="X"):
    return [round(float(value), 9) + 0.0 for value in read(text).target[:, load("gantry").index(axis)]]


# ---- blocks

blanks = st.sampled_from(["", " ", " ", "\t"])
numbers = st.from_regex(r"[+-]?([0-9]{1,4}(\.[0-9]{0,4})?|\.[0-9]{1,4})", fullmatch=True)
words = st.builds("".join, st.tuples(st.sampled_from("GMXYZABCIJKFSTDHxyzgmLRP"), blanks, numbers))
others = st.sampled_from(
    [
        "MCALL CYCLE83(5, -1, , R1+2)",
        "L340(R1)",
        'CALL "PART"',
        "EXTERN PART(REAL)",
        "PROC PART(REAL AA, INT B=3)",
        "$P_UIFR[1,X,TR]=5",
        "$P_UIFR[1]=CTRANS(X,1):CROT(Z,0)",
        "AP=IC(30)",
        "AR=90",
        "TURN=2",
        "RND=1",
        "RET",
        "ID=1 DO M5",
        "X=R1",
        "Y=IC(-2)",
        "R1=5",
        "TRAORI",
        "CR=20",
        'MSG("a;(b")',
        "LAB_1:",
        "IF R1>2",
        "GOTOF AB",
        "X1=5",
        "A3=1",
    ]
)
comments = st.sampled_from(["", ";", "; X1 (a)", ";$PATH=/_N_WKS_DIR"])


@given(
    st.sampled_from(["", "N10", "N10 ", " N0010", "/N5 ", ":10 "]),
    st.lists(st.tuples(st.one_of(words, words, words, others), blanks).map("".join), max_size=6).map("".join),
    comments,
    st.sampled_from(["\n", "\r\n", ""]),
)
@example("N10", "X1 Y=R1", "", "")
def test_quick_way_equals_the_grammar(number, items, comment, end):
    text = number + items + comment + end
    quick = _read_plain(3, text)
    try:
        full = parse_block(3, text)
    except Refusal as refusal:
        assert quick is None, text
        assert refusal.reason
        return
    assert quick is None or quick == full
    assert full.text == text
    places = [(word.at, word.start, word.end + word.tail) for word in full.words]
    assert all(at <= start <= end for at, start, end in places)
    assert all(a[2] <= b[0] for a, b in itertools.pairwise(places))


@cache
def real_lines(folder: Path) -> list[str]:
    lines = set()
    for path in sorted((folder / "siemens").rglob("*.*")):
        with path.open(encoding=ENCODING, newline="\n") as file:
            lines.update(file)
    return sorted(lines)


def test_every_line_of_real_programs(nc_data):
    read_ = 0
    for line in real_lines(nc_data):
        try:
            full = parse_block(1, line)
        except Refusal:
            assert _read_plain(1, line) is None
            continue
        read_ += 1
        assert _read_plain(1, line) in (None, full)
    assert read_ > 0.9 * len(real_lines(nc_data)) > 1000


@given(st.data())
def test_mutated_lines_of_real_programs(nc_data, data):
    text = data.draw(st.sampled_from(real_lines(nc_data)))
    at = data.draw(st.integers(0, len(text)))
    text = (
        text[:at]
        + data.draw(st.text("GX01.-+()/;= \t[],\"'_:A", max_size=2))
        + text[at + data.draw(st.integers(0, 2)) :]
    )
    try:
        full = parse_block(1, text)
    except Refusal:
        assert _read_plain(1, text) is None
    else:
        assert _read_plain(1, text) in (None, full)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "N10 G1 X-.5 Y+2. F1.5EX2 ; a\n",
            [("N", 10, ""), ("G", 1, ""), ("X", -0.5, ""), ("Y", 2, ""), ("F", 150, "")],
        ),
        ("X=10 Y=-(2.5) I=AC(3) C=DC(-90)\n", [("X", 10, ""), ("Y", None, ""), ("I", 3, "AC"), ("C", -90, "DC")]),
        ("G2 X1 CR=-20\n", [("G", 2, ""), ("X", 1, ""), ("CR", -20, "")]),
        ('T="DRILL 8.5" M6 D1\n', [("T", None, "DRILL 8.5"), ("M", 6, ""), ("D", 1, "")]),
        ("G0G90X1Y2\n", [("G", 0, ""), ("G", 90, ""), ("X", 1, ""), ("Y", 2, "")]),
        ("TRAORI\n", [("TRAORI", None, "")]),
        ('MSG ("A" << R22 << "; (")\n', [("MSG", None, "")]),
        ("SUPA G0 Z500 D0\n", [("SUPA", None, ""), ("G", 0, ""), ("Z", 500, ""), ("D", 0, "")]),
        ("M3=5 S1=500\n", [("M3", 5, ""), ("S1", 500, "")]),
    ],
)
def test_words(text, expected):
    assert [(word.address, word.value, word.mode) for word in read_block(1, text).words] == expected


# ---- the run of the program

RUNS = {
    "order": ("X=2+3*4\nX=10-2*3\nX=2+6 DIV 4\nX=1+7 MOD 4\nX=(2+3)*4\nX=-2+3\nX=2*-3\nX=100-10*2+5\n", [14, 4, 3, 4, 20, 1, -6, 85]),
    "functions": ("X=SIN(30)*10\nX=ATAN2(30.5,80.1)\nX=SQRT(POT(3)+POT(4))\nX=ROUND(2.5)+TRUNC(2.9)\nX=ABS(-3)\n", [5, 20.845534, 5, 5, 3]),
    "variables": ("R1=5 R2=R3\nDEF REAL DEPTH=2.5, bb\nX=R1 Y=DEPTH\ndepth=R1/2\nX=Depth\nR[2]=7\nX=R2\nX=R[1+1]\nX=bb\n", [5, 2.5, 7, 7, 0]),
    "integers": ("DEF INT nn=7\nX=nn/2\nnn=nn/2\nX=nn\nX=7 DIV 2\n", [3.5, 4, 3]),
    "fields": ("DEF REAL FF[2,3]=SET(1,2,,4)\nX=FF[0,1]\nX=FF[0,2]\nX=FF[1,0]\nDEF INT GG[4]=REP(9)\nGG[2]=5\nX=GG[2]\nX=GG[3]\n", [2, 0, 4, 5, 9]),
    "for": ("DEF INT ii\nFOR ii=1 TO 3\nX=ii\nENDFOR\nX=ii\n", [1, 2, 3, 4]),
    "while": ("R1=0\nWHILE R1<2\nX=R1\nR1=R1+1\nENDWHILE\n", [0, 1]),
    "repeat": ("R1=0\nREPEAT\nX=R1\nR1=R1+1\nUNTIL R1>=2\n", [0, 1]),
    "loop": ("R1=0\nLOOP\nX=R1\nR1=R1+1\nIF R1==3 GOTOF OUT\nENDLOOP\nOUT: X9\n", [0, 1, 2, 9]),
    "branches": ("R1=2\nIF R1==1\nX1\nELSE\nIF (R1==2) AND (R1<>3)\nX2\nENDIF\nENDIF\nIF NOT R1\nX3\nENDIF\nIF TRUE\nX4\nENDIF\n", [2, 4]),
    "jumps": ("R1=30 R4=3\nGOTOF MID\nX999\nAGAIN: X=R1\nR1=R1+10 R4=R4-1\nIF R4>0 GOTOB AGAIN\nGOTOF 90\nX999\nN90 GOTOC NOWHERE\nM30\nMID: X1\nGOTOB AGAIN\n", [1, 30, 40, 50]),
    "either": ("R1=1\nIF R1>5 GOTOF AA ELSE GOTOF BB\nX1\nAA: X2\nBB: X3\n", [3]),
    "case": ("R1=7\nCASE(R1) OF 3 GOTOF L_A 7 GOTOF L_B DEFAULT GOTOF L_C\nL_A: X1\nL_B: X2\nGOTOF L_D\nL_C: X3\nL_D: X4\n", [2, 4]),
    "parts again": ("X0\nTOP: X1\nX2\nREPEAT TOP P=2\nX3\nREPEATB TOP\nX4\n", [0, 1, 2, 1, 2, 1, 2, 3, 1, 4]),
    "a part between labels": ("GOTOF GO_ON\nLA1: X1\nX2\nLA2: X3\nGO_ON: REPEAT LA1 LA2 P=2\nX9\n", [1, 2, 3, 1, 2, 3, 9]),
    "a part up to ENDLABEL": ("LA1: X1\nX2\nENDLABEL: X3\nX4\nREPEAT LA1 P=2\nX9\n", [1, 2, 3, 4, 1, 2, 3, 1, 2, 3, 9]),
    "a part behind its repetition": ("X0\nREPEAT LA1\nX9\nM30\nLA1: X1\nX2\nENDLABEL:\nX3\n", [0, 1, 2, 9]),
    "two parts up to ENDLABEL": ("LA1: X1\nENDLABEL:\nLA2: X2\nENDLABEL:\nREPEAT LA2\nREPEAT LA1\nREPEATB LA2\n", [1, 2, 2, 1, 2]),
    "words that say how": ("X5\nX=IC(2)\nG91 X=AC(1)\nX3\nG90 X=AC(2)\n", [5, 7, 1, 4, 2]),
    "the end": ("X1\nM17\nX2\n", [1]),
    "strings": ("DEF STRING[8] AA=\"B\"\nIF AA==\"B\"\nX1\nENDIF\n", [1]),
}  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_which_blocks_run(name):
    text, expected = RUNS[name]
    assert ends("G1 F100\n" + text) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", RUNS)
def test_with_a_constant_error_every_move_goes_by_it(name):
    text = "G1 X0 Y0 Z0 F100\n" + RUNS[name][0]
    assert correct(text) == text
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    before, after = read(text).target, read(written).target
    np.testing.assert_allclose(after - before, np.broadcast_to(SHIFT, before.shape), atol=1e-9)


@pytest.mark.parametrize(
    ("block", "written"),
    [
        ("X10", "X9.9970"),
        ("X=10", "X=9.9970"),
        ("X=R1", "X=R1-0.0030"),
        ("X = R1*2 ; a", "X = R1*2-0.0030 ; a"),
        ("X=AC(R1)", "X=AC(R1-0.0030)"),
        ("X=(R1>2)", "X=(R1>2)-0.0030"),
        ("X=R1>2", "X=(R1>2)-0.0030"),
        ("X=-R1", "X=-R1-0.0030"),
        ("X=IC(5)", "X=IC(5)"),
        ("G2 X20 Y0 I=AC(10) J=AC(0)", "G2 X19.9970 Y0.0042 I=AC(9.9970) J=AC(0.0042)"),
        ("G2 X20 Y0 I10", "G2 X19.9970 Y0.0042 I10"),
        ("G3 X10 Y10 CR=10", "G3 X9.9970 Y10.0042 CR=10"),
    ],
)
def test_what_is_written(block, written):
    text = f"R1=5\nG0 X0 Y0 Z0\n{block}\n"
    assert correct(text, model=shifted(load("gantry"), **OFFSET)).splitlines()[-1] == written


def test_inserted_words_stand_behind_the_whole_neighbour():
    text = "G0 X0 Y0 Z0\nR1=300\nG1 X=AC(R1) F100\n"
    last = correct(text, model=random_model(load("gantry"), 3)).splitlines()[-1]
    assert re.fullmatch(r"G1 X=AC\(R1[+-]0\.\d{4}\) Y-?0\.\d{4} Z-?0\.\d{4} F100", last), last


# ---- frames, tools, machine coordinates


def test_frames():
    text = "G54\nG0 X1 Y1\nTRANS X100 Y2\nX1 Y1\nATRANS X50 Y2\nX1 Y1\nTRANS Z5\nX1 Y1 Z1\nTRANS\nX4 Y4\nATRANS X5\nROT\nX6\n"
    places = read(text, offsets=["G54=10,20,30"]).machine_target
    assert places[:, 0].tolist() == [11, 111, 161, 11, 14, 16]
    assert places[:, 1].tolist() == [21, 23, 25, 21, 24, 24]
    assert places[3:, 2].tolist() == [36, 34, 34] or places[3, 2] == 36


PLACED = {
    "ROT RPL=90": [-20, 10, 5],
    "ROT Z90": [-20, 10, 5],
    "ROT X90": [10, -5, 20],
    "ROT Y90": [5, 20, -10],
    "MIRROR X0": [-10, 20, 5],
    "SCALE X2 Y2 Z2": [20, 40, 10],
    "TRANS X100\nAROT Z90": [80, 10, 5],
    "ROT Z90\nATRANS X100": [-20, 110, 5],
    "TRANS X100\nROT Z90": [-20, 10, 5],
    "TRANS X100\nAMIRROR Y0\nATRANS Y5": [110, -25, 5],
    "ROT Z90\nROT": [10, 20, 5],
}


@pytest.mark.parametrize("code", PLACED)
def test_changed_coordinates(code):
    text = f"G0 X0 Y0 Z0\n{code}\nG1 X10 Y20 Z5 F500\nX15\nG2 X10 Y25 CR=5\nG1 Z=IC(1)\n"
    motions = read(text)
    assert motions.machine_target[1].tolist() == pytest.approx(PLACED[code], abs=1e-9)
    model = random_model(load("gantry"), 8)
    written = correct(text, model=model)
    assert f"\n{code}\n" in written
    verdict = verify(motions, read(written), model)
    assert verdict.before.largest > 20.0
    assert verdict.after.largest < 0.2


def test_frames_are_no_motion():
    text = "G0 X1 Y1 Z1\nTRANS X100 Y=2*3\nX1 Y1\n"
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    assert "\nTRANS X100 Y=2*3\n" in written


def test_lengths_and_machine_coordinates():
    text = "T1 M6\nD1\nG0 X0 Y0 Z5\nSUPA G0 Z300 D0\nD1 Z5\nG53 X20\n"
    motions = read(text, tools=["T1=80"])
    assert motions.machine_target[:, 2].tolist() == [85, 300, 85, 85]
    assert [Kind(kind) for kind in motions.kind][1] is Kind.MACHINE
    assert motions.known[-1, 0] == Known.MACHINE
    written = correct(text, tools=["T1=80"], model=shifted(load("gantry"), **OFFSET))
    assert "SUPA G0 Z300 D0\n" in written
    assert "G53 X20\n" in written


def test_tool_point_under_traori():
    """The same as G43.4 of ISO programs."""
    siemens = read(
        "G54 T1 M6 D1\nTRAORI\nG1 X50 Y10 Z20 B30 C40 F100\nTRAFOOF\nX1 Y1 Z1\n", "head_table", ["G54=1,2,3"], ["T1=80"]
    )
    iso = read_iso(
        "T1 M6\nG54 G43.4 H1\nG1 X50. Y10. Z20. B30. C40. F100\nG43 H1\nX1. Y1. Z1.\n",
        load("head_table"),
        ["G54=1,2,3"],
        ["T1=80"],
    )
    np.testing.assert_allclose(siemens.machine_target, iso.machine_target, atol=1e-9)


REFUSED = {
    "X=R1": "X=R1: R1 is not set by the program",
    "X=DEEP": "DEEP is not set by the program",
    "DEEP=5": "DEEP is neither a declared variable nor an axis",
    "REPEAT\nX=IC(1)\nUNTIL $AA_IW[X]>5": "too close to the value at which the program goes on in another way",
    "IF $AA_IW[X]==1 GOTOF AWAY": "too close to the value at which the program goes on in another way",
    "G2 X5 Y0 Z1 K1 F100": "the arc has no centre and no radius: write I and J, or CR",
    "TRANS X5\nR1=$AA_IW[X]\nX=R1": "R1 is not known: $AA_IW[X] is read where the program has not moved X",
    "SUPA X5\nX=$AA_IW[X]": "read where the program has not moved X in the present coordinates",
    "X=$AA_IB[X]": "ncomp follows $AA_IW and $AA_IM of X, Y and Z only",
    "G41 X9\nG40\nX=$AA_IW[X]": "read behind a move with radius compensation",
    "X9 RND=2\nX=$AA_IW[X]": "a broken corner",
    "G70\nX=$AA_IW[X]": "in a program in inches",
    "X=$AA_IM[X]": "$AA_IM[X] needs the offsets that are on the control",
    "X=IC($AA_IW[X])": "X is an increment that depends on a position",
    "TRANS X=$AA_IW[X]": "only X, Y and Z of a move can depend on it",
    "G53 X=$AA_IW[X]": "only X, Y and Z of a move can depend on it",
    "G2 X5 Y0 I=$AA_IW[X]": "only X, Y and Z of a move can depend on it",
    "$P_UIFR[1,X,TR]=$AA_IW[X]": "it depends on a position that the program reads",
    "R[$AA_IW[X]]=1": "it depends on a position that the program reads",
    "FOR R1=0 TO $AA_IW[X]\nENDFOR": "it depends on a position that the program reads",
    "DEF INT NR\nNR=$AA_IW[X]": "it depends on a position that the program reads",
    "CASE $AA_IW[X] OF 1 GOTOF AWAY": "it depends on a position that the program reads",
    "R1=2 R2=2\nIF R1==1 OR R2==2\nENDIF": "a comparison binds less than AND and OR",
    "R1=5 X=R1": "variable assigned and used in the same block",
    "R1=1/0\nX=R1": "/ has no value for 1, 0",
    "X=\"A\"": "its value is known only while the program runs",
    "TRAORI\nG41 X5": "tool radius compensation under TCP is not corrected",
    "G58 X5": "G58 shifts the coordinates",
    "ROTS X10": "ROTS rotates by angles in space, which is not followed",
    "SCALE X2\nG1 X1 F100\nG2 X3 I1": "scaled by different factors",
    "SCALE X-1": "SCALE has a factor that is not above 0",
    "ROT Z=IC(5)": "IC has no meaning in Z",
    "G1 RPL=30": "RPL has no rotation",
    "TRANS X5 G1": "must be alone in its block",
    "CYCLE800(1,\"\",0,57,0,0,0,30,0)": "a tilted plane needs a rotary axis, and machine gantry has none",
    "X5 CYCLE81(10,0,2,-5)": "a cycle call must be alone in its block",
    "MCALL POINTS(1,2)": "POINTS is not known to ncomp",
    "L340": "the file has no subprogram L340",
    "PART_TWO": "PART_TWO is not known to ncomp",
    "TRAORI(2)": "TRAORI with another transformation than the first",
    "G1 X5 I1=2": "the block has a centre, a radius or turns, but no arc",
    "G2 X5 Y1 I2 TURN=1.5": "TURN=1.5 is no number of turns",
    "G2 AR=400 I5": "AR=400 is no angle of an arc",
    "G2 AR=90": "the arc has no centre and no radius",
    "G1 X50 ANG=30": "ANG gives the end of a line by its angle, which is not followed",
    "G1 AP=30": "the polar coordinates are not complete",
    "G1 AP=30 RP=20 X5": "Cartesian and polar coordinates are mixed in the working plane",
    "G111 Z5": "Z is no coordinate of a pole",
    "A3=0 B3=0 C3=1": "a tool vector without TRAORI",
    "A5=1": "A5 is an orientation that is not corrected",
    "G291": "G291 switches to ISO programs, which are not followed here",
    "$P_PFRAME=CTRANS(X,1)": "$P_PFRAME belongs to the control",
    "$P_UIFR[1]=CROT(Z,30)": "CROT or CMIRROR rotates or mirrors a frame, which is not followed",
    "RET(1)": "RET with arguments",
    "X=DC(5)": "DC needs a rotary axis",
    "X=AC(1,2)": "AC takes one value",
    "X=IC()": "IC takes one value",
    "TRANS X5\nX=IC(5)": "an increment of X before its first absolute position in this frame",
    "G74 X1=0\nX=IC(5)": "an increment of X needs a known start",
    "DEF INT n=7": "n is an address",
    "FOR i=1 TO 3\nENDFOR": "I is neither a declared variable nor an axis",
    "E=5": "has no axis E",
    "X1=5": "the address X1 is not known to ncomp",
    "/X5": "block-skip switch",
    "GOTOF AWAY": "the program has no block with the label AWAY",
    "WHEN $A_IN[1] DO M5": "WHEN is a synchronised action",
    "IF R1": "the end of this loop, branch or subprogram is missing",
    "G1 X5 GOTOF AWAY": "must be alone in its block",
    "LA1: X1\nREPEAT LA1\nENDLABEL:": "the repetition stands between LA1 and ENDLABEL, which both may end it",
    'CALL "PART" BLOCK A1 TO A2': "CALL calls a program in a form that is not followed",
    'CALL "PART" BLOCK "N100" TO "N200"': "CALL calls a program in a form that is not followed",
    "CALL BLOCK LA1 TO LA2": "CALL calls a program in a form that is not followed",
    "PCALL /_N_WKS_DIR/_N_SHAFT_WPD/SHAFT(1,2)": "a program is called by its name, or by a path in its own folder",
    "G0 G1": "G0 and G1 in one block",
    "G999": "G999 is not known",
    "X 1 Y": "is not",
}  # fmt: skip


@pytest.mark.parametrize("block", REFUSED)
def test_refused(block):
    with pytest.raises(UserError, match=r"^test\.mpf:[2-9]: ") as caught:
        read("G1 X1 Y1 Z1 F100\n" + block + "\n")
    assert REFUSED[block] in str(caught.value)


def test_the_head_stays_in_front():
    text = "%_N_PART_MPF\n;$PATH=/_N_WKS_DIR\n; a\nG0 X1 Y1 Z1\n"
    machine, out = load("gantry"), io.BytesIO()
    job = Job(source_of(text, "test.mpf"), SIEMENS, machine, shifted(machine, X=3.0), setup_of(machine))
    Pipeline(job).run(out, lambda _: None)
    assert out.getvalue().decode().startswith(text[: text.index("G0")] + "; NCOMP ")


# ---- real programs

ACCEPTED = {
    "arrays": False, "actual_position": False, "arc": True, "axis_index_assignment": False, "custom_vars": False,
    "defaults": False, "edge_cases": False, "flatten_demo": True, "increment": False, "logic_operators": True,
    "simple": False, "spline": True, "trans2": False, "basic_math": True, "case": True,
    "case_insensitive_variables": True, "def_string": True, "for_loop": True, "function_calls": True, "goto": True,
    "if_statement": True, "loop": True, "multiple_m_codes": True, "precedence": True, "r_param": True, "repeat": True,
    "tool": True, "trans": True, "trans_ic": True, "trans_reset": True, "trig": True, "variables": True,
}  # fmt: skip


@pytest.mark.parametrize("name", ACCEPTED)
def test_real_programs(nc_data, name):
    """What is read comes out as it went in, and goes where the comments say (`;= 14`)."""
    text = (nc_data / "siemens" / "cead" / f"{name}.mpf").read_bytes().decode(ENCODING)
    machine = "trunnion_ac" if name in ("for_loop", "repeat") else "gantry"
    if not ACCEPTED[name]:
        with pytest.raises(UserError, match=r"^test\.mpf:\d+: "):
            correct(text, machine)
        return
    assert correct(text, machine) == text
    motions = read(text, machine)
    assert len(motions) > 0 or name in ("tool", "def_string")
    said = dict(enumerate(re.findall(r"(?m)^X ?=.*?(?:;= ([-\d.]+))?.*$", text)))
    for row, value in said.items():
        if value:
            assert motions.target[row, 0] == pytest.approx(float(value), abs=1e-4)


def test_loops_of_a_real_program(nc_data):
    """A raster of 101 lines: a constant error is put right in the loop's own blocks; one that changes is refused."""
    text = (nc_data / "siemens" / "cead" / "loop.mpf").read_bytes().decode(ENCODING)
    motions = read(text)
    assert len(motions) == 3 + 2 * 101
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    np.testing.assert_allclose(
        read(written).target - motions.target, np.broadcast_to(SHIFT, motions.target.shape), atol=1e-9
    )
    with pytest.raises(UserError, match="this block runs more than once and needs a different correction each time"):
        correct(text, model=random_model(load("gantry"), 1))


@pytest.mark.parametrize("name", ["bb.mpf", "CC.SPF"])
def test_the_dialect_is_found(name):
    assert find_dialect("auto", name, "G1 X1\n").name == "siemens"
    assert find_dialect("auto", "a.nc", "N10 R1=5\nX=R1\n").name == "siemens"
