"""Where: the places at which errors follow a course of `when.py`, with what they have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from kinematics.basis import Basis, Interval, Legendre
from kinematics.effects.base import (
    COMPONENTS,
    INSTRUMENT,
    TOOL,
    UM,
    URAD,
    Acting,
    Component,
    EffectBase,
    Positions,
    Remedy,
    own_component,
    own_motion,
    unit_of,
)
from kinematics.effects.records import Columns
from kinematics.forward import axis_pose
from kinematics.machine import Machine
from kinematics.state import State, general_state
from kinematics.transforms import ROUNDING_OF_DIRECTION, Array, by_turn, turn

Direction = Literal["X", "Y", "Z"]
SHUFFLED = "positions in shuffled order, or measured once more backwards, with times"
SHUFFLED_WITH_HEAT = f"{SHUFFLED} and temperatures"


class AtTool:
    """The tool point, in the tool's own directions; rotations are about the tool reference point."""

    __slots__ = ()

    ACTS_ON: ClassVar[Acting] = "tool"
    POSITIONS: ClassVar[Positions] = "none"
    SHOWN_OVER: ClassVar[str] = "heat"
    SHOWN_BY: ClassVar[str] = SHUFFLED

    component: Component

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:  # noqa: ARG002
        """See `Course.at_place`."""
        yield Columns(TOOL, COMPONENTS.index(self.component), course * unit_of(self.component)[1])


class AtWorkpiece:
    """The workpiece, its fixture or its table, in the workpiece's own directions; of the tool relative to it."""

    __slots__ = ()

    ACTS_ON: ClassVar[Acting] = "workpiece"
    side: ClassVar[Literal["workpiece"]] = "workpiece"
    """The drift is not one of the tool's side."""
    RARE: ClassVar[bool] = True
    SHOWN_OVER: ClassVar[str] = "heat along the workpiece"
    SHOWN_BY: ClassVar[str] = SHUFFLED

    component: Direction

    @property
    def meaning(self) -> str:
        """See `EffectBase.meaning`."""
        return "of the table, the fixture or the part, in the workpiece's directions"

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`."""
        (anywhere,) = workpiece_direction(machine, general_state(machine), self.component)
        shares = workpiece_direction(machine, state, self.component)
        for k in np.flatnonzero(np.abs(anywhere) > ROUNDING_OF_DIRECTION):
            yield Columns(0, int(k), shares[:, [k]] * course * UM)


def workpiece_direction(machine: Machine, state: State, component: Direction) -> Array:
    """A direction of the workpiece `(n, 3)` in the error frame of the machine's first axis.

    Errors of an axis that carries the workpiece lie behind its own turn.
    """
    axis, own = machine.axes[0], np.eye(3)[["XYZ".index(component)]]
    if axis.side == "workpiece":
        own = turn(axis_pose(axis, state.positions[:, 0]).inverse().rotation, own)
    return np.asarray(np.broadcast_to(own, (len(state), 3)) @ axis.error_frame)


class AlongAxis:
    """The positioning of a linear axis, in proportion to the distance from a fixed point, mm."""

    __slots__ = ()

    POSITIONS: ClassVar[Positions] = "of its axis"
    SHOWN_OVER: ClassVar[str] = "heat per metre"
    SHOWN_BY: ClassVar[str] = SHUFFLED_WITH_HEAT

    axis: str
    fixed_point: float

    @property
    def conditions(self) -> tuple[str, ...]:
        """The fixed point; see `EffectBase.conditions`."""
        return (f"from {self.axis} {self.fixed_point:.5g} mm",)

    @property
    def has_fixed_point(self) -> bool:
        """See `EffectBase.has_fixed_point`."""
        return True

    def fault_of_place(self) -> str:
        """See `Course.fault_of_place`."""
        return f"{self.axis} has no length that could grow" if self.axis[0] in "ABC" else ""

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`; the course is per m."""
        i, component, forward = own_motion(machine, self.axis)
        yield Columns(i, component, course * (forward * 1e-3 * UM) * (state.positions[:, [i]] - self.fixed_point))


class InMotion:
    """An error motion of an axis: the Legendre polynomial of a degree over an interval, 1 at its end."""

    __slots__ = ()

    RARE: ClassVar[bool] = True
    SHOWN_OVER: ClassVar[str] = "heat and position"
    SHOWN_BY: ClassVar[str] = SHUFFLED_WITH_HEAT

    component: Component
    axis: str
    interval: Interval
    degree: int

    @property
    def meaning(self) -> str:
        """What changes: roll, pitch or yaw, squareness or straightness, or the line of a rotary axis."""
        if self.axis[0] in "ABC":
            return changed_line(self.component, self.axis)
        if self.component in "ABC":
            return f"roll, pitch or yaw of {self.axis}"
        return f"{'squareness' if self.degree == 1 else 'straightness'} of {self.axis}"

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.interval}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: self._shape.feature_length} if self.degree > 1 else {}

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: self._shape}

    def fault_of_place(self) -> str:
        """See `Course.fault_of_place`; ValueError for an interval without a length."""
        assert self._shape
        return ""

    @property
    def _shape(self) -> Legendre:
        return Legendre(self.interval, self.degree)

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`."""
        shape = state.basis_columns(machine, self.axis, self._shape)[:, -1:]
        component = COMPONENTS.index(self.component)
        yield Columns(machine.index(self.axis), component, course * shape * unit_of(self.component)[1])


class OfLine:
    """Position or orientation of an axis line; the line of a linear axis turns about a fixed point, 0 mm or its own."""

    __slots__ = ()

    POSITIONS: ClassVar[Positions] = "of its axis"

    component: Component
    axis: str

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`."""
        i, j, size = machine.index(self.axis), COMPONENTS.index(self.component), unit_of(self.component)[1]
        axis = machine.axes[i]
        if axis.rotary or j < 3:
            yield Columns(i, j, size * course)
            return
        sideways = axis.tilted[j - 3] * size
        fixed = getattr(self, "fixed_point", 0.0)
        for k in np.flatnonzero(sideways):
            yield Columns(i, int(k), sideways[k] * (state.positions[:, [i]] - fixed) * course)


def changed_line(component: str, axis: str) -> str:
    """What a change of an axis line is of: the zero of the axis, its squareness, or the line of a rotary axis."""
    other = "line" if axis[0] in "ABC" else "squareness"
    return f"{'zero' if component == own_component(axis) else other} of {axis}"


class OfInstrument(EffectBase, frozen=True):
    """An error of the measurement: observed minus true, in the instrument's frame."""

    ACTS_ON = "instrument"
    REMEDY: ClassVar[Remedy] = "none"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed",)


class AtStation(OfInstrument, frozen=True):
    """The pose of the instrument: three shifts, um, and three turns about its origin, urad."""

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:  # noqa: ARG002
        """See `Course.at_place`; observations move in the opposite direction."""
        points = state.need("observed", self.name)
        points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))  # an instrument may observe x and y alone
        values = np.empty((len(points), 3, 6))
        values[:, :, :3] = -np.eye(3) * UM
        values[:, :, 3:] = -by_turn(points) * URAD
        yield from observed(values * course[:, :, None])


class InRange(OfInstrument, frozen=True):
    """The ranges of a laser tracker: too long by the same length."""

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:  # noqa: ARG002
        """See `Course.at_place`."""
        yield from observed((beam(state.need("observed", self.name)).direction * course)[:, :, None] * UM)


class InAir(OfInstrument, frozen=True):
    """The ranges of an instrument: too long in proportion, um per m."""

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:  # noqa: ARG002
        """See `Course.at_place`."""
        yield from observed((state.need("observed", self.name) * course)[:, :, None] * 1e-3 * UM)


def in_station(state: State, station: str, purpose: str) -> Array:
    """1 `(n, 1)` in the rows of a station, 0 in others."""
    return np.where(state.need("station", purpose) == station, 1.0, 0.0)[:, None]


def observed(values: Array) -> Iterator[Columns]:
    """Columns of the observed x, y and z, from derivatives `(n, 3, parameters)`."""
    for k in range(3):
        yield Columns(INSTRUMENT, k, values[:, k])


class Beam(NamedTuple):
    """Beams to points, as a tracker reads them."""

    direction: Array
    """Unit vectors `(n, 3)`."""
    sideways: Array
    """Displacements `(n, 3)` of the points by the azimuth, mm per rad."""
    upwards: Array
    """Displacements `(n, 3)` of the points by the elevation, mm per rad."""
    angles: Array
    """Azimuth and elevation `(n, 2)`, rad."""


def beam(points: Array) -> Beam:
    """The beams to points `(n, 3)` of the instrument's frame."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    length = np.hypot(flat, z)
    azimuth, elevation = np.arctan2(y, x), np.arctan2(z, flat)
    sideways = np.stack([-y, x, np.zeros_like(x)], axis=1)
    upwards = np.stack([-z * np.cos(azimuth), -z * np.sin(azimuth), flat], axis=1)
    return Beam(points / length[:, None], sideways, upwards, np.stack([azimuth, elevation], axis=1))
