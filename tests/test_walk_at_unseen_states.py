"""Errors at unseen states by a random walk of the tool: where rotary axes turn the workpiece it is no common shift."""

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.unseen.random_walk import squares_by_walk
from calibration.diagnosis.unseen.unseen_states import moments
from support.virtual_measurements import THREE, measured, positions

import machines
from calibration.fit.fit import fit
from calibration.observation.full_model import BasisChoice, rigid_model
from kinematics.effects import Unnamed
from kinematics.error_model.model import no_errors

ROWS = 150
COURSE = Unnamed("Z", ("time",), ((0.0, 15.0 * ROWS),), ((1,), (3,)), (40.0, 30.0))
"""A tool that wanders along Z in a measurement with a row every 15 s."""


def wandering(name):
    """The fit without the course, and the course from its start, which is where the model is."""
    machine, rng = machines.load(name), np.random.default_rng(1)
    moved = msgspec.structs.replace(no_errors(machine), effects=(COURSE,))
    measurement = measured(machine, positions(machine, ROWS, rng), THREE, moved, rng)
    bases = {axis: BasisChoice("fourier", 1) if axis in "ABC" else BasisChoice("cubic", 2) for axis in machine.names}
    return LinearisedFit.of(fit(measurement, rigid_model(measurement, bases)))


def test_a_walk_is_held_as_large_as_it_was():
    linearised = wandering("dmu50")
    start = Unnamed("Z", ("time",), COURSE.ranges, ((0,), (1,), (3,)), (70.0, 40.0, 30.0))
    true = np.mean(
        [np.mean(each.deviations_of(start) ** 2, axis=0) for each in moments(linearised.measurement)], axis=0
    )
    assert squares_by_walk(linearised).sum() == pytest.approx(true.sum(), rel=0.5)


def test_a_walk_of_a_machine_without_rotary_axes_shifts_all_poses_alike():
    assert np.all(squares_by_walk(wandering("cframe")) == 0.0)
