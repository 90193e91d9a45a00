"""Causes that the data neither name nor exclude: the errors that they leave to be expected at unseen states."""

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.search.evaluation import evaluate
from calibration.diagnosis.unseen.undecided_causes import errors_by_undecided
from calibration.diagnosis.unseen.unseen_states import mean_squares, moments
from support.diagnosis_cases import CFRAME, data_with, selector

from kinematics.effects import Backlash, ThermalDrift, TrackerDrift
from kinematics.error_model.model import no_errors


def errors(linearised, *true):
    """Mean squares `(3,)` of the errors of a fit's model against true effects, and those of its uncertainty, um^2."""
    found, own = [], []
    for moment in moments(linearised.measurement):
        truth = moment.deviations(msgspec.structs.replace(no_errors(CFRAME), effects=true))
        found.append(np.mean((moment.deviations(linearised.fit.model) - truth) ** 2, axis=0))
        own.append(np.mean(linearised.fit.model.propagated(moment.design(linearised.fit.model)) ** 2, axis=0))
    return np.mean(found, axis=0), np.mean(own, axis=0)


def test_a_likely_cause_counts_with_its_whole_error():
    true = Backlash("X", 40.0)
    linearised = selector(data_with(true)).bare.linearised
    expected = mean_squares(errors_by_undecided(linearised, evaluate(linearised, [Candidate(Backlash("X", 0.0))])))
    found, own = errors(linearised, true)
    assert found[0] > 10.0 * own[0]
    assert expected[0] == pytest.approx(found[0], rel=0.15)


def test_an_unlikely_cause_does_not_count():
    linearised = selector(data_with(n=300)).bare.linearised
    expected = mean_squares(errors_by_undecided(linearised, evaluate(linearised, [Candidate(Backlash("X", 0.0))])))
    assert np.all(expected < 0.1 * errors(linearised)[1])


def test_of_a_cause_of_the_instrument_the_model_has_learned_a_part():
    true = TrackerDrift(shift_um_per_h=(0.0, 0.0, 0.0), turn_urad_per_h=(0.0, 0.0, 60.0))
    linearised = selector(data_with(true)).bare.linearised
    expected = mean_squares(
        errors_by_undecided(
            linearised, evaluate(linearised, [Candidate(TrackerDrift((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))])
        )
    )
    assert expected.sum() == pytest.approx(errors(linearised)[0].sum(), rel=0.5)


def test_of_a_drift_that_the_model_lacks_the_part_counts_that_it_has_learned():
    true = ThermalDrift("Z", rate=300.0)
    linearised = selector(data_with(true)).bare.linearised
    candidate = Candidate(ThermalDrift("Z", rate=0.0))
    expected = mean_squares(errors_by_undecided(linearised, evaluate(linearised, [candidate])))
    assert expected[2] == pytest.approx(errors(linearised, true)[0][2], rel=0.25)
