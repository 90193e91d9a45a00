"""The fit at its edges: odd instruments, few rows, wrong guesses, far starts."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from measured import MONTAVON, ONE, THREE, measured, pose_of, positions, truth

import machines
from calibration import equations
from calibration.calibrate import calibrate
from calibration.fit import fit
from calibration.heldout import blocks_of, held_out
from calibration.instruments import Interferometer, LaserTracker, Part
from calibration.measurement import Measurement, Target, with_moves
from calibration.models import BasisChoice, rigid_model
from calibration.outliers import duplicates
from kinematics.effects import Cyclic, ErrorMotion, GrowthWithSensor
from kinematics.errors import UserError
from kinematics.model import decode_model, encode_model, no_errors
from kinematics.state import State

COARSE = {axis: BasisChoice("b-spline", 5) for axis in "XYZ"}


def tracked(machine=MONTAVON, n=320, targets=THREE, seed=0, **options):
    rng = np.random.default_rng(seed)
    model = truth(machine, rng, 15.0)
    return model, measured(machine, positions(machine, n, rng), targets, model, rng, **options)


def zeroed(model):
    effects = tuple(effect.with_parameters([0.0] * len(effect.parameters), effect.u) for effect in model.effects)
    return msgspec.structs.replace(model, effects=effects)


def laser(name="gantry", axes="XYZ", runs=3, digits=1e-5, noise=0.3, constant=5.0):
    """Interferometer runs, there and back on each axis in turn; deviations um, urad on rotary axes."""
    machine, rng = machines.load(name), np.random.default_rng(0)
    q, names, run = [], [], []
    for axis in axes:
        i = machine.index(axis)
        low, high = np.clip(machine.travel[:, i], -3.0, 3.0) if machine.rotary[i] else machine.travel[:, i]
        way = np.linspace(low, high, 15)
        for number in range(runs):
            for x in (*way, *way[::-1]):
                q.append([x if k == i else 0.0 for k in range(len(machine.axes))])
                names.append(axis)
                run.append(str(number + 1))
    state = with_moves(State(np.array(q), target=np.full(len(q), "1")))
    own = np.array([machine.index(axis) for axis in names])
    share = state.positions[np.arange(len(q)), own] / np.ptp(state.positions, axis=0)[own]
    deviation = constant + 20.0 * np.sin(3.0 * share) + rng.normal(0.0, noise, len(q))
    rounded = np.round(deviation / (1e3 * digits)) * (1e3 * digits) * np.where(machine.rotary[own], 1e-6, 1e-3)
    empty = Measurement(machine, Interferometer(u_um=0.3), state, np.zeros((len(q), 1)), source="laser")
    return replace(empty, observed=rounded[:, None], axis=np.array(names), run=np.array(run))


def test_a_failed_run_does_not_stop_the_calibration():
    clean = laser()
    bad = clean.groups == "X 2"
    noise = np.random.default_rng(1).normal(0.0, 0.05, clean.observed.shape)
    found = calibrate(replace(clean, observed=clean.observed + noise * bad[:, None]), basis="b-spline:6")
    assert found.fit.failed == ("X 2",)
    assert found.before_rms_um == pytest.approx(6.4, abs=0.5)


def test_few_positions_have_few_cells():
    _, measurement = tracked()
    for rows in ([0, 5, 9] * 20, [3] * 50, [0] * 70 + list(range(30))):
        labels, what = blocks_of(measurement.rows(np.array(rows)))
        assert what == "cells of space"
        assert labels.max() < 8
    labels, _ = blocks_of(measurement.rows(np.array([0, 5, 9] * 20)))
    assert len(np.unique(labels)) == 3


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_station_of_few_rows_is_fitted_and_not_predicted(rows):
    model, measurement = tracked(stations=3)
    last = np.cumsum(measurement.state.station == "s3")
    some = measurement.rows(np.flatnonzero(last <= rows))
    found = fit(some, zeroed(model))
    assert found.chi2_reduced == pytest.approx(1.0, abs=0.2)
    held = held_out(some, zeroed(model), found.prior, found.kept)
    assert found.rms_um < held.rms_um < 2.0 * found.rms_um


def test_neighbours_predict_a_position_of_an_interferometer():
    measurement = laser("dmu50", "XYZBC", runs=2)
    held = calibrate(measurement, basis="cubic:6").held_out
    assert held.what == "sets of positions"
    assert held.rms_um < 1.0


EVERYWHERE = {
    **THREE,
    "table": Target((100.0, 20.0, 30.0), "table"),
    "bed": Target((300.0, -200.0, 10.0), "bed"),
}


@pytest.mark.parametrize("stands_on", ["workpiece", "bed"])
def test_targets_on_table_and_bed_need_only_a_rough_guess(stands_on):
    model, measurement = tracked(machines.load("dmu50"), 500, EVERYWHERE, 3, stands_on=stands_on)
    of = measurement.state.target
    few = np.isin(of, list(THREE))
    for name in ("table", "bed"):
        few[np.flatnonzero(of == name)[:3]] = True
    off = np.array([5.0, -4.0, 30.0])
    guesses = {
        name: target if target.known else replace(target, position=tuple(off + target.position))
        for name, target in EVERYWHERE.items()
    }
    found = fit(replace(measurement.rows(np.flatnonzero(few)), targets=guesses), zeroed(model))
    assert not len(found.outliers)
    for name, position in found.registration.targets.items():
        assert position == pytest.approx(EVERYWHERE[name].position, abs=0.05)


def test_a_run_of_an_interferometer_is_registered_before_it_is_judged():
    found = calibrate(laser(constant=200.0), basis="b-spline:6", hold_out=False)
    assert found.before_rms_um == pytest.approx(6.4, abs=0.5)


@pytest.mark.parametrize("digits", [1e-4, 1e-5])
def test_readings_that_come_again_are_no_copies(digits):
    measurement = laser(digits=digits)
    assert not duplicates(measurement).any()
    timed = replace(measurement, state=replace(measurement.state, time=np.arange(float(len(measurement)))))
    twice = timed.rows(np.append(np.arange(len(timed)), 7))
    assert np.flatnonzero(duplicates(twice)).tolist() == [len(timed)]


@pytest.mark.parametrize(
    ("instrument", "keys"),
    [
        (LaserTracker(u_range_um=1.0), "u_angle_um"),
        (LaserTracker(u_angle_um=1.0), "u_range_um"),
        (LaserTracker(u_angle_um=10.0, u_range_um=1e-9), "u_range_um"),
        (Part(), "u_um"),
    ],
)
def test_an_instrument_without_uncertainty_is_refused(instrument, keys):
    model, measurement = tracked()
    with pytest.raises(UserError, match=keys):
        fit(replace(measurement, instrument=instrument), model)


def test_an_interferometer_without_uncertainty_is_refused():
    measurement = replace(laser(), instrument=Interferometer(u_um_per_m=1.0))
    with pytest.raises(UserError, match="u_um"):
        fit(measurement, rigid_model(measurement, COARSE))


def test_points_on_one_line_are_refused():
    rng = np.random.default_rng(0)
    model = truth(MONTAVON, rng)
    q = np.zeros((60, 3))
    q[:, 1] = np.linspace(0.0, 2000.0, 60)
    measurement = measured(MONTAVON, q, ONE, model, rng)
    with pytest.raises(UserError, match="station s1 saw points on one line only"):
        fit(measurement, rigid_model(measurement, COARSE))
    three = measured(MONTAVON, q, THREE, model, rng)
    assert fit(three, rigid_model(three, COARSE)).chi2_reduced < 2.0
