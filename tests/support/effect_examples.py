"""One table of examples of every effect, states that have every column, and what an effect does at the tool."""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import ArrayLike

import machines
from kinematics.basis import BSpline, Fourier, Legendre, Polynomial
from kinematics.deviation import Deviation, exact_deviation
from kinematics.effects import (
    AirDrift,
    AirScale,
    AngleHarmonic,
    AngleStep,
    Backlash,
    ControlTable,
    CrossAxis,
    Cyclic,
    DistortionWithSensor,
    DistortionWithTime,
    DriftWithDuty,
    DriftWithSensor,
    Effect,
    ErrorMotion,
    FirstCycle,
    FollowingError,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    Hysteresis,
    JointCompliance,
    LateralPlay,
    LateReadBack,
    LocationError,
    LocationJump,
    MeasuringMachineScale,
    MeasuringMachineSquareness,
    Outliers,
    ProbeLobing,
    QuadraticGrowth,
    QuantisedCompensation,
    Racking,
    RamSag,
    RangeDrift,
    RangeJump,
    RangeOffset,
    Reversal,
    ReversalSpike,
    Scale,
    ServoMismatch,
    Settling,
    StationShift,
    TargetOffset,
    ThermalDrift,
    ToolShift,
    TrackerDrift,
    UnknownApproach,
    Unnamed,
    Wobble,
    WorkpieceDrift,
    WorkpieceDriftWithSensor,
    WorkpieceSurface,
)
from kinematics.error_model.model import no_errors
from kinematics.machine import Machine
from kinematics.state import State

DMU50 = machines.load("dmu50")
BACKWARD = machines.parse(
    """
name = "backward"
chain = "w C Y b X U Z t"
axes.C = { travel = [-180, 180], direction = [0, 0, -1], point = [40, -20, 0] }
axes.Y = { travel = [0, 400], direction = [0, -1, 0] }
axes.X = { travel = [0, 600], direction = [-1, 0, 0], point = [5, 120, 30] }
axes.U = { travel = [-50, 50] }
axes.Z = { travel = [0, 300] }
""",
    "backward",
)
"""C, Y and X run against their letters; Y and C carry the workpiece; U is a second axis along x."""
HEAD_HEAD = machines.load("head_head")


@dataclass(frozen=True)
class Example:
    """An effect, and what is expected of it."""

    effect: Effect
    name: str
    units: str
    """Units of its parameters, in order."""
    keys: str
    """Keys of its quantities, in order: names with units, once."""
    touched: str
    """Error motions, `tool` and `seen` with their components, in no order."""
    machine: Machine = DMU50


TABLE = BSpline((-250.0, 0.0, 250.0), 1)
XYZ = "seen X, seen Y, seen Z"
OWN = "E_CC, E_BB, E_XX, E_YY, E_ZZ"
SIX = "um um um urad urad urad"
PER_HOUR = "um/h um/h um/h urad/h urad/h urad/h"
RISE = {"amplitudes": (12.0,), "time_constants_s": (900.0,)}
TWO = {"rate": -2.0, "amplitudes": (12.0, -5.0), "time_constants_s": (900.0, 9000.0)}

EXAMPLES = [
    Example(ErrorMotion("X", "X", TABLE, (1.0, -2.0, 3.0), u=(0.1, 0.1, 0.2), note="seen"), "E_XX", "um um um", "parameters_um", "E_XX"),
    Example(ErrorMotion("C", "Y", Legendre((-225.0, 225.0), 2), (4.0, 0.5, -1.0)), "E_CY", "urad urad urad", "parameters_urad", "E_CY"),
    Example(ErrorMotion("Z", "Z", Polynomial((0.0, 400.0), 1), (0.0, 9.0), u=(1.0, 1.0)), "E_ZZ", "um um", "parameters_um", "E_ZZ"),
    Example(
        ErrorMotion("B", "C", Fourier((0.0, 360.0), (2.0,)), (1.0, 2.0, 3.0, 4.0)), "E_BC", "urad " * 4, "parameters_urad", "E_BC"
    ),
    Example(ErrorMotion("X", "U", Polynomial((-50.0, 50.0), 1), (3.0, 9.0)), "E_XU", "um um", "parameters_um", "E_XU", BACKWARD),
    Example(LocationError("C", "Y", 12.0, u=(2.0,)), "E_C0Y", "urad", "value_urad", "E_XY"),
    Example(LocationError("B", "Z", -15.0, u=(2.0,), note="seen"), "E_B0Z", "urad", "value_urad", "E_XZ"),
    Example(LocationError("A", "X", 3.0), "E_A0X", "urad", "value_urad", ""),  # a line has no roll
    Example(LocationError("Z", "Z", 6.0), "E_Z0Z", "um", "value_um", "E_ZZ"),
    Example(LocationError("X", "C", 6.0), "E_X0C", "um", "value_um", "E_XC"),
    Example(LocationError("A", "B", 6.0), "E_A0B", "urad", "value_urad", "E_AB"),
    Example(ToolShift("Z", -12.0, u=(0.5,)), "tool-shift Z", "um", "value_um", "tool Z"),
    Example(Scale("Y", -12.0, u=(0.5,)), "scale Y", "um/m", "scale_um_per_m", "E_YY"),
    Example(Scale("U", 12.0), "scale U", "um/m", "scale_um_per_m", "E_XU", BACKWARD),
    Example(
        CrossAxis("Z", "X", "Y", (-250.0, 250.0), (-225.0, 225.0), 1, 2, (3.0, -1.0, 2.0, 0.5), u=(1.0,) * 4),
        "E_ZX(Y)", "um um um um", "coefficients_um", "E_ZX",
    ),
    Example(CrossAxis("A", "C", "Z", (0.0, 360.0), (0.0, 400.0), 0, 1, (8.0,)), "E_AC(Z)", "urad", "coefficients_urad", "E_AC"),
    Example(Racking("X", "Y", 450.0, TABLE, (20.0, -5.0, 8.0), -225.0), "racking X", "um um um", "lead_um", "E_XX, E_CX"),
    Example(
        Racking("X", "Y", 400.0, Polynomial((0.0, 600.0), 1), (20.0, -5.0)), "racking X", "um um", "lead_um", "E_XX, E_CX",
        BACKWARD,
    ),
    Example(Wobble("C", "radial", 1, 1, 4.0, -2.0), "wobble C radial 1 1", "um um", "cosine_um sine_um", "E_XC, E_YC"),
    Example(Wobble("B", "tilt", 2, -1, 4.0, -2.0), "wobble B tilt 2 -1", "urad urad", "cosine_urad sine_urad", "E_AB, E_CB"),
    Example(Backlash("X", 12.0, u=(0.5,)), "backlash X", "um", "width_um", "E_XX"),
    Example(Backlash("Z", 12.0, 30.0), "backlash Z", "um um/m", "width_um windup_um_per_m", "E_ZZ"),
    Example(Backlash("B", 40.0, 9.0, u=(1.0, 2.0)), "backlash B", "urad urad/rad", "width_urad windup_urad_per_rad", "E_BB"),
    Example(Backlash("U", 9.0, -7.0), "backlash U", "um um/m", "width_um windup_um_per_m", "E_XU", BACKWARD),
    Example(Reversal("X", "Y", Legendre((-225.0, 225.0), 1), (4.0, -1.0), u=(0.5, 0.5)), "reversal E_XY", "um um", "differences_um", "E_XY"),
    Example(Reversal("C", "X", BSpline((-250.0, 0.0, 250.0), 1), (5.0, 1.0, -2.0)), "reversal E_CX", "urad " * 3, "differences_urad", "E_CX"),
    Example(Cyclic("X", "X", 10.0, (2.0,), (-1.0,)), "cyclic E_XX", "mm um um", "period_mm sine_um cosine_um", "E_XX"),
    Example(
        Cyclic("C", "Y", 0.25, (2.0, 0.3, 0.0), (-1.0, 0.0, 0.5)), "cyclic E_CY", "mm" + " urad" * 6, "period_mm sine_urad cosine_urad", "E_CY"
    ),
    Example(Cyclic("Z", "C", 360.0, (3.0, 1.0), (0.0, 2.0)), "cyclic E_ZC", "deg um um um um", "period_deg sine_um cosine_um", "E_ZC"),
    Example(QuantisedCompensation("X", 4.0, 25.0, 3.0), "quantised-compensation X", "um mm mm", "step_um pitch_mm offset_mm", "E_XX"),
    Example(QuantisedCompensation("C", -6.0, 15.0), "quantised-compensation C", "urad deg deg", "step_urad pitch_deg offset_deg", "E_CC"),
    Example(
        ControlTable("X", ("X",), ((-250.0, 0.0, 100.0),), (3.0, -2.0, 5.0), 1), "control-table X(X) forward", "um um um", "values_um", "E_XX"
    ),
    Example(ControlTable("Z", ("Y",), ((0.0,),), (4.0,), u=(1.0,)), "control-table Z(Y)", "um", "values_um", "E_ZZ"),
    Example(
        ControlTable("C", ("X", "B"), ((0.0, 200.0), (0.0, 90.0, 180.0)), (1.0, 2.0, -3.0, 4.0, 0.0, 6.0), -1),
        "control-table C(X,B) backward", "urad " * 6, "values_urad", "E_CC",
    ),
    Example(ControlTable("X", ("X", "Y"), ((0.0, 600.0), (0.0, 400.0)), (1.0, 2.0, -3.0, 4.0)), "control-table X(X,Y)", "um " * 4, "values_um", "E_XX", BACKWARD),
    Example(WorkpieceSurface("Z", ("X", "Y"), ((-100.0, 300.0), (-50.0, 400.0)), (1.0, 2.0, -3.0, 4.0)), "surface Z(X,Y)", "um " * 4, "values_um", "E_ZZ"),
    Example(
        WorkpieceSurface("Z", ("X", "Y"), ((-100.0, 100.0, 300.0), (0.0, 400.0)), (1.0, 2.0, -3.0, 4.0, 0.5, 6.0), interpolation="cubic"),
        "surface Z(X,Y)", "um " * 6, "values_um", "E_ZZ",
    ),
    Example(FollowingError("Y", 1.5), "following-error Y", "ms", "lag_ms", "E_YY"),
    Example(FollowingError("C", 1.5, 12.0), "following-error C", "ms ms2", "lag_ms compliance_ms2", "E_CC"),
    Example(Settling("Z", 30.0), "settling Z", "ppm", "share_ppm", "E_ZZ"),
    Example(FirstCycle("Y", "X", -4.0), "first-cycle E_YX", "um", "offset_um", "E_YX"),
    Example(FirstCycle("B", "B", -4.0), "first-cycle E_BB", "urad", "offset_urad", "E_BB"),
    Example(ThermalDrift(component="Z", rate=-25.0), "thermal-drift Z", "um/h", "rate_um_per_h", "tool Z"),
    Example(ThermalDrift(component="X", **RISE), "thermal-drift X", "um s", "amplitudes_um time_constants_s", "tool X"),
    Example(ThermalDrift(component="A", **TWO), "thermal-drift A", "urad/h urad urad s s", "rate_urad_per_h amplitudes_urad time_constants_s", "tool A"),
    Example(
        DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0),
        "thermal-drift-sensor Z spindle", "um/K", "coefficient_um_per_k", "tool Z",
    ),
    Example(
        DriftWithSensor(component="B", sensor="column", coefficient=-6.0, lag_s=700.0),
        "thermal-drift-sensor B column", "urad/K s", "coefficient_urad_per_k lag_s", "tool B",
    ),
    Example(DriftWithDuty("Z", -3.0, 1500.0), "thermal-drift-duty Z", "um/krpm s", "growth_um_per_krpm time_constant_s", "tool Z"),
    Example(DriftWithDuty("B", 2.0, 700.0, u=(0.1, 9.0)), "thermal-drift-duty B", "urad/krpm s", "growth_urad_per_krpm time_constant_s", "tool B"),
    Example(WorkpieceDrift(component="Z", rate=-25.0), "thermal-drift-workpiece Z", "um/h", "rate_um_per_h", "E_ZC"),
    Example(WorkpieceDrift(component="X", **TWO), "thermal-drift-workpiece X", "um/h um um s s", "rate_um_per_h amplitudes_um time_constants_s", "E_XC, E_YC", BACKWARD),
    Example(WorkpieceDrift(component="Y", **RISE), "thermal-drift-workpiece Y", "um s", "amplitudes_um time_constants_s", "E_YX", HEAD_HEAD),
    Example(
        WorkpieceDriftWithSensor(component="Y", sensor="column", coefficient=-6.0, lag_s=700.0),
        "thermal-drift-workpiece-sensor Y column", "um/K s", "coefficient_um_per_k lag_s", "E_XC, E_YC",
    ),
    Example(GrowthWithTime(axis="X", rate=15.0, fixed_point=-250.0), "thermal-scale X", "um/m/h", "rate_um_per_m_per_h", "E_XX"),
    Example(GrowthWithTime(axis="Y", **RISE), "thermal-scale Y", "um/m s", "amplitudes_um_per_m time_constants_s", "E_YY", BACKWARD),
    Example(GrowthWithTime(axis="Z", **TWO), "thermal-scale Z", "um/m/h um/m um/m s s", "rate_um_per_m_per_h amplitudes_um_per_m time_constants_s", "E_ZZ"),
    Example(
        GrowthWithSensor(axis="Y", sensor="column", coefficient=10.0, lag_s=700.0),
        "thermal-scale-sensor Y column", "um/m/K s", "coefficient_um_per_m_per_k lag_s", "E_YY",
    ),
    Example(
        GrowthWithSensor(axis="U", sensor="column", coefficient=10.0, fixed_point=20.0),
        "thermal-scale-sensor U column", "um/m/K", "coefficient_um_per_m_per_k", "E_XU", BACKWARD,
    ),
    Example(
        Unnamed("Y", ("X", "time"), ((-250.0, 250.0), (0.0, 9000.0)), ((0, 1), (2, 0), (3, 2)), (3.0, -2.0, 4.0), u=(1.0,) * 3),
        "unnamed Y(X, time)", "um um um", "coefficients_um", "tool Y",
    ),
    Example(
        Unnamed("Z", ("C", "temperature column"), ((-180.0, 180.0), (0.0, 6.0)), ((1, 1), (2, 0)), (3.0, -2.0)),
        "unnamed Z(C, temperature column)", "um um", "coefficients_um", "tool Z", BACKWARD,
    ),
    Example(Unnamed("X", ("Z",), ((0.0, 300.0),), ((2,),), (5.0,)), "unnamed X(Z)", "um", "coefficients_um", "tool X"),
    Example(StationShift("s2", (5.0, -3.0, 8.0), (2.0, 1.0, -4.0)), "station-shift s2", SIX, "shift_um turn_urad", XYZ),
    Example(TrackerDrift((5.0, -3.0, 8.0), (2.0, 1.0, -4.0)), "tracker-drift", PER_HOUR, "shift_um_per_h turn_urad_per_h", XYZ),
    Example(RangeOffset(7.0), "tracker-range", "um", "offset_um", XYZ),
    Example(AirScale(-1.5), "air-scale", "um/m", "scale_um_per_m", XYZ),
    Example(AngleHarmonic("azimuth", 1, 6.0, -3.0), "tracker-angle azimuth 1", "urad urad", "sine_urad cosine_urad", XYZ),
    Example(AngleHarmonic("elevation", 2, 6.0, -3.0), "tracker-angle elevation 2", "urad urad", "sine_urad cosine_urad", XYZ),
    Example(AngleStep("elevation", "azimuth", -40.0, 6.0), "tracker-angle-step elevation azimuth", "urad", "step_urad", XYZ),
    Example(TargetOffset("t1", (30.0, -20.0, 10.0)), "target-offset t1", "um um um", "offset_um", "tool X, tool Y, tool Z"),
    Example(UnknownApproach("Y", 4.0), "unknown-approach Y", "um", "offset_um", "E_YY"),
    Example(UnknownApproach("C", 4.0), "unknown-approach C", "urad", "offset_urad", "E_CC"),
    Example(LateReadBack(2.0), "late-read-back", "ms", "lag_ms", OWN),
    Example(LocationJump("C", "Y", 12.0, 9000.0, u=(2.0,)), "location-jump E_C0Y", "urad", "value_urad", "E_XY"),
    Example(LocationJump("X", "X", -30.0, 9000.0), "location-jump E_X0X", "um", "value_um", "E_XX"),
    Example(LocationJump("Y", "C", 6.0), "location-jump E_Y0C", "um", "value_um", "E_YC"),
    Example(JointCompliance("B", 40.0, u=(1.0,)), "joint-compliance B", "urad/m", "compliance_urad_per_m", "E_BB", HEAD_HEAD),
    Example(RamSag("X", 30.0, -300.0), "ram-sag X", "um/m3", "sag_um_per_m3", "E_ZX, E_BX"),
    Example(RamSag("U", 30.0, 60.0, -1, "X"), "ram-sag U", "um/m3", "sag_um_per_m3", "E_ZU, E_BU", BACKWARD),
    Example(LateralPlay("Z", "X", 6.0, u=(0.5,)), "lateral-play E_ZX", "um", "play_um", "E_ZX"),
    Example(LateralPlay("A", "X", 6.0), "lateral-play E_AX", "urad", "play_urad", "E_AX"),
    Example(Hysteresis("X", 300.0, 12.0, u=(0.5, 1.0)), "hysteresis X", "um mm", "width_um length_mm", "E_XX"),
    Example(Hysteresis("C", 200.0, 12.0), "hysteresis C", "urad deg", "width_urad length_deg", "E_CC", BACKWARD),
    Example(ReversalSpike("Y", 200.0, 8.0), "reversal-spike Y", "um mm", "height_um length_mm", "E_YY"),
    Example(ServoMismatch("X", "Y", 1.5), "servo-mismatch X Y", "ms", "lag_ms", "E_XX, E_YY"),
    Example(
        QuadraticGrowth("Y", "column", 10.0, -0.8, 50.0),
        "thermal-scale-quadratic Y column", "um/m/K um/m/K2", "coefficient_um_per_m_per_k quadratic_um_per_m_per_k2", "E_YY",
    ),
    Example(GrowthWithDuty("X", 0.8, 1500.0), "thermal-scale-duty X", "um/m/m s", "growth_um_per_m_per_m time_constant_s", "E_XX"),
    Example(
        DistortionWithTime(component="Y", axis="X", interval=(-250.0, 250.0), degree=1, rate=8.0),
        "thermal-distortion E_YX 1", "um/h", "rate_um_per_h", "E_YX",
    ),
    Example(
        DistortionWithTime(component="A", axis="C", interval=(-180.0, 180.0), degree=0, **TWO),
        "thermal-distortion E_AC 0", "urad/h urad urad s s", "rate_urad_per_h amplitudes_urad time_constants_s", "E_AC", BACKWARD,
    ),
    Example(
        DistortionWithSensor(component="Z", axis="Y", interval=(-225.0, 225.0), degree=2, sensor="column", coefficient=3.0, lag_s=700.0),
        "thermal-distortion-sensor E_ZY 2 column", "um/K s", "coefficient_um_per_k lag_s", "E_ZY",
    ),
    Example(TargetOffset("t2", (30.0, -20.0, 10.0), 9000.0), "target-offset t2", "um um um", "offset_um", "tool X, tool Y, tool Z"),
    Example(StationShift("s2", (5.0, -3.0, 8.0), (2.0, 1.0, -4.0), 9000.0), "station-shift s2", SIX, "shift_um turn_urad", XYZ),
    Example(RangeDrift(7.0), "tracker-range-drift", "um/h", "rate_um_per_h", XYZ),
    Example(RangeDrift(7.0, "s2"), "tracker-range-drift s2", "um/h", "rate_um_per_h", XYZ),
    Example(RangeJump("s2", 7.0, 9000.0), "range-jump s2", "um", "offset_um", XYZ),
    Example(AirDrift(-1.5), "air-scale-drift", "um/m/h", "rate_um_per_m_per_h", XYZ),
    Example(ProbeLobing(2.0, -1.0), "probe-lobing", "um um", "cosine_um sine_um", "tool X, tool Y"),
    Example(MeasuringMachineScale("y", 4.0), "cmm-scale y", "um/m", "scale_um_per_m", "seen Y"),
    Example(MeasuringMachineSquareness("xz", 4.0), "cmm-squareness xz", "urad", "angle_urad", "seen X"),
    Example(Outliers((3, 0), (100.0, 0.0, 50.0, -70.0, 5.0, 5.0)), "outliers", "um " * 6, "shift_um", XYZ),
]  # fmt: skip


def deviation_of(effect: Effect, machine: Machine, state: State, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Deviation:
    """What the data show of it at the tool, by the exact kinematics, mm and rad, workpiece frame."""
    model = msgspec.structs.replace(no_errors(machine), effects=(effect,))
    return exact_deviation(machine, state.positions, model.observation(machine, state).errors, tool)


def full_state(machine: Machine, n: int, seed: int = 1) -> State:
    """Random states with every column; positions inside travel, unlimited axes within a turn each way."""
    rng, axes = np.random.default_rng(seed), len(machine.axes)
    travel = np.where(machine.rotary, np.clip(machine.travel, -2 * np.pi, 2 * np.pi), machine.travel)
    return State(
        rng.uniform(*travel, (n, axes)),
        approach=rng.choice([-1.0, 0.0, 1.0], (n, axes)),
        last_move=rng.normal(0.0, 50.0, (n, axes)),
        velocity=rng.normal(0.0, 30.0, (n, axes)),
        acceleration=rng.normal(0.0, 500.0, (n, axes)),
        time=np.sort(rng.uniform(0.0, 20_000.0, n)),
        temperatures={name: rng.normal(3.0, 2.0, n) for name in ("spindle", "column")},
        spindle_speed=rng.choice([0.0, 6000.0, 12000.0], n),
        cycle=rng.integers(0, 3, n).astype(float),
        station=rng.choice(["s1", "s2"], n),
        target=rng.choice(["t1", "t2"], n),
        observed=rng.uniform(500.0, 3000.0, (n, 3)) * rng.choice([-1.0, 1.0], (n, 3)),
    )
