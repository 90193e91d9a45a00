"""The causes of the library: each is named in data with it, or tied with what looks like it there."""

from collections.abc import Iterator
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with
from support.effect_examples import HEAD_HEAD
from support.tiers import STATISTICAL, quick
from support.virtual_measurements import ONE, THREE, TRACKER, measured, positions

import machines
from calibration.diagnosis.conclusion.cause import Cause
from calibration.diagnosis.contract import contract_kind, family_of, where
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.library.causes import causes, jumps
from calibration.diagnosis.library.changes import changes
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


OFTEN = ["wind-up", "late sensor, growth", "counts lost", "squareness about the middle"]


def named(cause: Cause) -> Iterator[tuple[str, str | None]]:
    """Kind and place of a cause, and of those that the data do not tell from it."""
    yield cause.kind, cause.axis
    yield from ((other.kind, other.axis) for other in cause.alternatives)


NOT_YET = {
    "duty": "what the model cannot do: sizes that were found beside a growth with time speak against the growth with "
    "the duty, which is likelier by 5 in the log posterior where they are found again",
}


def tried_as(name: str) -> list[pytest.MarkDecorator]:
    return [pytest.mark.xfail(strict=True, reason=NOT_YET[name])] if name in NOT_YET else []


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[*([] if n in OFTEN else [STATISTICAL]), *tried_as(n)]) for n in EXPLAINED],
)
def test_a_cause_is_named_in_data_with_it(name):
    effect, columns = EXPLAINED[name]
    (cause,) = diagnose(data_with(effect, n=N, **columns)).causes
    assert (contract_kind(effect), where(effect)) in set(named(cause))
    assert cause.log_odds > np.log(1000.0)
    found = cause.effect
    if type(found) is not type(effect):
        return
    if getattr(effect, "since_s", None) is not None:
        assert found.since_s == pytest.approx(MIDDLE, abs=45.0)
    if isinstance(effect, AngleStep):
        assert found.above_deg == pytest.approx(effect.above_deg, abs=3.0)


def test_a_reversal_along_its_axis_is_a_backlash_and_no_rival_of_one():
    assert family_of(Backlash("X", 1.0, 2.0)) == family_of(EXPLAINED["reversal along"][0])
    assert family_of(Reversal("Y", "X", Legendre(X, 0), (1.0,))) != family_of(Backlash("X", 1.0, 2.0))


TRACKER_X = -2500.0
"""mm: the tracker stands in front of the gantry, in line with X."""


def seen_from_the_end(effect):
    """A long, slim part of the gantry's volume, seen by a tracker in line with X, without noise."""
    gantry, rng = machines.load("gantry"), np.random.default_rng(2)
    q = rng.uniform([0.0, 1000.0, 500.0], [5000.0, 1800.0, 1000.0], (150, 3))
    state = State(q, time=60.0 * np.arange(150), target=rng.choice(list(THREE), 150))
    poses = {"1": tracker_pose((TRACKER_X, 1400.0, 750.0), rng)}
    model = msgspec.structs.replace(no_errors(gantry), effects=(effect,))
    return observe(gantry, model, state, TRACKER, rng, poses, THREE)


SIBLINGS = {
    "range drift as drift of the tool": (RangeDrift(20.0), "thermal-drift"),
    "drift of the tool as range drift": (ThermalDrift(component="X", rate=20.0), "tracker-range-drift"),
}


@pytest.mark.parametrize("name", quick(SIBLINGS, list(SIBLINGS)[:1]))
def test_drifts_of_the_range_and_of_the_tool_along_the_beam_are_alternatives(name):
    truth, other = SIBLINGS[name]
    (cause,) = diagnose(seen_from_the_end(truth), force=True).causes
    kinds = {kind for kind, _ in named(cause)}
    assert {contract_kind(truth), other} <= kinds
    assert cause.verdict == "tied"


def test_a_joint_yields_under_the_tool():
    effect, rng = JointCompliance("B", 400.0), np.random.default_rng(3)
    model = msgspec.structs.replace(no_errors(HEAD_HEAD), effects=(effect,))
    q = positions(HEAD_HEAD, 150, rng)
    assert family_of(effect) not in set(map(family_of, causes(measured(HEAD_HEAD, q, ONE, model, rng))))


def on_the_table(*effects, standing=(), stands_on="workpiece", n=120):
    """Random positions of the DMU 50; rotary axes may stand still at 0."""
    machine, rng = machines.load("dmu50"), np.random.default_rng(3)
    q = positions(machine, n, rng)
    q[:, [machine.index(axis) for axis in standing]] = 0.0
    model = msgspec.structs.replace(no_errors(machine), effects=effects)
    return measured(machine, q, THREE, model, rng, stands_on=stands_on)


def of_workpiece(data):
    """Directions in which a drift of the workpiece is tried."""
    return {effect.component for effect in causes(data) if isinstance(effect, WorkpieceDrift)}


def test_a_drift_of_the_workpiece_is_tried_where_rotary_axes_turn_it():
    assert of_workpiece(on_the_table()) == set("XYZ")
    assert of_workpiece(on_the_table(standing="B")) == set("XY")
    assert of_workpiece(on_the_table(standing="BC")) == of_workpiece(data_with(n=40)) == set()
    assert of_workpiece(on_the_table(stands_on="bed")) == set()


RISE = {"amplitudes": (40.0,), "time_constants_s": (500.0,)}


@pytest.mark.statistical
@pytest.mark.parametrize("effect", [WorkpieceDrift(component="Z", **RISE), ThermalDrift(component="Z", **RISE)])
def test_the_side_of_a_drift_is_found_where_rotary_axes_move(effect):
    (cause,) = diagnose(on_the_table(effect), force=True).causes
    assert type(cause.effect) is type(effect)
    assert cause.axis == "Z"


@pytest.mark.statistical
def test_a_drift_of_the_workpiece_at_a_constant_rate_may_be_one_of_the_tracker():
    """The tracker stands on the workpiece: its own drift is the opposite."""
    (cause,) = diagnose(on_the_table(WorkpieceDrift(component="Z", rate=80.0)), force=True).causes
    assert {kind for kind, _ in named(cause)} >= {"thermal-drift", "tracker-drift"}


def test_wobble_and_racking_are_changes_of_a_calibrated_machine():
    def kinds(machine):
        q = positions(machine, 20, np.random.default_rng(1))
        data = measured(machine, q, ONE, no_errors(machine), np.random.default_rng(1))
        bases = dict.fromkeys(machine.names, BasisChoice("legendre", 2))
        model = rigid_model(data, bases)
        assert not any(isinstance(effect, (Wobble, Racking)) for effect in causes(data))
        return {(contract_kind(effect), where(effect)) for effect in changes(model)}

    assert ("racking", "X") in kinds(machines.load("gantry"))
    assert not {kind for kind, _ in kinds(CFRAME)} & {"racking", "wobble"}
    assert {axis for kind, axis in kinds(machines.load("dmu50")) if kind == "wobble"} == {"B", "C"}


def test_heat_of_a_spindle_needs_its_speeds():
    def tried_on(**columns):
        return any(isinstance(effect, DriftWithDuty) for effect in causes(data_with(n=N, **columns)))

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
    (cause,) = diagnose(data, force=True).causes
    assert family_of(cause.effect) == family_of(effect)
    alone = data.rows(np.arange(0, 60, 2))
    assert not any(effect.kind.startswith("cmm") for effect in causes(alone))


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
    assert title(Cause(effect.kind, effect, np.zeros((0, 0)), 50.0, "strong")) == expected


def test_a_jump_is_permanent_in_the_new_calibration():
    """The clock of later data begins at zero again."""
    jump = LocationJump("X", "X", 40.0, MIDDLE)
    model = diagnose(data_with(jump, n=N)).calibration
    jumps_of_it = [effect for effect in model.effects if isinstance(effect, LocationJump)]
    (written,) = (effect for effect in jumps_of_it if effect.name == jump.name)
    assert written.value == pytest.approx(40.0, abs=3 * written.u[0])
    assert all(effect.since_s is None for effect in jumps_of_it)
    assert not any(effect.needs for effect in jumps_of_it)
