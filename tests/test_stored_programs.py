"""Programs with jumps: interpreted once, stored, and corrected with all contexts of their blocks known."""

import dataclasses
import io

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.backlash_paths import with_backlash
from support.corrected_lines import written
from support.programs import load, model_of, random_model, setup_of, source_of
from support.three_dialects import WRITERS, loops, paths

from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.user_error import UserError
from postproc.compensation import correction as compensate
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.blocks import PlainRun

GANTRY = load("gantry")
BOWED = ErrorMotion("Y", "X", Polynomial((0.0, 5000.0), 2), (0.0, -400.0, 400.0))
HEAD = "G21 G90 G54\nG0 X5. Y5. Z5.\n"
LOOP = HEAD + "#1=0\nWHILE[#1 LT {times}]DO1\nG0 X10. Y10.\nX20. Y20.\nG1 X820. F100\nG0 X5.\n#1=#1+1\nEND1\nM30\n"


def corrected(text, *effects, **options):
    """The number of blocks that were interpreted, the points that were solved, and the report."""
    runs, points = [], []

    def interpreter(*given):
        made = iso.interpreter(*given)
        read = made._read_all
        made._read_all = lambda blocks, done: read((item for item in blocks if runs.append(lines(item)) is None), done)
        return made

    def lines(item):
        return len(item) if isinstance(item, PlainRun) else 1

    def solve(machine, errors, nominal, *more):
        points.append(len(nominal))
        return correct_position(machine, errors, nominal, *more)

    iso = find_dialect("iso", "", "")
    counted = msgspec.structs.replace(iso, interpreter=interpreter)
    correct_position = compensate.correct_position
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compensate, "correct_position", solve)
        job = Job(source_of(text), counted, GANTRY, model_of(GANTRY, *effects), setup_of(GANTRY), **options)
        report = Pipeline(job).run(io.BytesIO(), lambda _: None)
    return sum(runs), points, report


@pytest.mark.parametrize("times", [2, 50])
def test_every_block_run_is_interpreted_once(times):
    runs, *_ = corrected(LOOP.format(times=times), BOWED)
    assert runs == 4 + 6 * times


def test_the_written_text_is_interpreted_once():
    text = LOOP.format(times=10)
    looped, *_ = corrected(text, BOWED)
    both, _, report = corrected(text, BOWED, unroll=True)
    assert both == looped + report.blocks


def test_a_move_that_runs_many_times_is_cut_once():
    """All iterations together need as many samples as the first."""
    few, many = (corrected(LOOP.format(times=times), BOWED) for times in (2, 50))
    assert few[1][0] == many[1][0] > 8
    assert many[2].split_moves == 25 * few[2].split_moves == 50


def test_the_points_of_moves_that_stay_whole_are_solved_once():
    flat = Polynomial((0.0, 5000.0), 1)
    text = HEAD + "".join(f"G1 X{x}. Y{x}. F100\n" for x in range(1, 100)) + "M30\n"
    _, points, report = corrected(text, ErrorMotion("Y", "X", flat, (0.0, 50.0)))
    assert points == [report.moves]


def test_the_directions_of_moves_need_no_full_solution():
    """With play the directions of the moves depend on the corrections of their ends: found to a tenth of the band."""
    _, points, report = corrected(LOOP.format(times=3), Backlash("X", 15.0))
    assert len(points) == 2
    assert points[0] == report.moves


@pytest.mark.statistical
@pytest.mark.parametrize("kept", [0, 1])
@pytest.mark.parametrize("writer", WRITERS)
@settings(max_examples=8)
@given(part=st.one_of(loops(), paths(3)), play=st.booleans(), seed=st.integers(0, 2**32 - 1))
def test_chunks_in_a_file_give_the_same_text(writer, kept, part, play, seed):
    model = (with_backlash if play else random_model)(GANTRY, seed)
    text = writer().program(part)
    whole = written(text, GANTRY, model, writer.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", 3)
        patch.setattr("postproc.execution.KEPT_CHUNKS", kept)
        assert written(text, GANTRY, model, writer.name) == whole


def test_a_refusal_names_the_work_offset_at_the_move():
    """And not the one that the program has set when it ends."""
    text = (
        "G21 G90\nG10 L2 P1 X10 Y20 Z30\nG54 G0 X0. Y0. Z0.\nM98 P100\nX99999.\nG10 L2 P1 X-7 Y0 Z0\nM30\nO100\nM99\n"
    )
    machine = dataclasses.replace(GANTRY, control=dataclasses.replace(GANTRY.control, family="fanuc"))
    job = Job(source_of(text), find_dialect("iso", "", ""), machine, model_of(GANTRY, BOWED), setup_of(GANTRY))
    with pytest.raises(UserError, match=r"work offset G54 = X 10, Y 20, Z 30 \(set by the program\)"):
        Pipeline(job).run(io.BytesIO(), lambda _: None)


def results(text, *, stored):
    """The corrected text and the report, or the message of a refusal."""
    job = Job(source_of(text), find_dialect("iso", "", ""), GANTRY, model_of(GANTRY, BOWED), setup_of(GANTRY))
    out, steps = io.BytesIO(), []
    try:
        report = Pipeline(job, stored=stored).run(out, steps.append)
    except UserError as refusal:
        return str(refusal)
    content = report.json()
    content["calibration"].pop("age_days")
    return out.getvalue(), content, sum(steps)


STRAIGHT = "".join(f"X{10 + i % 7}. Y{20 + i}.\n" for i in range(20))
LATE = "#1=0\nN50 #1=#1+1\nG1 X30. F100\nG0 X31.\nIF[#1 LT 3]GOTO50\nM30\n"


@pytest.mark.parametrize("size", [1, 4, 1000])
@pytest.mark.parametrize(
    "straight", [STRAIGHT, f"{STRAIGHT}X#5\n", f"{STRAIGHT}X99999.\n", f"{STRAIGHT}G1 Q5 ?\n"],
    ids=["moves", "unknown value", "outside", "unknown word"],
)  # fmt: skip
def test_a_jump_that_is_found_on_the_way(straight, size, monkeypatch):
    """The result is that of a program that is known to jump, also where a block before is refused."""
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    text = HEAD + straight + LATE
    assert results(text, stored=False) == results(text, stored=True)


def test_a_program_that_goes_straight_on_is_read_once(monkeypatch):
    """Without a look for jumps; the refusal of a block alone makes one."""
    looks = []
    monkeypatch.setattr("postproc.correct.pipeline.turns", lambda *_: looks.append(1))
    results(HEAD + STRAIGHT, stored=False)
    assert not looks
    assert "Q5" in results(f"{HEAD}{STRAIGHT}G1 Q5 ?\n", stored=False)
    assert looks
