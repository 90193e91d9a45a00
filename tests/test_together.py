"""Several instruments in one fit: the same as one fit where that is possible, and better than each alone."""

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.probe_cases import probed, shifted_rows, unseen_um
from support.virtual_measurements import THREE, measured, positions, truth, written

import machines
from calibration.fit.calibrate import calibrate
from calibration.fit.set_up.common_basis import common_basis
from calibration.fit.together import CONTRADICTION_P, calibrate_together
from calibration.instruments import Interferometer
from calibration.measurement.joining import by_instrument, joined
from calibration.measurement.plan import Choices
from calibration.planning.strategies import plan
from calibration.reports.together import together_json, together_report
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.true_model import model_of
from kinematics.basis import BSpline, Fourier, Harmonics, Legendre
from kinematics.effects import Backlash, Scale
from kinematics.user_error import UserError

CFRAME, DMU50 = machines.load("cframe"), machines.load("dmu50")
SCALES = (Scale("X", 80.0), Scale("Y", -60.0), Scale("Z", 70.0))


@pytest.fixture(scope="module")
def two_runs():
    """Two measurements of a C-frame by one tracker at other poses, one of them over a part of the volume."""
    rng = np.random.default_rng(1)
    model = truth(CFRAME, rng)
    runs = [measured(CFRAME, positions(CFRAME, 150, rng, 20), THREE, model, rng, start_s=start) for start in (0, 9000)]
    return [replace(run, source=f"{name}.csv", fingerprint=name) for name, run in zip("ab", runs, strict=True)]


@pytest.fixture(scope="module")
def shop():
    """Spheres and an interferometer on a DMU 50 with location errors and scales, and its true errors."""
    _, located = probed("dmu50", 2, seed=6)
    effects = [*located.effects, *SCALES]
    spheres, model = probed("dmu50", effects=effects, seed=6)
    return [replace(spheres, source="spheres.csv"), lengths(model)], model


def lengths(model, seed=7):
    """An interferometer along the linear axes of a DMU 50."""
    virtual = VirtualInstrument(Interferometer(u_um=0.3))
    choices = Choices(runs=3, ranges={"X": (-249.0, 249.0), "Y": (-224.0, 224.0), "Z": (1.0, 399.0)})
    found = measure_plan(plan(DMU50, "axes", 22, None, choices), model, virtual, streams(seed, 3))
    return replace(found.measurement, source="lengths.csv")


def of_tool(model):
    """The errors of a model at positions without a direction of approach."""
    effects = tuple(effect for effect in model.effects if not isinstance(effect, Backlash))
    return msgspec.structs.replace(model, effects=effects, covariance=None)


def test_two_runs_of_one_instrument_give_what_one_fit_of_both_gives(two_runs):
    basis, scale = "legendre:4", 1.0
    one = calibrate(joined(two_runs), basis=basis, prior_scale=scale).model
    both = calibrate_together(two_runs, basis=basis, prior_scale=scale).model
    assert [effect.name for effect in both.effects] == [effect.name for effect in one.effects]
    u = np.sqrt(np.diag(one.covariance))
    np.testing.assert_allclose(both.parameters, one.parameters, atol=2e-2 * u.max())
    np.testing.assert_allclose(both.covariance, one.covariance, atol=2e-2 * u.max() ** 2)


@pytest.mark.statistical
def test_the_order_has_no_effect(shop):
    measurements, _ = shop
    first, second = (calibrate_together(each, hold_out=False).model for each in (measurements, measurements[::-1]))
    by_name = {effect.name: effect for effect in second.effects}
    for effect in first.effects:
        np.testing.assert_allclose(effect.parameters, by_name[effect.name].parameters, atol=1e-6)
        np.testing.assert_allclose(effect.uncertainties, by_name[effect.name].uncertainties, atol=1e-6)


@pytest.mark.statistical
def test_spheres_and_an_interferometer_show_what_neither_shows_alone(shop):
    measurements, model = shop
    both = calibrate_together(measurements)
    scales = {"E_XX", "E_YY", "E_ZZ"}
    alone = calibrate(measurements[0])
    assert any(scales <= set(each.effects) for each in alone.identifiability.unidentifiable)
    assert not any(scales <= set(each.effects) for each in both.identifiability.unidentifiable)
    before, left = unseen_um(of_tool(both.model), model)
    assert left < 0.2 * before
    assert left < 0.6 * unseen_um(alone.model, model)[1]
    assert not any(part.contradicts for part in both.parts)
    assert all(part.together.rms_um < 0.3 * part.before_um for part in both.parts)


@pytest.mark.statistical
def test_a_machine_that_has_changed_between_the_measurements_is_found(shop):
    (spheres, _), model = shop
    lines = (*(effect for effect in model.effects if not isinstance(effect, Scale)), Scale("X", 700.0))
    # second harmonics of a table look like scales of X and Y that differ
    both = calibrate_together([spheres, lengths(model_of(DMU50, lines))], basis="fourier:1", force=True)
    assert min(part.p_value for part in both.parts) < CONTRADICTION_P
    assert "CONTRADICTS the other measurements" in together_report(both, "ncomp fit").verdict


@pytest.mark.statistical
def test_results_for_programs(shop):
    measurements, _ = shop
    found = calibrate_together(measurements, hold_out=False)
    results = json.loads(json.dumps(together_json(found)))
    assert [each["instrument"] for each in results["measurements"]] == ["touch-probe", "interferometer"]
    assert [each["rows"] for each in results["measurements"]] == [len(each) for each in measurements]
    assert results["accepted"]
    assert results["calibration"] == found.model.id
    assert set(found.model.provenance.inputs) == {"spheres.csv", "lengths.csv"}


def test_the_command(shop, ncomp):
    measurements, _ = shop
    for each in measurements:
        written(each, Path(each.source))
    words = ["fit", "spheres.csv", "lengths.csv", "--machine", "dmu50", "--no-hold-out", "-o", "cal.json"]
    done = ncomp(*words, "--json", "out.json")
    assert done.status == 0
    assert b"spheres.csv (touch-probe): residual" in done.out
    assert Path("cal.json").exists()
    assert len(json.loads(Path("out.json").read_text())["measurements"]) == 2


def test_files_of_one_instrument_are_one_measurement(two_runs, shop):
    spheres = shop[0][0]
    assert [len(each) for each in by_instrument([two_runs[0], two_runs[1]])] == [300]
    assert by_instrument([two_runs[0], spheres, two_runs[1]])[1] is spheres


def test_a_moved_sphere_is_refused(shop):
    (spheres, lengths), _ = shop
    behind = (spheres.groups == spheres.groups[0]) & (np.arange(len(spheres)) >= len(spheres) // 2)
    with pytest.raises(UserError, match=r"spheres\.csv: sphere .* moved by 50. um before"):
        calibrate_together([shifted_rows(spheres, behind, [0.3, 0.4, 0.0]), lengths], hold_out=False)


def test_other_machines_are_refused(two_runs, shop):
    with pytest.raises(UserError, match="of different machines"):
        calibrate_together([two_runs[0], shop[0][0]])


@pytest.mark.parametrize(
    ("bases", "turning", "common"),
    [
        ([Legendre((0, 10), 3), Legendre((0, 10), 5)], False, Legendre((0, 10), 5)),
        ([Legendre((0, 5), 3), Legendre((0, 10), 3)], False, Legendre((0, 10), 6)),
        ([BSpline((0, 5, 10), 1), BSpline((-6, 30), 1)], False, BSpline((-6, -3, 0, 5, 10, 15, 20, 25, 30), 1)),
        ([Fourier((0, 90), (1.0,)), Fourier((0, 180), (1.0,))], False, Fourier((0, 180), (2.0,))),
        ([Fourier((0, 90), (1.0,)), Fourier((90, 180), (1.0,))], True, Harmonics((0, 360), 2)),
        ([Harmonics((0, 360), 2), Fourier((90, 180), (0.2,))], True, Harmonics((0, 360), 2)),
    ],
)
def test_the_common_basis(bases, turning, common):
    assert common_basis(bases, turning=turning) == common
    assert common_basis(bases[::-1], turning=turning) == common
