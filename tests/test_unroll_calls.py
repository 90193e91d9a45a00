"""Calls with variables in their arguments, written out with the values that these have when the call runs."""

import io

import pytest
from support.axis_positions import positions
from support.programs import load, random_model, setup_of, source_of, written_out

from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import ENCODING

DRILLED = """\
G17 G90 G71 G94
DEF REAL RTP = 50, DEPTH
G0 X10 Y10 Z60
FOR R1 = 1 TO 2
DEPTH = -5 * R1
MCALL CYCLE81(RTP, R1 - 1, 2, DEPTH,)
X=10*R1 Y20
X=10*R1 Y30
MCALL
ENDFOR
G0 Z60
M30
"""


def unrolled(text):
    machine, dialect = load("gantry"), find_dialect("siemens", "", "")
    source = source_of(text, "test.mpf")
    return written_out(source, dialect, machine, setup_of(machine)).source.data.decode(ENCODING)


def test_a_modal_cycle_with_variables_is_written_out():
    text = unrolled(DRILLED)
    assert "MCALL CYCLE81(50,0,2,-5,)" in text
    assert "MCALL CYCLE81(50,1,2,-10,)" in text
    assert positions(text, "siemens") == positions(DRILLED, "siemens")


def test_it_is_corrected():
    machine, out = load("gantry"), io.BytesIO()
    source, dialect = source_of(DRILLED, "test.mpf"), find_dialect("siemens", "", "")
    job = Job(source, dialect, machine, random_model(machine, 8), setup_of(machine), travel_check=False, unroll=True)
    Pipeline(job).run(out, lambda _: None)
    assert b"MCALL CYCLE81(50,1,2,-10,)" in out.getvalue()


def test_an_argument_that_is_not_known_is_refused_with_its_line():
    with pytest.raises(UserError, match=r"test\.mpf:6: .*an argument of CYCLE81 is unknown"):
        unrolled(DRILLED.replace("2, DEPTH", "2, $AA_IM[Z]"))
