"""The noise of a fit: by the specification, unless the residuals contradict it."""

import json

import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with, with_stops
from support.evidence.strd import measurement_of, thermometer_readings

from calibration.evaluation.volumetric import aligned, deviation_on
from calibration.fit.calibrate import calibrate
from calibration.fit.fit import fit
from calibration.observation.full_model import BasisChoice, with_effects
from calibration.reports.fit import fit_json, fit_report
from kinematics.effects import Backlash

QUADRATIC = {"basis": "legendre:2", "hold_out": False, "force": True}


def test_data_as_specified_give_the_numbers_of_the_specification():
    data = data_with(n=120)
    found = calibrate(data, **QUADRATIC)
    model, prior = with_effects(data, dict.fromkeys("XYZ", BasisChoice("legendre", 2)), (), 1.0)
    plain = fit(data, model, prior=prior)
    assert found.fit.measurement.noise is None
    np.testing.assert_array_equal(found.fit.model.parameters, plain.model.parameters)
    np.testing.assert_array_equal(found.fit.model.covariance, plain.model.covariance)
    assert fit_json(found, None)["estimated_noise"] is None


def test_an_axis_that_does_not_repeat_is_said_and_widens_its_uncertainties_only():
    data = with_stops(1, {0: 0.025})
    found, quiet = calibrate(data, **QUADRATIC), calibrate(with_stops(1, {}), **QUADRATIC)
    noise = found.fit.measurement.noise
    assert noise is not None
    assert list(noise.non_repeatability) == ["X"]
    assert found.fit.chi2_reduced > 2.0
    assert found.fit.p_value > 1e-3
    written = fit_json(found, None)
    json.dumps(written)
    assert written["estimated_noise"]["non_repeatability"]["X"] == pytest.approx(25.0, rel=0.25)
    verdict = fit_report(found, None, "ncomp fit").verdict
    assert "X repeats to" in verdict
    assert "No table cures that" in verdict
    assert "The model explains the data" not in verdict
    for name, least, most in (("E_XX", 1.5, 10.0), ("E_ZZ", 0.7, 1.4)):
        own, before = (
            next(np.mean(each.uncertainties) for each in one.model.effects if each.name == name)
            for one in (found, quiet)
        )
        assert least < own / before < most


def test_noise_that_is_larger_than_specified_may_be_a_missing_effect():
    """A backlash that the model lacks looks like an axis that does not repeat."""
    found = calibrate(data_with(Backlash("X", 60.0), n=150), **QUADRATIC)
    assert found.fit.measurement.noise is not None
    assert [each.variable for each in found.dependences] == ["the direction of X"]


@pytest.mark.statistical
def test_errors_of_stops_are_no_errors_of_the_machine():
    """It has none; 48 nodes under the typical prior would take up the whole error of each stop."""
    positions, size, left = np.random.default_rng(0).uniform(*CFRAME.travel, (400, 3)), 0.02, []
    for seed in range(4):
        found = calibrate(with_stops(3, dict.fromkeys(range(3), size), seed), hold_out=False, force=True)
        assert set(found.fit.measurement.noise.non_repeatability) == set("XYZ")
        errors, points = deviation_on(CFRAME, found.model, positions)
        left.append(float(np.sqrt(np.mean(aligned(errors, points) ** 2))))
    assert max(left) < 0.3 * size


@pytest.mark.xfail(strict=True, reason="under a small prior the evidence of fine bases is that of coarse ones")
@pytest.mark.statistical
def test_an_axis_that_does_not_repeat_is_no_fine_error_motion():
    """Random stops with three rows each: a fine basis would follow the error of each stop."""
    found = calibrate(with_stops(3, dict.fromkeys(range(3), 0.02)), hold_out=False, force=True)
    assert found.fit.measurement.noise is not None
    assert set(found.fit.measurement.noise.non_repeatability) == set("XYZ")
    assert max(basis.size for basis in found.choice.bases.values()) <= 8


def test_an_estimated_noise_gives_the_uncertainties_of_a_straight_line_by_hand():
    """GUM, H.3: residual standard deviation 3.5 mdegC, slope 2.18 with 0.67 mdegC per degC."""
    temperature, correction = map(np.array, thermometer_readings())
    measured = measurement_of({"target_mm": temperature.tolist(), "deviation_um": correction.tolist()}, 1.0)
    found = calibrate(measured, basis="legendre:1", variance="estimate", prior_scale=1e3, hold_out=False, force=True)
    line = np.polyfit(temperature, correction, 1)
    s = np.sqrt(np.sum((correction - np.polyval(line, temperature)) ** 2) / 9)
    u = s / np.sqrt(np.sum((temperature - temperature.mean()) ** 2))
    half = np.ptp(temperature) / 2.0
    motion = found.model.effects[0]
    assert np.array([motion.parameters[1], motion.u[1]]) / half == pytest.approx([line[0], u], rel=1e-6)
    assert (round(s, 1), round(line[0], 2), round(u, 2)) == (3.5, 2.18, 0.67)
