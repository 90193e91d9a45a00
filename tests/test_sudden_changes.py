"""Outliers in sequence: a knock, or a target seated again, shortly before the end or after the beginning."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.search.sudden_changes import LEAST, _sequences, with_outliers_beyond
from support.diagnosis_cases import data_with, selector
from support.tiers import quick

from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import StationShift

ROWS, FEW = 160, 8
SHIFT_UM = (80.0, -60.0, 30.0)


def knocked(moment):
    """Data of an instrument that was knocked before the row of this number."""
    time = float(data_with(n=ROWS).state.time[moment])
    return data_with(StationShift("s1", SHIFT_UM, since_s=time), n=ROWS)


@pytest.mark.parametrize("moment", quick([ROWS - FEW, FEW], []))
def test_a_knock_near_the_end_or_the_beginning_is_no_row_of_outliers(moment):
    data = knocked(moment)
    found = diagnose(data)
    assert [cause.kind for cause in found.causes] == ["station-shift"]
    effect = found.causes[0].effect
    assert isinstance(effect, StationShift)
    assert effect.since_s == data.state.time[moment]
    np.testing.assert_allclose(effect.shift_um, SHIFT_UM, atol=25.0)
    assert not len(found.after.fit.outliers)


@pytest.mark.parametrize("count", quick([FEW, 3, 2], [], [FEW, 2]))
def test_rows_that_are_off_each_by_itself_stay_outliers(count):
    data, rng = data_with(n=ROWS), np.random.default_rng(8)
    off = np.zeros((ROWS, 3))
    off[-count:] = rng.choice([-1.0, 1.0], (count, 3)) * rng.uniform(0.05, 0.1, (count, 3))
    observed = data.observed + off
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    assert [cause.kind for cause in found.causes] == ["outliers"]


ENDS = [slice(-2, None), slice(-3, None), slice(0, 2), slice(-1, None)]


@pytest.mark.parametrize("rows", quick(ENDS, ENDS[3:], [slice(0, 2)]))
def test_few_rows_at_an_end_that_are_off_alike_are_tied_with_a_knock(rows):
    """They are left out; one row says nothing about a knock."""
    data, off = data_with(n=ROWS), np.zeros((ROWS, 3))
    off[rows] = [0.08, -0.06, 0.05]
    observed = data.observed + off
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    (cause,) = found.causes
    assert cause.kind == "outliers"
    assert found.after.fit.outliers.tolist() == np.flatnonzero(off[:, 0]).tolist()
    count = len(found.after.fit.outliers)
    assert cause.verdict == ("tied" if count > 1 else "strong")
    assert found.conclusion.at_an_end == (count > 1)
    if count > 1:
        assert ("station-shift", "s1") in {(other.kind, other.axis) for other in cause.alternatives if other.tied}
        assert "measured once more" in cause.notes[0]


DRAWS = [(1, 1, 20.0), (2, 2, 20.0), (5, 2, 30.0)]


@pytest.mark.parametrize(("number", "seed", "um"), quick(DRAWS, [], DRAWS[:1]))
def test_three_rows_do_not_tell_a_knock_from_a_jump_of_the_machine(number, seed, um):
    towards = np.random.default_rng(5).normal(size=(6, 3))[number]
    shift = tuple((um * towards / np.linalg.norm(towards)).tolist())
    time = float(data_with(n=ROWS).state.time[ROWS - 3])
    found = diagnose(data_with(StationShift("s1", shift, since_s=time), n=ROWS, seed=seed))
    assert [cause.kind for cause in found.causes] == ["outliers"]


@pytest.mark.parametrize("off", [-2, -1, 1, 2])
def test_the_moment_of_a_knock_leaves_no_outliers_beside_it(off):
    data = knocked(ROWS // 2)
    made, time = selector(data), data.state.time
    blank = StationShift("s1", (0.0, 0.0, 0.0), since_s=float(time[ROWS // 2 + off]))
    stage = made.stage([(Candidate(blank, 1, float(ROWS)), np.zeros(6))])
    beside = range(min(ROWS // 2, ROWS // 2 + off), max(ROWS // 2, ROWS // 2 + off))
    assert stage.fit.outliers.tolist() == list(beside)
    moved = with_outliers_beyond(made, stage)
    assert moved.accepted[0].candidate.effect.since_s == time[ROWS // 2]
    assert not len(moved.fit.outliers)
    assert with_outliers_beyond(made, moved) is moved


def test_outliers_that_are_not_behind_a_change_do_not_move_it():
    """A row before the knock that is off by something else."""
    data, off = knocked(ROWS // 2), np.zeros((ROWS, 3))
    off[ROWS // 2 - 1] = 0.2, 0.1, -0.3
    observed = data.observed + off
    made = selector(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    blank = StationShift("s1", (0.0, 0.0, 0.0), since_s=float(data.state.time[ROWS // 2]))
    stage = made.stage([(Candidate(blank, 1, float(ROWS)), np.zeros(6))])
    assert stage.fit.outliers.tolist() == [ROWS // 2 - 1]
    assert with_outliers_beyond(made, stage) is stage


@pytest.mark.parametrize(
    ("outlying", "found"),
    [
        ("0000000011111111", [(8, slice(8, None))]),
        ("0000100011110111", [(8, slice(8, None))]),
        ("1111101100000000", [(8, slice(0, 8))]),
        ("1110000000000111", [(13, slice(13, None)), (3, slice(0, 3))]),
    ],
)
def test_sequences(outlying, found):
    assert list(_sequences(np.array([each == "1" for each in outlying]))) == found


def test_without_outliers_no_sequence_is_long_enough():
    none = np.zeros(20, bool)
    assert all(np.count_nonzero(none[rows]) < LEAST for _, rows in _sequences(none))
