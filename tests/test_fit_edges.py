"""The fit at its edges: odd instruments, few rows, wrong guesses, far starts."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from support.tiers import quick
from support.virtual_measurements import MONTAVON, ONE, THREE, measured, pose_of, positions, truth

import machines
from calibration.fit.calibrate import calibrate
from calibration.fit.cross_validation import cross_validate
from calibration.fit.fit import fit
from calibration.instruments import Interferometer, LaserTracker, Part
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.observation.full_model import BasisChoice, rigid_model
from calibration.observation.stops_and_lines import held_out_blocks
from kinematics.effects import Cyclic, ErrorMotion, GrowthWithSensor
from kinematics.error_model.model import decode_model, encode_model, no_errors
from kinematics.state import State
from kinematics.user_error import UserError

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


def test_the_errors_of_a_table_need_targets_on_it():
    """A tracker on the bed and targets on the tool: the table turns, and nothing that is measured turns with it."""
    machine = machines.load("dmu50")
    _, measurement = tracked(machine, 80, THREE, 5, stands_on="bed")
    found = calibrate(measurement, basis="legendre:1", hold_out=False, force=True)
    hidden = {name: each.remedy for each in found.identifiability.unidentifiable for name in each.effects}
    assert {"E_CC", "E_XC", "E_BB"} <= hidden.keys()
    assert all("targets on the table" in hidden[name] for name in ("E_CC", "E_XC", "E_BB"))


def test_a_failed_run_is_left_out_by_name():
    """It holds more than 5 % of the rows: nothing is written without --force."""
    clean = laser(axes="XY")
    bad = clean.groups == "X 2"
    noise = np.random.default_rng(1).normal(0.0, 0.05, clean.observed.shape)
    found = calibrate(replace(clean, observed=clean.observed + noise * bad[:, None]), basis="b-spline:6", force=True)
    assert found.fit.failed == ("X 2",)
    assert found.before_rms_um == pytest.approx(6.4, abs=0.5)


def test_few_positions_have_few_cells():
    _, measurement = tracked()
    for rows in ([0, 5, 9] * 20, [3] * 50, [0] * 70 + list(range(30))):
        labels, what = held_out_blocks(measurement.rows(np.array(rows)))
        assert what == "regions of stops"
        assert labels.max() < 8
    labels, _ = held_out_blocks(measurement.rows(np.array([0, 5, 9] * 20)))
    assert len(np.unique(labels)) == 3


@pytest.mark.parametrize("rows", quick([1, 2, 3], [1, 3]))
def test_a_station_of_few_rows_is_fitted_and_not_predicted(rows):
    model, measurement = tracked(n=180, stations=3)
    last = np.cumsum(measurement.state.station == "s3")
    some = measurement.rows(np.flatnonzero(last <= rows))
    found = fit(some, zeroed(model))
    assert found.chi2_reduced == pytest.approx(1.0, abs=0.2)
    held = cross_validate(found.good, zeroed(model), found.prior)
    assert found.rms_um < held.rms_um < 2.0 * found.rms_um


def test_neighbours_predict_a_position_of_an_interferometer():
    measurement = laser("dmu50", "XB", runs=1)
    held = calibrate(measurement, basis="cubic:6").cross_validation
    assert held.name == "sets of positions"
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
    assert not measurement.copies.any()
    timed = replace(measurement, state=replace(measurement.state, time=np.arange(float(len(measurement)))))
    twice = timed.rows(np.append(np.arange(len(timed)), 7))
    assert np.flatnonzero(twice.copies).tolist() == [len(timed)]


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
    with pytest.raises(UserError, match="all points of station s1 lie on one line"):
        fit(measurement, rigid_model(measurement, COARSE))
    three = measured(MONTAVON, q, THREE, model, rng)
    assert fit(three, rigid_model(three, COARSE)).chi2_reduced < 2.0


def with_effect(effect, start, warm=0.0):
    """A fit of the C-frame with an effect that starts elsewhere."""
    machine, rng = machines.load("cframe"), np.random.default_rng(0)
    base = truth(machine, rng, 10.0)
    model = msgspec.structs.replace(base, effects=(*base.effects, effect))
    clean = measured(machine, positions(machine, 500, rng), THREE, no_errors(machine), rng, noise=False)
    state = replace(clean.state, temperatures={"scale": warm * np.sin(np.arange(500) / 60.0)})
    observed = clean.instrument.expected(clean, pose_of(["s1"]), model.observation(machine, state))
    root = np.linalg.cholesky(clean.instrument.covariance(observed))
    observed = observed + (root @ rng.normal(size=(500, 3, 1)))[:, :, 0]
    measurement = replace(clean, observed=observed, state=replace(state, observed=observed))
    zero = zeroed(base)
    return fit(measurement, msgspec.structs.replace(zero, effects=(*zero.effects, start)))


@pytest.mark.parametrize(
    ("coefficient", "lag"),
    quick(
        [(3.0, 400.0), (1.0, 10.0), (1.0, 0.0), (1.0, 5000.0), (-3.0, 100.0)],
        [(1.0, 0.0), (1.0, 5000.0), (-3.0, 100.0)],
    ),
)
def test_a_time_constant_is_found_from_afar(coefficient, lag):
    growth = GrowthWithSensor(axis="Y", sensor="scale", coefficient=9.0, lag_s=900.0)
    found = with_effect(growth, msgspec.structs.replace(growth, coefficient=coefficient, lag_s=lag), 4.0)
    assert found.chi2_reduced == pytest.approx(1.0, abs=0.1)
    assert found.model.effects[-1].lag_s == pytest.approx(900.0, abs=4 * found.model.effects[-1].u[1])
    assert not len(found.outliers)


def test_evidence_charges_for_the_way_from_the_start():
    wave = Cyclic(component="X", axis="X", period=10.0, sine=(6.0,), cosine=(3.0,))
    still = Cyclic(component="X", axis="X", period=10.02, sine=(0.0,), cosine=(0.0,))
    found = with_effect(wave, still)
    assert float(found.away @ found.away) < 100.0
    assert found.log_evidence == pytest.approx(
        -0.5 * (found.chi2 + found.away @ found.away + found.solved.log_determinant), rel=1e-9
    )


@pytest.mark.parametrize("sheet", quick([0.1, 1.0, 10.0, 100.0], [0.1, 100.0]))
def test_outliers_are_found_whatever_the_sheet_says_where_the_noise_is_estimated(sheet):
    model, measurement = tracked(machines.load("cframe"), seed=50)
    rng = np.random.default_rng(2)
    gross = rng.random(320) < 0.04
    observed = measurement.observed + np.where(gross[:, None], rng.normal(0.0, 0.2, (320, 3)), 0.0)
    tracker = measurement.instrument
    sizes = {name: sheet * getattr(tracker, name) for name in tracker.__struct_fields__ if name.startswith("u_")}
    dirty = replace(measurement, observed=observed, instrument=msgspec.structs.replace(tracker, **sizes))
    found = fit(dirty, zeroed(model), variance="estimate")
    assert found.outliers.tolist() == np.flatnonzero(gross).tolist()
    assert found.variance_factor == pytest.approx(sheet**-2, rel=0.15)


@pytest.mark.parametrize("name", ["gantry", "dmu50", "head_head"])
def test_positioning_alone_counts_from_its_own_zero(name):
    measurement = laser(name, "XYZ" if name == "gantry" else "XYZBC" if name == "dmu50" else "XYZCB")
    found = calibrate(measurement, basis="b-spline:6", hold_out=False)
    assert not found.identifiability.unidentifiable
    for effect in found.model.effects:
        if isinstance(effect, ErrorMotion):
            low, high = effect.basis.interval
            assert effect.basis.columns(np.linspace(low, high, 801)).mean(axis=0) @ effect.parameters == pytest.approx(
                0.0, abs=1e-6
            )
            assert max(effect.u) < 0.5
    again = decode_model(encode_model(found.model), "again")
    assert again.covariance == found.model.covariance


def test_an_axis_that_only_moves_aside_has_no_error_motion():
    measurement = laser(axes="XY").rows(np.arange(90))
    aside = measurement.state.positions.copy()
    aside[30:, 1] = 100.0
    moved = replace(measurement, state=replace(measurement.state, positions=aside))
    assert {effect.axis for effect in rigid_model(moved, COARSE).effects} == {"X"}


@pytest.mark.parametrize("period", quick([9.95, 9.99, 10.05], [9.95, 10.05]))
def test_a_period_is_found_from_half_a_percent_off(period):
    wave = Cyclic(component="X", axis="X", period=10.0, sine=(6.0,), cosine=(3.0,))
    found = with_effect(wave, Cyclic(component="X", axis="X", period=period, sine=(1.0,), cosine=(1.0,)))
    assert found.model.effects[-1].period == pytest.approx(10.0, abs=4 * found.model.effects[-1].u[0])


def test_residuals_of_rotary_axes_are_told_in_urad():
    found = calibrate(laser("dmu50", "C", runs=2), basis="cubic:6")
    assert found.fit.rms_um == pytest.approx(0.3, rel=0.2)
    assert 0.3 < found.cross_validation.rms_um < 1.0
    assert 0.3 < found.fit.max_um < 2.0


def test_a_station_that_saw_one_place_shifts():
    model, measurement = tracked(stations=2)
    rows = np.append(np.flatnonzero(measurement.state.station == "s1"), 300)
    found = fit(measurement.rows(rows), zeroed(model))
    assert found.failed == ()
    assert found.residual[-1] == pytest.approx(0.0, abs=1e-6)
