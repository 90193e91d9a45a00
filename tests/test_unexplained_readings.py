"""Unexplained errors of the tracker's readings: told from those of the machine, and no causes beside them."""

from dataclasses import replace

import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with
from support.tiers import quick

from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import AngleHarmonic, CrossAxis, Unnamed
from kinematics.effects.combined.where import beam

N = 240
TRAVELS = tuple(axis.travel for axis in CFRAME.axes)


def misreading(urad, *effects):
    """A tracker whose elevation reads wrong by the product of azimuth and elevation, each over its range."""
    data = data_with(*effects, n=N)
    angles = [2.0 * (v - v.min()) / np.ptp(v) - 1.0 for v in beam(data.observed).angles.T]
    wrong = 1e-6 * urad * angles[0] * angles[1]
    observed = data.observed + wrong[:, None] * beam(data.observed).upwards
    return replace(data, observed=observed, state=replace(data.state, observed=observed))


def readings_in(found):
    """Whether the functions without a name of a diagnosis depend on the tracker's readings."""
    variables = {variable for each in found.unexplained for variable in each.variables}
    return bool(variables & {"azimuth", "elevation"})


@pytest.mark.parametrize("of_machine", quick([True, False], [], [True, False]))
def test_errors_of_machine_and_readings_are_told_apart(of_machine):
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (120.0,))
    found = diagnose(data_with(warped, n=N) if of_machine else misreading(200.0))
    assert found.unexplained
    assert readings_in(found) == (not of_machine)
    assert not found.causes


@pytest.mark.statistical
def test_a_sag_is_a_cause_and_no_error_of_readings():
    sag = CrossAxis("Z", "Y", "X", TRAVELS[1], TRAVELS[0], 2, 1, (0.0, 0.0, 30.0))
    found = diagnose(data_with(sag, n=N))
    (cause,) = found.causes
    assert isinstance(cause.effect, CrossAxis)
    assert (cause.effect.component, {cause.effect.axis, cause.effect.other}) == ("Z", {"X", "Y"})
    assert not readings_in(found)


@pytest.mark.parametrize("urad", quick([0.0, 25.0, 50.0], [], [0.0, 50.0]))
def test_an_error_of_an_encoder_stays_a_cause(urad):
    """Also beside an error of the readings without a name, which a function can describe together with it."""
    found = diagnose(misreading(urad, AngleHarmonic("azimuth", 2, 90.0, -40.0)))
    assert [(cause.kind, cause.axis) for cause in found.causes] == [("tracker-angle", "azimuth")]
