"""Uncertainties of a diagnosis' calibration: they hold at poses that were not measured, with a residual left too."""

import msgspec
import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with
from support.tiers import EXAM, STATISTICAL
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


@pytest.mark.parametrize(
    ("size", "seeds"),
    [
        pytest.param(0.0, range(3, 4)),
        pytest.param(100.0, range(3, 4), marks=STATISTICAL),
        *(pytest.param(size, range(3, 13), marks=EXAM) for size in (0.0, 100.0)),
    ],
)
def test_predictions_are_no_more_wrong_than_they_are_uncertain(size, seeds):
    """A frame that warps with all three positions is in no library.

    The errors of one draw are those of a few smooth functions, so their size varies from draw to draw.
    """
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (size,))
    squares = []
    for seed in seeds:
        found = diagnose(data_with(warped, n=240, seed=seed), force=True)
        assert bool(found.unexplained) == (size > 0)
        squares.append(np.mean(standardised(found.model, warped) ** 2, axis=0))
    assert np.sqrt(np.mean(squares, axis=0)).max() < 1.5
