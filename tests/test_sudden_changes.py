"""Outliers in sequence: a knock, or a target seated again, shortly before the end or after the beginning."""

from dataclasses import replace

import numpy as np
import pytest
from support.diagnosis_cases import data_with
from support.tiers import quick

from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import StationShift

ROWS, FEW = 160, 8
SHIFT_UM = (80.0, -60.0, 30.0)


def knocked(moment):
    """Data of an instrument that was knocked before the row of this number."""
    time = float(data_with(n=ROWS).state.time[moment])
    return data_with(StationShift("s1", SHIFT_UM, since_s=time), n=ROWS)


@pytest.mark.xfail(
    strict=True, reason="what the model cannot do: rows that are outliers by themselves say nothing of a common cause"
)
@pytest.mark.parametrize("moment", quick([ROWS - FEW, FEW], [], [FEW]))
def test_a_knock_near_the_end_or_the_beginning_is_no_row_of_outliers(moment):
    data = knocked(moment)
    found = diagnose(data)
    assert [cause.kind for cause in found.causes] == ["station-shift"]
    effect = found.causes[0].effect
    assert isinstance(effect, StationShift)
    assert effect.since_s == data.state.time[moment]
    np.testing.assert_allclose(effect.shift_um, SHIFT_UM, atol=25.0)
    assert not found.outliers


@pytest.mark.parametrize("count", quick([FEW, 3, 2], [], [FEW, 2]))
def test_rows_that_are_off_each_by_itself_stay_outliers(count):
    data, rng = data_with(n=ROWS), np.random.default_rng(8)
    off = np.zeros((ROWS, 3))
    off[-count:] = rng.choice([-1.0, 1.0], (count, 3)) * rng.uniform(0.05, 0.1, (count, 3))
    observed = data.observed + off
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    assert [cause.kind for cause in found.causes] == ["outliers"]


ENDS = [slice(-2, None), slice(-3, None), slice(-1, None)]


@pytest.mark.parametrize("rows", quick(ENDS, ENDS[2:], ENDS[:1]))
def test_few_rows_at_an_end_that_are_off_alike_are_outliers(rows):
    data, off = data_with(n=ROWS), np.zeros((ROWS, 3))
    off[rows] = [0.08, -0.06, 0.05]
    observed = data.observed + off
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    (cause,) = found.causes
    assert cause.kind == "outliers"
    assert found.outliers == np.flatnonzero(off[:, 0]).tolist()


DRAWS = [(1, 1, 20.0), (2, 2, 20.0), (5, 2, 30.0)]


@pytest.mark.parametrize(("number", "seed", "um"), quick(DRAWS, [], DRAWS[:1]))
def test_three_rows_do_not_tell_a_knock_from_a_jump_of_the_machine(number, seed, um):
    towards = np.random.default_rng(5).normal(size=(6, 3))[number]
    shift = tuple((um * towards / np.linalg.norm(towards)).tolist())
    time = float(data_with(n=ROWS).state.time[ROWS - 3])
    found = diagnose(data_with(StationShift("s1", shift, since_s=time), n=ROWS, seed=seed))
    assert [cause.kind for cause in found.causes] == ["outliers"]
