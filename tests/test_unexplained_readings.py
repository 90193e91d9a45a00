"""Unexplained errors of the tracker's readings: told from those of the machine, and no causes beside them."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.next.ranking import proposed_measurements
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.readings import readings, with_function_of_readings
from calibration.diagnosis.residual.unexplained import in_lengths, misread, nearly_of_readings, shared_rms, unexplained
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.widening import unseen_errors
from support.diagnosis_cases import CFRAME, data_with, selector
from support.tiers import quick

from kinematics.effects import AngleHarmonic, CrossAxis, Unnamed
from kinematics.effects.combined.where import beam

N = 240
TRAVELS = tuple(axis.travel for axis in CFRAME.axes)


def misreading(urad, *effects):
    """A tracker whose elevation reads wrong by the product of azimuth and elevation, each over its range."""
    data = data_with(*effects, n=N)
    angles = [2.0 * (v - v.min()) / np.ptp(v) - 1.0 for v in list(readings(data, np.arange(N)).values())[:2]]
    wrong = 1e-6 * urad * angles[0] * angles[1]
    observed = data.observed + wrong[:, None] * beam(data.observed).upwards
    return replace(data, observed=observed, state=replace(data.state, observed=observed))


def stage_of(data, kind):
    """The fit that has the likeliest cause of a kind besides error motions."""
    made = selector(data)
    tried = [each for each in made.library if each.kind == kind]
    best = evaluate(made.stage([]).linearised, tried)[0]
    return made.stage([(best.candidate, best.score.size)])


def test_a_function_of_readings_is_found_on_the_reading_on_which_it_acts():
    linearised = selector(misreading(200.0)).stage([]).linearised
    found = with_function_of_readings(linearised)
    assert found.function is not None
    assert found.function.variables == ("azimuth", "elevation")
    assert found.linearised.squares < 1.1 * found.linearised.degrees_of_freedom < 0.7 * linearised.squares


def test_noise_has_none():
    assert with_function_of_readings(selector(data_with(n=N)).stage([]).linearised).function is None


@pytest.mark.parametrize("of_machine", quick([True, False], [True]))
def test_errors_of_machine_and_readings_are_told_apart(of_machine):
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (120.0,))
    stage = selector(data_with(warped, n=N) if of_machine else misreading(200.0)).stage([])
    found = unexplained(stage.linearised)
    assert found.of_readings == (not of_machine)
    assert found.listed == ("X, Y, Z" if of_machine else "azimuth, elevation of the tracker's readings")
    residual = stage.linearised.in_lengths(stage.linearised.residual)
    assert np.mean((residual - in_lengths(stage.linearised, found)) ** 2) < 0.5 * np.mean(residual**2)
    first = next(iter(proposed_measurements(stage, [], found)))
    assert ("tracker at another place" in first.text) == (not of_machine)
    # the model has learned a part of a misreading; it lacks the warping everywhere
    errors = unseen_errors(stage.linearised, found, None, curves=False)
    assert errors.recurs == of_machine
    assert (np.sqrt(errors.squares.sum()) > 0.8 * 3**0.5 * shared_rms(stage.linearised, found)) == of_machine


@pytest.mark.parametrize("of_machine", [True, False])
def test_uncertainties_hold_an_error_of_the_readings_that_is_nearly_as_likely(of_machine):
    """Also where the dependence is one of positions."""
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (120.0,))
    linearised = selector(data_with(warped, n=N) if of_machine else misreading(200.0)).stage([]).linearised
    residual = linearised.residual.reshape(len(linearised.rows), -1)
    positions = Unexplained(("X", "Y", "Z"), (0.45,) * 3, 0.005, 1.0, residual)
    found = nearly_of_readings(linearised, positions)
    assert (found is None) == of_machine
    assert found is None or found.of_readings
    without = unseen_errors(linearised, positions, None, curves=False).squares
    assert found is None or np.all(without >= 0.999 * unseen_errors(linearised, found, None, curves=False).squares)


@pytest.mark.parametrize("there", [True, False])
def test_a_cause_that_imitates_a_misreading_is_none(there):
    sag = CrossAxis("Z", "Y", "X", TRAVELS[1], TRAVELS[0], 2, 1, (0.0, 0.0, 30.0))
    stage = stage_of(data_with(sag, n=N) if there else misreading(200.0), "cross-axis")
    assert stage.accepted[0].score.delta_bic < WORTH
    assert misread(stage) == ([] if there else list(stage.accepted))


@pytest.mark.parametrize("urad", [0.0, 25.0, 50.0])
def test_an_error_of_an_encoder_stays_a_cause(urad):
    """Also beside an error of the readings without a name, which a function can describe together with it."""
    stage = stage_of(misreading(urad, AngleHarmonic("azimuth", 2, 90.0, -40.0)), "tracker-angle")
    assert stage.accepted[0].score.delta_bic < WORTH
    assert misread(stage) == []


def test_a_function_of_a_direction_is_none_of_readings():
    """No error of the tool can depend on a direction; a fine function of the readings imitates some of it."""
    data = data_with(n=N)
    side = data.state.approach[:, CFRAME.index("Y")]
    u = 2.0 * (data.state.position(CFRAME, "Z") - TRAVELS[2][0]) / np.ptp(TRAVELS[2]) - 1.0
    observed = data.observed + 0.02 * (side * np.sin(np.pi * u))[:, None] * [1.0, 0.5, 0.0]
    linearised = (
        selector(replace(data, observed=observed, state=replace(data.state, observed=observed))).stage([]).linearised
    )
    assert {"Z", "direction of Y"} <= set(unexplained(linearised).variables)
