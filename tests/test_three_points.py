"""Three-point identification: recovery through the exact kinematics, covariance, reference lines, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from support.command import refusal, succeed
from support.three_points_cases import SERIES, TARGETS, locations, measured, model, random_effects, station
from support.tiers import quick

import machines
from calibration.instruments import LaserTracker, Part
from calibration.measurement.measurement import Measurement, Target
from calibration.measurement.written_file import write_measurement
from calibration.simulation.true_model import TABLE_1, random_true_model
from calibration.single_axis.reference_lines import reference_line, straightness
from calibration.single_axis.three_points import Choice, ThreePoints, identify
from calibration.single_axis.three_points_figures import kind_of, ranges, squarenesses, straightnesses
from kinematics.deviation import exact_deviation
from kinematics.error_model.model import ErrorModel, decode_model, encode_model, read_model
from kinematics.forward import forward
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

DMU50 = machines.load("dmu50")
FRONT = {"1": station((200.0, -1500.0, -300.0), 0.4)}
AROUND = {
    "1": station((800.0, -850.0, -650.0), 0.4),
    "2": station((-800.0, 850.0, -650.0), 2.0),
    "3": station((850.0, 800.0, 950.0), -1.0),
    "4": station((-850.0, -800.0, 950.0), -2.0),
}
CUBIC = Choice("polynomial", {f"{c}{a}": 3 for a in SERIES for c in "XYZABC"})
CUBIC_OF_B = Choice("polynomial", {f"{c}B": 3 for c in "XYZABC"})
LINEAR = Choice("polynomial", {f"{c}{a}": 3 for a in "XYZ" for c in "XYZABC"})


def parameters(found: ThreePoints) -> dict[str, float]:
    return {e.name: e.parameters[0] for e in found.model.effects if e.kind == "location"}


def clamped(truth: ErrorModel, found: ErrorModel, n: int = 300) -> Array:
    """What one machine's tool does on the table unlike the other's, `(n, 3)` um, with the workpiece clamped at best."""
    rng = np.random.default_rng(0)
    ends = np.array([[SERIES[name].min(), SERIES[name].max()] for name in DMU50.names]).T * DMU50.scale
    q = rng.uniform(*ends, (n, len(DMU50.axes)))
    tool = (0.0, 0.0, -100.0)
    two = [exact_deviation(DMU50, q, one.errors(DMU50, State(q)), tool).position for one in (truth, found)]
    points = forward(DMU50, q).apply(tool)
    clamp = np.concatenate(
        [np.broadcast_to(np.eye(3), (n, 3, 3)), np.cross(np.eye(3), points[:, None, :]).swapaxes(1, 2)], axis=2
    ).reshape(-1, 6)
    away = (two[0] - two[1]).reshape(-1)
    return (1e3 * (away - clamp @ np.linalg.lstsq(clamp, away, rcond=None)[0])).reshape(-1, 3)


def open_to(axis: str, component: int, x: Array) -> Array:
    """Functions `(n, k)` of an error motion that a datum, or the place of the targets, takes with it."""
    ones = np.ones_like(x)
    own = component % 3 == "XYZABC".index(axis) % 3
    if axis in "XYZ":
        return np.stack([ones, x], axis=1) if component < 3 and not own else ones[:, None]
    return ones[:, None] if own else np.stack([ones, np.cos(np.deg2rad(x)), np.sin(np.deg2rad(x))], axis=1)


@pytest.mark.parametrize("stations", [FRONT, AROUND], ids=["one station", "four stations"])
def test_all_error_motions_are_recovered_without_noise(stations):
    truth = model(DMU50, random_effects(3, size=3.0))
    found = identify(measured(DMU50, truth, stations), CUBIC)
    for axis, x in SERIES.items():
        q = np.zeros((len(x), len(DMU50.axes)))
        q[:, DMU50.index(axis)] = x
        given_errors = truth.errors(DMU50, State(q * DMU50.scale))[:, DMU50.index(axis)] / ([1e-3] * 3 + [1e-6] * 3)
        for component in range(6):
            away = found.axes[axis].errors[:, component] - given_errors[:, component]
            free = open_to(axis, component, x)
            left = away - free @ np.linalg.lstsq(free, away, rcond=None)[0]
            assert np.abs(left).max() < 1e-3, (axis, component)  # 1e-6 mm, 1e-9 rad


@pytest.mark.parametrize("axis", quick("XYZBC", "XC"))
def test_model_of_one_faulty_axis_moves_the_tool_as_the_machine_does(axis):
    truth = model(DMU50, random_effects(5, axes=axis, size=5.0))
    found = identify(measured(DMU50, truth, FRONT), CUBIC)
    assert np.abs(clamped(truth, found.model)).max() < 1e-3


def test_model_of_five_faulty_axes_moves_the_tool_as_the_machine_does():
    truth = model(DMU50, random_effects(6, size=6.0) + locations({"C0Y": 8.0, "X0C": 20.0, "A0B": 12.0, "Z0B": 7.0}))
    found = identify(measured(DMU50, truth, AROUND), CUBIC)
    left = clamped(truth, found.model)
    assert np.abs(left).max() < 1.5e-3  # products of three errors
    assert np.abs(clamped(truth, model(DMU50, []))).max() > 10.0


def test_tables_hold_at_their_nodes():
    truth = model(DMU50, random_effects(3, axes="XYZ", size=5.0))
    found = identify(measured(DMU50, truth, FRONT, axes="XYZ"), Choice("table"))
    polynomial = identify(measured(DMU50, truth, FRONT, axes="XYZ"), LINEAR)
    q = np.zeros((11, len(DMU50.axes)))
    q[:, DMU50.index("X")] = SERIES["X"]
    two = [one.model.errors(DMU50, State(q))[:, DMU50.index("X")] for one in (found, polynomial)]
    np.testing.assert_allclose(two[0], two[1], atol=1e-9)


def test_degrees_are_those_that_the_data_show():
    truth = model(DMU50, random_effects(8, degree=2, axes="XYZ"))
    found = identify(measured(DMU50, truth, AROUND, axes="XYZ", rng=np.random.default_rng(2)))
    degrees = [degree for axis in found.axes.values() for degree in axis.curves.degrees]
    assert max(degrees) < 8
    assert np.mean(degrees) < 3.0


def waves(monkeypatch, n: int, seed: int, axes: str = "XYZ") -> tuple[ErrorModel, Measurement]:
    """Linear axes with up to five half-waves over the travel, seen at n positions of each of some."""
    rng = np.random.default_rng(seed)
    for name in axes:
        monkeypatch.setitem(SERIES, name, np.linspace(*DMU50.axes[DMU50.index(name)].travel, n))
    truth = random_true_model(DMU50, rng, TABLE_1)
    return truth, measured(DMU50, truth, AROUND, axes=axes, rng=rng)


def covered(truth: ErrorModel, found: ErrorModel) -> float:
    """Share of predicted deviations, rotary axes at rest, that two standard uncertainties hold."""
    rng = np.random.default_rng(0)
    ends = np.array([[SERIES[a].min(), SERIES[a].max()] if a in "XYZ" else [0, 0] for a in DMU50.names]).T
    q, tool = rng.uniform(*(ends * DMU50.scale), (200, len(DMU50.axes))), (0.0, 0.0, -100.0)
    points = forward(DMU50, q).apply(tool)
    clamp = np.concatenate(
        [np.broadcast_to(np.eye(3), (200, 3, 3)), np.cross(np.eye(3), points[:, None, :]).swapaxes(1, 2)], axis=2
    ).reshape(-1, 6)

    def moved(one: ErrorModel) -> Array:
        away = exact_deviation(DMU50, q, one.errors(DMU50, State(q)), tool).position.reshape(-1)
        return away - clamp @ np.linalg.lstsq(clamp, away, rcond=None)[0]

    assert found.covariance is not None
    values, vectors = np.linalg.eigh(found.covariance)
    root, best, draws = vectors * np.sqrt(np.maximum(values, 0.0)), moved(found), []
    for _ in range(60):
        left = (found.parameters + root @ rng.standard_normal(len(values))).tolist()
        effects = []
        for effect in found.effects:
            size = len(effect.parameters)
            effects.append(effect.with_parameters(left[:size]))
            left = left[size:]
        draws.append(moved(model(DMU50, effects)) - best)
    return float(np.mean(np.abs(best - moved(truth)) <= 2.0 * np.std(draws, axis=0)))


@pytest.mark.statistical
def test_uncertainties_hold_errors_with_five_half_waves(monkeypatch):
    shares, degrees = [], []
    for seed in (1, 2, 3, 4):
        truth, seen = waves(monkeypatch, 21, seed)
        found = identify(seen)
        shares.append(covered(truth, found.model))
        degrees += [degree for axis in found.axes.values() for degree in axis.curves.degrees]
    assert np.mean(shares) >= 0.85
    assert max(degrees) > 8


def test_waves_that_the_positions_hardly_resolve_are_named(monkeypatch):
    """Five half-waves over the travel of X: u does not contain what 11 positions do not show, and 31 do."""
    named = []
    for n in (11, 31):
        found = identify(waves(monkeypatch, n, 2, "X")[1])
        named.append([note for note in found.notes if "positions resolve" in note])
    (note,) = named[0]
    assert note.startswith("E_XX, ")
    assert "measure X at 21 positions" in note
    assert named[1] == []
    monkeypatch.undo()
    smooth = measured(
        DMU50, model(DMU50, random_effects(8, degree=2)), AROUND, axes="XYZ", rng=np.random.default_rng(2)
    )
    assert not [note for note in identify(smooth).notes if "positions resolve" in note]


def test_a_curve_that_misses_its_points_is_named_and_widened(monkeypatch):
    _, seen = waves(monkeypatch, 21, 1, "XZ")
    found = identify(seen, Choice(degrees={"XX": 3}))
    (note,) = [note for note in found.notes if "deviates from its points" in note]
    assert note.startswith("E_XX (")
    assert "--basis table" in note
    missed, *others = found.axes["X"].misfits
    factor = missed.widening
    assert factor == pytest.approx((missed.chi2 / missed.degrees_of_freedom) ** 0.5)
    assert factor > 1.5
    assert all(one.widening == 1.0 for one in others)
    monkeypatch.setattr("calibration.single_axis.error_curves.MISFIT", 0.0)
    sharp = identify(seen, Choice(degrees={"XX": 3}))
    index = next(i for i, e in enumerate(found.model.effects) if e.name == "E_XX")
    two = [np.array(one.model.effects[index].uncertainties) for one in (found, sharp)]
    np.testing.assert_allclose(two[0], factor * two[1])
    assert not [note for note in identify(seen, Choice("table")).notes if "deviates" in note]


def test_a_wobble_is_widened_together_with_the_curve_that_holds_it_down(monkeypatch):
    seen = measured(DMU50, model(DMU50, random_effects(3, axes="B")), AROUND, axes="XB", rng=np.random.default_rng(3))
    sharp = identify(seen, CUBIC_OF_B)
    monkeypatch.setattr("calibration.single_axis.error_curves.MISFIT", 1.1)  # every curve with chi2/dof above one
    wide = identify(seen, CUBIC_OF_B)
    factors = [one.widening for one in wide.axes["B"].misfits]
    assert len(set(factors)) > 2
    pairs = zip(wide.model.effects, sharp.model.effects, strict=True)
    for one, other in (pair for pair in pairs if pair[0].axes[0] == "B"):
        assert (np.array(one.uncertainties) <= (max(factors) + 1e-6) * np.array(other.uncertainties) + 1e-9).all()


@pytest.mark.parametrize("seed", quick(range(3), [0], [1]))
def test_a_model_is_read_again(seed):
    seen = measured(DMU50, model(DMU50, random_effects(seed)), AROUND, axes="XC", rng=np.random.default_rng(seed))
    found = identify(seen).model
    again = decode_model(encode_model(found), "cal.json")
    np.testing.assert_array_equal(again.covariance, np.array(again.covariance).T)
    np.testing.assert_allclose(again.covariance, found.covariance, rtol=1e-12)


@pytest.mark.statistical
def test_the_uncertainty_holds_the_curve_between_the_positions():
    """Over the noise of 30 measurements: the model of X, less lines that a datum takes, between its positions."""
    truth, rng = model(DMU50, random_effects(8, degree=2, axes="XYZ", size=4.0)), np.random.default_rng(5)
    at = np.linspace(-250.0, 250.0, 41)
    q = np.zeros((len(at), len(DMU50.axes)))
    q[:, DMU50.index("X")] = at
    ratios = []
    for _ in range(30):
        found = identify(measured(DMU50, truth, AROUND, axes="XYZ", rng=rng)).model
        two = [one.errors(DMU50, State(q * DMU50.scale))[:, DMU50.index("X")] for one in (found, truth)]
        away = (two[0] - two[1]) / ([1e-3] * 3 + [1e-6] * 3)
        for component in range(6):
            free = open_to("X", component, at)
            effect = next(k for k, e in enumerate(found.effects) if e.name == f"E_{'XYZABC'[component]}X")
            part, basis = found.slices[effect], found.effects[effect].basis
            rows = basis.columns(at) - free @ np.linalg.lstsq(free, basis.columns(at), rcond=None)[0]
            left = away[:, component] - free @ np.linalg.lstsq(free, away[:, component], rcond=None)[0]
            covariance = np.array(found.covariance)[part, part]
            ratios.append(np.mean(left**2) / np.mean(np.einsum("ip,pq,iq->i", rows, covariance, rows)))
    assert 0.5 < np.sqrt(np.mean(ratios)) < 1.1


@pytest.mark.statistical
def test_chi2_of_curves_is_that_of_noise():
    truth, rng = model(DMU50, random_effects(3)), np.random.default_rng(7)
    ratios = []
    for _ in range(10):
        found = identify(measured(DMU50, truth, AROUND, rng=rng), CUBIC)
        ratios += [one.chi2 / one.degrees_of_freedom for axis in found.axes.values() for one in axis.misfits]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)


def test_location_errors_of_rotary_axes_are_recovered():
    given_values = {
        "X0C": 30.0, "Y0C": -12.0, "A0C": 15.0, "B0C": -8.0,
        "X0B": 11.0, "Z0B": -9.0, "A0B": 20.0, "C0B": -6.0,
    }  # fmt: skip
    found = identify(measured(DMU50, model(DMU50, locations(given_values)), FRONT), CUBIC)
    values = parameters(found)
    for name, value in given_values.items():
        assert values[f"E_{name}"] == pytest.approx(value, abs=1e-3)
    assert max(figure.value for figure in ranges(found.axes["C"])) < 1e-3


def test_squareness_has_the_sign_of_the_conventions():
    truth = model(DMU50, locations({"C0Y": 25.0, "C0X": 10.0, "B0Z": -7.0, "A0Z": 4.0, "A0Y": 9.0}))
    found = identify(measured(DMU50, truth, FRONT, axes="XYZ"), LINEAR)
    values = {figure.name: figure.value for figure in squarenesses(found)}
    assert values["E_C(0X)Y"] == pytest.approx(15.0, abs=1e-3)
    assert values["E_B(0X)Z"] == pytest.approx(-7.0, abs=1e-3)
    assert values["E_A(0Y)Z"] == pytest.approx(-5.0, abs=1e-3)


def test_angular_errors_of_one_axis_do_not_become_squareness_of_the_next():
    truth = model(DMU50, random_effects(4, axes="X", size=20.0))
    found = identify(measured(DMU50, truth, FRONT, axes="XYZ"), LINEAR)
    y, z = (found.axes[axis] for axis in "YZ")
    assert max(np.ptp(y.errors[:, [1, 3, 4, 5]], axis=0)) < 1e-3
    assert max(np.ptp(z.errors[:, [2, 3, 4, 5]], axis=0)) < 1e-3


@pytest.mark.statistical
@pytest.mark.parametrize("stations", [dict.fromkeys("1234", FRONT["1"]), AROUND], ids=["one station", "four stations"])
def test_covariance_agrees_with_monte_carlo(stations):
    truth, rng = model(DMU50, random_effects(3, axes="XYZ")), np.random.default_rng(11)
    errors, values = [], []
    for _ in range(60):
        measurement = measured(DMU50, truth, stations, axes="XYZ", rng=rng)
        found = identify(measurement, LINEAR)
        errors.append(np.concatenate([axis.errors.reshape(-1) for axis in found.axes.values()]))
        values.append(found.model.parameters)
        assert found.points.chi2 / found.points.degrees_of_freedom == pytest.approx(1.0, abs=0.25)
    u = np.concatenate([axis.u.reshape(-1) for axis in found.axes.values()])
    ratios = np.std(errors, axis=0, ddof=1) / u
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)
    assert ratios.min() > 0.65
    assert ratios.max() < 1.4
    assert found.model.covariance is not None
    of_parameters = np.std(values, axis=0, ddof=1) / np.sqrt(np.diag(found.model.covariance))
    assert np.mean(of_parameters) == pytest.approx(1.0, abs=0.1)


def test_repeatability_is_found_beyond_the_sheet():
    truth = model(DMU50, [])
    quiet = identify(measured(DMU50, truth, AROUND, axes="XYZ", rng=np.random.default_rng(1)), LINEAR)
    assert quiet.points.repeatability_um == 0.0
    assert quiet.axes["X"].u_a.max() == 0.0
    restless = measured(DMU50, truth, AROUND, axes="XYZ", rng=np.random.default_rng(1), stray=0.004)
    restless = identify(restless, LINEAR)
    assert restless.points.repeatability_um == pytest.approx(4.0, rel=0.15)
    x = restless.axes["X"]
    assert np.all(x.u > quiet.axes["X"].u)
    assert np.all(x.u_a < x.u)
    assert np.all(x.u_a[:, 0] > 0.5 * x.u[:, 0])


def test_datums_keep_the_frame():
    targets = TARGETS | {
        "D1": Target((500.0, -450.0, -100.0), "bed"),
        "D2": Target((-500.0, -450.0, 500.0), "bed"),
        "D3": Target((-500.0, 450.0, -100.0), "bed"),
    }
    bent = model(DMU50, locations({"C0X": 20.0, "C0Y": 20.0, "B0X": -30.0, "B0Z": -30.0}))
    straight = measured(DMU50, model(DMU50, []), FRONT, axes="XYZ", targets=targets)
    turned = measured(DMU50, bent, FRONT, axes="XYZ", targets=targets)
    first = identify(straight, LINEAR)
    np.testing.assert_allclose(first.datums["D1"], targets["D1"].position, atol=1e-6)
    # a frame of its own follows the axes, and in part the targets, which do not turn; the datums do neither
    assert parameters(identify(turned, LINEAR))["E_C0X"] < 10.0
    assert parameters(identify(turned, LINEAR, first.datums))["E_C0X"] == pytest.approx(20.0, abs=1e-2)


def test_names_of_iso_230():
    found = identify(measured(DMU50, model(DMU50, []), FRONT), CUBIC)
    assert [kind_of(found.axes["Y"], j) for j in range(6)] == ["straightness", "positioning", "straightness"] + [
        "angular"
    ] * 3
    assert [kind_of(found.axes["C"], j) for j in range(6)] == [
        "radial", "radial", "axial", "tilt", "tilt", "angular positioning",
    ]  # fmt: skip
    assert list(straightnesses(found.axes["Y"])) == ["E_XY", "E_ZY"]
    assert straightnesses(found.axes["C"]) == {}


# reference straight lines

READINGS = st.lists(st.floats(-50, 50, allow_subnormal=False).map(lambda v: round(v, 3)), min_size=3, max_size=15)


@given(READINGS, st.integers(0, 1000))
def test_minimum_zone_is_the_narrowest(readings, seed):
    y = np.array(readings)
    x = np.cumsum(np.random.default_rng(seed).uniform(5.0, 60.0, len(y))) - 200.0
    found = straightness("minimum-zone", x, y, np.eye(len(y)))
    ones = np.ones_like(x)
    rows = np.concatenate([np.stack([x, ones, -ones], axis=1), np.stack([-x, -ones, -ones], axis=1)])
    best = linprog([0, 0, 1], A_ub=rows, b_ub=np.concatenate([y, -y]), bounds=[(None, None)] * 3)
    assert found.value == pytest.approx(2.0 * best.x[2], abs=1e-6)
    assert found.deviations.max() == pytest.approx(-found.deviations.min(), abs=1e-9)


@given(READINGS)
def test_no_line_is_narrower_than_the_minimum_zone(readings):
    y = np.array(readings)
    x = np.arange(len(y)) * 50.0
    values = [straightness(kind, x, y, np.eye(len(y))).value for kind in ("minimum-zone", "least-squares", "end-point")]
    assert values[0] <= min(values[1:]) + 1e-9


def test_least_squares_and_end_point_lines():
    x, y = np.array([300.0, 200.0, 100.0, 0.0]), np.array([3.0, 5.0, 2.0, 0.0])
    slope, offset = np.polyfit(x, y, 1)
    line = reference_line("least-squares", x, y)
    assert line.slope_of @ y == pytest.approx(slope)
    assert line.offset_of @ y == pytest.approx(offset)
    found = straightness("end-point", x, y, np.diag([1.0, 4.0, 9.0, 16.0]))
    np.testing.assert_allclose(found.deviations, [0.0, 3.0, 1.0, 0.0], atol=1e-12)
    assert found.u_slope == pytest.approx(17.0**0.5 / 300.0)
    with pytest.raises(UserError, match="two positions"):
        reference_line("least-squares", x[:1], y[:1])


# refusals


def without(measurement: Measurement, drop: np.ndarray) -> Measurement:
    return measurement.rows(np.flatnonzero(~drop))


def test_refusals():
    good = measured(DMU50, model(DMU50, []), FRONT, axes="XY")
    q, names = good.state.positions, good.state.target
    x = DMU50.index("X")
    with pytest.raises(UserError, match="tracker on the bed"):
        identify(replace(good, stands_on="workpiece"))
    with pytest.raises(UserError, match="laser tracker"):
        identify(replace(good, instrument=Part(u_um=1.0)))
    with pytest.raises(UserError, match=r"X at 100\.0000 mm lacks target Q"):
        identify(without(good, (q[:, x] == 100.0) & (names == "Q")))
    with pytest.raises(UserError, match=r"2 target\(s\) \(K, P\)"):
        identify(without(good, names == "Q"))
    with pytest.raises(UserError, match="no axis moves alone"):
        identify(good.rows(np.flatnonzero(q[:, x] == 100.0)))
    with pytest.raises(UserError, match="no such error motion was measured"):
        identify(good, Choice(degrees={"XC": 3}))
    with pytest.raises(UserError, match="degree 0 of E_XY: 11 positions allow 1 to 10"):
        identify(good, Choice(degrees={"XY": 0}))
    with pytest.raises(UserError, match="no points determine the frame"):
        identify(good, datums={})
    two = np.concatenate([q, q + np.eye(5)[DMU50.index("Z")]])
    twice = good.rows(np.tile(np.arange(len(good)), 2))
    with pytest.raises(UserError, match="X moves along 2 lines"):
        identify(replace(twice, state=replace(twice.state, positions=two)))


def test_targets_in_one_line_are_refused():
    line = {"P": Target((0.0, 0.0, 0.0)), "Q": Target((50.0, 0.0, 0.0)), "K": Target((100.0, 0.0, 0.5))}
    with pytest.raises(UserError, match="lie in one line"):
        identify(measured(DMU50, model(DMU50, []), FRONT, axes="XY", targets=line))


def test_a_station_that_nothing_ties_to_the_others_is_refused():
    good = measured(DMU50, model(DMU50, []), AROUND)
    alone = (good.state.station == "3") & np.isin(good.state.target, ["P", "Q", "K"])
    with pytest.raises(UserError, match="station 3 observes fewer than three"):
        identify(without(good, alone))


# the command


def test_the_command(monkeypatch, tmp_path: Path):
    for axis in SERIES:
        monkeypatch.setitem(SERIES, axis, SERIES[axis][::2])
    truth = model(DMU50, random_effects(3, degree=2))
    data, cal, results, one_axis = (tmp_path / name for name in ("data.csv", "cal.json", "out.json", "x.csv"))
    for path, axes in ((data, "XYZBC"), (one_axis, "X")):
        with path.open("wb") as file:
            write_measurement(measured(DMU50, truth, AROUND, axes=axes, rng=np.random.default_rng(5)), file)
    call = ["three-points", str(data), "--machine", "dmu50", "--degree", "XX=2", "-o", str(cal), "--json", str(results)]
    shown = succeed(*call).shown
    content = json.loads(results.read_text())
    assert set(content["axes"]) == set("XYZBC")
    assert content["axes"]["X"]["positions"][0] == -250.0
    assert set(content["squareness"]) == {"E_C(0X)Y", "E_B(0X)Z", "E_A(0Y)Z"}
    assert np.abs(clamped(truth, read_model(cal, DMU50))).max() < 8.0
    assert "E_X0C" in shown
    assert content["axes"]["X"]["curves"]["E_XX"]["degree"] == 2
    assert len(shown.splitlines()) < 120
    assert "degree" in shown
    assert "Errors are in um and urad" not in shown
    call[1] = str(one_axis)
    page = tmp_path / "page.html"
    assert "Errors are in um and urad" in succeed(*call, "--tables", "--report", str(page)).shown
    assert "Error motions of X" in page.read_text()
    assert "--basis spline" in refusal(*call, "--basis", "spline")


def test_a_correction_within_its_uncertainty_is_not_written(command, tmp_path: Path):
    blunt = LaserTracker(u_range_um=50.0, u_range_um_per_m=1.0, u_angle_um=50.0, u_angle_um_per_m=10.0)
    truth = model(DMU50, random_effects(3, degree=2, size=2.0))
    with (tmp_path / "data.csv").open("wb") as file:
        write_measurement(
            measured(DMU50, truth, AROUND, axes="XYZ", instrument=blunt, rng=np.random.default_rng(5)), file
        )
    done = command("three-points", "data.csv", "-m", "dmu50", "-o", "cal.json")
    assert done.status == 2
    assert "um RMS, with a standard uncertainty of" in done.err
    assert not (tmp_path / "cal.json").exists()


@pytest.mark.parametrize("option", ["-o", "--json"])
def test_an_output_does_not_replace_an_input(command, tmp_path: Path, option: str):
    for name in ("data.csv", "plan.csv"):
        (tmp_path / name).write_text("nothing that could be read")
        outputs = {"-o": "cal.json"} | {option: f"./{name}"}
        given = [part for pair in outputs.items() for part in pair]
        done = command("three-points", "data.csv", "-m", "dmu50", "--plan", "plan.csv", *given)
        assert done.status == 2
        assert f"{name} is an input and would be overwritten" in done.err
        assert (tmp_path / name).read_text() == "nothing that could be read"


@pytest.mark.parametrize("place", ["-", "same.json"])
def test_results_do_not_go_where_the_calibration_goes(command, tmp_path: Path, place: str):
    (tmp_path / "data.csv").write_text("nothing that could be read")
    done = command("three-points", "data.csv", "-m", "dmu50", "-o", place, "--json", place)
    assert done.status == 2
    assert "--json" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]


@pytest.mark.parametrize(
    ("step", "last"),
    [(20.0, 340.0), (20.0, 300.0), pytest.param(10.0, 340.0, marks=pytest.mark.statistical)],
    ids=["all round", "an arc", "a long arc"],
)
def test_a_turn_is_the_same_in_every_turn_and_does_not_grow_in_a_gap(monkeypatch, step, last):
    monkeypatch.setitem(SERIES, "C", np.arange(0.0, last + 1.0, step))
    truth = model(DMU50, random_effects(11, degree=2, axes="C", size=6.0))
    found = identify(measured(DMU50, truth, AROUND, axes="XC", rng=np.random.default_rng(4))).model
    q = np.zeros((721, len(DMU50.axes)))
    q[:, DMU50.index("C")] = np.deg2rad(np.linspace(0.0, 360.0, 721))
    here, there = (found.errors(DMU50, State(each))[:, DMU50.index("C")] for each in (q, q - 4.0 * np.pi))
    np.testing.assert_allclose(there, here, atol=1e-11)
    inside = np.rad2deg(q[:, DMU50.index("C")]) <= last
    assert (np.ptp(here, axis=0) <= 1.1 * np.ptp(here[inside], axis=0)).all()


def test_the_worked_figure_of_the_page():
    page = " ".join((Path(__file__).parents[1] / "docs" / "three_points.md").read_text().split())
    points = np.array([[95.0, 20.0, -80.0], [-65.0, 75.0, 0.0], [-40.0, -85.0, 80.0]])
    design = np.concatenate([np.hstack([np.eye(3), 1e-3 * np.cross(np.eye(3), point).T]) for point in points])
    moved = design @ [5.0, 0.0, 0.0, 0.0, 10.0, 0.0]
    for point in moved.reshape(3, 3) + 0.0:
        assert "({:.2f}, {:.0f}, {:.2f})".format(*point) in page
    wrong = moved + 10.0 * (np.arange(9) == 3)
    six = [0, 1, 3, 5, 7, 8]  # Px Py Qx Qz Ky Kz
    (of_six, of_nine), (u_six, u_nine) = (
        [np.linalg.lstsq(design[rows], wrong[rows], rcond=None)[0] for rows in (six, range(9))],
        [10.0 * np.diag(np.linalg.inv(design[rows].T @ design[rows])) ** 0.5 for rows in (six, range(9))],
    )
    assert f"make E_XX = {of_six[0]:.1f} um and E_BX = {of_six[4]:.0f} urad" in page
    assert f"all nine make {of_nine[0]:.1f} um and {of_nine[4]:.0f} urad" in page
    assert f"u of E_XX is {u_six[0]:.1f} um from six and {u_nine[0]:.1f} um from nine" in page
    assert f"of E_BX {u_six[4]:.0f} and {u_nine[4]:.0f} urad" in page
