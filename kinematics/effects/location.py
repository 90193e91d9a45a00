"""Axis lines: location errors of ISO 230-1, their jumps, and scales."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import msgspec
import numpy as np

from kinematics.effects.base import (
    BY_DIRECTION,
    UM,
    Component,
    EffectBase,
    Part,
    Remedy,
    own_component,
    own_motion,
)
from kinematics.effects.combined.when import Always, FromMoment
from kinematics.effects.combined.where import AtTool, Direction, OfLine, changed_line
from kinematics.effects.records import Columns, InControl, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State


class LocationError(OfLine, Always, frozen=True, tag="location"):
    """Position or orientation of an axis line (ISO 230-1), E_C0Y, E_B0Z, E_X0C, E_A0B, ..., tool relative to workpiece.

    An orientation error of a linear axis tilts its line, so its carriage leaves the nominal direction d by
    angle x d per mm and does not turn: E_XY = -E_C0Y y, E_YX = E_C0X x, E_XZ = E_B0Z z. All others are the constants of
    the error motions: the line of a rotary axis in the head lies at the value, that of a table at minus the value.
    """

    TITLE: ClassVar[str] = "location error of an axis line (squareness, position and tilt of a rotary axis)"
    OF_AXIS_LINE = True
    CONTROL_PARAMETER = "rotary"
    OF_ISO_230 = True
    SHOWN_OVER = "position"
    SHOWN_BY = "a second tool vector, and positions over the whole travel"
    WORKSHOP = Workshop(
        "Assembly or a collision: guides that are not square, a rotary axis beside its nominal line.",
        "Set the axis line or the kinematic parameters of the control; after a collision check the fixing screws.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("value", BY_DIRECTION, 50.0),)

    component: Component
    axis: str
    value: float

    @property
    def name(self) -> str:
        """E_C0Y, E_X0C, ..."""
        return f"E_{self.component}0{self.axis}"

    @property
    def meaning(self) -> str:
        """Squareness of two linear axes; zero, position or tilt of a rotary axis (ISO 230-1)."""
        return self.line_name

    @property
    def line_name(self) -> str:
        """The property of the axis line of which it is the error."""
        return line_name(self.component, self.axis)

    @property
    def part(self) -> Part:
        """Of the axis line."""
        return "line"

    def beyond_kinematics(self, machine: Machine) -> str:
        """See `EffectBase.beyond_kinematics`."""
        axis = machine.axes[machine.index(self.axis)]
        if not axis.rotary:
            return "location error of a linear axis"
        if self.component == axis.name[0]:
            return "zero angle of the axis: its reference position"
        return "tilt of the line" if self.component in "ABC" else "displacement that these parameters do not have"

    def in_control(self, machine: Machine) -> InControl | None:
        """The actual line of a rotary axis.

        It lies at the value for an axis of the head, at minus the value for one of the table.
        """
        axis = machine.axes[machine.index(self.axis)]
        if not axis.rotary:
            return None
        side = 1.0 if axis.side == "tool" else -1.0
        if self.component in "ABC":
            tilt = f"the line is tilted by {side * self.value:.3f} urad about {self.component}"
            return InControl(self.name, f"{self.value:.3f} urad: {tilt}")
        shift = axis.error_frame[:, "XYZ".index(self.component)] * self.value * UM * side
        x, y, z = np.asarray(axis.point) + shift
        line = f"the line lies at X {x:.6f} Y {y:.6f} Z {z:.6f} mm instead of {list(axis.point)}"
        return InControl(self.name, f"{self.value:.3f} um: {line}")


class LocationJump(OfLine, FromMoment, frozen=True, tag="location-jump"):
    """A location error (see `location`) that appears at a moment: the reference of an axis is lost, its zero jumps
    (E_X0X); squareness changes in a collision (E_C0Y); a table is shifted (E_X0C).

    Zero before `since_s`; without it the jump has happened before the data and is permanent, as in a calibration. The
    line of a linear axis turns about the position `fixed_point` of its axis.
    ISO 230-1:2012 (location errors); Schwenke et al., CIRP Annals 57/2 (2008): drift and sudden changes of geometry.
    """

    TITLE: ClassVar[str] = "jump of a location error at a moment (zero of an axis, squareness after a collision)"
    RARE = True
    SHOWN_OVER = "time"
    SHOWN_BY = "the same positions before and after the moment, and fixed references on the bed"
    WORKSHOP = Workshop(
        "A collision, a lost reference point or a loosened fixing between two measurements.",
        "Find the event at the given moment, reference the axis again, check the screws; measure again.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("value", BY_DIRECTION, 50.0),)

    component: Component
    axis: str
    value: float
    since_s: float | None = None
    fixed_point: float = 0.0
    """Position of a linear axis, mm, that the turn of its line leaves where it is."""
    since_touch_off: bool | msgspec.UnsetType = msgspec.UNSET
    """True where it came after the work offsets were touched off, which therefore do not contain it."""

    @property
    def turns(self) -> bool:
        """True where the line of a linear axis turns."""
        return self.axis[0] not in "ABC" and self.component in "ABC"

    @property
    def has_fixed_point(self) -> bool:
        """Where the line turns; see `EffectBase.has_fixed_point`."""
        return self.turns

    @property
    def name(self) -> str:
        """`location-jump E_C0Y`."""
        return f"{self.kind} E_{self.component}0{self.axis}"

    @property
    def part(self) -> Part:
        """Of the axis line, as the location error that it changes; the zero of an axis is its positioning."""
        return "own" if self.component == own_component(self.axis) else "line"

    @property
    def meaning(self) -> str:
        """See `EffectBase.meaning`."""
        return changed_line(self.component, self.axis)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Its moment, and the position about which a line turns."""
        about = (f"about {self.axis} {self.fixed_point:.5g} mm",) * bool(self.turns and self.fixed_point)
        return (*super().conditions, *about)

    def lasting(self) -> LocationJump:
        """See `EffectBase.lasting`."""
        return msgspec.structs.replace(self, since_s=None)


class ToolShift(AtTool, Always, frozen=True, tag="tool-shift"):
    """The tool point is displaced in the tool's own directions: a longer spindle or tool, a head that bends.

    A spindle that has grown brings the tool to -Z. On a machine without a rotary axis in the head it is the zero of a
    linear axis; behind such an axis it turns with it. ISO 230-3 (thermal distortion caused by the rotating spindle).
    """

    TITLE: ClassVar[str] = "shift of the tool point in the tool's own directions (length of spindle and tool)"
    OF_AXIS_LINE = True
    SHOWN_OVER = "rows"
    SHOWN_BY = "several positions of the rotary axes of the head"
    WORKSHOP = Workshop(
        "The spindle or the tool has another length than when it was measured.",
        "Measure the length of the tool again at the temperature of the cut.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("value", "um", 20.0),)

    component: Direction
    value: float
    since_touch_off: bool | msgspec.UnsetType = msgspec.UNSET
    """As of `location-jump`."""

    @property
    def line_name(self) -> str:
        """The tool, in its own direction."""
        return f"shift of the tool in its own {self.component}"


class Scale(EffectBase, frozen=True, tag="scale"):
    """The scale of a linear axis: it goes too far by the scale times its position, E_YY = scale y.

    Mean slope of the positioning error over the travel (ISO 230-2, mean bidirectional positional deviation). Positive:
    the axis goes farther than commanded. In a calibration it is part of the error motion; it is a change since then.
    """

    TITLE: ClassVar[str] = "scale of a linear axis (mean slope of its positioning error)"
    REMEDY: ClassVar[Remedy] = "table"
    POSITIONS = "of its axis"
    OF_AXIS_LINE = True
    SHOWN_OVER = "position"
    WORKSHOP = Workshop(
        "A wrong screw pitch or scale factor in the control, or a scale at another temperature.",
        "Correct the scale factor of the axis in the control.",
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "A wrong gear ratio or number of increments in the control.",
        "Correct the gear ratio of the axis in the control.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale", "um/m", 20.0),)

    axis: str
    scale: float
    since_touch_off: bool | msgspec.UnsetType = msgspec.UNSET
    """As of `location-jump`."""

    def __post_init__(self) -> None:
        if self.axis[0] in "ABC":
            raise ValueError(f"{self.name}: {self.axis} is no linear axis")
        super().__post_init__()

    @property
    def line_name(self) -> str:
        """The property of the axis line of which it is the error."""
        return f"scale of {self.axis}"

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, k, sign = own_motion(machine, self.axis)
        yield Columns(i, k, sign * UM * 1e-3 * state.positions[:, [i]])


def after_touch_off(effect: EffectBase) -> bool:
    """True for a drift that has come since the work offsets were touched off, and goes on."""
    return getattr(effect, "since_touch_off", False) is True


def line_name(component: str, axis: str) -> str:
    """Name of a location error by ISO 230-1: squareness of two linear axes, position and tilt of a rotary axis."""
    along = own_component(axis)
    if component == along:
        return f"zero of {axis}"
    if axis[0] in "ABC":
        return f"{'position' if component in 'XYZ' else 'tilt'} of the line of {axis} " + (
            f"in {component}" if component in "XYZ" else f"about {'XYZ'['ABC'.index(component)]}"
        )
    (other,) = (letter for letter in "XYZ" if letter not in (along, "XYZ"["ABC".index(component)]))
    return f"squareness of {axis} to {other}"
