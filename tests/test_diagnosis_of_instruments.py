"""The search among structures in the data of all instruments: what is hidden is found, nothing else is."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from support import robot
from support.ballbar_cases import circles_of
from support.interferometer_runs import runs
from support.probe_cases import probed, spheres_of
from support.virtual_measurements import ONE, THREE, TRACKER, measured, positions, truth

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.search import search
from calibration.gaussian_terms.linearised import linearised, mean_errors
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.instruments import Interferometer, Level, Part
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.measurement.plan import Choices
from calibration.planning.strategies import plan
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.simulate import observe
from calibration.simulation.true_model import model_of
from kinematics.effects import Backlash, Effect, LocationError, Scale, ThermalDrift
from kinematics.error_model.priors import KINDS
from kinematics.forward import tool_point
from kinematics.state import State

CFRAME, DMU50 = machines.load("cframe"), machines.load("dmu50")
FREE = {
    "known": Target((0.0, 0.0, -120.0)),
    "free": Target((90.0, 40.0, -180.0), free=True),
    "table": Target((200.0, 100.0, 50.0), carrier="table"),
}
LASER = Interferometer(u_um=0.3, u_um_per_m=0.5, u_straightness_um=0.5, u_angle_urad=1.0)


def errors_of(machine, *causes: Effect):
    """Smooth error motions of all axes, and causes."""
    return model_of(machine, (*truth(machine, np.random.default_rng(5), 8.0).effects, *causes))


def tracked(machine, targets, rows, *causes: Effect, **how) -> Measurement:
    rng = np.random.default_rng(2)
    return measured(machine, positions(machine, rows, rng), targets, errors_of(machine, *causes), rng, **how)


def along_axes(instrument, *causes: Effect) -> Measurement:
    laid = plan(CFRAME, "axes", spacing_mm=40.0, choices=Choices(runs=3))
    return measure_plan(laid, errors_of(CFRAME, *causes), VirtualInstrument(instrument), streams(0, 4)[1:]).measurement


def cut(*causes: Effect) -> Measurement:
    rng = np.random.default_rng(1)
    state = State(positions(CFRAME, 150, rng))
    return observe(CFRAME, errors_of(CFRAME, *causes), state, Part(u_um=2.0), rng)


def of_arm(count: int, mm: float, mrad: float) -> Measurement:
    """A robot whose links differ from the nominal ones."""
    joints = robot.random_joints(count)
    state = with_moves(State(np.radians(joints), target=np.full(count, "t"), station=np.full(count, "s1")))
    points = robot.measured(joints, robot.real_arm(1, mm, mrad))
    tracker = TRACKER.__class__(u_range_um=10.0, u_angle_um=10.0)
    return Measurement(robot.machine(), tracker, state, points, {"t": Target(tuple(robot.target()))}, source="arm")


def drifting(distances=None) -> Measurement:
    own = LocationError("X", "C", 40.0), LocationError("A", "C", 60.0), Scale("X", 60.0)
    drift = ThermalDrift(component="Z", amplitudes=(30.0,), time_constants_s=(900.0,))
    return probed("dmu50", 60, spheres=spheres_of("dmu50", 3, distances), effects=(*own, drift))[0]


CASES = {
    "touch probe": (drifting, {"thermal-drift Z": 30.0}),
    "distances": (partial(drifting, {("s1", "s2"): 0.0005}), {"thermal-drift Z": 30.0}),
    "probe, rotary": (lambda: probed("trunnion_ac", 50, effects=(Backlash("A", 40.0),))[0], {"backlash A": 40.0}),
    "ballbar": (lambda: circles_of(Backlash("X", 8.0), step=2.0)[0], {"backlash X": 8.0}),
    "interferometer": (
        lambda: along_axes(LASER, Backlash("X", 6.0), Backlash("Z", 9.0)),
        {"backlash X": 6.0, "backlash Z": 9.0},
    ),
    "level": (lambda: along_axes(Level(u_angle_urad=2.0)), {}),
    "part": (lambda: cut(Backlash("X", 12.0)), {"backlash X": 12.0}),
    "two stations": (lambda: tracked(CFRAME, THREE, 200, Backlash("Y", 15.0), stations=2), {"backlash Y": 15.0}),
    "free targets": (
        lambda: tracked(DMU50, FREE, 160, Backlash("Y", 20.0), stands_on="bed"),
        {"backlash Y": 20.0},
    ),
    "five axes": (lambda: tracked(DMU50, ONE, 160, Backlash("Y", 20.0)), {"backlash Y": 20.0}),
    "arm": (lambda: of_arm(150, 0.3, 0.5), {}),
}
QUICK = ("ballbar", "interferometer", "level", "part")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.statistical) for name in CASES]
)
def test_what_is_hidden_is_named_with_its_size(name):
    make, hidden = CASES[name]
    found = search(Observations.of(make())).structure
    sizes, bands = {}, len(found.band_sizes)
    for number, term in enumerate(found.terms):
        sizes[term.name] = (term.parameters @ found.posterior.mean[found.groups == bands + number])[0]
    assert sizes == {name: pytest.approx(size, rel=0.25) for name, size in hidden.items()}
    assert found.noise.factor**0.5 == pytest.approx(1.0, abs=0.3)
    assert max(found.noise.repeats.values(), default=0.0) < 2.0
    assert np.count_nonzero(found.noise.left_out) <= 1


def first(measurement: Measurement) -> Structure:
    return Structure.first(Data.of(Observations.of(measurement))).fitted()


def test_an_arm_whose_links_are_millimetres_off_is_linearised_about_its_errors():
    """8 mrad and 5 mm are no linear problem: tens of um of the second order remain of it."""
    start = first(of_arm(120, 5.0, 8.0))
    found = linearised(start)
    assert start.noise.factor**0.5 > 1.2
    assert found.noise.factor**0.5 == pytest.approx(1.0, abs=0.15)
    unseen = robot.random_joints(60, seed=9)
    real = robot.real_arm(1, 5.0, 8.0).reflector(unseen)
    left = []
    for structure in (start, found):
        errors = mean_errors(structure).errors(robot.machine(), State(np.radians(unseen)))
        left.append(_apart(tool_point(robot.machine(), np.radians(unseen), robot.target(), errors), real))
    assert left[1] < 0.05
    assert left[1] < 0.7 * left[0]


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["machining-centre", "arm"])
def test_joints_that_yield_to_gravity_do_not_pass_for_joints_that_do_not_repeat(kind):
    """400 poses that never repeat; without the causes hundreds of um are left."""
    compliance = {1: 1240.0, 2: 950.0, 4: 1340.0}
    arm, joints = robot.real_arm(1, 0.3, 0.5), robot.random_joints(400, seed=3)
    state = with_moves(State(np.radians(joints), target=np.full(400, "t"), station=np.full(400, "s1")))
    points = robot.measured(arm.yielding(joints, compliance), arm)
    tracker = TRACKER.__class__(u_range_um=10.0, u_angle_um=10.0)
    machine = replace(robot.machine(), priors=KINDS[kind].priors)
    found = diagnose(Measurement(machine, tracker, state, points, {"t": Target(tuple(robot.target()))}, source="arm"))
    sizes = {cause.effect.name: cause.effect.parameters[0] for cause in found.causes}
    assert sizes == {f"joint-compliance A{i + 1}": pytest.approx(size, rel=0.15) for i, size in compliance.items()}
    assert found.structure.noise.factor**0.5 == pytest.approx(1.0, abs=0.15)
    assert max(found.structure.noise.repeats.values(), default=0.0) < 5.0
    unseen = robot.random_joints(200, seed=9)
    errors = found.calibration.errors(machine, with_moves(State(np.radians(unseen))))
    predicted = tool_point(machine, np.radians(unseen), robot.target(), errors)
    assert _apart(predicted, arm.reflector(arm.yielding(unseen, compliance))) < 0.012


def _apart(points, others) -> float:
    """RMS distance of points `(n, 3)` after the best rigid motion."""
    points, others = points - points.mean(axis=0), others - others.mean(axis=0)
    turned, _, right = np.linalg.svd(points.T @ others)
    return float(np.sqrt(np.mean(np.sum((points @ (turned @ right) - others) ** 2, axis=1))))


def test_a_table_four_thousandths_too_long_on_a_ballbar():
    data = circles_of(Scale("Y", 4000.0), LocationError("C", "Y", 3000.0), planes=("XY", "YZ"), step=5.0)[0]
    found = linearised(first(data))
    assert found.noise.factor**0.5 == pytest.approx(1.0, abs=0.15)
    again = Observations.of(data, mean_errors(found))
    assert np.abs(beside_registration(again, found.data.observations)).max() < 3e-5


def test_observations_about_any_model_are_the_same_where_they_are_linear():
    data = tracked(CFRAME, THREE, 40)
    plain, about = Observations.of(data), Observations.of(data, errors_of(CFRAME))
    assert np.abs(beside_registration(about, plain)).max() < 2e-5


def beside_registration(one: Observations, other: Observations) -> np.ndarray:
    """Difference of the residuals `(n d,)`, mm, that no registration explains."""
    columns, change = one.registration.reshape(one.residual.size, -1), (one.residual - other.residual).ravel()
    return change - columns @ np.linalg.lstsq(columns, change)[0]


def test_a_wave_of_a_short_axis():
    """An axis whose travel has no room for three of the shortest periods has no waves."""
    short = runs(lambda x: 0.01 * x, np.linspace(0.0, 10.0, 9), np.random.default_rng(1))
    assert not search(Observations.of(short)).structure.terms


def logged(error, count: int = 900) -> Measurement:
    """A log along X of the gantry, one way, 11 mm long."""
    return runs(error, np.linspace(100.0, 111.0, count), np.random.default_rng(1), 0.3)


def test_a_gear_in_a_log_is_one_wave_with_its_harmonics():
    """Waves of a log are as short as its positions show, and its period is found to a hundredth of the noise."""

    def gear(x):
        turn = 2.0 * np.pi * x / 0.25
        return 14.0 * np.sin(turn) + 4.0 * np.cos(2.0 * turn) + 2.0 * np.sin(3.0 * turn) + 0.2 * (x - 105.0) ** 2

    found = search(Observations.of(logged(gear, 450))).structure
    (term,) = found.terms
    assert term.kind == "cyclic"
    assert term.effects[0].period == pytest.approx(0.25, abs=1e-5)
    assert len(term.effects[0].sine) >= 3
    assert found.noise.factor**0.5 < 1.1


def test_a_log_has_a_curve_finer_than_error_motions():
    """Without a name, and no period: the error of a rack that was ground in short pieces."""
    pieces = np.random.default_rng(3).normal(0.0, 1.0, 45)

    def rack(x):
        return 4.0 * CubicSpline(np.linspace(100.0, 111.0, 45), pieces)(x)

    found = search(Observations.of(logged(rack))).structure
    assert [term.name for term in found.terms] == ["fine errors of X"]
    assert found.noise.factor**0.5 < 1.1


TURNTABLE = machines.parse(
    'name = "turntable"\nchain = "w C b t"\n[axes.C]\ntravel = [-1, 361]\npoint = [0, 0, 0]\nhome = 0\n', "turntable"
)


def turned(standing: int) -> Measurement:
    """A turn of a table, logged with a wave of 200 urad four times a turn, and so many readings where it ends."""
    degrees = np.append(np.linspace(0.0, 360.0, 721), np.full(standing, 360.0))
    n, rng = len(degrees), np.random.default_rng(2)
    urad = 200.0 * np.sin(np.radians(4.0 * degrees) + 0.4) + 20.0 * rng.normal(size=n)
    state = with_moves(State(np.radians(degrees)[:, None], target=np.full(n, "1"), time=0.1 * np.arange(n)))
    target = {"1": Target((0.0, 0.0, 0.0))}
    return Measurement(
        TURNTABLE, Interferometer(u_um=20.0), state, urad[:, None] * 1e-6, target, axis=np.full(n, "C"),
        run=np.full(n, "1"), source="turn",
    )  # fmt: skip


@pytest.mark.parametrize("standing", [1, 3000])
def test_a_wave_that_error_motions_hide_is_named(standing):
    """Order 4 is one of their harmonics. A long standstill counts as one position, and takes no time."""
    found = search(Observations.of(turned(standing))).structure
    (term,) = found.terms
    assert (term.kind, term.effects[0].period) == ("cyclic", pytest.approx(90.0, rel=0.01))
    sizes = term.parameters @ found.posterior.mean[-term.width :]
    assert np.hypot(*sizes[[0, len(sizes) // 2]]) == pytest.approx(200.0, rel=0.05)
    assert len(found.data.observations) < 760
    expected = 20.0 * found.noise.factor**0.5
    assert np.hypot(expected, found.noise.repeats.get("C", 0.0)) == pytest.approx(20.0, rel=0.1)


def test_a_backlash_that_differs_from_target_to_target():
    """Runs as of ISO 230-2: each target has a difference of its own between forward and backward."""
    targets = np.linspace(0.0, 4000.0, 9)
    each = 20.0 + np.random.default_rng(4).normal(0.0, 4.0, 9)
    data = runs(lambda x: 0.01 * x, targets, np.random.default_rng(1))
    side = np.sign(data.state.approach[:, 0]) * np.interp(data.state.positions[:, 0], targets, each)
    found = search(Observations.of(replace(data, observed=data.observed + 0.5e-3 * side[:, None]))).structure
    (term,) = found.terms
    differences = term.parameters @ found.posterior.mean[-term.width :]
    assert (term.kind, term.effects[0].name) == ("reversal", "reversal E_XX")
    assert differences == pytest.approx(each, abs=1.5)


def test_a_backlash_that_is_the_same_at_all_targets_is_one_number():
    data = runs(lambda x: 0.01 * x, np.linspace(0.0, 4000.0, 9), np.random.default_rng(1))
    side = 6e-3 * np.sign(data.state.approach[:, :1])
    (term,) = search(Observations.of(replace(data, observed=data.observed + side))).structure.terms
    assert term.name == "backlash X"
