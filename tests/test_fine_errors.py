"""Errors finer than any basis: found where visits of one position share them, and expected at unseen positions."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.unseen.fine_errors import fine_variances, squares_by_fine_errors
from calibration.diagnosis.unseen.unseen_states import moments
from support.diagnosis_cases import CFRAME, selector
from support.virtual_measurements import THREE, measured, positions

from calibration.measurement.estimated_noise import EstimatedNoise
from kinematics.effects import Cyclic
from kinematics.error_model.model import no_errors

PERIOD = 23.7
"""mm; the travels of the C-frame are 450 mm and more."""
PHASES = 6


def lines(rng):
    """Positions `(n, 3)` along each axis at nine places of the others, out and back, then random ones."""
    low, high = CFRAME.travel
    found = []
    for axis in range(3):
        for one in (0.0, 0.5, 1.0):
            for other in (0.0, 0.5, 1.0):
                way = np.insert(np.tile([one, other], (9, 1)), axis, np.linspace(0.0, 1.0, 9), axis=1)
                found += [way, way[::-1]]
    return np.concatenate([low + np.concatenate(found) * (high - low), positions(CFRAME, 120, rng)])


def bare(*effects, seed=3, q=None):
    """The fit of error motions to lines of a machine with just these errors."""
    rng = np.random.default_rng(seed)
    q = lines(rng) if q is None else q
    model = msgspec.structs.replace(no_errors(CFRAME), effects=effects)
    return selector(measured(CFRAME, q, THREE, model, rng)).bare.linearised


def waves(k=0, **sizes):
    """Waves of these amplitudes, um, along axes, in the phase of a number."""
    sine, cosine = np.sin(np.pi * k / PHASES), np.cos(np.pi * k / PHASES)
    return [Cyclic(axis, axis, PERIOD, (sine * size,), (cosine * size,)) for axis, size in sizes.items()]


def errors(linearised, *true):
    """Mean squares `(3,)` of the errors of a fit's model against true effects, um^2."""
    found = []
    for moment in moments(linearised.measurement):
        truth = moment.deviations(msgspec.structs.replace(no_errors(CFRAME), effects=true))
        found.append(np.mean((moment.deviations(linearised.fit.model) - truth) ** 2, axis=0))
    return np.mean(found, axis=0)


@pytest.mark.statistical
def test_the_variance_of_waves_is_found_along_their_axes():
    drawn = [fine_variances(bare(*waves(k, X=6.0, Y=4.0, Z=5.0), seed=k)) for k in range(PHASES)]
    for axis, size in (("X", 6.0), ("Y", 4.0), ("Z", 5.0)):
        # waves that nine positions sample as steep ones are none of the cubic, which takes 4 of 9 values of others
        assert 0.6 < np.mean([found[axis] for found in drawn]) / (size**2 / 2.0) < 9.0 / 5.0, axis


def test_noise_alone_adds_nothing():
    for seed in range(4):
        linearised = bare(seed=seed)
        assert squares_by_fine_errors(linearised).max() < 0.1 * errors(linearised).max()


@pytest.mark.statistical
def test_the_expected_squares_are_those_at_unseen_poses():
    expected, found = [], []
    for k in range(PHASES):
        true = waves(k, X=6.0, Y=6.0, Z=6.0)
        linearised = bare(*true, seed=k)
        expected.append(squares_by_fine_errors(linearised).sum())
        found.append(errors(linearised, *true).sum())
    assert np.mean(expected) == pytest.approx(np.mean(found), rel=0.3)


def test_without_visits_of_one_position_nothing_is_known():
    rng = np.random.default_rng(4)
    assert fine_variances(bare(*waves(X=6.0), q=positions(CFRAME, 150, rng))) == {}


def test_shifts_of_stops_that_no_visit_repeats_may_be_errors_of_the_axis():
    linearised = bare(q=positions(CFRAME, 150, np.random.default_rng(4)))
    fitted = linearised.fit
    noise = EstimatedNoise(1.0, {"X": 0.025}, fitted.measurement.stops, np.zeros((150, 3, 0)), revisited=False)
    expected = replace(linearised, fit=replace(fitted, measurement=replace(fitted.measurement, noise=noise)))
    assert squares_by_fine_errors(expected) == pytest.approx([25.0**2, 0.0, 0.0], rel=0.03, abs=1e-6)


def test_waves_that_are_named_along_an_axis_are_expected_along_the_others():
    wave = waves(X=6.0)[0]
    rng = np.random.default_rng(5)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(wave,))
    own = selector(measured(CFRAME, lines(rng), THREE, model, rng))
    found = fine_variances(own.stage([(Candidate(wave), np.array([0.0, 1.2]))]).linearised)
    assert found["X"] < 1.0
    assert min(found["Y"], found["Z"]) > 0.1
