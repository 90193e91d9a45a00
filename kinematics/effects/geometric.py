"""Geometry: error motions and location errors of ISO 230-1, and rigid effects that couple axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np
from numpy.polynomial import legendre

from kinematics.basis import Basis, Interval
from kinematics.effects.base import COMPONENTS, UM, Cause, Columns, Component, Parameter, Remedy, unit_of
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

TYPICAL = 30.0
"""um or urad: error motions of machines in good order."""


class ErrorMotion(Cause, frozen=True, tag="error-motion"):
    """One of the six error motions of ISO 230-1 of an axis, E_XX ... E_CC, as a function of its own position."""

    TITLE: ClassVar[str] = "error motion of an axis (positioning, straightness, angular, radial, axial, tilt)"
    REMEDY: ClassVar[Remedy] = "table"

    component: Component
    axis: str
    basis: Basis
    parameters: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.parameters) != self.basis.size or len(self.uncertainties) != self.basis.size:
            raise ValueError(
                f"{self.name}: its basis takes {self.basis.size} parameters with as many u, "
                f"got {len(self.parameters)} and {len(self.u)}"
            )

    @property
    def name(self) -> str:
        """E_XX, E_CY, ..."""
        return f"E_{self.component}{self.axis}"

    @property
    def interval(self) -> Interval | None:
        """Positions of its axis that it is known for, mm or degrees."""
        return self.basis.interval

    def quantities(self) -> tuple[Parameter, ...]:
        """Its coefficients."""
        return (Parameter("parameters", unit_of(self.component)[0], TYPICAL),)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        values = self.basis.columns(state.position(machine, self.axis)) * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), values)


class LocationError(Cause, frozen=True, tag="location"):
    """Position or orientation of an axis line (ISO 230-1), E_C0Y, E_B0Z, E_X0C, E_A0B, ..., tool relative to workpiece.

    An orientation error of a linear axis tilts its line, so its carriage leaves the nominal direction d by
    angle x d per mm and does not turn: E_XY = -E_C0Y y, E_YX = E_C0X x, E_XZ = E_B0Z z. All others are the constants of
    the error motions: the line of a rotary axis in the head lies at the value, that of a table at minus the value.
    """

    TITLE: ClassVar[str] = "location error of an axis line (squareness, position and tilt of a rotary axis)"

    component: Component
    axis: str
    value: float

    @property
    def name(self) -> str:
        """E_C0Y, E_X0C, ..."""
        return f"E_{self.component}0{self.axis}"

    def quantities(self) -> tuple[Parameter, ...]:
        """Its value."""
        return (Parameter("value", unit_of(self.component)[0], 50.0),)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        i, j, size = machine.index(self.axis), COMPONENTS.index(self.component), unit_of(self.component)[1]
        axis = machine.axes[i]
        if axis.rotary or j < 3:
            yield Columns(i, j, np.full((len(state), 1), size))
            return
        turn = axis.error_frame[:, j - 3]
        sideways = axis.error_frame.T @ np.cross(turn, axis.unit_direction) * size
        for k in np.flatnonzero(sideways):
            yield Columns(i, int(k), sideways[k] * state.positions[:, [i]])


class CrossAxis(Cause, frozen=True, tag="cross-axis"):
    """An error motion of one axis that also depends on the position of another: sag, twist, mass shift.

    Products P_i(own) P_j(other) of Legendre polynomials over both intervals, i = 0 ... own_degree, j = 1 ...
    other_degree, i running first.
    """

    TITLE: ClassVar[str] = "error motion that also depends on another axis (sag, twist, mass shift)"

    component: Component
    axis: str
    other: str
    own_interval: Interval
    other_interval: Interval
    own_degree: Annotated[int, msgspec.Meta(ge=0, le=12)]
    other_degree: Annotated[int, msgspec.Meta(ge=1, le=12)]
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        size = (self.own_degree + 1) * self.other_degree
        if len(self.coefficients) != size:
            raise ValueError(f"{self.name}: these degrees take {size} coefficients, got {len(self.coefficients)}")
        super().__post_init__()

    @property
    def name(self) -> str:
        """E_ZX(Y), ..."""
        return f"E_{self.component}{self.axis}({self.other})"

    @property
    def interval(self) -> Interval | None:
        """Positions of its own axis that it is known for."""
        return self.own_interval

    def quantities(self) -> tuple[Parameter, ...]:
        """Its coefficients."""
        return (Parameter("coefficients", unit_of(self.component)[0], TYPICAL / 3),)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        own = legendre.legvander(_centred(state.position(machine, self.axis), self.own_interval), self.own_degree)
        other = legendre.legvander(
            _centred(state.position(machine, self.other), self.other_interval), self.other_degree
        )
        products = other[:, 1:, None] * own[:, None, :]
        values = products.reshape(len(state), -1) * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), values)


class Racking(Cause, frozen=True, tag="racking"):
    """A gantry driven on both sides whose second side leads the first: the bridge turns.

    The lead of the side at +width over the side at 0 of the cross axis is a function of the axis' position; the bridge
    turns by lead / width about the first side.
    """

    TITLE: ClassVar[str] = "racking of a gantry (X1 against X2)"

    axis: str
    cross: str
    width_mm: Annotated[float, msgspec.Meta(gt=0)]
    basis: Basis
    lead_um: tuple[float, ...]

    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("lead_um", "um", TYPICAL),)

    def __post_init__(self) -> None:
        if len(self.lead_um) != self.basis.size:
            raise ValueError(f"{self.name}: its basis takes {self.basis.size} parameters, got {len(self.lead_um)}")
        super().__post_init__()

    @property
    def interval(self) -> Interval | None:
        """Positions of its axis that it is known for."""
        return self.basis.interval

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        i = machine.index(self.axis)
        axis, cross = machine.axes[i], machine.axes[machine.index(self.cross)]
        turn = axis.error_frame.T @ np.cross(cross.unit_direction, axis.unit_direction) / self.width_mm
        basis = self.basis.columns(state.position(machine, self.axis)) * UM
        for k in np.flatnonzero(turn):
            yield Columns(i, 3 + int(k), turn[k] * basis)


class Wobble(Cause, frozen=True, tag="wobble"):
    """One harmonic of the radial or tilt error motion of a rotary axis: the axis line runs round a circle.

    In the two directions across the axis (Z X for B): a cos n q + b sin n q and sense (a sin n q - b cos n q).
    """

    TITLE: ClassVar[str] = "wobble of a rotary axis (radial or tilt, one harmonic)"

    axis: str
    motion: Literal["radial", "tilt"]
    harmonic: Annotated[int, msgspec.Meta(ge=1)]
    sense: Literal[1, -1]
    cosine: float
    sine: float

    def quantities(self) -> tuple[Parameter, ...]:
        """Both amplitudes."""
        unit = "um" if self.motion == "radial" else "urad"
        return Parameter("cosine", unit, 10.0), Parameter("sine", unit, 10.0)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        i = machine.index(self.axis)
        own = "ABC".index(self.axis[0])
        shift, size = (0, UM) if self.motion == "radial" else (3, unit_of("A")[1])
        angle = self.harmonic * state.positions[:, i]
        cos, sin = np.cos(angle) * size, np.sin(angle) * size
        yield Columns(i, shift + (own + 1) % 3, np.stack([cos, sin], axis=1))
        yield Columns(i, shift + (own + 2) % 3, self.sense * np.stack([sin, -cos], axis=1))


def _centred(x: Array, interval: Interval) -> Array:
    low, high = interval
    return np.asarray(2.0 * (np.clip(x, low, high) - low) / (high - low) - 1.0)
