"""Noise estimated from residuals: of the instrument, and of the axes from stop to stop."""

from dataclasses import replace

import numpy as np
import pytest
from shop_floor.question import ask
from support.diagnosis_cases import CFRAME, data_with, fitted, with_stops
from support.virtual_measurements import ONE, THREE, measured, positions

import machines
from calibration.fit import noise
from calibration.fit.fit import fit
from calibration.fit.noise import with_estimated_noise
from calibration.instruments import LaserTracker, Part
from calibration.measurement.estimated_noise import Decorrelation, EstimatedNoise
from calibration.measurement.file import read_measurement
from calibration.observation.full_model import BasisChoice, with_effects
from calibration.simulation.simulate import observe
from kinematics.effects import StationShift
from kinematics.error_model.model import no_errors
from kinematics.state import State

HALF = LaserTracker(u_range_um_per_m=0.25, u_angle_um=1.5, u_angle_um_per_m=1.5)
"""Specification with half of the noise of the virtual measurements."""


def test_data_as_specified_keep_their_noise():
    assert with_estimated_noise(fitted(data_with(n=200, seed=5))).noise is None


@pytest.mark.parametrize("rows_of_a_stop", [1, 3])
def test_an_axis_that_does_not_repeat_is_found_by_name_and_size(rows_of_a_stop):
    data = with_stops(rows_of_a_stop, {0: 0.025})
    found = with_estimated_noise(fitted(data)).noise
    assert found is not None
    assert list(found.non_repeatability) == ["X"]
    assert found.non_repeatability["X"] == pytest.approx(0.025, rel=0.25)
    assert "X repeats to" in found.text


def test_without_visits_the_report_tells_that_shifts_of_stops_may_recur():
    again = with_estimated_noise(fitted(with_stops(3, {0: 0.025}))).noise
    unless = "unless the model lacks errors of this size that recur with the position"
    assert unless in replace(again, revisited=False).text
    assert unless not in again.text


def test_all_axes_that_do_not_repeat_are_found_where_three_rows_share_a_stop():
    """Errors of stops that are several times the noise of the instrument."""
    found = with_estimated_noise(fitted(with_stops(3, dict.fromkeys(range(3), 0.05)))).noise
    assert found is not None
    assert found.instrument_factor == 1.0
    assert list(found.non_repeatability.values()) == pytest.approx([0.05] * 3, rel=0.25)


@pytest.mark.parametrize("start", [(1.0, 0.0, 0.0, 0.0), (1.0, 0.1, 0.0, 0.0), (4.0, 0.0, 0.0, 0.1)])
def test_variances_that_rest_at_zero_grow_where_the_residuals_show_them(start):
    found = fitted(with_stops(3, {0: 0.05, 1: 0.03}))
    components = noise._Components.of(found, replace(found.measurement, noise=None), ("X", "Y", "Z"))
    every = noise._estimate(components, np.array([1.0, 0.1, 0.1, 0.1])).estimate
    resting = noise._estimate(components, np.array(start)).estimate
    assert every is not None
    assert resting is not None
    assert np.flatnonzero(every.of_axes).tolist() == [0, 1]
    assert resting.factor == every.factor
    assert resting.of_axes == pytest.approx(every.of_axes, rel=0.01)


def test_of_two_axes_that_explain_the_same_the_clearer_remains(tmp_path):
    """X and Y are each uncertain beside the other; without both, the instrument would seem to be noisy."""
    path = tmp_path / "data.csv"
    path.write_text(ask("bad-repeat", "shift", "gantry", 1, 15001).sheet(), encoding="utf-8")
    data = read_measurement(path, machines.load("gantry"))
    data = replace(data, state=replace(data.state, station=np.full(len(data), "1")))
    knock = StationShift(station="1", shift_um=(0.0,) * 3, turn_urad=(0.0,) * 3, since_s=1051.9)
    model, prior = with_effects(data, dict.fromkeys("XYZ", BasisChoice("cubic", 8)), [knock], 0.5)
    found = with_estimated_noise(fit(data, model, prior=prior)).noise
    assert found is not None
    assert found.instrument_factor == 1.0
    assert list(found.non_repeatability) == ["Y"]


def test_visits_that_do_not_see_an_axis_limit_none_of_its_variance():
    rng = np.random.default_rng(4)
    q = np.repeat(positions(CFRAME, 70, rng), 3, axis=0)
    found = fitted(measured(CFRAME, rng.permutation(q), THREE, no_errors(CFRAME), rng))
    seen = noise._Components.of(found, found.measurement, ["X", "Y", "Z"])
    large = noise._Estimate(1.0, np.array([400.0, 0.0, 0.0]))
    blind = replace(seen, arms=np.where(seen.stop[:, None, None] == seen.stop[0], 0.0, seen.arms))
    shifted = replace(seen, residual=seen.residual + 3.0 * rng.normal(size=(len(q), 1)) * seen.arms[:, :, 0])
    shifted_blind = replace(shifted, arms=blind.arms)
    for all_of_them, others in ((seen, blind), (shifted, shifted_blind)):
        of_all, of_others = (each.repeated(large).of_axes[0] for each in (all_of_them, others))
        assert of_others == pytest.approx(of_all, rel=0.02)
    assert of_all > 1.0


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
    noise = with_estimated_noise(fitted(data)).noise
    assert noise is not None
    assert noise.instrument_factor**0.5 == pytest.approx(2.0, rel=0.15)
    assert not noise.non_repeatability
