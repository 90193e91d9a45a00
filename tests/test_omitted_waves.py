"""Waves of rotary axes that a fit leaves out: no estimate changes, and the uncertainties are those of its errors."""

import numpy as np
import pytest
from shop_floor.exam import K_95
from shop_floor.question import ask
from support.probe_cases import MIDDLE, TIP, in_datum, poses, probed, spheres_of
from support.tiers import quick

import machines
from calibration.fit.calibrate import calibrate
from calibration.fit.calibrate import in_datum as fitted_in_datum
from calibration.fit.fit import fit
from calibration.fit.omitted_waves import omitted_waves, with_next_waves
from calibration.fit.prediction import relative
from calibration.fit.together import calibrate_together
from calibration.measurement.file import read_measurement
from calibration.simulation.true_model import ROTARY, random_location_errors, random_true_model
from kinematics.deviation import exact_deviation
from kinematics.effects import COMPONENTS, ErrorMotion, LocationError
from kinematics.inverse import linear_positions
from kinematics.state import State

BASIS = "X=legendre:1,Y=legendre:1,Z=legendre:1,A=fourier:1,C=fourier:1"
SMALL = 0.1
ONE_WAVE = {name: row[:5] for name, row in ROTARY.items()}


def measured_with(waves, seed=0, name="trunnion_ac", count=1):
    """Spheres on a machine with location errors and waves of its rotary axes, and the true model."""
    machine, rng = machines.load(name), np.random.default_rng(seed)
    effects = [*random_location_errors(machine, rng, 50.0), *random_true_model(machine, rng, waves).effects]
    return probed(name, 34, spheres=spheres_of(name, count), effects=effects, seed=seed)


def locations(model):
    return {each.name: each for each in model.effects if isinstance(each, LocationError)}


def covered(model, true, name="trunnion_ac"):
    """Within U (k = 2) `(n, 3)`, the deviations of the tip at poses that were not measured."""
    machine, tips = machines.load(name), np.tile(TIP, (200, 1))
    points = np.add(MIDDLE[name], (0.0, 0.0, 60.0)) + np.random.default_rng(9).uniform(-100.0, 100.0, (200, 3))
    q = linear_positions(machine, poses(machine, len(points), seed=99).positions, points, TIP)
    real = 1e3 * exact_deviation(machine, q, true.errors(machine, State(q)), TIP).position
    told = relative(model, machine, State(q), tips)
    return np.abs(real - real.mean(axis=0) - told.deviation) <= 2.0 * told.u


def test_the_estimate_stays_and_its_variance_is_that_of_its_error():
    """By a fit of the wider basis: its variances, and the squares of its distances from the estimate."""
    found = calibrate(measured_with(ONE_WAVE)[0], basis=BASIS, hold_out=False, prior_scale=SMALL)
    assert (found.fit.widening, found.fit.variance_factor, found.fit.measurement.noise) == (1.0, 1.0, None)
    plain, stated = locations(fitted_in_datum(found.fit)), locations(found.model)
    model, prior, own = with_next_waves(found.fit.model, found.fit.prior, np.inf)
    assert own.sum() == 2 * 6 * 2
    wider = locations(fitted_in_datum(fit(found.fit.measurement, model.with_parameters(0.0 * prior), prior=prior)))
    for name, each in stated.items():
        # the datum of the wider basis moves them by less than a tenth of u
        assert each.value == pytest.approx(plain[name].value, abs=0.1 * plain[name].uncertainties[0])
        expected = wider[name].uncertainties[0] ** 2 + (wider[name].value - each.value) ** 2
        assert each.uncertainties[0] == pytest.approx(expected**0.5, rel=2e-3)
        assert each.uncertainties[0] > 0.999 * plain[name].uncertainties[0]
    assert not [each for each in found.findings if each.check == "waves"]


def test_an_option_that_was_not_given_is_not_to_be_left_out():
    measured, _ = measured_with(ROTARY, 0)
    found = calibrate(measured, basis=BASIS, hold_out=False, prior_scale=SMALL)
    waves = omitted_waves(found.fit, chosen=False)
    notes = {chosen: [each.message for each in waves.findings(chosen=chosen)] for chosen in (True, False)}
    assert notes[False]
    assert all("leave out --basis" in note for note in notes[False])
    assert not any("leave out" in note for note in notes[True])


@pytest.mark.parametrize("seeds", quick([range(2), range(4)], [], [range(2)]), ids=len)
def test_a_stated_basis_that_lacks_a_wave_is_named_and_its_uncertainties_contain_it(seeds):
    inside = []
    for seed in seeds:
        measured, true = measured_with(ROTARY, seed)
        found = calibrate(measured, basis=BASIS, hold_out=False, prior_scale=SMALL)
        notes = [each.message for each in found.findings if each.check == "waves"]
        assert any(
            "the rows show wave number 2 per turn of C" in note
            and "state --basis C=fourier:2, or leave out --basis" in note
            for note in notes
        )
        inside.append(covered(found.model, true))
        assert covered(fitted_in_datum(found.fit), true).mean() < inside[-1].mean()
        wider = calibrate(
            measured, basis=BASIS.replace("C=fourier:1", "C=fourier:2"), hold_out=False, prior_scale=SMALL
        )
        assert not any("of C" in each.message for each in wider.findings if each.check == "waves")
    assert np.mean(inside) > 0.92


def test_several_instruments_contain_it_too():
    one, other = (measured_with(ROTARY, 1)[0] for _ in range(2))
    found = calibrate_together([one, other.rows(np.arange(10))], basis=BASIS, hold_out=False, prior_scale=SMALL)
    waves = [e for e in found.model.effects if isinstance(e, ErrorMotion) and e.axis in "AC"]
    assert [len(each.parameters) - len(found.bases[each.name].columns(np.zeros(1))[0]) for each in waves] == [2] * 12
    plain, stated = locations(fitted_in_datum(found.fit)), locations(found.model)
    assert all(each.uncertainties[0] > 0.999 * plain[name].uncertainties[0] for name, each in stated.items())
    assert stated["E_Z0A"].uncertainties[0] > 1.2 * plain["E_Z0A"].uncertainties[0]


@pytest.mark.statistical
def test_location_errors_of_a_part_of_a_turn_are_within_their_uncertainties():
    """One sphere, bases by the evidence, which often takes one wave per turn of A where the machine has two."""
    off = []
    for seed in range(12):
        measured, true = measured_with(ROTARY, seed)
        found = calibrate(measured, hold_out=False, force=True)
        exact, own = in_datum(true, found.fit), locations(found.model)
        off += [(own[name].value - exact[name]) / own[name].uncertainties[0] for name in ("E_Z0A", "E_B0A")]
    assert np.mean(np.abs(off) <= 2.0) >= 0.9


@pytest.mark.exam
def test_by_a_tracker_the_errors_along_a_part_of_a_turn_are_within_their_uncertainties(tmp_path):
    """Lines and random poses of a DMU 50 whose B has three waves per turn and moves over 110 degrees."""
    inside, before = [], []
    for design, draw in (("two-stations", 0), ("random3", 0), ("diagonals", 0), ("lines-once", 0)):
        question = ask(design, "none", "dmu50", draw, 71001)
        sheet = tmp_path / f"{design}.csv"
        sheet.write_text(question.sheet(), encoding="utf-8")
        found = calibrate(read_measurement(sheet, machines.load("dmu50")), hold_out=False)
        inside += of_b(found.model, question)
        before += of_b(found.fit.model, question)
    assert np.mean(before) < np.mean(inside)
    assert np.mean(inside) > 0.88


def of_b(model, question):
    """Shares of the error motions of B within their 95 % intervals, less shifts and turns of the axis' neighbours."""
    place = question.run.machine.names.index("B")
    q = question.run.positions[:, place]
    x = np.linspace(q.min(), q.max(), 100)
    positions = np.zeros((len(x), len(question.run.machine.names)))
    positions[:, place] = x
    true = question.motions.errors(positions)[:, place]
    neighbours = np.stack([np.ones(len(x)), np.cos(np.radians(x)), np.sin(np.radians(x))], axis=1)
    apart = np.eye(len(x)) - neighbours @ np.linalg.pinv(neighbours)
    shares = []
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, ErrorMotion) and effect.axis == "B":
            k = COMPONENTS.index(effect.component)
            columns = apart @ effect.basis.columns(x)
            error = columns @ effect.parameters - apart @ true[:, k] * (1e6 if effect.angular else 1e3)
            u = np.sqrt(np.sum((columns @ np.array(model.covariance)[part, part]) * columns, axis=1))
            shares.append(float(np.mean(np.abs(error) <= K_95 * u)))
    return shares
