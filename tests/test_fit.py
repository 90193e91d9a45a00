"""The fit: exactness, statistics, rank and names, outliers, datum, location errors, choice of basis."""

from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest
from support.tiers import quick
from support.virtual_measurements import COLLINEAR, EXACT, MONTAVON, ONE, THREE, measured, pose_of, positions, truth

import machines
from calibration.fit import cross_validation
from calibration.fit.calibrate import calibrate
from calibration.fit.cross_validation import cross_validate
from calibration.fit.datum import gauge, null_space, split_locations, to_datum, transformed
from calibration.fit.fit import _shares, fit
from calibration.fit.identifiability import identifiability
from calibration.fit.linear import effective_parameters, singular_values
from calibration.fit.problem import Problem
from calibration.instruments import Interferometer, Part
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.observation.full_model import BasisChoice, parse_basis, priors, rigid_model, with_effects
from calibration.observation.stops_and_lines import held_out_blocks
from calibration.registration.registration import PLANAR, Registration
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, Cyclic, GrowthWithSensor, Hysteresis, LocationError, ThermalDrift
from kinematics.error_model.model import no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.transforms import Pose, rotation_vector_matrix
from kinematics.user_error import UserError

HATS = {"X": BasisChoice("b-spline", 21), "Y": BasisChoice("b-spline", 16), "Z": BasisChoice("b-spline", 9)}
"""Nodes every 100, 100 and 50 mm: 276 parameters, as Montavon et al."""


def montavon(targets, seed=0, **options):
    rng = np.random.default_rng(seed)
    model = truth(MONTAVON, rng)
    return model, measured(MONTAVON, positions(MONTAVON, 320, rng, edges=170), targets, model, rng, **options)


TARGETS = {"at the spindle": {"1": Target((0.0, 0.0, 0.0))}, "one": ONE, "collinear": COLLINEAR, "three": THREE}


@cache
def fitted_with_hats(targets, stations=1):
    _, measurement = montavon(TARGETS[targets], stations=stations)
    return fit(measurement, rigid_model(measurement, HATS))


def deviations(machine, model, q, tool=(0.0, 0.0, -120.0)):
    return exact_deviation(machine, q, model.errors(machine, State(q)), tool).position


def aligned(machine, difference, q):
    """Difference of deviations `(n, 3)` with its rigid part taken out."""
    points = tool_point(machine, q, (0.0, 0.0, -120.0))
    centred = points - points.mean(axis=0)
    design = np.zeros((len(q), 3, 6))
    design[:, :, :3] = np.eye(3)
    design[:, :, 3:] = np.cross(np.eye(3), centred[:, None, :]).swapaxes(1, 2)
    flat = design.reshape(-1, 6)
    return (difference.reshape(-1) - flat @ np.linalg.lstsq(flat, difference.reshape(-1), rcond=None)[0]).reshape(-1, 3)


@pytest.mark.parametrize(
    ("targets", "stations", "rank", "registered"),
    [("one", 1, 217, 211), ("collinear", 1, 235, 229), ("three", 1, 264, 258), ("one", 2, 217, 211)],
)
def test_rank_of_montavon_s_model(targets, stations, rank, registered):
    # computed independently with an SVD of the dense design: 217/211, 235/229, 264/258
    seen = identifiability(fitted_with_hats(targets, stations))
    assert (seen.parameters, seen.rank, seen.rank_registered, seen.by_convention) == (276, rank, registered, 18)


def test_null_directions_are_named_with_their_remedy():
    seen = identifiability(fitted_with_hats("at the spindle"))
    assert seen.not_visible == ["E_CX", "E_AZ", "E_BZ", "E_CZ"]  # 21 + 27 columns vanish
    assert all("second tool vector" in str(unidentifiable) for unidentifiable in seen.unidentifiable)
    seen = identifiability(fitted_with_hats("collinear"))
    assert seen.not_visible == ["E_CX", "E_CZ"]
    assert all("third tool vector" in str(unidentifiable) for unidentifiable in seen.unidentifiable)
    assert not identifiability(fitted_with_hats("three")).unidentifiable


def test_what_is_not_seen_keeps_the_uncertainty_of_the_prior():
    found = fitted_with_hats("at the spindle")
    u = {effect.name: effect.uncertainties for effect in found.model.effects}
    assert u["E_CZ"] == pytest.approx([30.0] * 9)
    assert max(u["E_ZZ"]) < 30.0
    assert all(p == pytest.approx(0.0, abs=1e-6) for p in found.model.effects[-1].parameters)  # E_CZ


@pytest.mark.parametrize("name", ["gantry", "cframe", "dmu50"])
def test_exact_data_give_the_exact_deviations(name):
    machine, rng = machines.load(name), np.random.default_rng(1)
    model = truth(machine, rng, 40.0)
    q = positions(machine, 900, rng)
    measurement = measured(machine, q, THREE, model, rng, tracker=EXACT, noise=False)
    found = fit(measurement, zeroed(model))
    assert found.chi2_reduced < 1e-2  # second-order leftovers far below 0.01 um
    grid = positions(machine, 300, rng)
    difference = deviations(machine, found.model, grid) - deviations(machine, model, grid)
    assert np.abs(aligned(machine, difference, grid)).max() < 3e-4


def zeroed(model):
    effects = tuple(effect.with_parameters([0.0] * 6, effect.u) for effect in model.effects)
    return msgspec.structs.replace(model, effects=effects)


def test_chi2_and_coverage_of_predictions():
    machine, rng = machines.load("cframe"), np.random.default_rng(7)
    chi2, inside, count = [], 0, 0
    for _ in range(8):
        model = truth(machine, rng, 15.0)
        measurement = measured(machine, positions(machine, 250, rng), THREE, model, rng)
        found = fit(measurement, zeroed(model))
        chi2.append(found.chi2_reduced)
        grid = positions(machine, 60, rng)
        difference = aligned(machine, deviations(machine, found.model, grid) - deviations(machine, model, grid), grid)
        inside += int(np.sum(np.abs(difference) < 2 * predicted_u(machine, found.model, grid)))
        count += difference.size
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.05)
    assert inside / count == pytest.approx(0.954, abs=0.03)


def predicted_u(machine, model, q):
    """Standard uncertainties `(n, 3)` of the aligned deviations, from the covariance of the parameters."""
    design = model.design(machine, State(q), error_transform_with_tool(machine, q, (0.0, 0.0, -120.0))[:, :3])
    columns = np.stack([aligned(machine, design[:, :, p], q) for p in range(design.shape[2])], axis=2)
    return np.sqrt(np.einsum("nkp,pq,nkq->nk", columns, np.array(model.covariance), columns))


def test_outliers_and_copies_are_named_and_not_fitted():
    _, clean = montavon(THREE)
    observed = clean.observed.copy()
    observed[17] += [0.0, 0.3, 0.0]
    observed[100] += [50.0, 0.0, 0.0]
    observed[200] = observed[200] * 1000.0
    rows = np.append(np.arange(320), 5)
    dirty = replace(clean.rows(rows), observed=observed[np.append(np.arange(320), 5)])
    coarse = {axis: BasisChoice("b-spline", 6) for axis in "XYZ"}
    found = fit(dirty, rigid_model(dirty, coarse))
    assert found.outliers.tolist() == [17, 100, 200]
    assert np.flatnonzero(found.copies).tolist() == [320]
    without = fit(clean.rows(np.setdiff1d(np.arange(320), [17, 100, 200])), rigid_model(clean, coarse))
    assert found.model.parameters == pytest.approx(without.model.parameters, abs=2e-2)


def test_clean_data_lose_no_rows():
    lost = [len(fit(m, zeroed(t)).outliers) for t, m in (montavon(THREE, seed) for seed in range(5))]
    assert sum(lost) <= 1  # one in a hundred measurements, by the rule


def test_a_failed_station_is_left_out_by_name():
    model, measurement = montavon(THREE, stations=2)
    rng = np.random.default_rng(5)
    bad = measurement.state.station == "s2"
    observed = measurement.observed + np.where(bad[:, None], rng.normal(0.0, 0.5, (320, 3)), 0.0)
    found = fit(replace(measurement, observed=observed), zeroed(model))
    assert found.failed == ("s2",)
    assert not found.kept[bad].any()
    assert found.kept[~bad].mean() > 0.98


def test_nonsense_is_refused():
    _, measurement = montavon(THREE)
    few = measurement.rows(np.arange(1))
    with pytest.raises(UserError, match="too few"):
        fit(few, rigid_model(measurement, HATS))
    still = replace(measurement, state=replace(measurement.state, positions=np.zeros((320, 3))))
    with pytest.raises(UserError, match="no axis moves"):
        rigid_model(still, HATS)


def test_effects_with_time_temperature_and_direction_are_fitted_with_the_rest():
    rng = np.random.default_rng(3)
    machine = machines.load("cframe")
    causes = (
        Backlash("X", 12.0),
        ThermalDrift(component="Z", rate=-20.0, amplitudes=(15.0,), time_constants_s=(1500.0,)),
        GrowthWithSensor(axis="Y", sensor="scale", coefficient=9.0, lag_s=900.0),
    )
    model = msgspec.structs.replace(truth(machine, rng, 10.0), effects=(*truth(machine, rng, 10.0).effects, *causes))
    q = positions(machine, 700, rng)
    warm = {"scale": 4.0 * np.sin(np.arange(700) / 60.0)}
    base = measured(machine, q, THREE, no_errors(machine), rng, tracker=EXACT, noise=False)
    state = replace(base.state, temperatures=warm, time=15.0 * np.arange(700))

    observed = base.instrument.expected(base, pose_of(["s1"]), model.observation(machine, state))
    measurement = replace(base, observed=observed, state=replace(state, observed=observed))
    start = (
        Backlash("X", 0.0),
        ThermalDrift(component="Z", rate=0.0, amplitudes=(5.0,), time_constants_s=(1000.0,)),
        GrowthWithSensor(axis="Y", sensor="scale", coefficient=3.0, lag_s=400.0),
    )
    zero = zeroed(msgspec.structs.replace(model, effects=model.effects[:-3]))
    found = fit(measurement, msgspec.structs.replace(zero, effects=(*zero.effects, *start)))
    backlash, drift, growth = found.model.effects[-3:]
    assert backlash.width == pytest.approx(12.0, abs=0.05)
    assert (drift.rate, *drift.amplitudes, *drift.time_constants_s) == pytest.approx((-20.0, 15.0, 1500.0), rel=0.02)
    assert (growth.coefficient, growth.lag_s) == pytest.approx((9.0, 900.0), rel=0.02)


@pytest.mark.parametrize("name", quick(machines.names(), ["gantry", "dmu50", "head_table"]))
def test_the_datum_moves_along_the_gauge_only(name):
    machine, rng = machines.load(name), np.random.default_rng(4)
    model = truth(machine, rng, 30.0)
    prior = priors(model)
    matrix = to_datum(machine, model, prior)
    assert matrix @ matrix == pytest.approx(matrix, abs=1e-6)
    moved = model.parameters @ matrix.T
    q = positions(machine, 200, rng)
    other = msgspec.structs.replace(model, covariance=np.eye(len(prior)).tolist())
    changed = deviations(machine, transformed(other, model.effects, matrix), q) - deviations(machine, model, q)
    assert np.abs(aligned(machine, changed, q)).max() < 2e-4  # second order of moves by 50 um and urad
    assert np.abs(changed).max() > 1e-3
    assert moved.shape == model.parameters.shape


def test_location_errors_come_out_of_error_motions_without_changing_them():
    machine, rng = machines.load("dmu50"), np.random.default_rng(5)
    model = msgspec.structs.replace(truth(machine, rng, 30.0), covariance=None)
    n = len(model.parameters)
    model = msgspec.structs.replace(model, covariance=tuple(map(tuple, np.eye(n).tolist())))
    effects, matrix = split_locations(machine, model)
    apart = transformed(model, effects, matrix)
    names = [effect.name for effect in apart.effects if isinstance(effect, LocationError)]
    assert names == ["E_X0C", "E_Y0C", "E_A0C", "E_B0C", "E_X0B", "E_Z0B", "E_A0B", "E_C0B", "E_C0Y", "E_B0Z", "E_A0Z"]
    q = positions(machine, 100, rng)
    assert deviations(machine, apart, q) == pytest.approx(deviations(machine, model, q), abs=1e-8)


def test_location_errors_of_b_and_c_of_the_dmu50_are_recovered():
    machine, rng = machines.load("dmu50"), np.random.default_rng(6)
    locations = {"X0C": 25.0, "Y0C": -18.0, "A0C": 30.0, "B0C": -22.0, "X0B": 12.0, "A0B": 15.0, "C0B": -28.0}
    effects = tuple(LocationError(name[0], name[2], value) for name, value in locations.items())
    small = truth(machine, rng, 3.0)
    model = msgspec.structs.replace(small, effects=(*small.effects, *effects))
    measurement = measured(machine, positions(machine, 400, rng), THREE, model, rng)
    found = calibrate(measurement, basis="legendre:3", hold_out=False)
    # the truth in the same frame
    whole = msgspec.structs.replace(small, covariance=tuple(map(tuple, np.eye(len(small.parameters)).tolist())))
    with_constants = tuple(
        effect.with_parameters(
            [effect.parameters[0] + locations.get(f"{effect.component}0{effect.axis}", 0.0), *effect.parameters[1:]],
            effect.u,
        )
        for effect in whole.effects
    )
    whole = msgspec.structs.replace(whole, effects=with_constants)
    inside = transformed(whole, whole.effects, to_datum(machine, whole, priors(whole)))
    wanted = {
        e.name: e.value
        for e in transformed(inside, *split_locations(machine, inside)).effects
        if isinstance(e, LocationError)
    }
    got = {e.name: e for e in found.model.effects if isinstance(e, LocationError)}
    assert got.keys() == wanted.keys()
    for name, effect in got.items():
        assert abs(effect.value - wanted[name]) < 3.5 * effect.uncertainties[0], name
        assert effect.uncertainties[0] < 25.0, name


def test_gauge_is_the_null_space_of_a_rich_measurement():
    model = truth(MONTAVON, np.random.default_rng(0))
    assert gauge(MONTAVON, model, priors(model)).shape[1] == 18
    assert null_space(np.diag([1.0, 0.0, 1e-20])).shape[1] == 2


def test_held_out_blocks_are_predicted_worse_than_fitted_ones():
    model, measurement = montavon(THREE)
    found = fit(measurement, zeroed(model))
    held = cross_validate(found.good, zeroed(model), found.prior)
    assert held.blocks == 8
    assert found.rms_um < held.rms_um < 1.5 * found.rms_um
    labels, what = held_out_blocks(measurement)
    assert what == "regions of stops"
    assert np.bincount(labels).min() >= 30


def test_held_out_residuals_are_those_of_new_fits(monkeypatch):
    """Rows that are taken out of the normal equations leave the fit of the others."""
    model, measurement = montavon(THREE)
    found, start = fit(measurement, zeroed(model)), zeroed(model)
    quick = cross_validate(found.good, start, found.prior, near=found)
    monkeypatch.setattr(cross_validation, "LeavingOut", None)
    monkeypatch.setattr(cross_validation, "_is_linear", lambda _: False)
    anew = cross_validate(found.good, start, found.prior)
    assert quick.blocks == anew.blocks
    for name in ("rms_um", "max_um", "other_rms_um", "improvement"):
        assert getattr(quick, name) == pytest.approx(getattr(anew, name), rel=1e-6)


def test_effects_with_memory_and_periods_are_fitted_anew():
    model = zeroed(montavon(THREE)[0])
    assert cross_validation._is_linear(model)
    for effect in (Hysteresis("X", 10.0, 5.0), Cyclic("X", "X", 10.0, (0.0,), (0.0,))):
        assert not cross_validation._is_linear(msgspec.structs.replace(model, effects=(*model.effects, effect)))


@pytest.mark.parametrize("seed", [0, 2])
def test_a_period_is_found_from_afar(seed):
    machine, rng = machines.load("gantry"), np.random.default_rng(seed)
    q, model = positions(machine, 150, rng), truth(machine, rng, 5.0)
    wave = Cyclic(component="X", axis="X", period=800.0, sine=(300.0,), cosine=(150.0,))
    data = measured(machine, q, THREE, msgspec.structs.replace(model, effects=(*model.effects, wave)), rng)
    start = Cyclic(component="X", axis="X", period=1000.0, sine=(0.0,), cosine=(0.0,))
    found = fit(data, with_effects(data, dict.fromkeys("XYZ", BasisChoice("b-spline", 5)), [start], 1.0)[0])
    assert found.model.effects[-1].period == pytest.approx(800.0, abs=0.2)
    assert found.chi2_reduced < 1.5


def test_interferometer_data_give_positioning_and_backlash():
    machine, rng = machines.load("gantry"), np.random.default_rng(9)
    targets = np.linspace(0, 5000, 26)
    sweep = np.concatenate([targets, targets[::-1]])
    x = np.tile(sweep, 3)
    state = with_moves(
        State(np.stack([x, np.full_like(x, 900.0), np.full_like(x, 700.0)], axis=1), target=np.full(156, "1"))
    )
    run = np.repeat(["1", "2", "3"], 52)
    empty = Measurement(machine, Interferometer(u_um=0.3), state, np.zeros((156, 1)), axis=np.full(156, "X"), run=run)
    wave = 30.0 * np.sin(np.pi * x / 5000) - 0.5 * 14.0 * state.approach[:, 0] + rng.normal(0, 0.3, 156)
    found = fit(replace(empty, observed=wave[:, None] * 1e-3), rigid_model(empty, {"X": BasisChoice("b-spline", 13)}))
    motion, backlash = found.model.effects
    assert backlash.width == pytest.approx(14.0, abs=4 * backlash.u[0])
    assert found.chi2_reduced < 1.5
    middle = np.array(motion.parameters)[6] - np.array(motion.parameters)[0]
    assert middle == pytest.approx(30.0, abs=1.0)


def test_a_part_shows_what_its_plane_shows():
    machine, rng = machines.load("cframe"), np.random.default_rng(10)
    model = truth(machine, rng, 20.0)
    q = positions(machine, 400, rng)
    q[:, 2] = 100.0
    state = with_moves(State(q, target=np.full(400, "1")))
    empty = Measurement(machine, Part(u_um=2.0, components=2), state, np.zeros((400, 2)))

    pose = Pose(rotation_vector_matrix([[0, 0, 0.3]]), np.array([[5.0, 6.0, 0.0]]))
    seen = empty.instrument.expected(
        empty, Registration({"1": pose}, {"1": np.zeros(3)}, PLANAR), model.observation(machine, state)
    )
    part = replace(empty, observed=seen + rng.normal(0, 2e-3, seen.shape), source="part")
    found = calibrate(part, basis="b-spline:6")
    assert found.fit.chi2_reduced == pytest.approx(1.0, abs=0.15)
    assert found.before_rms_um > 5 * found.fit.rms_um
    assert {"E_ZX", "E_ZY"} <= set(found.identifiability.not_visible)
    assert "Z" not in part.moving


@pytest.mark.parametrize("text", ["b-spline", "b-spline:1", "spline:4", "legendre:-1", "legendre:99", ""])
def test_bad_bases_are_refused(text):
    with pytest.raises(UserError, match="basis"):
        parse_basis(text)


def test_effective_parameters_beside_information_that_is_large_beyond_rounding():
    known = np.diag([1e18, 3.0, 0.0])
    assert effective_parameters(known) == pytest.approx(1.75)
    assert effective_parameters(np.diag([1e22, -1e5, -1e5])) == pytest.approx(1.0)


@pytest.mark.parametrize("times", [0.15, 0.5, 1.9, 2.5, 7.0])
def test_steps_of_shapes_that_are_too_long_or_too_short_end_by_the_secant(times):
    """Gauss-Newton alone would diverge from 2 times on, and creep far below 1."""
    left, last, taken = np.array([3.0, -1.0]), np.zeros(0), np.zeros(0)
    for _ in range(3):
        own = -times * left
        taken, last = own * _shares(own, last, taken), own
        left = left + taken
    np.testing.assert_allclose(left, 0.0, atol=1e-9)


def test_a_step_with_its_own_shapes_is_the_step():
    """With none, the step that holds them."""
    rng = np.random.default_rng(4)
    model = truth(MONTAVON, rng)
    drifting = msgspec.structs.replace(
        model, effects=(*model.effects, ThermalDrift("X", amplitudes=(30.0,), time_constants_s=(900.0,)))
    )
    data = measured(MONTAVON, positions(MONTAVON, 120, rng), THREE, drifting, rng)
    problem = Problem.of(data, drifting, priors(drifting))
    point = problem.point(
        1.1 * np.array(drifting.parameters), data.instrument.first_registration(data, np.ones(len(data), bool))
    )
    found = problem.solve_reweighted(point, np.ones_like, 1.0, problem.derivatives(point))
    own = problem.shapes_of(found.solved.step, point)
    assert len(own) == 1
    scale = np.abs(found.solved.step).max()
    np.testing.assert_allclose(problem.step_with_shapes(own, point, found.normal), found.solved.step, atol=1e-6 * scale)
    held = problem.step_with_shapes(0.0 * own, point, found.normal)
    assert abs(problem.shapes_of(held, point)[0]) < 1e-6 * abs(own[0])


def test_reweighted_steps_have_the_weights_that_follow_them():
    model, data = montavon(THREE)
    off = data.observed.copy()
    off[::17] += 0.5
    data = replace(data, observed=off)
    problem = Problem.of(data, model, priors(model))
    point = problem.point(
        np.array(model.parameters), data.instrument.first_registration(data, np.ones(len(data), bool))
    )
    derivatives = problem.derivatives(point)

    def weights_of(distances):
        return 1.0 / np.maximum(distances / 8.0, 1.0) ** 0.5

    found = problem.solve_reweighted(point, weights_of, 1.0, derivatives)
    direct = problem.solve(point, found.weights, 1.0, derivatives)
    np.testing.assert_allclose(found.solved.step, direct.step, atol=1e-9 * np.abs(direct.step).max())
    after = replace(point, residual=point.residual - derivatives.times(direct.step))
    assert np.abs(weights_of(problem.distances(after)) - found.weights).max() < 0.2


@pytest.mark.parametrize("shape", [(120, 40), (40, 120), (0, 5), (5, 0)])
def test_matrices_of_deficient_rank_are_decomposed(shape):
    """Divide and conquer did not converge for the parameters of a gantry, of which 60 of 204 move nothing."""
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(shape[0], 8)) @ rng.normal(size=(8, shape[1]))
    matrix[:, 30:] *= 1e-15
    u, values, v = singular_values(matrix)
    assert (u * values) @ v == pytest.approx(matrix, abs=1e-12)
    assert np.count_nonzero(values > 1e-9) == (8 if matrix.size else 0)
