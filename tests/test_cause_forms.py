"""Forms of a named cause: the likeliest one stays, and the others are in the uncertainties."""

import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.unseen.undecided_causes import errors_by_forms
from calibration.diagnosis.unseen.unseen_states import mean_squares
from support.diagnosis_cases import data_with, selector

from calibration.diagnosis.forms import with_likelier_forms
from kinematics.effects import AngleHarmonic, ThermalDrift

RATE = Candidate(ThermalDrift("Z", rate=0.0))


def named(true, size):
    """The selector of data with a drift, and the stage in which it is named as one of constant rate."""
    data = data_with(true, n=300)
    own = selector(data)
    return own, own.stage([(RATE, np.array([size / 20.0]))])


def settling(measurement, amplitude):
    """A drift that settles within a third of the measurement."""
    span = float(np.ptp(measurement.state.time))
    return ThermalDrift("Z", amplitudes=(amplitude,), time_constants_s=(span / 3.0,))


def test_a_drift_that_settles_is_none_of_constant_rate():
    own, stage = named(settling(data_with(n=300), 40.0), 40.0)
    found = with_likelier_forms(own, stage)
    effect = found.fit.model.effects[found.numbers[0]]
    assert effect.amplitudes[0] == pytest.approx(40.0, rel=0.3)


def test_a_drift_of_constant_rate_stays():
    own, stage = named(ThermalDrift("Z", rate=120.0), 120.0)
    assert with_likelier_forms(own, stage) is stage


def test_one_wave_of_a_circle_is_not_two():
    """Over the range of the elevation both look alike."""
    first, second = (Candidate(AngleHarmonic("elevation", n, sine_urad=0.0, cosine_urad=0.0)) for n in (1, 2))
    own = selector(data_with(AngleHarmonic("elevation", 1, sine_urad=60.0, cosine_urad=-60.0), n=300))
    for named in (first, second):
        stage = with_likelier_forms(own, own.stage([(named, np.array([3.0, 3.0]))]))
        assert [each.candidate.effect.harmonic for each in stage.accepted] == [1]


def test_the_uncertainty_holds_forms_that_the_data_leave_open():
    own, stage = named(settling(data_with(n=300), 120.0), 120.0)
    wrong = mean_squares(errors_by_forms(stage, own.library))
    right = mean_squares(errors_by_forms(with_likelier_forms(own, stage), own.library))
    assert wrong[2] > 1.0
    assert right.max() < 0.1 * wrong[2]
