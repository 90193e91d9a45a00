"""What a design can show and separate, before any reading of it is looked at."""

import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate, library
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.separability import ALIKE, separability
from support.diagnosis_cases import data_with, fitted

from kinematics.effects import Backlash


def of_design(*effects, seed=3):
    data = data_with(*effects, n=90, seed=seed)
    linearised = LinearisedFit.of(fitted(data))
    return {each.name: each for each in separability(linearised, library(data, linearised.fit.model)[0])}


@pytest.fixture(scope="module")
def found():
    return of_design()


def test_each_cause_of_the_library_has_one_of_three_verdicts(found):
    assert found["settling X"].verdict == "visible"
    assert (found["thermal-drift Z"].verdict, found["thermal-drift Z"].tied_with[0][0]) == ("tied", "tracker-drift")
    assert found["thermal-drift Z"].tied_with[0][1] == pytest.approx(1.0, abs=1e-6)
    assert found["air-scale"].verdict == "not visible"
    assert "length standard" in found["air-scale"].remedy
    for each in found.values():
        assert (each.verdict == "tied") == bool(each.tied_with)
        assert (each.verdict == "not visible") == (each.share < 0.05)
        assert all(ALIKE <= cosine <= 1.0 and name in found and name != each.name for name, cosine in each.tied_with)


def test_the_readings_do_not_change_it(found):
    """The same design, with a cause in the readings and other noise: the same verdicts."""
    data, other = data_with(n=90), data_with(Backlash("X", 300.0), n=90)
    assert np.array_equal(data.state.positions, other.state.positions)
    again = of_design(Backlash("X", 300.0))
    assert {name: each.verdict for name, each in again.items()} == {name: each.verdict for name, each in found.items()}
    assert [each.share for each in again.values()] == pytest.approx([e.share for e in found.values()], abs=0.002)


def test_a_library_of_nothing_visible_has_no_ties():
    data = data_with(n=60)
    linearised = LinearisedFit.of(fitted(data))
    assert separability(linearised, []) == []
    (only,) = separability(linearised, [Candidate(Backlash("X", 0.0))])
    assert (only.verdict, only.tied_with) == ("visible", ())
