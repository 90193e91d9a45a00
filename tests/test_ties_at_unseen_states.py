"""Causes that the data do not distinguish mean different machines: the uncertainties hold all of them."""

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate, library
from calibration.diagnosis.search.selection import Search, Selector
from calibration.diagnosis.search.shapes import proposed_shapes
from calibration.diagnosis.search.start_model import Base
from calibration.diagnosis.unseen.undecided_causes import errors_by_ties
from calibration.diagnosis.unseen.unseen_states import moments
from calibration.diagnosis.verdict import tied_with
from calibration.diagnosis.widening import widened
from support.virtual_measurements import ONE, measured, positions

import machines
from calibration.observation.full_model import BasisChoice, priors, rigid_model
from kinematics.effects import StationShift, TargetOffset
from kinematics.error_model.model import no_errors
from kinematics.running.progress import silent

DMU50, GANTRY, ROWS = machines.load("dmu50"), machines.load("gantry"), 240
SINCE_S = 15.0 * ROWS / 2
KNOCK, OFFSET = StationShift("s1", since_s=SINCE_S), TargetOffset("1", (0.0, 0.0, 0.0), since_s=SINCE_S)
BASES = dict.fromkeys("XYZ", BasisChoice("legendre", 2)) | dict.fromkeys("BC", BasisChoice("fourier", 1))


def knocked(machine, q, shift_um, rng):
    """A tracker that was knocked in the middle; fitted as a single target that moved."""
    knock = msgspec.structs.replace(KNOCK, shift_um=shift_um)
    data = measured(machine, q, ONE, msgspec.structs.replace(no_errors(machine), effects=(knock,)), rng)
    model = rigid_model(data, {axis: BASES[axis] for axis in machine.names})
    base, search = Base(model, priors(model), "refitted"), Search(proposed_shapes.proposals)
    selector = Selector(data, base, library(data, model)[0], "sheet", silent, search)
    return selector.against_siblings(selector.stage([(Candidate(OFFSET, 1), np.zeros(3))]))


@pytest.fixture(scope="module")
def stage():
    """Knocked where the rotary axes begin to turn."""
    rng = np.random.default_rng(3)
    q = positions(DMU50, ROWS, rng)
    q[: ROWS // 2, DMU50.rotary] = 0.0
    return knocked(DMU50, q, (8.0, -6.0, 5.0), rng)


def test_a_knock_far_above_the_noise_and_a_target_that_moved_are_tied():
    """The odds are then those of fits, of which one has three parameters more: a knock may turn the instrument."""
    rng = np.random.default_rng(3)
    (cause,) = knocked(GANTRY, positions(GANTRY, 2 * ROWS, rng), (50.0, -60.0, -110.0), rng).accepted
    assert [each.evaluated.candidate.effect for each in tied_with(cause)] == [KNOCK]


def test_the_uncertainty_holds_the_machine_of_each_tied_cause(stage):
    (cause,) = stage.accepted
    assert [each.evaluated.candidate.effect for each in tied_with(cause)] == [KNOCK]
    model, data = stage.fit.model.part(lambda effect: effect.ACTS_ON != "instrument"), stage.fit.measurement
    unseen = list(moments(data))
    design = np.concatenate([moment.design(model) for moment in unseen])
    # the true machine has no errors
    error = np.concatenate([moment.deviations(model) for moment in unseen])
    own = model.propagated(design)
    all_of_them = widened(model, data, np.zeros(3), possible=errors_by_ties(stage)).model.propagated(design)
    assert np.mean(np.abs(error) < 2.0 * own) < 0.8
    assert np.mean(np.abs(error) < 2.0 * all_of_them) > 0.92
    assert np.mean(all_of_them**2) < 1.5 * np.mean(error**2)


def test_a_possible_error_is_an_uncertainty_of_the_parameters_that_imitate_it(stage):
    model, data = stage.fit.model.part(lambda effect: effect.ACTS_ON != "instrument"), stage.fit.measurement
    design = np.concatenate([moment.design(model) for moment in moments(data)])
    error = 5.0 * design @ np.sqrt(np.diagonal(model.covariance))
    more = widened(model, data, np.zeros(3), possible=error[None]).model.propagated(design) ** 2
    np.testing.assert_allclose(more - model.propagated(design) ** 2, error**2, atol=0.01 * error.max() ** 2)
