"""The written text does not depend on the division of a program into chunks."""

import io

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.backlash_paths import with_backlash
from support.corrected_lines import written
from support.programs import correct, load, model_of, random_model, setup_of, source_of
from support.three_dialects import WRITERS, parts
from support.tiers import drawn

from kinematics.basis import Fourier, Legendre
from kinematics.effects import Backlash, ErrorMotion
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect

GANTRY, DMU50 = load("gantry"), load("dmu50")
HEAD = "G21 G90 G17 G54 G94\nG0 X1000 Y1000 Z510\nX1010 Y1010 Z505\n"
LINES = "G1 X1030 Y1030 Z501 F100\nX1020\nX1040\nX1030\n"


@pytest.mark.parametrize("more", ["G2 X1030 Y1030 I5 J0 M5\n", "G2 X1040 I5 M5\n", "G3 I5 M9\nG1 X1000\n"])
def test_one_arc_does_not_take_the_take_ups_of_other_moves_away(more):
    model = model_of(GANTRY, *(Backlash(axis, 15.0) for axis in "XYZ"))
    alone, beside = (correct(HEAD + LINES + text, GANTRY, model) for text in ("", more))
    assert alone.text.count("TAKE-UP") == 3
    assert beside.text.splitlines()[1 : len(alone.text.splitlines())] == alone.text.splitlines()[1:]
    assert not [note for note in beside.report.notes if "(line 5" in note and "reverses within the move" in note]


def test_one_move_under_tcp_does_not_take_the_take_ups_of_other_moves_away():
    model = model_of(DMU50, *(Backlash(axis, 15.0) for axis in "XYZ"))
    head = "G21 G90 G17 G94\nG0 X10 Y10 Z50 B0 C0\nX20 Y20 Z45\n"
    lines = "G1 X30 Y30 Z41 F100\nX20\nX40\nX30\n"
    tcp = "G43.4 H1\nG1 X30 Y30 Z41 B0 C0\nX35 C5\n"
    alone, beside = (correct(head + lines + text, DMU50, model, tools=["T1=0"]) for text in ("", tcp))
    assert alone.text.count("TAKE-UP") == 3
    assert beside.text.splitlines()[1 : len(alone.text.splitlines())] == alone.text.splitlines()[1:]


@pytest.mark.statistical
@pytest.mark.parametrize("play", [False, True], ids=["smooth", "play"])
@pytest.mark.parametrize("writer", WRITERS)
@settings(max_examples=8)
@given(part=parts(), seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1, 2, 3, 7]))
def test_chunks_of_any_size_give_one_text(writer, play, part, seed, size):
    model = (with_backlash if play else random_model)(GANTRY, seed)
    text = writer().program(part)
    whole = written(text, GANTRY, model, writer.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", size)
        assert written(text, GANTRY, model, writer.name) == whole


TABLE = ErrorMotion("Y", "C", Fourier((0.0, 360.0), (2.0,)), (0.0, 0.0, 20.0, 0.0), u=(0.1,) * 4)
HEADS = {
    "iso": ["G21 G90 G17 G54 G94", "T1 M6", "G43 H1"],
    "siemens": ["G17 G90 G71 G94 G54", "T1 M6 D1"],
    "heidenhain": ["BEGIN PGM PART MM", "TOOL CALL 1 Z S1000"],
}
BETWEEN = {"iso": "(TURN)", "siemens": "; TURN", "heidenhain": "; TURN"}


def turning_program(dialect, steps):
    """Feed moves and comments, as dialects write them: of C alone, of X alone, or of both."""
    move = "L {} {}" if dialect == "heidenhain" else "{1} {0}"
    rapid, feed = ("FMAX", "F500") if dialect == "heidenhain" else ("G0", "G1 F500")
    sign = "+" if dialect == "heidenhain" else ""
    lines = [*HEADS[dialect], move.format(f"X{sign}10.0 Y{sign}10.0 Z{sign}200.0 B{sign}0.0 C{sign}90.0", rapid)]
    for kind, x, c in steps:
        words = " ".join([f"X{sign}{x}.5"] * (kind in "xb") + [f"C{sign}{c}.0"] * (kind in "cb"))
        lines.append(move.format(words, feed) if words else BETWEEN[dialect])
    return "\n".join([*lines, "M30", *["END PGM PART MM"] * (dialect == "heidenhain"), ""])


@pytest.mark.parametrize("dialect", HEADS)
@drawn(
    few=3,
    many=12,
    steps=st.lists(
        st.tuples(st.sampled_from("ccxb-"), st.integers(0, 40), st.integers(0, 359)), min_size=2, max_size=9
    ),
    size=st.sampled_from([1, 2, 3, 5]),
)
def test_turns_of_rotary_axes_do_not_depend_on_chunks(dialect, steps, size):
    """Whether a position is left as it is depends on the turn behind it, which may stand in the next chunk."""
    model, setup = model_of(DMU50, TABLE), setup_of(DMU50, tools=["T1=80"])
    text = turning_program(dialect, steps)
    whole = written(text, DMU50, model, dialect, setup)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", size)
        assert written(text, DMU50, model, dialect, setup) == whole


@pytest.mark.parametrize("size", [1, 2, 4096])
def test_the_limit_of_a_correction_is_that_of_its_own_tool(size, monkeypatch):
    """A long tool later in the program allows a short one no larger corrections, whatever the chunk they stand in."""
    tilted = ErrorMotion("A", "Z", Legendre((0.0, 400.0), 0), (100.0,), u=(0.1,))
    shifted = ErrorMotion("Y", "X", Legendre((0.0, 1.0), 1), (0.0, 0.1), u=(0.1, 0.1))
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    text = "G21 G90 G17 G54\nT1 M6\nG43 H1\nG0 X10. Y10. Z100. B0 C0\n{}M30\n"
    setup = setup_of(DMU50, tools=["T1=10", "T2=300"], datums=["G54=true"])
    limits = []
    for more in ("", "T2 M6\nG43 H2\nG0 X10. Y10. Z50.\n"):
        source = source_of(text.format(more))
        model = model_of(DMU50, tilted, shifted)
        job = Job(source, find_dialect("iso", "", ""), DMU50, model, setup, travel_check=False)
        limits.append(Pipeline(job).run(io.BytesIO(), lambda _: None).max_correction_um)
    assert limits[1] > limits[0] + 20.0
