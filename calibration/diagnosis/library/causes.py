"""The causes that a diagnosis tries on a measurement, by subject: drives, heat, geometry, loads, jumps, instruments.

Each is one that the physics of the machine and of the instrument allows: a candidate more costs little time, but is one
more chance of a false cause. Effects that a first calibration contains as error motions are not tried here: racking,
wobble and the sag of a ram with its own overhang (see `changes`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import Any, cast, get_args

import msgspec
import numpy as np

from calibration.diagnosis.library.changes import HARMONICS_OF_TURN
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import is_log
from calibration.observation.mean_lines import point_of
from kinematics.basis import Legendre
from kinematics.effects import (
    EFFECTS,
    AirDrift,
    AirScale,
    AngleHarmonic,
    AngleStep,
    Backlash,
    Component,
    CrossAxis,
    DistortionWithSensor,
    DistortionWithTime,
    DriftWithDuty,
    DriftWithSensor,
    Effect,
    FirstCycle,
    FollowingError,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    Hysteresis,
    JointCompliance,
    LateralPlay,
    LateReadBack,
    LocationJump,
    MeasuringMachineScale,
    MeasuringMachineSquareness,
    ProbeLobing,
    QuadraticGrowth,
    RamSag,
    RangeDrift,
    RangeJump,
    RangeOffset,
    Reversal,
    ReversalSpike,
    ServoMismatch,
    Settling,
    StationShift,
    TargetOffset,
    ThermalDrift,
    TrackerDrift,
    WorkpieceDrift,
    WorkpieceDriftWithSensor,
)
from kinematics.effects.base import own_component
from kinematics.effects.combined.where import Direction
from kinematics.effects.friction import way_since_reversal
from kinematics.effects.tracker import CIRCLES
from kinematics.forward import forward
from kinematics.state import State

TIME_CONSTANTS = (0.1, 0.2, 0.4, 0.8)
"""Time constants of exponentials, as shares of the duration of the data; refined in the fit."""
LAGS = TIME_CONSTANTS[::2]
"""Lags of temperatures and of duty, likewise, at steps twice as large."""
LENGTHS = (0.2, 0.6)
"""Lengths of hysteresis, as quantiles of the distances since a reversal; refined in the fit."""
ON_CIRCLES_MM = (0.15, 0.6)
"""Lengths on circles in addition, mm: most rows are far from reversals, but those beside them are close together."""
WARMER = 0.2
"""Range of a temperature, K, above which candidates depend on it."""
CURVED = 2.0
"""Range of a temperature, K, above which a growth may be curved."""
SIDES_DIFFER_RAD = 0.1
"""Least change of a direction, rad, by which the sides of tool and workpiece differ."""
OWN_DEGREE, OTHER_DEGREE = 1, 2
"""Degrees of error motions that depend on another axis."""
REVERSAL_DEGREE = 2
"""Degree of the difference between forward and backward along an axis."""


def causes(measurement: Measurement) -> Iterator[Effect]:
    """The causes that are tried on a measurement; some need columns that it lacks."""
    for axis in measurement.moving:
        yield from _of_drive(measurement, axis)
    yield from _thermal(measurement)
    if not measurement.axis_rows:
        yield from _crossed(measurement)
        yield from _loads(measurement)
        if measurement.instrument.CLOCK_OF_MACHINE:
            yield from _distortions(measurement)
    if measurement.instrument.READS_RANGES:
        yield from _of_ranges(measurement)
    if measurement.instrument.OWN_TIP and any(_in_head(measurement, axis) for axis in measurement.moving):
        yield ProbeLobing(cosine_um=0.0, sine_um=0.0)
    if not measurement.instrument.CLOCK_OF_MACHINE:
        yield from _of_measuring_machine(measurement)
    if given(measurement.state, "velocity"):
        yield LateReadBack(lag_ms=0.0)
        for one, other in combinations([axis for axis in measurement.moving if axis[0] not in "ABC"], 2):
            yield ServoMismatch(axis=one, other=other, lag_ms=0.0)
    for kind in EFFECTS:
        yield from kind.candidates(measurement.moving)


def jumps(measurement: Measurement) -> Iterator[Effect]:
    """Effects with a moment, which is to be searched for: each holds from the first row on.

    A knock at the instrument or at a sphere, a target seated again, the zero of an axis; the squareness of a linear
    axis; the line of a rotary axis. None for a part, whose times are those of the measuring machine, and none without
    the stations of a tracker: a knock would be blamed on the machine.
    """
    state, start = measurement.state, -np.inf
    if state.time is None or not measurement.instrument.CLOCK_OF_MACHINE:
        return
    if measurement.instrument.MAY_BE_KNOCKED:
        if state.station is None:
            return
        for station in np.unique(state.station).tolist():
            yield StationShift(station=station, since_s=start)
            if measurement.instrument.ZERO_BY_BEAM:
                yield RangeJump(station=station, offset_um=0.0, since_s=start)
        for name, target in measurement.targets.items():
            if target.carrier == "tool":
                yield TargetOffset(target=name, offset_um=(0.0, 0.0, 0.0), since_s=start)
    for axis in measurement.moving:
        yield LocationJump(own_component(axis), axis, 0.0, start)
        if not measurement.axis_rows:
            for component in _lateral(axis, "XYZ" if axis[0] in "ABC" else "ABC"):
                yield LocationJump(component, axis, 0.0, start)


def angle_steps(measurement: Measurement) -> Iterator[AngleStep]:
    """Steps of the angles that a tracker reads, over one of its circles; the angle is to be searched for."""
    if measurement.instrument.BY_BEAM:
        yield from (AngleStep(circle, over, 0.0, 0.0) for circle in CIRCLES for over in CIRCLES)


def given(state: State, column: str) -> bool:
    """True where the data have a column and its numbers vary; temperatures and names need not vary."""
    value = getattr(state, column)
    if column == "temperatures":
        return bool(value)
    if value is None:
        return False
    return value.dtype.kind not in "fi" or bool(np.any(value != value[:1]))


def _lateral(axis: str, letters: str) -> list[Component]:
    """The two components across the line of an axis among XYZ or ABC."""
    own = "XYZ".index(own_component(axis)) if axis[0] not in "ABC" else "ABC".index(axis[0])
    return [cast(Component, letter) for k, letter in enumerate(letters) if k != own]


def _in_head(measurement: Measurement, axis: str) -> bool:
    """True for a rotary axis that carries the tool."""
    own = measurement.machine.axes[measurement.machine.index(axis)]
    return own.rotary and own.side == "tool"


def _roll(axis: str) -> Component:
    return cast(Component, "ABC"["XYZ".index(own_component(axis))])


def _of_drive(measurement: Measurement, axis: str) -> Iterator[Effect]:
    yield Backlash(axis=axis, width=0.0)
    if not is_log(measurement, axis):  # the moves between rows of a log are no moves of the machine
        yield Settling(axis=axis, share_ppm=0.0)
    if not measurement.instrument.ON_CIRCLES:  # there the differences of lags are seen: see ServoMismatch
        yield FollowingError(axis=axis, lag_ms=0.0)
    own = own_component(axis)
    if measurement.state.cycle is not None:
        yield FirstCycle(component=own, axis=axis, offset=0.0)
    if axis[0] in "ABC" or not given(measurement.state, "approach"):
        return
    yield Backlash(axis=axis, width=0.0, windup=0.0)
    if not measurement.axis_rows:  # elsewhere a shape is proposed: see `reversals`
        basis = Legendre(measurement.moving[axis], REVERSAL_DEGREE)
        yield Reversal(own, axis, basis, (0.0,) * (REVERSAL_DEGREE + 1))
    seen = measurement.errors_shown[axis].motions
    yield from (LateralPlay(component, axis, 0.0) for component in seen if component != own)
    ways = way_since_reversal(measurement.machine, measurement.state, axis, "a hysteresis")
    ways = ways[np.isfinite(ways) & (ways > 0.0)]
    lengths = np.unique(np.round(np.quantile(ways, LENGTHS), 3)).tolist() if len(ways) else []
    if measurement.instrument.ON_CIRCLES and len(ways):
        lengths = [*ON_CIRCLES_MM, *lengths]
    for length in lengths:
        if length > 0.0:
            yield Hysteresis(axis, 0.0, length)
            yield ReversalSpike(axis, 0.0, length)


def _thermal(measurement: Measurement) -> Iterator[Effect]:
    """Drift and growth with time and with temperatures.

    None with the time of a part: that is the measuring machine's, and the machine tool's at its cuts is unknown.
    """
    state, of_machine = measurement.state, measurement.instrument.CLOCK_OF_MACHINE
    span = float(np.ptp(state.time)) if state.time is not None else 0.0
    courses: list[dict[str, Any]] = [{"rate": 0.0}]
    courses += [{"amplitudes": (0.0,), "time_constants_s": (max(share * span, 1.0),)} for share in TIME_CONSTANTS]
    courses = courses if of_machine else []
    linear = [axis for axis in measurement.moving if axis[0] not in "ABC"]
    seen = {component for shown in measurement.errors_shown.values() for component in shown.motions}
    components = [component for component in get_args(Component) if component in seen]
    turning = _turning(measurement)
    for course in courses:
        for component in components:
            yield ThermalDrift(component=component, **course)
        for direction in turning:
            yield WorkpieceDrift(component=direction, **course)
        for axis in linear:
            yield GrowthWithTime(axis=axis, **course)
    lags = [max(share * span, 1.0) for share in LAGS] if of_machine and given(state, "time") else []
    for constant in lags:
        yield from (GrowthWithDuty(axis, 0.0, constant) for axis in linear)
        if given(state, "spindle_speed"):
            yield from (DriftWithDuty(c, 0.0, constant) for c in components if c in "XYZ")
    for sensor in _warming(state, WARMER):
        for lag in (None, *lags):
            late = {"sensor": sensor, "coefficient": 0.0, "lag_s": lag}
            yield from _with_sensor(late, components, turning, linear)
    for sensor in _warming(state, CURVED):
        yield from (QuadraticGrowth(axis, sensor, 0.0, 0.0) for axis in linear)


def _with_sensor(
    course: dict[str, Any], components: Sequence[Component], turning: Sequence[Direction], linear: Sequence[str]
) -> Iterator[Effect]:
    """Drifts of the tool, without the tilts if late, and of the workpiece, and growth of axes, by one sensor."""
    for component in components:
        if course["lag_s"] is None or component in "XYZ":
            yield DriftWithSensor(component=component, **course)
    yield from (WorkpieceDriftWithSensor(component=direction, **course) for direction in turning)
    yield from (GrowthWithSensor(axis=axis, **course) for axis in linear)


def _turning(measurement: Measurement) -> list[Direction]:
    """Directions of the workpiece that turn against the tool in the data, where the instrument sees the workpiece move.

    Elsewhere a drift of the workpiece along them is one of the tool.
    """
    on_table = any(target.carrier == "table" for target in measurement.targets.values())
    if measurement.axis_rows or (measurement.stands_on == "bed" and not on_table):
        return []
    turned = np.ptp(forward(measurement.machine, measurement.state.positions).rotation, axis=0)
    return [letter for letter, row in zip(get_args(Direction), turned, strict=True) if row.max() > SIDES_DIFFER_RAD]


def _warming(state: State, least: float) -> list[str]:
    """Sensors whose temperatures vary by more than `least`, K."""
    return [name for name, kelvin in state.temperatures.items() if np.ptp(kelvin) > least]


def _distortions(measurement: Measurement) -> Iterator[Effect]:
    """Squareness, bow and roll of linear axes, and the line of rotary ones, with time and with temperatures."""
    sensors = _warming(measurement.state, WARMER)
    for axis, interval in measurement.moving.items():
        if axis[0] in "ABC":
            shapes = [(component, 0) for letters in ("XYZ", "ABC") for component in _lateral(axis, letters)]
        else:
            shapes = [(component, degree) for component in _lateral(axis, "XYZ") for degree in (1, 2)]
            shapes.append((_roll(axis), 1))
        for component, degree in shapes:
            where: dict[str, Any] = {"component": component, "axis": axis, "interval": interval, "degree": degree}
            if given(measurement.state, "time"):
                yield DistortionWithTime(**where, rate=0.0)
            for sensor in sensors:
                yield DistortionWithSensor(**where, sensor=sensor, coefficient=0.0)


def _crossed(measurement: Measurement) -> Iterator[Effect]:
    """Errors of an axis that depend on another axis; turns of linear axes about the centre of the measured points."""
    count = (OWN_DEGREE + 1) * OTHER_DEGREE
    centres = {axis: point_of(arms) for axis, arms in measurement.arms.items()}
    for axis, other in permutations(measurement.moving, 2):
        for component in get_args(Component):
            yield CrossAxis(
                component=component,
                axis=axis,
                other=other,
                own_interval=measurement.moving[axis],
                other_interval=measurement.moving[other],
                own_degree=OWN_DEGREE,
                other_degree=OTHER_DEGREE,
                coefficients=(0.0,) * count,
                about=centres.get(axis, msgspec.UNSET) if component in "ABC" else msgspec.UNSET,
            )


def _loads(measurement: Measurement) -> Iterator[Effect]:
    """Compliance of rotary axes of the head whose load does not follow from their own angle alone; sag of double rams.

    The lever of the tool changes if an axis behind it moves, or the direction of gravity if one before it tilts it.
    """
    machine, moving = measurement.machine, measurement.moving
    head = [axis for axis in machine.axes if axis.side == "tool"]
    for i, axis in enumerate(head):
        horizontal = abs(axis.unit_direction[2]) < 0.99
        if axis.name not in moving or not horizontal:
            continue
        tilting = any(one.rotary and abs(one.unit_direction[2]) < 0.99 and one.name in moving for one in head[:i])
        if axis.rotary and (tilting or any(one.name in moving for one in head[i + 1 :])):
            yield JointCompliance(axis.name, 0.0)
        for other in head[:i] if not axis.rotary else []:
            parallel = float(other.unit_direction @ axis.unit_direction)
            if not other.rotary and other.name in moving and abs(parallel) > 0.99:
                low, _ = moving[axis.name]
                yield RamSag(axis.name, 0.0, low, 1, other.name)


def _of_ranges(measurement: Measurement) -> Iterator[Effect]:
    """Errors of an instrument that reads ranges, of its angles where it reads them, and of its targets."""
    own = measurement.instrument
    if own.BY_BEAM:
        yield RangeOffset(offset_um=0.0)
    yield AirScale(scale_um_per_m=0.0)
    for circle in CIRCLES if own.BY_BEAM else ():
        for harmonic in HARMONICS_OF_TURN:
            yield AngleHarmonic(circle=circle, harmonic=harmonic, sine_urad=0.0, cosine_urad=0.0)
    yield TrackerDrift()
    if given(measurement.state, "time"):
        yield RangeDrift(rate_um_per_h=0.0)
        yield AirDrift(rate_um_per_m_per_h=0.0)
        stations = np.unique(measurement.groups).tolist()
        if not own.BY_BEAM and len(stations) > 1:
            yield from (RangeDrift(rate_um_per_h=0.0, station=station) for station in stations)
    on_tool = [name for name, target in measurement.targets.items() if target.carrier == "tool"]
    if len(on_tool) > 1:
        for name in on_tool:
            yield TargetOffset(target=name, offset_um=(0.0, 0.0, 0.0))


def _of_measuring_machine(measurement: Measurement) -> Iterator[Effect]:
    """Errors of the measuring machine; of a part in one position on it they are those of the machine tool.

    The times of a part are those of its measurement, so that the part, or the measuring machine, may have drifted.
    """
    if given(measurement.state, "time"):
        yield TrackerDrift()
    if len(np.unique(measurement.groups)) > 1:
        letters = "xyz"[: measurement.instrument.components]
        for letter in letters:
            yield MeasuringMachineScale(letter, 0.0)  # type: ignore[arg-type]
        for one, other in combinations(letters, 2):
            yield MeasuringMachineSquareness(one + other, 0.0)  # type: ignore[arg-type]
