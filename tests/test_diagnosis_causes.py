"""The causes of the library: each explains clean data with it, and siblings show in the cosine of their signals."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate, at_zero, changes, library
from calibration.diagnosis.not_visible import below_spacing
from calibration.diagnosis.search.evaluation import evaluate, siblings
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes import proposed_shapes
from calibration.diagnosis.search.stage import Accepted
from calibration.diagnosis.search.start_model import Base
from calibration.diagnosis.updated_model import new_calibration
from calibration.diagnosis.verdict import Named
from support.diagnosis_cases import CFRAME, data_with, fitted
from support.effect_examples import HEAD_HEAD
from support.virtual_measurements import ONE, THREE, TRACKER, measured, positions

import machines
from calibration.diagnosis.library.causes import causes, jumps
from calibration.fit.fit import fit
from calibration.instruments import Part
from calibration.observation.full_model import BasisChoice, rigid_model
from calibration.reports.causes.text import title
from calibration.simulation.simulate import observe, tracker_pose
from kinematics.basis import Legendre
from kinematics.effects import (
    AirDrift,
    AngleStep,
    Backlash,
    DistortionWithSensor,
    DistortionWithTime,
    DriftWithDuty,
    DriftWithSensor,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    Hysteresis,
    JointCompliance,
    LateralPlay,
    LocationJump,
    MeasuringMachineSquareness,
    QuadraticGrowth,
    Racking,
    RangeDrift,
    Reversal,
    ReversalSpike,
    ServoMismatch,
    StationShift,
    TargetOffset,
    ThermalDrift,
    TrackerDrift,
    Wobble,
    WorkpieceDrift,
)
from kinematics.effects.combined.where import beam
from kinematics.error_model.model import no_errors
from kinematics.state import State
from kinematics.transforms import Pose, rotation_vector_matrix

N = 100
X, Y, Z = (CFRAME.axes[CFRAME.index(name)].travel for name in "XYZ")
WARM = {"temperatures": {"column": 6.0 * np.sin(np.arange(N) / 12.0) ** 2}}
MOVING = {"velocity": np.random.default_rng(5).normal(0.0, 40.0, (N, 3))}
TURNING = {"spindle_speed": np.repeat([0.0, 9000.0, 3000.0, 0.0, 12000.0], N // 5)}
MIDDLE = 15.0 * N / 2
ANGLES = np.degrees(np.median(beam(data_with(n=N).observed).angles, axis=0)).tolist()

EXPLAINED = {
    "wind-up": (Backlash("X", 10.0, 60.0), {}),
    "reversal along": (Reversal("X", "X", Legendre(X, 2), (30.0, -90.0, 120.0)), {}),
    "lateral play": (LateralPlay("Y", "X", 12.0), {}),
    "roll at reversal": (LateralPlay("A", "Z", 60.0), {}),
    "hysteresis": (Hysteresis("X", 200.0, 250.0), {}),
    "spike": (ReversalSpike("X", 40.0, 150.0), {}),
    "servo mismatch": (ServoMismatch("X", "Y", 1.5), MOVING),
    "squareness with time": (DistortionWithTime(component="Y", axis="X", interval=X, degree=1, rate=60.0), {}),
    "bow with time": (DistortionWithTime(component="Z", axis="X", interval=X, degree=2, rate=250.0), {}),
    "roll with time": (DistortionWithTime(component="A", axis="X", interval=X, degree=1, rate=400.0), {}),
    "squareness with temperature": (
        DistortionWithSensor(component="X", axis="Z", interval=Z, degree=1, sensor="column", coefficient=12.0), WARM,
    ),
    "late sensor, drift": (DriftWithSensor(component="Z", sensor="column", coefficient=30.0, lag_s=400.0), WARM),
    "late sensor, growth": (GrowthWithSensor(axis="X", sensor="column", coefficient=80.0, lag_s=400.0), WARM),
    "quadratic growth": (QuadraticGrowth("X", "column", 2.0, 8.0), WARM),
    "duty": (GrowthWithDuty("X", 40.0, 300.0), {}),
    "spindle": (DriftWithDuty("Z", -4.0, 300.0), TURNING),
    "range drift": (RangeDrift(400.0), {}),
    "air drift": (AirDrift(40.0), {}),
    "counts lost": (AngleStep("azimuth", "azimuth", ANGLES[0], 40.0), {}),
    "counts lost by the other circle": (AngleStep("elevation", "azimuth", ANGLES[0], -40.0), {}),
    "counts lost over the elevation": (AngleStep("azimuth", "elevation", ANGLES[1], 40.0), {}),
    "zero of an axis": (LocationJump("X", "X", 25.0, MIDDLE), {}),
    "squareness after a collision": (LocationJump("C", "Y", 90.0, MIDDLE), {}),
    "squareness about the middle": (LocationJump("C", "Y", 250.0, MIDDLE, 225.0), {}),
    "target seated again": (TargetOffset("2", (15.0, -10.0, 12.0), MIDDLE), {}),
    "knock": (StationShift("s1", (15.0, -10.0, 12.0), since_s=MIDDLE), {}),
}  # fmt: skip


def tried(data):
    """The linearised fit of cubic error motions, and all candidates of the library on it."""
    linearised = LinearisedFit.of(fitted(data))
    known, _ = library(data, linearised.fit.model)
    events = proposed_shapes.events(linearised, known)
    return linearised, evaluate(linearised, [*known, *events])


@pytest.mark.parametrize(("effect", "columns"), EXPLAINED.values(), ids=EXPLAINED)
def test_a_cause_is_explained_by_its_candidate(effect, columns):
    _, evaluated = tried(data_with(effect, n=N, **columns))
    best = evaluated[0]
    assert type(best.candidate.effect) is type(effect)
    assert best.candidate.cause == Candidate(effect).cause
    assert best.score.delta_bic < -30.0
    if getattr(effect, "since_s", None) is not None:
        assert best.candidate.effect.since_s == pytest.approx(MIDDLE, abs=45.0)
    if isinstance(effect, LocationJump):
        assert best.candidate.effect.fixed_point == pytest.approx(effect.fixed_point, abs=20.0)
    if isinstance(effect, AngleStep):
        assert best.candidate.effect.above_deg == pytest.approx(effect.above_deg, abs=3.0)
        assert best.candidate.effect.circle == effect.circle


def test_a_reversal_along_its_axis_is_a_backlash_and_no_rival_of_one():
    one, other = Candidate(Backlash("X", 1.0, 2.0)), Candidate(EXPLAINED["reversal along"][0])
    assert one.cause == other.cause
    assert Candidate(Reversal("Y", "X", Legendre(X, 0), (1.0,))).cause != one.cause


def test_noise_alone_has_no_cause():
    _, evaluated = tried(data_with(n=N, **WARM))
    assert evaluated[0].score.delta_bic > -10.0


TRACKER_X = -2500.0
"""mm: the tracker stands in front of the gantry, in line with X."""


def seen_from_the_end(effect):
    """A long, slim part of the gantry's volume, seen by a tracker in line with X, without noise."""
    gantry, rng = machines.load("gantry"), np.random.default_rng(2)
    q = rng.uniform([0.0, 1000.0, 500.0], [5000.0, 1800.0, 1000.0], (150, 3))
    state = State(q, time=60.0 * np.arange(150), target=rng.choice(list(THREE), 150))
    poses = {"1": tracker_pose((TRACKER_X, 1400.0, 750.0), rng)}
    model = msgspec.structs.replace(no_errors(gantry), effects=(effect,))
    return tried(observe(gantry, model, state, TRACKER, rng, poses, THREE))


SIBLINGS = {
    "air drift as growth of X from the tracker's side": (AirDrift(20.0), GrowthWithTime),
    "growth of X from the tracker's side as air drift": (
        GrowthWithTime(axis="X", rate=20.0, fixed_point=TRACKER_X), AirDrift,
    ),
    "range drift as drift of the tool": (RangeDrift(20.0), ThermalDrift),
    "drift of the tool as range drift": (ThermalDrift(component="X", rate=20.0), RangeDrift),
}  # fmt: skip


@pytest.mark.parametrize(("truth", "other"), SIBLINGS.values(), ids=SIBLINGS)
def test_drifts_of_the_tracker_and_growth_from_its_side_are_alternatives(truth, other):
    linearised, evaluated = seen_from_the_end(truth)
    own = next(each for each in evaluated if isinstance(each.candidate.effect, type(truth)))
    accepted = Accepted(own.candidate, own.score.size, own.score, own.projected.visible, lambda: np.zeros(1))
    alike = {
        (type(each.evaluated.candidate.effect), each.evaluated.candidate.axis): each.cosine
        for each in siblings(linearised, accepted.candidate, evaluated)
    }
    found = max(cosine for (kind, axis), cosine in alike.items() if kind is other and axis in ("X", None))
    assert found > 0.9


def test_a_joint_yields_under_the_tool():
    effect, rng = JointCompliance("B", 400.0), np.random.default_rng(3)
    model = msgspec.structs.replace(no_errors(HEAD_HEAD), effects=(effect,))
    q = positions(HEAD_HEAD, 150, rng)
    assert Candidate(effect).cause not in {Candidate(*c).cause for c in causes(measured(HEAD_HEAD, q, ONE, model, rng))}


def on_the_table(*effects, standing=(), stands_on="workpiece", n=120):
    """Random positions of the DMU 50; rotary axes may stand still at 0."""
    machine, rng = machines.load("dmu50"), np.random.default_rng(3)
    q = positions(machine, n, rng)
    q[:, [machine.index(axis) for axis in standing]] = 0.0
    model = msgspec.structs.replace(no_errors(machine), effects=effects)
    return measured(machine, q, THREE, model, rng, stands_on=stands_on)


def of_workpiece(data):
    """Directions in which a drift of the workpiece is tried."""
    return {cause.effect.component for cause in causes(data) if isinstance(cause.effect, WorkpieceDrift)}


def test_a_drift_of_the_workpiece_is_tried_where_rotary_axes_turn_it():
    assert of_workpiece(on_the_table()) == set("XYZ")
    assert of_workpiece(on_the_table(standing="B")) == set("XY")
    assert of_workpiece(on_the_table(standing="BC")) == of_workpiece(data_with(n=40)) == set()
    assert of_workpiece(on_the_table(stands_on="bed")) == set()


RISE = {"amplitudes": (40.0,), "time_constants_s": (500.0,)}


@pytest.mark.parametrize("effect", [WorkpieceDrift(component="Z", **RISE), ThermalDrift(component="Z", **RISE)])
def test_the_side_of_a_drift_is_found_where_rotary_axes_move(effect):
    data = on_the_table(effect)
    linearised = LinearisedFit.of(fit(data, rigid_model(data, dict.fromkeys("XYZBC", BasisChoice("legendre", 1)))))
    evaluated = evaluate(linearised, library(data, linearised.fit.model)[0])
    best = evaluated[0]
    assert best.candidate.cause == Candidate(effect).cause
    side = type(effect)
    drifts = [e for e in evaluated if e.candidate.kind == "thermal-drift" and not isinstance(e.candidate.effect, side)]
    assert best.score.gain > 1.2 * max(each.score.gain for each in drifts)


def test_a_drift_of_the_workpiece_at_a_constant_rate_may_be_one_of_the_tracker():
    """The tracker stands on the workpiece: its own drift is the opposite."""
    effect = WorkpieceDrift(component="Z", rate=80.0)
    data = on_the_table(effect)
    linearised = LinearisedFit.of(fit(data, rigid_model(data, dict.fromkeys("XYZBC", BasisChoice("legendre", 1)))))
    evaluated = evaluate(linearised, library(data, linearised.fit.model)[0])
    own = next(each for each in evaluated if each.candidate.effect.name == effect.name)
    accepted = Accepted(own.candidate, own.score.size, own.score, own.projected.visible, lambda: np.zeros(1))
    (drift,) = (
        each for each in siblings(linearised, accepted.candidate, evaluated)
        if isinstance(each.evaluated.candidate.effect, TrackerDrift)
    )  # fmt: skip
    assert drift.cosine == pytest.approx(1.0, abs=1e-3)


def test_wobble_and_racking_are_changes_of_a_calibrated_machine():
    def kinds(machine):
        q = positions(machine, 20, np.random.default_rng(1))
        data = measured(machine, q, ONE, no_errors(machine), np.random.default_rng(1))
        bases = dict.fromkeys(machine.names, BasisChoice("legendre", 2))
        model = rigid_model(data, bases)
        assert not any(isinstance(cause.effect, (Wobble, Racking)) for cause in causes(data))
        return {(candidate.kind, candidate.axis) for candidate in changes(model)}

    assert ("racking", "X") in kinds(machines.load("gantry"))
    assert not {kind for kind, _ in kinds(CFRAME)} & {"racking", "wobble"}
    assert {axis for kind, axis in kinds(machines.load("dmu50")) if kind == "wobble"} == {"B", "C"}


def test_an_error_between_the_signals_of_an_encoder_is_listed_as_not_visible():
    coarse = list(below_spacing(data_with(n=40)))
    assert [entry.name for entry in coarse] == [f"sub-divisional error of the encoder of {axis}" for axis in "XYZ"]
    assert all("show no period below 1 mm" in entry.remedy for entry in coarse)
    assert coarse[0].remedy.endswith("looks like noise in X")
    x = np.column_stack([np.arange(300) * 0.002, np.zeros(300), np.zeros(300)])
    fine = measured(CFRAME, x, ONE, no_errors(CFRAME), np.random.default_rng(1))
    assert not list(below_spacing(fine))


def test_heat_of_a_spindle_needs_its_speeds():
    def tried_on(**columns):
        return any(isinstance(cause.effect, DriftWithDuty) for cause in causes(data_with(n=N, **columns)))

    assert tried_on(**TURNING)
    assert not tried_on()
    assert not tried_on(spindle_speed=np.full(N, 9000.0))  # a drift with time


def test_a_jump_needs_the_stations_of_a_tracker():
    data = data_with(n=40)
    assert next(effect.name for effect in jumps(data)) == "station-shift s1"
    assert not list(jumps(replace(data, state=replace(data.state, station=None))))
    assert not list(jumps(replace(data, state=replace(data.state, time=None))))


def test_errors_of_a_measuring_machine_are_tried_on_a_part_in_two_positions():
    rng = np.random.default_rng(1)
    q = np.repeat(positions(CFRAME, 30, rng), 2, axis=0)
    state = State(q, target=np.full(60, "1"), station=np.tile(["0", "90"], 30))
    turned = {
        name: Pose(rotation_vector_matrix([[0.0, 0.0, angle]]), np.zeros((1, 3)))
        for name, angle in (("0", 0.0), ("90", np.pi / 2))
    }
    part, effect = Part(1.0), MeasuringMachineSquareness("xy", 60.0)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(effect,))
    data = observe(CFRAME, model, state, part, rng, turned, ONE)
    data = replace(data, state=replace(data.state, observed=data.observed))
    _, evaluated = tried(data)
    assert evaluated[0].candidate.cause == Candidate(effect).cause
    alone = data.rows(np.arange(0, 60, 2))
    assert not any(cause.effect.kind.startswith("cmm") for cause in causes(alone))


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (LocationJump("X", "X", 1.0, 9.0), "location-jump E_X0X (zero of X)"),
        (LocationJump("C", "Y", 1.0, 9.0), "location-jump E_C0Y (squareness of Y)"),
        (LocationJump("C", "C", 1.0, 9.0), "location-jump E_C0C (zero of C)"),
        (LocationJump("X", "C", 1.0, 9.0), "location-jump E_X0C (line of C)"),
        (EXPLAINED["squareness with time"][0], "thermal-distortion E_YX 1 (squareness of X)"),
        (EXPLAINED["bow with time"][0], "thermal-distortion E_ZX 2 (straightness of X)"),
        (EXPLAINED["roll with time"][0], "thermal-distortion E_AX 1 (roll, pitch or yaw of X)"),
        (RangeDrift(1.0), "tracker-range-drift (instrument)"),
        (
            WorkpieceDrift(component="Z", rate=1.0),
            "thermal-drift-workpiece Z (of the table, the fixture or the part, in the workpiece's directions)",
        ),
    ],
)
def test_titles_say_what_a_symbol_means(effect, expected):
    cause = Named(effect.kind, effect, -50.0, 1.0, 0.5, "strong", 0.9)
    assert title(cause) == expected


def test_a_jump_is_permanent_in_the_new_calibration():
    """The clock of later data begins at zero again."""
    jump = LocationJump("X", "X", 40.0, MIDDLE)
    found = fitted(data_with(jump, n=N), at_zero(jump))
    model = new_calibration(Base(found.model, found.prior, "refitted"), found, [], None)
    (written,) = (effect for effect in model.effects if isinstance(effect, LocationJump))
    assert written.since_s is None
    assert written.value == pytest.approx(40.0, abs=4 * written.u[0])
    assert not written.needs
