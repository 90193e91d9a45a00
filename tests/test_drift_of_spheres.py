"""A drift between the touches of spheres: estimated, left out of the calibration, and contained in its uncertainties."""

from dataclasses import replace

import numpy as np
import pytest
from support.probe_cases import AROUND, MIDDLE, TIP, covered, poses, shifted_rows
from support.tiers import STATISTICAL, quick

import machines
from calibration.fit.calibrate import calibrate
from calibration.instruments import TouchProbe
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.touch_probe import Spheres
from calibration.simulation.true_model import ROTARY, model_of, random_location_errors, random_true_model
from kinematics.effects import ThermalDrift, WorkpieceDrift
from kinematics.inverse import linear_positions

NAME = "dmu50"
MACHINE = machines.load(NAME)
BASIS = "X=legendre:1,Y=legendre:1,Z=legendre:1,B=fourier:1,C=fourier:1"
DRIFT_UM = (6.0, -5.0, 6.0)
END = 1.0 - np.exp(-3.0)


def measured_with(kind, seed, size=1.0, *, waves=1, at=None, drift_um=DRIFT_UM, near=""):
    """One sphere at 34 rotary positions, the first one again at the end, and the true model without the drift.

    waves: per turn of the rotary axes. at: seed of the positions; as of the machine when None. near: an axis that
    moves a tenth of its range only.
    """
    draws = streams(seed, 4)
    effects = [
        *random_location_errors(MACHINE, draws[0], 50.0),
        *random_true_model(MACHINE, draws[0], {name: row[: 2 + 3 * waves] for name, row in ROTARY.items()}).effects,
    ]
    plan = poses(MACHINE, 34, seed if at is None else at)
    plan = replace(plan, state=replace(plan.state, positions=nearer(plan.positions, near)))
    again = np.append(np.arange(len(plan)), 0)
    state = replace(plan.state.rows(again), time=40.0 * np.arange(len(again)))
    plan = replace(plan, state=state, names=plan.names[again], run=plan.run[again], before=None)
    virtual = VirtualInstrument(TouchProbe(u_um=1.0), spheres=Spheres({"s1": tuple(AROUND[0].tolist())}, {}))
    still = measure_plan(plan, model_of(MACHINE, effects), virtual, draws[1:]).measurement
    constant = (float(np.ptp(still.state.time)) / 3.0,)
    drift = [
        kind(letter, amplitudes=(size * um / END,), time_constants_s=constant)
        for letter, um in zip("XYZ", drift_um, strict=True)
    ]
    drifting = model_of(MACHINE, [*effects, *drift])
    return measure_plan(plan, drifting, virtual, draws[1:]).measurement, model_of(MACHINE, effects)


def nearer(positions, axis):
    """Positions with one axis within a tenth of its range."""
    return np.where([name == axis for name in MACHINE.names], 0.1, 1.0) * positions


def other_poses(near=""):
    """Axis positions `(200, axes)` of the tip near the sphere that were not measured."""
    points = np.add(MIDDLE[NAME], AROUND[0]) + np.random.default_rng(9).uniform(-50.0, 50.0, (200, 3))
    return linear_positions(MACHINE, nearer(poses(MACHINE, len(points), seed=99).positions, near), points, TIP)


def fitted(measured, basis=BASIS):
    found = calibrate(measured, basis=basis, hold_out=False, prior_scale=0.1, force=True)
    return found, [each.message for each in found.findings if each.check == "drift"]


@pytest.mark.parametrize(
    ("kind", "side"),
    [(ThermalDrift, "tool point"), pytest.param(WorkpieceDrift, "workpiece", marks=STATISTICAL)],
    ids=["tool", "workpiece"],
)
def test_a_drift_is_estimated_left_out_and_in_u(kind, side):
    inside = []
    for seed in range(3):
        measured, true = measured_with(kind, seed)
        if seed == 1:  # without times the rows count as equidistant
            measured = replace(measured, state=replace(measured.state, time=None))
        found, (message,) = fitted(measured)
        assert f"estimates it as a drift of the {side} with time, and leaves it out" in message
        assert not [each.name for each in found.model.effects if "drift" in each.name]
        assert len(found.model.covariance) == len(found.model.parameters)
        inside.append(covered(found.model, true, MACHINE, other_poses()).mean())
    assert np.mean(inside) > 0.9


def test_without_a_drift_nothing_is_added():
    found, messages = fitted(measured_with(ThermalDrift, 0, size=0.0)[0])
    assert messages == []
    assert not [each.name for each in found.fit.model.effects if "drift" in each.name]


@pytest.mark.statistical
def test_a_single_centre_that_is_off_is_no_drift():
    measured, _ = measured_with(ThermalDrift, 0, size=0.0)
    found, (message,) = fitted(shifted_rows(measured, np.arange(len(measured)) == len(measured) - 1, [0.0, 0.1, 0.0]))
    assert "leaves it out" not in message
    assert not [each.name for each in found.fit.model.effects if "drift" in each.name]


@pytest.mark.parametrize("seed", quick([0, 2, 4], [0], [2]))
def test_a_wave_that_the_basis_lacks_does_not_move_the_drift_to_the_wrong_side(seed):
    measured, _ = measured_with(ThermalDrift, seed, waves=2)
    _, (message,) = fitted(measured)
    assert "as a drift of the workpiece" not in message


@pytest.mark.parametrize("seed", quick([0, 2, 4], [0], [2]))
def test_with_automatic_bases_a_drift_is_in_u(seed):
    measured, true = measured_with(ThermalDrift, seed, waves=2)
    found = calibrate(measured, hold_out=False, force=True)
    assert not [each.name for each in found.model.effects if "drift" in each.name]
    assert covered(found.model, true, MACHINE, other_poses()).mean() > 0.9


def test_where_the_rows_do_not_show_the_side_both_are_stated_and_in_u():
    # where B hardly moves, a drift along Z is nearly the same on both sides
    measured, true = measured_with(ThermalDrift, 2, drift_um=(0.0, 0.0, 10.0), near="B")
    found, (message,) = fitted(measured, BASIS)
    assert "do not show clearly which side drifts" in message
    assert covered(found.model, true, MACHINE, other_poses("B")).mean() > 0.9
