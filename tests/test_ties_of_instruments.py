"""Causes of the instrument that the data do not distinguish."""

import msgspec
import numpy as np
import pytest
from support.virtual_measurements import ONE, measured, positions

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.evaluation.volumetric import aligned, deviation_on
from kinematics.effects import StationShift
from kinematics.error_model.model import no_errors

ROWS = 240
SINCE_S = 15.0 * ROWS / 2


def knocked(machine, q, shift_um, rng):
    """A tracker that was knocked in the middle, and sees a single target."""
    knock = StationShift("s1", shift_um, since_s=SINCE_S)
    model = msgspec.structs.replace(no_errors(machine), effects=(knock,))
    return measured(machine, q, ONE, model, rng)


@pytest.mark.statistical
def test_a_knock_that_a_moved_target_imitates_is_no_error_of_the_machine():
    """Both predict nearly the same readings of a machine of linear axes: at least one of them is named."""
    rng, gantry = np.random.default_rng(3), machines.load("gantry")
    found = diagnose(knocked(gantry, positions(gantry, ROWS, rng), (50.0, -60.0, -110.0), rng))
    (cause,) = found.causes
    assert cause.kind in ("station-shift", "target-offset")
    errors, points = deviation_on(gantry, found.model, positions(gantry, 300, rng))
    assert 1e3 * np.sqrt(np.mean(aligned(errors, points) ** 2)) < 3.0
