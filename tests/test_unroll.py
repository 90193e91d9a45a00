"""Programs with loops and calls, written out: the same moves, and corrections that differ from pass to pass."""

import io

import numpy as np
import pytest
from support.iso_generator import HEAD, OUTSIDE, lines
from support.programs import correct, load, model_of, random_model, setup_of, source_of, written_out
from support.tiers import drawn

from kinematics.basis import Polynomial
from kinematics.effects import ErrorMotion
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.motion.moves import Kind
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions, verify

GANTRY = load("gantry")
BENT = model_of(GANTRY, ErrorMotion("Y", "X", Polynomial((0.0, 5000.0), 2), (0.0, -400.0, 400.0)))
"""A different correction in every pass."""


def run(text, dialect="iso", model=BENT, tolerance_um=1.0, *, unroll=True):
    """The source that is corrected, the corrected text, and the moves of the original and of the result."""
    language = find_dialect(dialect, "", "")
    source, setup = source_of(text), setup_of(GANTRY, ["G54=0,0,0"])
    out = io.BytesIO()
    job = Job(source, language, GANTRY, model, setup, False, tolerance_um=tolerance_um, unroll=unroll)
    Pipeline(job).run(out, lambda _: None)
    if unroll:
        source = written_out(source, language, GANTRY, setup).source
    written = out.getvalue().decode(ENCODING)
    moves = [merged(read_motions(source_of(t), language, GANTRY, setup)) for t in (text, written)]
    return source, written, *moves


ISO = """%
O0001 (LOOP)
#1=0
G21 G90 G54 G0 X0. Y0. Z0.
WHILE[#1 LT 2]DO1
G1 X[100.*#1] Y-#1 F500. (A)
G2 X[100.*#1+20.] I10. J0.
#1=[#1+1]
END1
M98 P100
G0 X300. M98 P100
M30
O100
N5 G91 G1 X10. (STEP)
G90 Y[#1*5] M99
%
"""
UNROLLED = """%
O0001 (LOOP)
G21 G90 G54 G0 X0. Y0. Z0.
G1 X0.0 Y0.0 F500. (A)
G2 X20.0 I10. J0.
(LINE 5, PASS 2)
G1 X100.0 Y-1.0 F500. (A)
G2 X120.0 I10. J0.
(LINE 14, PASS 1)
N5 G91 G1 X10. (STEP)
G90 Y10.0
(LINE 11, PASS 1)
G0 X300.
(LINE 14, PASS 2)
N5 G91 G1 X10. (STEP)
G90 Y10.0
(LINE 12, PASS 1)
M30
%
"""


def test_by_hand():
    source, written, nominal, commanded = run(ISO)
    assert source.data.decode() == UNROLLED
    assert source.hash == source_of(ISO).hash
    verdict = verify(nominal, commanded, BENT)
    assert verdict.moves == len(nominal) == 10
    assert verdict.after.largest < 0.1
    assert verdict.path_after.largest < 1.0
    with pytest.raises(UserError, match="this block runs more than once and needs a different correction each time"):
        run(ISO, unroll=False)
    assert ISO.startswith(written[:14])


def test_a_program_without_loops_is_the_source_itself():
    text = "G0 X1\nM30\n"
    written, plain = (correct(text, GANTRY, BENT, unroll=unroll, travel_check=False) for unroll in (True, False))
    assert written.text == plain.text != text
    assert written.report.program == plain.report.program


def test_siemens():
    text = "DEF REAL STEP=100\nR1=0\nG90 G54 G0 X0 Y0 Z0\nFOR R1=1 TO 2\nG1 X=R1*STEP Y=AC(R1) F500\nENDFOR\n"
    text += "LA1: X=IC(5) ; B\nREPEAT LA1 P=1\nM30\n"
    source, _, nominal, commanded = run(text, "siemens")
    assert source.data.decode().splitlines() == [
        "G90 G54 G0 X0 Y0 Z0", "G1 X=100.0 Y=AC(1.0) F500", "; LINE 5, PASS 2", "G1 X=200.0 Y=AC(2.0) F500",
        "X=IC(5)", "; LINE 7, PASS 2", "X=IC(5)", "; LINE 9, PASS 1", "M30",
    ]  # fmt: skip
    assert verify(nominal, commanded, BENT).after.largest < 0.1


def test_klartext():
    text = "0 BEGIN PGM A MM\n1 Q1 = 0\n2 L X+0 Y+0 Z+0 FMAX\n3 LBL 1\n4 Q1 = Q1 + 100\n5 L X+Q1 Y-Q1 F500\n"
    text += (
        "6 CALL LBL 1 REP 1\n7 CALL LBL 2\n8 M30\n9 LBL 2\n10 CC IX+10 Y+0\n11 L IX+5,5\n12 LBL 0\n13 END PGM A MM\n"
    )
    source, _, nominal, commanded = run(text, "heidenhain")
    assert source.data.decode().splitlines() == [
        "0 BEGIN PGM A MM", "2 L X+0 Y+0 Z+0 FMAX", "5 L X+100.0 Y-100.0 F500", "; LINE 4, PASS 2",
        "5 L X+200.0 Y-200.0 F500", "; LINE 11, PASS 1", "10 CC IX+10 Y+0", "11 L IX+5,5", "; LINE 9, PASS 1", "8 M30",
        "13 END PGM A MM",
    ]  # fmt: skip
    assert verify(nominal, commanded, BENT).after.largest < 0.1


def test_tool_speed_and_feed_of_klartext_have_no_sign():
    text = (
        "BEGIN PGM T MM\nQ1 = 3\nQ2 = 1500\nTOOL CALL Q1 Z SQ2 FQ2\nL X+0 Y+0 Z+0 R0 FMAX\n"
        "LBL 1\nL IX+Q1 FQ2\nCALL LBL 1 REP 2\nEND PGM T MM\n"
    )
    source, *_ = run(text, "heidenhain")
    written = source.data.decode(ENCODING)
    assert "TOOL CALL 3 Z S1500 F1500" in written.replace(".0", "")
    assert written.replace(".0", "").count("L IX+3 F1500") == 3


def test_what_is_not_known_is_refused():
    with pytest.raises(
        UserError, match=r"test.nc:3: .*F#5041.*: the value is unknown, and the block cannot be unrolled"
    ):
        run("#1=1\nG0 X0. Y0. Z0.\nG1 X1. F#5041\nWHILE[#1 LT 2]DO1\n#1=[#1+1]\nEND1\nM30\n")


@drawn(few=5, many=15, body=lines(OUTSIDE, []))
def test_generated_programs(linuxcnc, body):
    """LinuxCNC makes the same moves of the program and of what is written out; each is corrected at its place."""
    text = HEAD + body + "M2\n"
    model = random_model(GANTRY, 3)
    source, written, nominal, commanded = run(text, model=model, tolerance_um=1e3)
    assert verify(nominal, commanded, model).after.largest < 0.2 or (nominal.kind == Kind.ARC).any()
    runs = [linuxcnc.run(program) for program in (text, source.data.decode())]
    assert [run.exit_status for run in runs] == [0, 0], runs
    before, after = (np.array([move.machine[:3] for move in run.moves]).reshape(-1, 3) for run in runs)
    np.testing.assert_allclose(after, before, atol=1e-6)
    assert written.count("NCOMP") == 1
