"""Uncertainties of a diagnosis' calibration: they hold at poses that were not measured, with a residual left too."""

import msgspec
import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with
from support.tiers import quick
from support.virtual_measurements import positions

from calibration.diagnosis.diagnose import diagnose
from calibration.fit.prediction import relative
from kinematics.deviation import exact_deviation
from kinematics.effects import Unnamed
from kinematics.error_model.model import no_errors
from kinematics.state import State

TRAVELS = tuple(axis.travel for axis in CFRAME.axes)
TOOL = np.array([[0.0, 0.0, -120.0]])


def standardised(model, *effects, n=300, seed=99):
    """Errors `(n, 3)` of predictions at other positions, relative to their mean, in standard uncertainties."""
    state = State(positions(CFRAME, n, np.random.default_rng(seed)), np.zeros((n, 3)))
    tool = np.repeat(TOOL, n, axis=0)
    truth = msgspec.structs.replace(no_errors(CFRAME), effects=effects)
    found = relative(model, CFRAME, state, tool)
    true = 1e3 * exact_deviation(CFRAME, state.positions, truth.errors(CFRAME, state), tool).position
    return (found.deviation - (true - true.mean(axis=0))) / found.u


@pytest.mark.parametrize("seed", quick([3, 4, 5, 6], [3]))
@pytest.mark.parametrize("size", [0.0, 100.0])
def test_predictions_are_as_uncertain_as_they_are_wrong(size, seed):
    """A frame that warps with all three positions is in no library."""
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (size,))
    data = data_with(warped, n=240, seed=seed)
    found = diagnose(data)
    assert (found.unexplained is not None) == (size > 0)
    assert (found.widened > 1.0) == (size > 0)
    spread = np.sqrt(np.mean(standardised(found.model, warped) ** 2, axis=0))
    assert 0.5 < spread[2] < 1.5
    assert spread.max() < 1.5


def test_an_unexplained_part_that_is_added_to_the_model_does_not_widen_it():
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (100.0,))
    found = diagnose(data_with(warped, n=240), left_over="add")
    assert found.with_unnamed
    assert found.widened == 1.0
