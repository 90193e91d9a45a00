"""Shapes proposed from residuals: what was put in is found, to what the travel resolves."""

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.library.candidate import at_zero, library
from calibration.diagnosis.search.evaluation import evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes import proposed_shapes as scans
from calibration.diagnosis.search.shapes.change_points import breaks
from calibration.diagnosis.search.shapes.sawtooth import refined, saw_uncertainty
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from support.diagnosis_cases import CFRAME, data_with, fitted, framed
from support.tiers import quick
from support.virtual_measurements import THREE, measured

from kinematics.basis import Fourier
from kinematics.effects import Cyclic, ErrorMotion, GrowthWithTime, QuantisedCompensation, StationShift
from kinematics.error_model.model import no_errors

X, Y = (CFRAME.axes[CFRAME.index(name)].travel for name in "XY")
TRAVEL = X[1] - X[0]


def wave(component, axis, period, sine, cosine=None):
    return Cyclic(component=component, axis=axis, period=period, sine=sine, cosine=cosine or (0.0,) * len(sine))


def best(linearised, proposals):
    return evaluate(linearised, list(proposals))[0]


@pytest.mark.parametrize(("component", "axis", "period"), [("X", "X", 8.0), ("Z", "Y", 21.37), ("Y", "X", 11.113)])
def test_a_period_is_found_to_a_fraction_of_what_the_travel_resolves(component, axis, period):
    linearised = framed(wave(component, axis, period, (9.0,)), n=120)
    found = best(linearised, scans.waves(linearised)).candidate
    assert (found.effect.axis, found.effect.component) == (axis, component)
    assert len(found.effect.sine) == 1
    # one wave more over the travel is the next one that can be told apart
    assert abs(TRAVEL / found.effect.period - TRAVEL / period) < 0.1
    assert found.trials > 1000


def test_a_period_is_found_at_few_positions_that_make_many_periods_alike():
    """A line measured again and again has a lattice of positions; only those off it part the periods."""
    rng, wide = np.random.default_rng(3), wave("X", "X", 12.0, (60.0,))
    steps = np.r_[np.linspace(20.0, 580.0, 11), 47.5, 131.9, 311.3, 440.8]
    q = np.column_stack([rng.choice(steps, 150), rng.uniform(*Y, 150), rng.uniform(0.0, 500.0, 150)])
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(wide,))
    linearised = LinearisedFit.of(fitted(measured(CFRAME, q, THREE, model, rng)))
    found = best(linearised, scans.waves(linearised, ("X",))).candidate
    assert TRAVEL / found.effect.period == pytest.approx(TRAVEL / 12.0, abs=0.2)


def test_harmonics_are_taken_along_where_they_pay():
    linearised = framed(wave("X", "X", 12.5, (9.0, 0.0, 5.0)), n=300)
    found = best(linearised, scans.waves(linearised, ("X",))).candidate
    assert TRAVEL / found.effect.period == pytest.approx(TRAVEL / 12.5, abs=0.2)
    assert len(found.effect.sine) == 3


def test_a_harmonic_that_is_a_cyclic_error_already_is_none():
    known = wave("X", "X", 6.0, (8.0,))
    linearised = framed(wave("X", "X", 12.0, (9.0,)), known, n=120)
    along = LinearisedFit.of(fitted(linearised.measurement, at_zero(known)))
    found = best(along, scans.waves(along, ("X",))).candidate
    assert TRAVEL / found.effect.period == pytest.approx(TRAVEL / 12.0, abs=0.2)
    assert len(found.effect.sine) == 1


def test_steps_are_found_with_their_pitch_and_place():
    linearised = framed(QuantisedCompensation(axis="X", step=12.0, pitch=50.0, offset=13.0), n=300)
    found = best(linearised, scans.steps(linearised)).candidate.effect
    assert found.axis == "X"
    u_pitch, u_offset = saw_uncertainty(linearised, found)
    assert found.pitch == pytest.approx(50.0, abs=max(3 * u_pitch, 0.5))
    assert (found.offset - 13.0 + 25.0) % 50.0 - 25.0 == pytest.approx(0.0, abs=max(3 * u_offset, 3.0))
    assert 0.0 < u_pitch < 1.0
    assert 0.0 < u_offset < 5.0


@pytest.mark.parametrize(("n", "size"), quick([(60, 60.0), (150, 60.0), (300, 120.0)], [(60, 60.0)]))
def test_pitches_that_no_position_tells_apart_are_in_the_uncertainty(n, size):
    """Between two positions a jump lies anywhere, however large it is."""
    inside = []
    for seed in range(12):
        truth = QuantisedCompensation(axis="X", step=size, pitch=62.0, offset=32.0)
        linearised = framed(truth, n=n, seed=seed)
        found = refined(Sensitivity.of(linearised, "X", "X"), at_zero(truth))
        u_pitch, u_offset = saw_uncertainty(linearised, found)
        apart = (found.offset - 32.0 + found.pitch / 2) % found.pitch - found.pitch / 2
        inside += [abs(found.pitch - 62.0) < 2 * u_pitch, abs(apart) < 2 * u_offset]
    assert np.mean(inside) >= 0.95


def test_the_moment_of_a_knock_is_found():
    data = data_with(n=120, stations=2)
    data.observed[90:] += [0.02, -0.015, 0.01]
    linearised = LinearisedFit.of(fitted(data))
    knocks = [each for each in breaks(linearised) if isinstance(each.effect, StationShift)]
    found = best(linearised, knocks).candidate.effect
    assert found.station == "s2"
    assert found.since_s == pytest.approx(data.state.time[90], abs=45.0)


def test_a_finer_basis_is_proposed_for_the_motion_that_lacks_it():
    amplitudes = (0.0, 0.0, 0.0, 0.0, 12.0, 0.0)
    ripple = ErrorMotion("Y", "Y", Fourier(Y, (0.5, 6.0)), amplitudes, u=(0.0,) * 6)
    linearised = framed(ripple, n=120)
    found = best(linearised, scans.finer(linearised))
    assert found.candidate.replaces == "E_YY"
    assert found.candidate.effect.basis.size > 6
    assert found.score.delta_bic < -50.0


def test_growth_is_from_the_point_that_the_data_say():
    linearised = framed(GrowthWithTime(axis="X", rate=60.0, fixed_point=400.0), n=200)
    candidates, _ = library(linearised.measurement, linearised.fit.model)
    found = best(linearised, scans.fixed_points(linearised, candidates)).candidate
    assert isinstance(found.effect, GrowthWithTime)
    assert found.effect.axis == "X"
    assert found.effect.fixed_point == pytest.approx(400.0, abs=25.0)
    assert found.shapes >= 1


def test_noise_pays_for_no_shape():
    """However many frequencies were tried."""
    linearised = framed(seed=1, n=60)
    for each in evaluate(
        linearised, list(scans.proposals(linearised, library(linearised.measurement, linearised.fit.model)[0]))
    ):
        assert each.score.p_value > 1e-4, each.candidate.effect.name
