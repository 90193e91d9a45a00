"""Geometry: error motions and location errors of ISO 230-1, and rigid effects that couple axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from kinematics.basis import Basis
from kinematics.effects.base import (
    BY_DIRECTION,
    COMPONENTS,
    UM,
    Component,
    EffectBase,
    Part,
    Remedy,
    unit_of,
)
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array

TYPICAL_MOTION_UM = 30.0
"""um or urad: error motions of machines in good order."""
GEOMETRY = "Level the machine, scrape or shim the guide, or set the axis line; measure again."
Motion = Literal["radial", "tilt"]


class ErrorMotion(EffectBase, frozen=True, tag="error-motion"):
    """One of the six error motions of ISO 230-1 of an axis, E_XX ... E_CC, as a function of its own position."""

    TITLE: ClassVar[str] = "error motion of an axis (positioning, straightness, angular, radial, axial, tilt)"
    REMEDY: ClassVar[Remedy] = "table"
    POSITIONS = "of its axis"
    OF_ISO_230 = True
    IN_POSITIONING = "mean"
    SHOWN_OVER = "position"
    WORKSHOP = Workshop(
        "Form of the guides and of the scale: machining, mounting, wear, a foundation that has moved.", GEOMETRY
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "Bearing, encoder or gear of the rotary axis: eccentric mounting, wear.",
        "Centre the encoder or the plate, check the bearing; measure again.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("parameters", BY_DIRECTION, TYPICAL_MOTION_UM),)

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
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: self.basis.feature_length}

    @property
    def shortest_wave(self) -> tuple[str, float] | None:
        """See `EffectBase.shortest_wave`."""
        length = self.basis.wave_length
        return None if length is None else (self.axis, length)

    @property
    def kinks(self) -> tuple[float, ...]:
        """See `EffectBase.kinks`: the nodes of its table, or the ends of its interval."""
        return self.basis.kinks

    @property
    def shift(self) -> Array:
        """Displacement `(3,)` of the axis' own point, mm per rad, in the axis' error frame: none, it turns about it."""
        return np.zeros(3)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        values = state.basis_columns(machine, self.axis, self.basis) * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), values)


class CentredMotion(ErrorMotion, frozen=True, kw_only=True, tag="centred-motion"):
    """An angular error motion of a linear axis that turns the carriage about any point, while a model is fitted.

    With the centre of the measured points, the prior of the translations refers to these points, wherever the origin of
    the frame lies. It is in no file: a calibration is written about the axis' own point (`at_own_point`).
    """

    about: Vector
    """The point, mm, in the axis' error frame, from the point that `ErrorMotion` turns about."""

    @property
    def shift(self) -> Array:
        """Displacement `(3,)` of the axis' own point, mm per rad, in the axis' error frame."""
        return shift_of(self.component, self.about)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        for turn in super().columns(machine, state):
            yield from with_shift(turn, self.shift)

    def at_own_point(self) -> ErrorMotion:
        """The same turn about the axis' own point: without the displacement of this point."""
        return ErrorMotion(self.component, self.axis, self.basis, self.parameters, u=self.u, note=self.note)


def shift_of(component: Component, about: Vector) -> Array:
    """Displacement `(3,)`, mm per rad, of an axis' own point by an angular error that turns about another point."""
    i, shift = COMPONENTS.index(component) % 3, np.zeros(3)
    shift[i - 2], shift[i - 1] = about[i - 1], -about[i - 2]
    return shift


def with_shift(turn: Columns, shift: Array) -> Iterator[Columns]:
    """An angular error with its displacement `(3,)`, mm per rad, of the axis' own point."""
    yield turn
    for direction in np.flatnonzero(shift).tolist():
        yield Columns(turn.column, direction, turn.values * shift[direction])


class Racking(EffectBase, frozen=True, tag="racking"):
    """A gantry driven on both sides (X1, X2) whose second side leads the first, so that its bridge turns.

    The drives are at the positions `first_mm` and `first_mm + width_mm` of the cross axis. The control uses the first
    drive as the position of the axis; the lead of the second over the first is a function of this position. The tool at
    cross position y is displaced forward by lead (y - first) / width, and turns by lead / width from forward to the
    first side.
    """

    TITLE: ClassVar[str] = "racking of a gantry (X1 against X2)"
    POSITIONS = "of its axis"
    RARE = True
    SHOWN_OVER = "position"
    SHOWN_BY = "positions on both sides of the bridge, with two targets far apart on the tool"
    WORKSHOP = Workshop(
        "The two drives of a gantry are not synchronous, or their scales differ.",
        "Set the gantry offset of the second drive in the control, and check its scale.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("lead_um", "um", TYPICAL_MOTION_UM),)

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
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        return {self.axis: self.basis.feature_length}

    @property
    def part(self) -> Part:
        """It turns the bridge."""
        return "turn"

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
    POSITIONS = "of its axis"
    RARE = True
    SHOWN_OVER = "position"
    SHOWN_BY = "positions over a whole turn, with two targets far apart"
    WORKSHOP = Workshop(
        "Eccentric or tilted bearing, encoder ring or table plate of the rotary axis.",
        "Centre the plate or the encoder ring, or replace the bearing.",
    )
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
    def part(self) -> Part:
        """Radial or tilt error motion."""
        return "across" if self.motion == "radial" else "turn"

    @property
    def shortest_wave(self) -> tuple[str, float]:
        """See `EffectBase.shortest_wave`."""
        return self.axis, 360.0 / self.harmonic

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, own = machine.index(self.axis), "ABC".index(self.axis[0])
        first, size = (3, unit_of("A")[1]) if self.angular else (0, UM)
        angle = self.harmonic * state.positions[:, i]
        cos, sin = np.cos(angle) * size, np.sin(angle) * size
        yield Columns(i, first + (own + 1) % 3, np.stack([cos, sin], axis=1))
        yield Columns(i, first + (own + 2) % 3, self.sense * np.stack([sin, -cos], axis=1))
