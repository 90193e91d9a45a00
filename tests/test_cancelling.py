"""Causes that cancel each other imitate another one; causes that add up, or lie across each other, do not."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.residual.cancelling import cancelling
from calibration.diagnosis.residual.unexplained import stand_together
from support.diagnosis_cases import data_with, selector

from kinematics.effects import Backlash, LocationError, LocationJump, ThermalDrift, Unnamed

DRIFT = Candidate(ThermalDrift("X", rate=0.0))
JUMP = Candidate(LocationJump("X", "X", 0.0, 700.0))
SLOW = Candidate(ThermalDrift("X", amplitudes=(0.0,), time_constants_s=(900.0,)))
ACROSS = Candidate(ThermalDrift("Y", rate=0.0))
PLAY = Candidate(Backlash("Z", 0.0))


@pytest.fixture(scope="module")
def blamed():
    """Number of causes that are blamed, of candidates with these sizes in typical ones."""
    made = selector(data_with(n=100))

    def count(*chosen):
        stage = made.stage([(candidate, np.array([size])) for candidate, size in chosen])
        sized = [replace(each, size=np.array([size])) for each, (_, size) in zip(stage.accepted, chosen, strict=True)]
        return len(cancelling(made.bare.linearised, sized))

    return count


def test_a_jump_that_takes_back_most_of_a_drift_is_blamed_with_it(blamed):
    assert blamed((DRIFT, 10.0), (JUMP, -1.0)) == 2
    assert blamed((DRIFT, 10.0), (JUMP, -1.0), (PLAY, 2.0)) == 2


def test_causes_that_add_up_or_lie_across_each_other_stand(blamed):
    assert blamed((DRIFT, 10.0)) == 0
    assert blamed((DRIFT, 10.0), (JUMP, 1.0)) == 0
    assert blamed((ACROSS, 10.0), (JUMP, -1.0)) == 0


def test_parts_of_one_warming_may_cancel(blamed):
    assert blamed((DRIFT, 10.0), (SLOW, -5.0)) == 0


def test_errors_of_one_geometry_may_cancel(blamed):
    lines = (Candidate(LocationError("C", "Y", 0.0)), Candidate(LocationError("B", "Z", 0.0)))
    assert blamed((lines[0], 1.0), (lines[1], -1.0)) == 0


@pytest.mark.parametrize("hidden", [True, False])
def test_causes_that_cancel_each_other_stand_where_they_are_likelier_than_a_function(hidden):
    """A drift and a jump back that are there, or a wave in time that these two imitate."""
    causes = ThermalDrift("X", rate=120.0), LocationJump("X", "X", -40.0, 700.0)
    wave = Unnamed(
        "X", ("time",), ((0.0, 15.0 * 240),), tuple((k,) for k in range(1, 7)), (3.0, -9.0, 8.0, 6.0, -9.0, 5.0)
    )
    made = selector(data_with(*(causes if hidden else (wave,)), n=240))
    stage = made.stage([(DRIFT, np.array([1.0])), (JUMP, np.array([-1.0]))])
    assert stand_together(stage, stage.accepted) == hidden
