"""Verification of two programs in step: the result of whole programs, in memory that does not grow with them."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from support.backlash_paths import played
from support.program_runs import corrected, job_of, programs
from support.programs import correct, load, random_model, read, setup_of, shifted, source_of
from support.tiers import drawn

import ncomp
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.motion.moves import Kind
from postproc.verification import contributions
from postproc.verification.in_step import DifferentMoves, in_step
from postproc.verification.verify import Verifier, read_motions, verify

GANTRY, DMU50 = load("gantry"), load("dmu50")
HEAD = "G21 G90 G17 G54 G94\nG0 X100. Y100. Z100.\n"
ZIGZAG = "G1 X{0}. Y{1}. F500\nX{2}. Z101.\nG2 Y150. R200.\nG1 X{0}.\nY{1}.\n"


def zigzag(times):
    return HEAD + "".join(ZIGZAG.format(300 + i % 7, 200 + i % 5, 900 - i % 3) for i in range(times)) + "M30\n"


def figures(content):
    """All values of a result, by their path in it."""
    if isinstance(content, dict):
        return {f"{k}.{name}": v for k, inner in content.items() for name, v in figures(inner).items()}
    if isinstance(content, list):
        return figures(dict(enumerate(content)))
    return {"": content}


def same(verdict, other):
    """The turn of a best fit about a line on which nearly all points lie is that of rounding errors."""
    found, expected = figures(verdict.json()), figures(other.json())
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert "turn_urad" in name or found[name] == (
            pytest.approx(value, abs=2e-4) if isinstance(value, float) else value
        ), name


@drawn(
    4,
    30,
    program=programs(),
    seed=st.integers(0, 99),
    size=st.sampled_from([1, 2, 7, 100]),
    chunk=st.sampled_from([1, 2, 7, 4096]),
)
def test_the_verdict_is_that_of_whole_programs(program, seed, size, chunk):
    job = job_of(program, seed, tolerance_um=0.5)
    text = corrected(job).get("text")
    assume(text is not None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", chunk)
        parts = [read_motions(s, job.dialect, job.machine, job.setup) for s in (job.source, source_of(text))]
    verifier, whole = (Verifier(job.machine, job.model, job.conditions, 0.5) for _ in range(2))
    for moves in in_step(*parts, size):
        assert len(moves.nominal) <= size
        assert len(moves.matched) == len(moves.commanded)
        assert np.array_equal(moves.matched.added, moves.commanded.added)
        verifier.add(moves)
    for moves in in_step(*parts):
        whole.add(moves)
    same(verifier.verdict(), whole.verdict())


def test_take_ups_and_segments_stay_with_their_moves():
    text = zigzag(5)
    model = played(GANTRY, X=20.0, Y=15.0)
    done = correct(text, GANTRY, model, tolerance_um=0.2).text
    assert "TAKE-UP" in done
    parts = [read(text, GANTRY)], [read(done, GANTRY)]
    pieces = list(in_step(*parts, 1))
    assert [len(piece.nominal) for piece in pieces] == [1] * len(parts[0][0])
    assert any((piece.commanded.kind[:1] == Kind.TAKE_UP).any() for piece in pieces)
    for piece in pieces:
        assert piece.commanded.kind[-1] != Kind.TAKE_UP
        assert int((~piece.commanded.added).sum()) == 1


def test_contributions_are_those_of_evenly_spaced_moves(monkeypatch):
    text, model = zigzag(60), random_model(GANTRY, 3)
    done = correct(text, GANTRY, model, tolerance_um=1e3).text
    every = verify(read(text, GANTRY), read(done, GANTRY), model).contributions
    monkeypatch.setattr(contributions, "LEAST_CONTRIBUTION_MOVES", 30)
    counts, some = set(), []
    for size in (9, 40, 4096):
        verifier = Verifier(GANTRY, model, ncomp.conditions(), 1.0)
        for moves in in_step([read(text, GANTRY)], [read(done, GANTRY)], size):
            verifier.add(moves)
        some.append(verifier.verdict().contributions)
        counts |= {statistic.count for statistic in some[-1].values()}
    (count,) = counts
    assert 30 <= count < 60
    assert some[0].keys() == every.keys()
    for name, statistic in every.items():
        assert len({each[name].largest for each in some}) == 1
        assert some[0][name].largest <= statistic.largest
        assert some[0][name].rms == pytest.approx(statistic.rms, rel=0.2)


@pytest.mark.parametrize("size", [1, 3, 4096])
@pytest.mark.parametrize(
    "change",
    [
        lambda lines: [*lines[:-4], *lines[-3:]],
        lambda lines: [*lines[:-2], "G1 X5.", *lines[-2:]],
        lambda lines: [*lines[:-3], lines[-3].replace("G1", "G0"), *lines[-2:]],
        lambda lines: lines[:1],
    ],
    ids=["left out", "more", "rapid", "none"],
)
def test_programs_with_other_moves_are_refused(change, size):
    text = HEAD + "G1 X300. F500\nG1 Y200.\nG1 X100.\nG1 Y100.\nM30\n"
    other = "\n".join(change(text.splitlines())) + "\n"
    for nominal, commanded in ((text, other), (other, text)):
        with pytest.raises(DifferentMoves, match="do not make the same moves"):
            list(in_step([read(nominal, GANTRY)], [read(commanded, GANTRY)], size))


def refusal(nominal, commanded):
    with pytest.raises(UserError) as refused:
        ncomp.verify(nominal, commanded, GANTRY, shifted(GANTRY, X=10.0), setup=setup_of(GANTRY))
    return str(refused.value)


@pytest.mark.parametrize("chunk", [1, 4096])
def test_a_refused_line_comes_before_other_moves_and_the_original_first(chunk, monkeypatch):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", chunk)
    monkeypatch.setattr("postproc.verification.in_step.in_step.__defaults__", (chunk,))
    good, early = zigzag(3), HEAD + "G1 X[5\n" + zigzag(3)
    late = zigzag(3).replace("M30", "G1 X#\nM30")
    assert "do not make the same moves" in refusal(good, HEAD + "G1 X5.\nM30\n")
    assert ":18:" in refusal(late, early)
    assert ":3:" in refusal(good, early)
    assert ":18:" in refusal(HEAD + "G1 X5.\nM30\n", late)


@pytest.mark.statistical
def test_memory_does_not_grow_with_the_programs(tmp_path, monkeypatch):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", 256)
    monkeypatch.setattr("postproc.text.source.PIECE", 4096)
    monkeypatch.setattr("postproc.verification.in_step.in_step.__defaults__", (256,))
    monkeypatch.setattr(contributions, "LEAST_CONTRIBUTION_MOVES", 100)
    peaks, path = [], tmp_path / "in.nc"
    for lines in (2_000, 2_000, 12_000):
        path.write_text(HEAD + "".join(f"G1 X{i % 97}.5 Y{i % 89}.25 Z{i % 83}.125\n" for i in range(lines)))
        tracemalloc.start()
        ncomp.verify(path, path, GANTRY, no_errors(GANTRY), setup=setup_of(GANTRY))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.5 * peaks[1], peaks
