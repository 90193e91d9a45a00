"""Geometry: error motions and location errors of ISO 230-1, and rigid effects that couple axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from kinematics.basis import Basis, Interval, Legendre
from kinematics.effects.base import (
    BY_DIRECTION,
    COMPONENTS,
    UM,
    Columns,
    Component,
    EffectBase,
    Parameter,
    Remedy,
    own_motion,
    unit_of,
)
from kinematics.machine import Machine
from kinematics.state import State

TYPICAL = 30.0
"""um or urad: error motions of machines in good order."""


Motion = Literal["radial", "tilt"]


class ErrorMotion(EffectBase, frozen=True, tag="error-motion"):
    """One of the six error motions of ISO 230-1 of an axis, E_XX ... E_CC, as a function of its own position."""

    TITLE: ClassVar[str] = "error motion of an axis (positioning, straightness, angular, radial, axial, tilt)"
    REMEDY: ClassVar[Remedy] = "table"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("parameters", BY_DIRECTION, TYPICAL),)

    component: Component
    axis: str
    basis: Basis
    parameters: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.parameters) != self.basis.size or len(self.uncertainties) != self.basis.size:
            raise ValueError(
                f"{self.name}: its basis takes {self.basis.size} parameters with as many u, "
                f"got {len(self.parameters)} and {len(self.uncertainties)}"
            )
        super().__post_init__()

    @property
    def name(self) -> str:
        """E_XX, E_CY, ..."""
        return f"E_{self.component}{self.axis}"

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.basis.interval}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: self.basis.feature_length}

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: self.basis}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        values = state.basis_columns(machine, self.axis, self.basis) * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), values)


class LocationError(EffectBase, frozen=True, tag="location"):
    """Position or orientation of an axis line (ISO 230-1), E_C0Y, E_B0Z, E_X0C, E_A0B, ..., tool relative to workpiece.

    An orientation error of a linear axis tilts its line, so its carriage leaves the nominal direction d by
    angle x d per mm and does not turn: E_XY = -E_C0Y y, E_YX = E_C0X x, E_XZ = E_B0Z z. All others are the constants of
    the error motions: the line of a rotary axis in the head lies at the value, that of a table at minus the value.
    """

    TITLE: ClassVar[str] = "location error of an axis line (squareness, position and tilt of a rotary axis)"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("value", BY_DIRECTION, 50.0),)

    component: Component
    axis: str
    value: float

    @property
    def name(self) -> str:
        """E_C0Y, E_X0C, ..."""
        return f"E_{self.component}0{self.axis}"

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        yield from _of_line(machine, state, self.component, self.axis)


class LocationJump(EffectBase, frozen=True, tag="location-jump"):
    """A location error (see `location`) that appears at a moment: the reference of an axis is lost, its zero jumps
    (E_X0X); squareness changes in a collision (E_C0Y); a table is shifted (E_X0C).

    Zero before `since_s`; without it the jump has happened before the data and is permanent, as in a calibration. The
    line of a linear axis turns about the position `fixed_point` of its axis.
    ISO 230-1:2012 (location errors); Schwenke et al., CIRP Annals 57/2 (2008): drift and sudden changes of geometry.
    """

    TITLE: ClassVar[str] = "jump of a location error at a moment (zero of an axis, squareness after a collision)"
    NEEDS: ClassVar[tuple[str, ...]] = ("time",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("value", BY_DIRECTION, 50.0),)

    component: Component
    axis: str
    value: float
    since_s: float | None = None
    fixed_point: float = 0.0
    """Position of a linear axis, mm, that the turn of its line leaves where it is."""

    @property
    def turns(self) -> bool:
        """True where the line of a linear axis turns."""
        return self.axis[0] not in "ABC" and self.component in "ABC"

    @property
    def name(self) -> str:
        """`location-jump E_C0Y`."""
        return f"{self.kind} E_{self.component}0{self.axis}"

    @property
    def needs(self) -> tuple[str, ...]:
        """Time only with `since_s`."""
        return () if self.since_s is None else self.NEEDS

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        after = 1.0 if self.since_s is None else (state.need("time", self.name) >= self.since_s)[:, None]
        for column in _of_line(machine, state, self.component, self.axis, self.fixed_point):
            yield column._replace(values=column.values * after)


class Scale(EffectBase, frozen=True, tag="scale"):
    """The scale of a linear axis: it goes too far by the scale times its position, E_YY = scale y.

    Mean slope of the positioning error over the travel (ISO 230-2, mean bidirectional positional deviation). Positive:
    the axis goes farther than commanded. In a calibration it is part of the error motion; it is a change since then.
    """

    TITLE: ClassVar[str] = "scale of a linear axis (mean slope of its positioning error)"
    REMEDY: ClassVar[Remedy] = "table"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale", "um/m", 20.0),)

    axis: str
    scale: float

    def __post_init__(self) -> None:
        if self.axis[0] in "ABC":
            raise ValueError(f"{self.name}: {self.axis} is no linear axis")
        super().__post_init__()

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, k, sign = own_motion(machine, self.axis)
        yield Columns(i, k, sign * UM * 1e-3 * state.positions[:, [i]])


class CrossAxis(EffectBase, frozen=True, tag="cross-axis"):
    """An error motion of one axis that also depends on the position of another: sag, twist, mass shift.

    Products P_i(own) P_j(other) of Legendre polynomials over both intervals, i = 0 ... own_degree, j = 1 ...
    other_degree, i running first; the part that does not depend on the other axis (j = 0) is the error motion itself.
    """

    TITLE: ClassVar[str] = "error motion that also depends on another axis (sag, twist, mass shift)"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("coefficients", BY_DIRECTION, TYPICAL / 3),)

    component: Component
    axis: str
    other: str
    own_interval: Interval
    other_interval: Interval
    own_degree: Annotated[int, msgspec.Meta(ge=0, le=12)]
    other_degree: Annotated[int, msgspec.Meta(ge=1, le=12)]
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        own, other = self._bases()
        if len(self.coefficients) != own.size * (other.size - 1):
            raise ValueError(
                f"{self.name}: these degrees take {own.size * (other.size - 1)} coefficients, "
                f"got {len(self.coefficients)}"
            )
        super().__post_init__()

    @property
    def name(self) -> str:
        """E_ZX(Y), ..."""
        return f"E_{self.component}{self.axis}({self.other})"

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.own_interval, self.other: self.other_interval}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        own, other = self._bases()
        return {self.axis: own.feature_length, self.other: other.feature_length}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        bases = zip((self.axis, self.other), self._bases(), strict=True)
        own, other = (state.basis_columns(machine, axis, basis) for axis, basis in bases)
        products = (other[:, 1:, None] * own[:, None, :]).reshape(len(state), len(self.coefficients))
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), products * unit_of(self.component)[1])

    def _bases(self) -> tuple[Legendre, Legendre]:
        return Legendre(self.own_interval, self.own_degree), Legendre(self.other_interval, self.other_degree)


class Racking(EffectBase, frozen=True, tag="racking"):
    """A gantry driven on both sides (X1, X2) whose second side leads the first, so that its bridge turns.

    The drives are at the positions `first_mm` and `first_mm + width_mm` of the cross axis. The control uses the first
    drive as the position of the axis; the lead of the second over the first is a function of this position. The tool at
    cross position y is displaced forward by lead (y - first) / width, and turns by lead / width from forward to the
    first side.
    """

    TITLE: ClassVar[str] = "racking of a gantry (X1 against X2)"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("lead_um", "um", TYPICAL),)

    axis: str
    cross: str
    width_mm: Annotated[float, msgspec.Meta(gt=0)]
    basis: Basis
    lead_um: tuple[float, ...]
    first_mm: float = 0.0

    def __post_init__(self) -> None:
        if len(self.lead_um) != self.basis.size:
            raise ValueError(f"{self.name}: its basis takes {self.basis.size} parameters, got {len(self.lead_um)}")
        super().__post_init__()

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.basis.interval}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: self.basis.feature_length}

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: self.basis}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i = machine.index(self.axis)
        axis, across = machine.axes[i], machine.axes[machine.index(self.cross)].unit_direction
        lead = state.basis_columns(machine, self.axis, self.basis) * UM
        # of the carriage point, and of the bridge about it
        share = (across @ np.asarray(axis.point) - self.first_mm) / self.width_mm
        shift = axis.error_frame.T @ axis.unit_direction * share
        turn = axis.error_frame.T @ np.cross(across, axis.unit_direction) / self.width_mm
        for k, factor in enumerate([*shift, *turn]):
            if factor:
                yield Columns(i, k, factor * lead)


class Wobble(EffectBase, frozen=True, tag="wobble"):
    """One harmonic of the radial or tilt error motion of a rotary axis: the axis line runs round a circle.

    In the two directions across the axis (Y Z for A, Z X for B, X Y for C), at the position q:
    cosine cos(n q) + sine sin(n q) and sense (cosine sin(n q) - sine cos(n q)). Sense +1 runs from the first direction
    to the second with rising q; both senses together are any ellipse. A first harmonic that turns with the part that
    the axis carries (sense +1 in the head, -1 in the table, if the axis runs along its letter) cannot be separated from
    a shift of that part.
    """

    TITLE: ClassVar[str] = "wobble of a rotary axis (radial or tilt, one harmonic)"
    LABEL: ClassVar[tuple[str, ...]] = ("motion", "harmonic", "sense")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("cosine", BY_DIRECTION, 10.0),
        Parameter("sine", BY_DIRECTION, 10.0),
    )

    axis: str
    motion: Motion
    harmonic: Annotated[int, msgspec.Meta(ge=1)]
    sense: Literal[1, -1]
    cosine: float
    sine: float

    def __post_init__(self) -> None:
        if self.axis[0] not in "ABC":
            raise ValueError(f"{self.name}: {self.axis} is no rotary axis")
        super().__post_init__()

    @property
    def angular(self) -> bool:
        """True of a tilt."""
        return self.motion == "tilt"

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: 180.0 / self.harmonic}

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, own = machine.index(self.axis), "ABC".index(self.axis[0])
        first, size = (3, unit_of("A")[1]) if self.angular else (0, UM)
        angle = self.harmonic * state.positions[:, i]
        cos, sin = np.cos(angle) * size, np.sin(angle) * size
        yield Columns(i, first + (own + 1) % 3, np.stack([cos, sin], axis=1))
        yield Columns(i, first + (own + 2) % 3, self.sense * np.stack([sin, -cos], axis=1))


def _of_line(
    machine: Machine, state: State, component: Component, axis_name: str, fixed_point: float = 0.0
) -> Iterator[Columns]:
    """Errors of a location error of 1 um or 1 urad of an axis line, which turns about a position of a linear axis."""
    i, j, size = machine.index(axis_name), COMPONENTS.index(component), unit_of(component)[1]
    axis = machine.axes[i]
    if axis.rotary or j < 3:
        yield Columns(i, j, np.full((len(state), 1), size))
        return
    tilt = axis.error_frame[:, j - 3]
    sideways = axis.error_frame.T @ np.cross(tilt, axis.unit_direction) * size
    for k in np.flatnonzero(sideways):
        yield Columns(i, int(k), sideways[k] * (state.positions[:, [i]] - fixed_point))
