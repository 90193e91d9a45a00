"""Outliers in sequence: a knock, or a target seated again, shortly before the end or after the beginning."""

from dataclasses import replace

import numpy as np
import pytest
from support.diagnosis_cases import data_with

from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.search.sudden_changes import LEAST, _sequences
from kinematics.effects import StationShift

ROWS, FEW = 160, 8
SHIFT_UM = (80.0, -60.0, 30.0)


def knocked(moment):
    """Data of an instrument that was knocked before the row of this number."""
    time = float(data_with(n=ROWS).state.time[moment])
    return data_with(StationShift("s1", SHIFT_UM, since_s=time), n=ROWS)


@pytest.mark.parametrize("moment", [ROWS - FEW, FEW])
def test_a_knock_near_the_end_or_the_beginning_is_no_row_of_outliers(moment):
    data = knocked(moment)
    found = diagnose(data)
    assert [cause.kind for cause in found.causes] == ["station-shift"]
    effect = found.causes[0].effect
    assert isinstance(effect, StationShift)
    assert effect.since_s == data.state.time[moment]
    np.testing.assert_allclose(effect.shift_um, SHIFT_UM, atol=25.0)
    assert not len(found.after.fit.outliers)


def test_rows_that_are_off_each_by_itself_stay_outliers():
    data, rng = data_with(n=ROWS), np.random.default_rng(8)
    off = np.zeros((ROWS, 3))
    off[-FEW:] = rng.choice([-1.0, 1.0], (FEW, 3)) * rng.uniform(0.05, 0.1, (FEW, 3))
    observed = data.observed + off
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    assert [cause.kind for cause in found.causes] == ["outliers"]


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
