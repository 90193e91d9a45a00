"""What is written does not depend on how a program is cut into chunks."""

import io

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import correct, load, model_of, random_model, source_of
from test_direction import with_play
from test_three_dialects import setup as offset_setup
from three_dialects import WRITERS, parts

from kinematics.effects import Backlash
from kinematics.errors import UserError
from postproc.dialects import find_dialect
from postproc.pipeline import Job, Pipeline
from postproc.source import ENCODING

GANTRY, DMU50 = load("gantry"), load("dmu50")
HEAD = "G21 G90 G17 G54 G94\nG0 X1000 Y1000 Z510\nX1010 Y1010 Z505\n"
LINES = "G1 X1030 Y1030 Z501 F100\nX1020\nX1040\nX1030\n"


def written(text, machine, model, dialect="iso", setup=None):
    """The corrected program without its mark, and the notes; or why it is refused."""
    source, out, dialect = source_of(text), io.BytesIO(), find_dialect(dialect, "", "")
    job = Job(source, dialect, machine, model, setup or offset_setup(machine, dialect.name), travel_check=False)
    try:
        report = Pipeline(job).run(out, lambda _: None)
    except UserError as refusal:
        return str(refusal), []
    lines = out.getvalue().decode(ENCODING).splitlines()
    return [line for line in lines if "CALIBRATION" not in line], report.notes


@pytest.mark.parametrize("more", ["G2 X1030 Y1030 I5 J0 M5\n", "G2 X1040 I5 M5\n", "G3 I5 M9\nG1 X1000\n"])
def test_one_arc_does_not_take_the_take_ups_of_other_moves_away(more):
    model = model_of(GANTRY, *(Backlash(axis, 15.0) for axis in "XYZ"))
    alone, beside = (correct(HEAD + LINES + text, GANTRY, model) for text in ("", more))
    assert alone.text.count("TAKE-UP") == 3
    assert beside.text.splitlines()[1 : len(alone.text.splitlines())] == alone.text.splitlines()[1:]
    assert not [note for note in beside.report.notes if "(line 5" in note and "turns back in it" in note]


def test_one_move_under_tcp_does_not_take_the_take_ups_of_other_moves_away():
    model = model_of(DMU50, *(Backlash(axis, 15.0) for axis in "XYZ"))
    head = "G21 G90 G17 G94\nG0 X10 Y10 Z50 B0 C0\nX20 Y20 Z45\n"
    lines = "G1 X30 Y30 Z41 F100\nX20\nX40\nX30\n"
    tcp = "G43.4 H1\nG1 X30 Y30 Z41 B0 C0\nX35 C5\n"
    alone, beside = (correct(head + lines + text, DMU50, model, tools=["T1=0"]) for text in ("", tcp))
    assert alone.text.count("TAKE-UP") == 3
    assert beside.text.splitlines()[1 : len(alone.text.splitlines())] == alone.text.splitlines()[1:]


@pytest.mark.parametrize("play", [False, True], ids=["smooth", "play"])
@pytest.mark.parametrize("writer", WRITERS)
@settings(max_examples=8)
@given(part=parts(), seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1, 2, 3, 7]))
def test_chunks_of_any_size_give_one_text(writer, play, part, seed, size):
    model = (with_play if play else random_model)(GANTRY, seed)
    text = writer().program(part)
    whole = written(text, GANTRY, model, writer.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK", size)
        assert written(text, GANTRY, model, writer.name) == whole
