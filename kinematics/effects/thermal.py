"""Heat: drift of the tool or of the workpiece, growth of axes; by time, or by a temperature with its lag.

Temperatures count from 20 degC, at which the growth is zero. Time counts from the start of the data, at which the
drift is zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np

from kinematics.basis import Basis
from kinematics.effects.base import (
    BY_DIRECTION,
    COMPONENTS,
    TOOL,
    UM,
    Columns,
    Component,
    EffectBase,
    Parameter,
    Remedy,
    own_motion,
    unit_of,
)
from kinematics.effects.thermal_course import MINUTES_30, Course, CourseOfSensor, lagged
from kinematics.forward import axis_pose
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, turn

Direction = Literal["X", "Y", "Z"]


class ThermalDrift(Course, frozen=True, tag="thermal-drift"):
    """The tool point drifts with time: spindle growth, a column that bends. In the tool's own directions.

    rate t + sum of amplitude (1 - exp(-t / time constant)). A spindle that grows brings the tool to -Z. Rotations are
    about the tool reference point.
    """

    TITLE: ClassVar[str] = "thermal drift of the tool point with time (linear, exponential, two time constants)"
    ACTS_ON = "tool"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "um/h or urad/h", 20.0),
        Parameter("amplitudes", BY_DIRECTION, 20.0),
        Parameter("time_constants_s", "s", MINUTES_30, linear=False, lower=0.0),
    )

    component: Component

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002  the same on any machine
        """See `EffectBase.columns`."""
        yield Columns(TOOL, COMPONENTS.index(self.component), self._course(state) * unit_of(self.component)[1])


class DriftWithSensor(CourseOfSensor, frozen=True, tag="thermal-drift-sensor"):
    """The tool point follows a temperature, with or without lag. In the tool's own directions.

    A first-order lag makes warming and cooling differ. A spindle that grows brings the tool to -Z. Rotations are about
    the tool reference point.
    """

    TITLE: ClassVar[str] = "thermal drift of the tool point with a temperature, with lag"
    ACTS_ON = "tool"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "um/K or urad/K", 5.0),
        Parameter("lag_s", "s", MINUTES_30, linear=False, lower=0.0, closed=True),
    )

    component: Component

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002  the same on any machine
        """See `EffectBase.columns`."""
        yield Columns(TOOL, COMPONENTS.index(self.component), self._course(state) * unit_of(self.component)[1])


class WorkpieceDrift(Course, frozen=True, tag="thermal-drift-workpiece"):
    """The table, the fixture or the part grows or shifts with time: a drift in the workpiece's own directions.

    rate t + sum of amplitude (1 - exp(-t / time constant)). The drift is that of the tool relative to the workpiece: a
    table that rises brings the tool to -Z. The direction turns with the rotary axes that carry the workpiece, that of a
    drift of the tool point with those of the head. ISO 230-3 (thermal distortion of tables and rotary axes); Mayr et
    al., CIRP Annals 61/2 (2012).
    """

    TITLE: ClassVar[str] = "thermal drift of the workpiece's side with time (linear, exponential, two time constants)"
    ACTS_ON = "workpiece"
    side: ClassVar[Literal["workpiece"]] = "workpiece"
    """The drift is not one of the tool's side."""
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "um/h", 20.0),
        Parameter("amplitudes", "um", 20.0),
        Parameter("time_constants_s", "s", MINUTES_30, linear=False, lower=0.0),
    )

    component: Direction

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield from _of_workpiece(machine, state, self.component, self._course(state))


class WorkpieceDriftWithSensor(CourseOfSensor, frozen=True, tag="thermal-drift-workpiece-sensor"):
    """The table, the fixture or the part follows a temperature, with or without lag, in the workpiece's own directions.

    The drift is that of the tool relative to the workpiece: a table that rises brings the tool to -Z. ISO 230-3.
    """

    TITLE: ClassVar[str] = "thermal drift of the workpiece's side with a temperature, with lag"
    ACTS_ON = "workpiece"
    side: ClassVar[Literal["workpiece"]] = "workpiece"
    """The drift is not one of the tool's side."""
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "um/K", 5.0),
        Parameter("lag_s", "s", MINUTES_30, linear=False, lower=0.0, closed=True),
    )

    component: Direction

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield from _of_workpiece(machine, state, self.component, self._course(state))


class GrowthWithTime(Course, frozen=True, tag="thermal-scale"):
    """The scale of a linear axis grows with time: forward of its fixed point the tool is too far forward.

    Per m from the fixed point: rate t + sum of amplitude (1 - exp(-t / time constant)).
    """

    TITLE: ClassVar[str] = "thermal growth of an axis with time"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "um/m/h", 20.0),
        Parameter("amplitudes", "um/m", 20.0),
        Parameter("time_constants_s", "s", MINUTES_30, linear=False, lower=0.0),
    )

    axis: str
    fixed_point: float = 0.0

    def __post_init__(self) -> None:
        _check_linear(self.axis, self.name)
        super().__post_init__()

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield _growth(machine, state, self.axis, self.fixed_point, self._course(state))


class GrowthWithSensor(CourseOfSensor, frozen=True, tag="thermal-scale-sensor"):
    """The scale of a linear axis follows a temperature, with or without lag, from a fixed point.

    The coefficient is that of the axis minus that of the instrument or of the workpiece with which it is compared.
    """

    TITLE: ClassVar[str] = "thermal growth of an axis with a temperature, with lag"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "um/m/K", 12.0),
        Parameter("lag_s", "s", MINUTES_30, linear=False, lower=0.0, closed=True),
    )

    axis: str
    fixed_point: float = 0.0

    def __post_init__(self) -> None:
        _check_linear(self.axis, self.name)
        super().__post_init__()

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield _growth(machine, state, self.axis, self.fixed_point, self._course(state))


class QuadraticGrowth(EffectBase, frozen=True, tag="thermal-scale-quadratic"):
    """The scale of a linear axis follows a temperature along a curve, from a fixed point: its growth is not linear.

    Per m from the fixed point: coefficient T + quadratic T^2. A screw that is stretched between its bearings grows only
    when its pretension is used up; the expansion coefficient of steel itself rises with the temperature. ISO 230-3;
    Slocum, Precision Machine Design (1992).
    """

    TITLE: ClassVar[str] = "thermal growth of an axis with a temperature and its square"
    NEEDS: ClassVar[tuple[str, ...]] = ("temperatures",)
    LABEL: ClassVar[tuple[str, ...]] = ("sensor",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "um/m/K", 12.0),
        Parameter("quadratic", "um/m/K2", 1.0),
    )

    axis: str
    sensor: str
    coefficient: float
    quadratic: float
    fixed_point: float = 0.0

    def __post_init__(self) -> None:
        _check_linear(self.axis, self.name)
        super().__post_init__()

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        kelvin = state.temperature(self.sensor, self.name)
        yield _growth(machine, state, self.axis, self.fixed_point, np.stack([kelvin, kelvin**2], axis=1))


class GrowthWithDuty(EffectBase, frozen=True, tag="thermal-scale-duty"):
    """The scale of a linear axis grows with its own duty: the screw is warmed by each metre that it travels, and cools.

    Each metre of travel adds the growth, per m from the fixed point, which fades by a first-order lag:
    d growth/dt = coefficient x speed - growth / time constant, from zero at the first row. The speed is the mean one
    between two rows. ISO 230-3 (distortion caused by the motion of linear axes); Mayr et al., CIRP Annals 61/2 (2012).
    """

    TITLE: ClassVar[str] = "thermal growth of an axis with the distance that it has travelled (duty)"
    NEEDS: ClassVar[tuple[str, ...]] = ("time",)
    REMEDY: ClassVar[Remedy] = "none"
    HAS_MEMORY: ClassVar[bool] = True
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("growth", "um/m/m", 0.2),
        Parameter("time_constant_s", "s", MINUTES_30, linear=False, lower=0.0),
    )

    axis: str
    growth: float
    time_constant_s: float
    fixed_point: float = 0.0

    def __post_init__(self) -> None:
        _check_linear(self.axis, self.name)
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        time, position = state.need("time", self.name), state.positions[:, machine.index(self.axis)] * 1e-3
        step, way = np.diff(time), np.abs(np.diff(position))
        late, slope = _at_speed(
            np.divide(way, step, out=np.zeros_like(way), where=step > 0), time, self.time_constant_s
        )
        faded = self.time_constant_s * late
        changed = self.growth * (late + self.time_constant_s * slope)
        yield _growth(machine, state, self.axis, self.fixed_point, np.stack([faded, changed], axis=1))


class DriftWithDuty(EffectBase, frozen=True, tag="thermal-drift-duty"):
    """The tool point follows the speed of the spindle, whose bearings and motor warm up. In the tool's own directions.

    d drift/dt = (growth x speed - drift) / time constant, from zero at the first row: growth is the drift in um per
    1000 rpm after several time constants at that speed. The speed of a row is the mean one since the row before. A
    spindle that grows brings the tool to -Z. Rotations are about the tool reference point. ISO 230-3 (thermal
    distortion caused by the rotating spindle).
    """

    TITLE: ClassVar[str] = "thermal drift of the tool point with the speed of the spindle (duty)"
    ACTS_ON = "tool"
    NEEDS: ClassVar[tuple[str, ...]] = ("spindle_speed", "time")
    REMEDY: ClassVar[Remedy] = "none"
    HAS_MEMORY: ClassVar[bool] = True
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("growth", "um/krpm or urad/krpm", 2.0),
        Parameter("time_constant_s", "s", MINUTES_30, linear=False, lower=0.0),
    )

    component: Component
    growth: float
    time_constant_s: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002  the same on any machine
        """See `EffectBase.columns`."""
        speed, time = state.need("spindle_speed", self.name), state.need("time", self.name)
        late, slope = _at_speed(speed[1:] * 1e-3, time, self.time_constant_s)
        course = np.stack([late, self.growth * slope], axis=1)
        yield Columns(TOOL, COMPONENTS.index(self.component), course * unit_of(self.component)[1])


def workpiece_direction(machine: Machine, state: State, component: Direction) -> Array:
    """A direction of the workpiece `(n, 3)` in the error frame of the machine's first axis.

    Errors of an axis that carries the workpiece lie behind its own turn.
    """
    axis, own = machine.axes[0], np.eye(3)[["XYZ".index(component)]]
    if axis.side == "workpiece":
        own = turn(axis_pose(axis, state.positions[:, 0]).inverse().rotation, own)
    return np.asarray(np.broadcast_to(own, (len(state), 3)) @ axis.error_frame)


def _of_workpiece(machine: Machine, state: State, component: Direction, course: Array) -> Iterator[Columns]:
    """Columns of a displacement along a direction of the workpiece, whose course is in um."""
    for k, share in enumerate(workpiece_direction(machine, state, component).T):
        if share.any():
            yield Columns(0, k, share[:, None] * course * UM)


def _check_linear(axis: str, name: str) -> None:
    if axis[0] in "ABC":
        raise ValueError(f"{name}: {axis} has no length that could grow")


def _growth(machine: Machine, state: State, axis: str, fixed_point: float, course: Array) -> Columns:
    """Columns of a growth whose course is in um per m of the distance from the fixed point, mm."""
    i, component, forward = own_motion(machine, axis)
    return Columns(i, component, course * (forward * 1e-3 * UM) * (state.positions[:, [i]] - fixed_point))


def _at_speed(speed: Array, time: Array, lag: float) -> tuple[Array, Array]:
    """`lagged` from zero, for a speed `(n - 1,)` that is constant from one of `n` rows to the next."""
    # a speed that jumps is two rows of the same time
    twice = np.repeat(time, 2)[: 2 * len(time) - 1]
    late, slope = lagged(np.append(0.0, np.repeat(speed, 2))[: len(twice)], twice, lag)
    return late[::2], slope[::2]
