"""Klartext with Q parameters, labels, cycles and changed coordinates: what runs, and what is written."""

import re

import numpy as np
import pytest
from support.klartext_programs import HEAD, OFFSET, SHIFT, TAIL, correct, read
from support.programs import load, model_of, random_model, shifted

from kinematics.effects import Backlash
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.compensation.correction import pose_errors
from postproc.verification.verify import verify

RUNS = {
    "formulas": ("Q1 = 2 + 3 * 4\nL X+Q1\nQ2 = ( 2 + 3 ) * 4\nL X+Q2\nQ3 = - Q1\nL X-Q3\nQ4 = SQRT 16 + SQ 3\nL X+Q4\nQ5 = 7 % 4\nL X+Q5\n", [14, 20, 14, 13, 3]),
    "functions": ("Q1 = SIN 30 * 10\nL X+Q1\nQ2 = COS ( 30 + 30 ) * 10\nL X+Q2\nQ3 = INT 2.9 + FRAC 3,5\nL X+Q3\nQ4 = ABS -3 + SGN -5\nL X+Q4\nQ5 = 2 ^ 3\nL X+Q5\n", [5, 5, 2.5, 2, 8]),
    "fn": ("FN 0: Q1 =+5\nFN 1: Q2 =+Q1 + +2\nFN 2: Q3 =+Q2 - +Q1\nFN 3: Q4 =+Q2 * +2\nFN 4: Q5 =+Q4 DIV +7\nFN 5: Q6 = SQRT +16\nFN 6: Q7 = SIN +30\nFN 8: Q8 =+3 LEN +4\nFN 13: Q9 =+1 ANG +1\nL X+Q2\nL X+Q3\nL X+Q4\nL X+Q5\nL X+Q6\nL X+Q7\nL X+Q8\nL X+Q9\n", [7, 2, 14, 2, 4, 0.5, 5, 45]),
    "subprograms": ("Q1 = 1\nCALL LBL 1\nL X+9\nCALL LBL \"IN\"\nL X+8 M30\nLBL 1\nL X+Q1\nLBL 0\nLBL \"IN\"\nL X+3\nLBL 0\n", [1, 9, 3, 8]),
    "repeats": ("Q1 = 0\nLBL 5\nQ1 = Q1 + 1\nL X+Q1\nCALL LBL 5 REP 2/2\nL X+9\n", [1, 2, 3, 9]),
    "repeats by a parameter": ("Q2 = 2\nLBL 5\nL IX+1\nCALL LBL 5 REP Q2\n", [1, 2, 3]),
    "nested repeats": ("LBL 1\nL IX+1\nLBL 2\nL IX+10\nCALL LBL 2 REP 1\nCALL LBL 1 REP 1\n", [1, 11, 21, 22, 32, 42]),
    "jumps": ("Q1 = 0\nLBL 1\nL X+Q1\nFN 1: Q1 =+Q1 + +1\nFN 12: IF +Q1 LT +3 GOTO LBL 1\nFN 9: IF +0 EQU +0 GOTO LBL 2\nL X+99\nLBL 2\nL X+7\n", [0, 1, 2, 7]),
    "a label in the way": ("L X+1\nLBL 1\nL X+2\nLBL 0\nCALL LBL 1\n", [1, 2, 2]),
}  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_which_blocks_run(name):
    text, expected = RUNS[name]
    motions = read(HEAD + text + TAIL)
    assert motions.target[1:, 0].tolist() == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", RUNS)
def test_with_a_constant_error_every_move_goes_by_it(name):
    text = HEAD + RUNS[name][0] + TAIL
    assert correct(text) == text
    before, after = read(text).target, read(correct(text, model=shifted(load("gantry"), **OFFSET))).target
    np.testing.assert_allclose(after - before, np.broadcast_to(SHIFT, before.shape), atol=1e-9)


def test_sums_go_into_parameters_of_our_own():
    text = HEAD + "Q1 = 5,5\n4 L X-Q1 IY+Q1 Z+1,5 F500\n" + TAIL
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    assert written.splitlines()[3:5] == ["FN 1: QL450 =-Q1 + -0,0030", "4 L X+QL450 IY+Q1 Z+1,4945 F500"]


def test_a_program_that_has_these_parameters_itself():
    text = HEAD + "FN 0: QL450 =+5\nL X+QL450 F500\n" + TAIL
    assert correct(text) == text
    with pytest.raises(UserError, match="QL450 is a variable for the corrections of ncomp"):
        correct(text, model=shifted(load("gantry"), **OFFSET))


def test_a_block_at_several_places_that_want_different_corrections():
    text = HEAD + "Q1 = 0\nLBL 1\nQ1 = Q1 + 100\nL X+Q1 F500\nCALL LBL 1 REP 3\n" + TAIL
    with pytest.raises(
        UserError, match=r"test.h:6: .*this block runs more than once and needs a different correction each time"
    ):
        correct(text, model=random_model(load("gantry"), 3))


# ---- changed coordinates

PLACED = {
    "a shift": ("CYCL DEF 7.0 DATUM\nCYCL DEF 7.1 X+100\nCYCL DEF 7.2 Y+20\n", [110, 40, 5]),
    "one axis of it": ("CYCL DEF 7.0 DATUM\nCYCL DEF 7.1 X+100\nCYCL DEF 7.0 DATUM\nCYCL DEF 7.1 Z+1\n", [110, 20, 6]),
    "a mirror": ("CYCL DEF 8.0 MIRROR\nCYCL DEF 8.1 X\n", [-10, 20, 5]),
    "two mirrors": ("CYCL DEF 8.0 MIRROR\nCYCL DEF 8.1 X Y\n", [-10, -20, 5]),
    "a rotation": ("CYCL DEF 10.0 ROT\nCYCL DEF 10.1 ROT+90\n", [-20, 10, 5]),
    "a scale": ("CYCL DEF 11.0 SCALE\nCYCL DEF 11.1 SCL 2\n", [20, 40, 10]),
    "a rotation round a shifted datum": ("CYCL DEF 7.0 D\nCYCL DEF 7.1 X+100\nCYCL DEF 10.0 R\nCYCL DEF 10.1 ROT+90\n", [80, 10, 5]),
    "taken back": ("CYCL DEF 8.0 MIRROR\nCYCL DEF 8.1 X\nCYCL DEF 8.0 MIRROR\nCYCL DEF 8.1\n", [10, 20, 5]),
}  # fmt: skip


@pytest.mark.parametrize("name", PLACED)
def test_changed_coordinates(name):
    code, expected = PLACED[name]
    text = HEAD + code + "L X+10 Y+20 Z+5 F500\nL IX+5\nCC X+10 Y+20\nC X+10 Y+25 DR+\nL IZ+1\n" + TAIL
    motions = read(text)
    assert motions.machine_target[1].tolist() == pytest.approx(expected, abs=1e-9)
    machine: Machine = load("gantry")
    model = random_model(machine, 8)
    written = correct(text, model=model)
    commanded = read(written)
    assert re.findall("CYCL DEF.*", written) == re.findall("CYCL DEF.*", text)
    rows = [1, 2, 4]
    left = pose_errors(machine, model, commanded.machine_target[rows], motions.machine_target[rows], motions.tool[rows])
    assert left.point_um.max() < 0.2
    verdict = verify(motions, commanded, model)
    assert verdict.before.largest > 20.0
    assert verdict.path_after.largest < 3.0


# ---- cycles and radius compensation


def test_cycles_start_from_the_corrected_place():
    cycle = "CYCL DEF 200 DRILLING ~\n  Q200=+2 ;SET-UP ~\n  Q201=-20 ;DEPTH ~\n  Q203=+5 ;SURFACE ~\n  Q204=+50 ;2ND\n"
    text = HEAD + cycle + "L X+10 Y+5 FMAX M99\nL X+20 FMAX\nCYCL CALL M13\nL Z+100 FMAX\n" + TAIL
    motions = read(text)
    assert motions.target[1:, 0].tolist() == [10, 20, 20]
    assert motions.start[2:, 2].tolist() == [55, 55]
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    assert "L X+9.9970 Y+5.0042 FMAX M99" in written
    assert cycle in written
    assert "Z+99.9945" in written


def test_a_cycle_behind_every_move():
    """M89 runs it at X10, X20 and Y30, where each hole begins at the second clearance of the one before; M99 ends it."""
    cycle = "CYCL DEF 200 DRILLING ~\n  Q200=+2 ;SET-UP ~\n  Q201=-20 ;DEPTH ~\n  Q203=+5 ;SURFACE ~\n  Q204=+50 ;2ND\n"
    text = HEAD + "L Z+90\n" + cycle + "L X+10 Y+5 FMAX M89\nL X+20 M8\nM9\nL Y+30 M99\nL Z+100 FMAX\nL IZ+1\n" + TAIL
    assert read(text).start[2:, 2].tolist() == [90, 55, 55, 55, 100]
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    lines = ["L X+9.9970 Y+5.0042 FMAX M89", "L X+19.9970 M8", "M9", "L Y+30.0042 M99", "L Z+99.9945 FMAX", "L IZ+1"]
    assert [line for line in written.splitlines() if line in lines] == lines


def test_no_block_of_our_own_where_a_cycle_runs_behind_every_move():
    """The blocks that take up backlash would each be a hole."""
    cycle = "CYCL DEF 200 D ~\n  Q200=+2 ~\n  Q201=-20 ~\n  Q203=+5 ~\n  Q204=+50\n"
    text = HEAD + "L X+0 Y+0 Z+90\n" + cycle + "L X+10 F500 M89\nL X+60 Y+60\nL X+5 Y+70\nL X+4 M99\nL Z+100\n" + TAIL
    model = model_of(load("gantry"), Backlash("X", 20.0))
    written = correct(text, model=model)
    assert len(written.splitlines()) == len(text.splitlines())
    assert "L X+4.9900 Y+70" in written
    assert "NCOMP TAKE-UP" in correct(text.replace(" M89", ""), model=model)


@pytest.mark.parametrize("block", ["L M89", "L X+5 M89 M99", "CYCL CALL M89"])
def test_where_a_cycle_behind_every_move_cannot_begin(block):
    with pytest.raises(UserError, match=r"M89 (needs a move|in a cycle call)"):
        read(HEAD + "CYCL DEF 200 D Q200=+2 Q201=-20 Q203=+5 Q204=+50\n" + block + "\n" + TAIL)


def test_points_of_a_compensated_contour_are_corrected():
    text = HEAD + "L X+10 Y+10 RL F500\nL Y+50\nRND R5\nL X+60\nCHF 2\nL Y+10\nL X+0 R0\n" + TAIL
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    assert written.splitlines()[2:-1] == [
        "L X+9.9970 Y+10.0042 RL F500", "L Y+50.0042", "RND R5", "L X+59.9970", "CHF 2", "L Y+10.0042", "L X-0.0030 R0",
    ]  # fmt: skip


def test_no_block_of_our_own_in_a_compensated_contour():
    text = HEAD + "L X+10 Y+10 RL F500\nL Y+50\nL X+60 Y+60\nL X+5 Y+70\n" + TAIL
    written = correct(text, model=model_of(load("gantry"), Backlash("X", 20.0)))
    assert "NCOMP TAKE-UP" not in written
    assert "L X+4.9900 Y+70" in written
