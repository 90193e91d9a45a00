"""Rows that are called wrong, and those that are not."""

from dataclasses import replace

import pytest
from support.diagnosis_cases import data_with, fitted

from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import Backlash, Outliers


@pytest.mark.parametrize("wrong", [(), (40,)])
def test_a_row_before_the_first_move_of_an_axis_with_backlash_is_no_wrong_row(wrong):
    """The axis stood on the other side of its lost motion; another row that is as far off is wrong."""
    data = data_with(Backlash("X", 300.0))
    along = fitted(data).registration.rotations(data)[:, :, 0] * 0.15
    observed = data.observed.copy()
    observed[[0, *wrong]] += along[[0, *wrong]]
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    rows = {row for cause in found.causes if isinstance(cause.effect, Outliers) for row in cause.effect.rows}
    assert {cause.kind for cause in found.causes} - {"outliers"} == {"backlash"}
    assert rows == set(wrong)
