"""Heat: drift of the tool or of the workpiece, growth and distortion of axes.

Temperatures count from 20 degC. Time counts from the start of the data, at which the errors are zero.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np

from kinematics.basis import Interval
from kinematics.effects.base import BY_DIRECTION, Component
from kinematics.effects.combined.when import WithDuty, WithSensor, WithSquareOfSensor, WithTime, at_speed
from kinematics.effects.combined.where import AlongAxis, AtTool, AtWorkpiece, Direction, InMotion
from kinematics.effects.records import InControl, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

Degree = Annotated[int, msgspec.Meta(ge=0, le=3)]
SPINDLE = "Warm the spindle up, check its bearings and its cooling, or measure the tool again before finishing."
HEAT = "Warm the machine up before measuring and cutting, shield it from draughts and coolant, or add a sensor."
TYPICAL_DRIFT_UM = 20.0
"""um or urad, or um/m, per hour or in all: drift and growth of a machine in a workshop."""
DISTORTION = 10.0
"""um or urad, per hour or in all: distortion of a machine in a workshop."""
STEEL = 12.0
"""um/m/K: expansion of steel."""


class ThermalDrift(AtTool, WithTime, frozen=True, tag="thermal-drift"):
    """The tool point drifts with time: spindle growth, a column that bends. In the tool's own directions.

    rate t + sum of amplitude (1 - exp(-t / time constant)). A spindle that grows brings the tool to -Z. Rotations are
    about the tool reference point.
    """

    TITLE = "thermal drift of the tool point with time (linear, exponential, two time constants)"
    CONTROL_PARAMETER = "growth"
    WORKSHOP = Workshop("Growth of spindle, column or head as the machine warms up.", SPINDLE)
    QUANTITIES = WithTime.sizes(BY_DIRECTION, TYPICAL_DRIFT_UM)

    component: Component


class DriftWithSensor(AtTool, WithSensor, frozen=True, tag="thermal-drift-sensor"):
    """The tool point follows a temperature, with or without lag. In the tool's own directions.

    A first-order lag makes warming and cooling differ. A spindle that grows brings the tool to -Z. Rotations are about
    the tool reference point.
    """

    TITLE = "thermal drift of the tool point with a temperature, with lag"
    DIAGNOSED_AS = "thermal-drift"
    WORKSHOP = Workshop("Growth of spindle, column or head with the temperature of a sensor.", SPINDLE)
    QUANTITIES = WithSensor.sizes(BY_DIRECTION, TYPICAL_DRIFT_UM / 4)

    component: Component


class DriftWithDuty(AtTool, WithDuty, frozen=True, tag="thermal-drift-duty"):
    """The tool point follows the speed of the spindle, whose bearings and motor warm up. In the tool's own directions.

    d drift/dt = (growth x speed - drift) / time constant, from zero at the first row: growth is the drift in um per
    1000 rpm after several time constants at that speed. The speed of a row is the mean one since the row before. A
    spindle that grows brings the tool to -Z. Rotations are about the tool reference point. ISO 230-3 (thermal
    distortion caused by the rotating spindle).
    """

    TITLE = "thermal drift of the tool point with the speed of the spindle (duty)"
    NEEDS = ("spindle_speed", "time")
    POSITIONS = "any"
    SHOWN_OVER = "time"
    SHOWN_BY = "the same positions after spells of different spindle speeds and after rests, with times"
    WORKSHOP = Workshop("Heat of the spindle's bearings by its speed.", SPINDLE)
    QUANTITIES = WithDuty.sizes(BY_DIRECTION, "krpm", 2.0)

    component: Component
    growth: float
    time_constant_s: float

    def course(self, machine: Machine, state: State) -> Array:  # noqa: ARG002
        """See `Course.course`."""
        speed, time = state.need("spindle_speed", self.name), state.need("time", self.name)
        late, slope = at_speed(speed[1:] * 1e-3, time, self.time_constant_s)
        return np.stack([late, self.growth * slope], axis=1)


class WorkpieceDrift(AtWorkpiece, WithTime, frozen=True, tag="thermal-drift-workpiece"):
    """The table, the fixture or the part grows or shifts with time: a drift in the workpiece's own directions.

    rate t + sum of amplitude (1 - exp(-t / time constant)). The drift is that of the tool relative to the workpiece: a
    table that rises brings the tool to -Z. The direction turns with the rotary axes that carry the workpiece, that of a
    drift of the tool point with those of the head. ISO 230-3 (thermal distortion of tables and rotary axes); Mayr et
    al., CIRP Annals 61/2 (2012).
    """

    TITLE = "thermal drift of the workpiece's side with time (linear, exponential, two time constants)"
    DIAGNOSED_AS = "thermal-drift"
    CONTROL_PARAMETER = "growth"
    WORKSHOP = Workshop("The table, the fixture or the part warms up or relaxes.", HEAT)
    QUANTITIES = WithTime.sizes("um", TYPICAL_DRIFT_UM)

    component: Direction


class WorkpieceDriftWithSensor(AtWorkpiece, WithSensor, frozen=True, tag="thermal-drift-workpiece-sensor"):
    """The table, the fixture or the part follows a temperature, with or without lag, in the workpiece's own directions.

    The drift is that of the tool relative to the workpiece: a table that rises brings the tool to -Z. ISO 230-3.
    """

    TITLE = "thermal drift of the workpiece's side with a temperature, with lag"
    DIAGNOSED_AS = "thermal-drift"
    WORKSHOP = Workshop("The table, the fixture or the part follows a temperature.", HEAT)
    QUANTITIES = WithSensor.sizes("um", TYPICAL_DRIFT_UM / 4)

    component: Direction


class GrowthWithTime(AlongAxis, WithTime, frozen=True, tag="thermal-scale"):
    """The scale of a linear axis grows with time: forward of its fixed point the tool is too far forward.

    Per m from the fixed point: rate t + sum of amplitude (1 - exp(-t / time constant)).
    """

    TITLE = "thermal growth of an axis with time"
    CONTROL_PARAMETER = "growth"
    WORKSHOP = Workshop("The screw or the scale of the axis warms up and grows.", HEAT)
    WORKSHOP_OF_ROTARY = Workshop("The drive or the encoder of the axis warms up.", HEAT)
    QUANTITIES = WithTime.sizes("um/m", TYPICAL_DRIFT_UM)

    axis: str
    fixed_point: float = 0.0


class GrowthWithSensor(AlongAxis, WithSensor, frozen=True, tag="thermal-scale-sensor"):
    """The scale of a linear axis follows a temperature, with or without lag, from a fixed point.

    The coefficient is that of the axis minus that of the instrument or of the workpiece with which it is compared.
    """

    TITLE = "thermal growth of an axis with a temperature, with lag"
    DIAGNOSED_AS = "thermal-scale"
    CONTROL_PARAMETER = "growth"
    WORKSHOP = Workshop("The screw or the scale of the axis follows a temperature.", HEAT)
    WORKSHOP_OF_ROTARY = Workshop("The drive or the encoder of the axis follows a temperature.", HEAT)
    QUANTITIES = WithSensor.sizes("um/m", STEEL)

    axis: str
    fixed_point: float = 0.0

    def in_control(self, machine: Machine) -> InControl:  # noqa: ARG002  the same on any machine
        """Its coefficient and its fixed point."""
        value = f"{self.coefficient:.4f} um/m/K of sensor {self.sensor}, fixed at {self.fixed_point:g}"
        return InControl(f"growth of {self.axis}", value)


class QuadraticGrowth(AlongAxis, WithSquareOfSensor, frozen=True, tag="thermal-scale-quadratic"):
    """The scale of a linear axis follows a temperature along a curve, from a fixed point: its growth is not linear.

    Per m from the fixed point: coefficient T + quadratic T^2. A screw that is stretched between its bearings grows only
    when its pretension is used up; the expansion coefficient of steel itself rises with the temperature. ISO 230-3;
    Slocum, Precision Machine Design (1992).
    """

    TITLE = "thermal growth of an axis with a temperature and its square"
    DIAGNOSED_AS = "thermal-scale"
    WORKSHOP = Workshop("The scale and its carrier grow differently with the temperature.", HEAT)
    QUANTITIES = WithSquareOfSensor.sizes("um/m", STEEL, 1.0)

    axis: str
    sensor: str
    coefficient: float
    quadratic: float
    fixed_point: float = 0.0


class GrowthWithDuty(AlongAxis, WithDuty, frozen=True, tag="thermal-scale-duty"):
    """The scale of a linear axis grows with its own duty: the screw is warmed by each metre that it travels, and cools.

    Each metre of travel adds the growth, per m from the fixed point, which fades by a first-order lag:
    d growth/dt = coefficient x speed - growth / time constant, from zero at the first row. The speed is the mean one
    between two rows. ISO 230-3 (distortion caused by the motion of linear axes); Mayr et al., CIRP Annals 61/2 (2012).
    """

    TITLE = "thermal growth of an axis with the distance that it has travelled (duty)"
    RARE = True
    POSITIONS = "any"
    SHOWN_OVER = "time"
    SHOWN_BY = "a log of the axis' temperature, and the same positions once more after a rest"
    WORKSHOP = Workshop("Friction warms the screw as the axis travels.", HEAT)
    QUANTITIES = WithDuty.sizes("um/m", "m", 0.2)

    axis: str
    growth: float
    time_constant_s: float
    fixed_point: float = 0.0

    def course(self, machine: Machine, state: State) -> Array:
        """See `Course.course`."""
        time, position = state.need("time", self.name), state.positions[:, machine.index(self.axis)] * 1e-3
        step, way = np.diff(time), np.abs(np.diff(position))
        late, slope = at_speed(np.divide(way, step, out=np.zeros_like(way), where=step > 0), time, self.time_constant_s)
        return np.stack([self.time_constant_s * late, self.growth * (late + self.time_constant_s * slope)], axis=1)


class DistortionWithTime(InMotion, WithTime, frozen=True, kw_only=True, tag="thermal-distortion"):
    """An error motion of an axis changes with time: a guide that bends, a column that leans, a table that moves.

    Legendre polynomial of the degree over the interval (1 at its end) times rate t + sum of
    amplitude (1 - exp(-t / time constant)). Degree 0 shifts or turns the axis line; degree 1 of a straightness changes
    a squareness, degree 2 bends the guide. ISO 230-3:2020; Mayr et al., Thermal issues in machine tools, CIRP
    Annals 61/2 (2012).
    """

    TITLE = "squareness, straightness, roll or line of an axis that changes with time"
    LABEL = ("degree",)
    WORKSHOP = Workshop("One side of the structure warms up more than the other.", HEAT)
    QUANTITIES = WithTime.sizes(BY_DIRECTION, DISTORTION)

    component: Component
    axis: str
    interval: Interval
    degree: Degree


class DistortionWithSensor(InMotion, WithSensor, frozen=True, kw_only=True, tag="thermal-distortion-sensor"):
    """An error motion of an axis follows a temperature, with or without lag: a guide bends, a column leans.

    Legendre polynomial of the degree over the interval (1 at its end) times coefficient T; degrees as in
    `thermal-distortion`. ISO 230-3:2020 (environmental temperature variation error).
    """

    TITLE = "squareness, straightness, roll or line of an axis that follows a temperature"
    LABEL = ("degree", "sensor")
    DIAGNOSED_AS = "thermal-distortion"
    WORKSHOP = Workshop("One side of the structure follows a temperature more than another.", HEAT)
    QUANTITIES = WithSensor.sizes(BY_DIRECTION, DISTORTION / 4)

    component: Component
    axis: str
    interval: Interval
    degree: Degree
