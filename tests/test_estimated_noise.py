"""Noise estimated from residuals: of the instrument, and of the axes from stop to stop."""

from dataclasses import replace

import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with, with_stops
from support.virtual_measurements import ONE, positions

from calibration.fit.calibrate import calibrate
from calibration.instruments import LaserTracker, Part
from calibration.measurement.estimated_noise import Decorrelation, EstimatedNoise
from calibration.simulation.simulate import observe
from kinematics.error_model.model import no_errors
from kinematics.state import State

HALF = LaserTracker(u_range_um_per_m=0.25, u_angle_um=1.5, u_angle_um_per_m=1.5)
"""Specification with half of the noise of the virtual measurements."""


def noise_of(data):
    """The noise of the fit of a measurement; None where it is that of the specification."""
    return calibrate(data, hold_out=False, force=True).fit.measurement.noise


def test_data_as_specified_keep_their_noise():
    assert noise_of(data_with(n=200, seed=5)) is None


@pytest.mark.parametrize("rows_of_a_stop", [1, 3])
def test_an_axis_that_does_not_repeat_is_found_by_name_and_size(rows_of_a_stop):
    data = with_stops(rows_of_a_stop, {0: 0.025})
    found = noise_of(data)
    assert found is not None
    assert list(found.non_repeatability) == ["X"]
    assert found.non_repeatability["X"] == pytest.approx(0.025, rel=0.25)
    assert "X repeats to" in found.text


def test_all_axes_that_do_not_repeat_are_found_where_three_rows_share_a_stop():
    """Errors of stops that are several times the noise of the instrument."""
    found = noise_of(with_stops(3, dict.fromkeys(range(3), 0.05)))
    assert found is not None
    assert found.instrument_factor == 1.0
    assert list(found.non_repeatability.values()) == pytest.approx([0.05] * 3, rel=0.25)


def test_decorrelated_rows_of_a_stop_are_white():
    """The transform turns the covariance of a stop, instrument and shared errors, into the identity."""
    data = with_stops(3, {0: 0.01})
    arms = np.zeros((len(data), 3, 1))
    arms[:, :, 0] = 0.01 * np.array([0.6, 0.8, 0.0])
    noise = EstimatedNoise(1.0, {"X": 0.01}, data.stops, arms)
    noisy = replace(data, noise=noise)
    white = noisy.whiteners
    transform = Decorrelation.of(noise, white)
    rows = np.flatnonzero(data.stops == data.stops[0])
    covariance = np.zeros((9, 9))
    for a in range(3):
        for b in range(3):
            shared = arms[rows[a]] @ arms[rows[b]].T
            covariance[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] = shared + (
                data.specified_covariances[rows[a]] if a == b else 0
            )
    root = np.linalg.cholesky(covariance)
    columns = np.zeros((len(data), 3, 9))
    columns[rows] = root.reshape(3, 3, 9)
    done = transform.apply(white @ columns)[rows].reshape(9, 9)
    np.testing.assert_allclose(done @ done.T, np.eye(9), atol=1e-9)


def test_a_part_measured_in_two_coordinates_has_the_noise_of_its_measuring_machine():
    """Two axes of such a part are as uncertain as its instrument: the noise is the instrument's."""
    rng = np.random.default_rng(1)
    q = positions(CFRAME, 200, rng)
    q[:, 2] = 100.0
    state = State(q, target=np.full(200, "1"))
    part = Part(1.0, components=2)
    data = observe(CFRAME, no_errors(CFRAME), state, part, rng, None, ONE, noise_scale=2.0)
    noise = noise_of(data)
    assert noise is not None
    assert noise.instrument_factor**0.5 == pytest.approx(2.0, rel=0.15)
    assert not noise.non_repeatability
