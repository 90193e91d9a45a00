"""The instrument: errors of the measurement, which leave the data and never enter the machine.

Observations are points in the instrument's frame, its beam starting in the origin; azimuth about z from x, elevation
from the x y plane. Errors are observed minus true; they are subtracted from the observations.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, NamedTuple

import msgspec
import numpy as np

from kinematics.effects.base import (
    BY_DIRECTION,
    HOUR,
    INSTRUMENT,
    TOOL,
    UM,
    URAD,
    Columns,
    EffectBase,
    Parameter,
    Remedy,
    own_motion,
    unit_of,
)
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, by_turn
from kinematics.user_error import UserError

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
Circle = Literal["azimuth", "elevation"]
CIRCLES: tuple[Circle, ...] = ("azimuth", "elevation")
"""Circles of a tracker, in the order of `Beam.angles`."""


class _Instrument(EffectBase, frozen=True):
    ACTS_ON = "instrument"
    REMEDY: ClassVar[Remedy] = "none"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed",)


class StationShift(_Instrument, frozen=True, tag="station-shift"):
    """The pose of the instrument in one set-up differs from its registration: shifted, and turned about its origin.

    With `since_s` it holds from this time on: the instrument was knocked. In the instrument's own frame; its
    observations move in the opposite direction.
    """

    TITLE: ClassVar[str] = "shift of an instrument station"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "station", "time")
    LABEL: ClassVar[tuple[str, ...]] = ("station",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("shift_um", "um", 20.0),
        Parameter("turn_urad", "urad", 20.0),
    )

    station: str
    shift_um: Vector = ZERO
    turn_urad: Vector = ZERO
    since_s: float | None = None

    @property
    def needs(self) -> tuple[str, ...]:
        """Time only with `since_s`."""
        return self.NEEDS[:2] if self.since_s is None else self.NEEDS

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        here = (state.need("station", self.name) == self.station) & _since(state, self.since_s, self.name)
        yield from _moved(state.need("observed", self.name), here.astype(float))


class TrackerDrift(_Instrument, frozen=True, tag="tracker-drift"):
    """The instrument moves on its base with time, from time 0: shifts, and turns about its origin, at constant rates.

    In the instrument's own frame; its observations move in the opposite direction.
    """

    TITLE: ClassVar[str] = "drift of the instrument on its base"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "time")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("shift_um_per_h", "um/h", 10.0),
        Parameter("turn_urad_per_h", "urad/h", 10.0),
    )

    shift_um_per_h: Vector = ZERO
    turn_urad_per_h: Vector = ZERO

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        yield from _moved(state.need("observed", self.name), _hours(state, self.name)[:, 0])


class RangeOffset(_Instrument, frozen=True, tag="tracker-range"):
    """All ranges are read too long by the same length (birdbath, ADM offset)."""

    TITLE: ClassVar[str] = "range offset of the tracker"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 10.0),)

    offset_um: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        yield from _observed(beam(state.need("observed", self.name)).direction[:, :, None] * UM)


class AirScale(_Instrument, frozen=True, tag="air-scale"):
    """All ranges are read too long in proportion: refractive index of the air, wavelength."""

    TITLE: ClassVar[str] = "scale of the instrument (refractive index of the air)"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale_um_per_m", "um/m", 2.0),)

    scale_um_per_m: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        yield from _observed(state.need("observed", self.name)[:, :, None] * 1e-3 * UM)


class RangeDrift(_Instrument, frozen=True, tag="tracker-range-drift"):
    """The range offset grows with time, from time 0, at a constant rate: the tracker's head or its ADM warms up.

    Muralikrishnan, Phillips, Sawyer: Laser trackers for large-scale dimensional metrology, a review. Precision
    Engineering 44 (2016).
    """

    TITLE: ClassVar[str] = "drift of the tracker's range offset with time"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "time")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_um_per_h", "um/h", 10.0),)

    rate_um_per_h: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        direction = beam(state.need("observed", self.name)).direction
        yield from _observed((direction * _hours(state, self.name))[:, :, None] * UM)


class AirDrift(_Instrument, frozen=True, tag="air-scale-drift"):
    """The scale of the instrument grows with time, from time 0, at a constant rate: the air warms, or its pressure
    falls, and the instrument does not know it.

    Ranges are read too short by 1 um/m for each K that the air is warmer than the instrument assumes, and by 0.27 um/m
    for each hPa less (Edlen's formula, in Muralikrishnan et al., Precision Engineering 44 (2016)).
    """

    TITLE: ClassVar[str] = "drift of the instrument's scale with time (temperature and pressure of the air)"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "time")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_um_per_m_per_h", "um/m/h", 2.0),)

    rate_um_per_m_per_h: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        points = state.need("observed", self.name)
        yield from _observed((points * _hours(state, self.name))[:, :, None] * 1e-3 * UM)


class MeasuringMachineScale(_Instrument, frozen=True, tag="cmm-scale"):
    """The measuring machine that measures a part reads one of its coordinates too long in proportion.

    Also the temperature of the part, if the measuring machine does not correct it. ISO 10360-2; Schwenke et al., CIRP
    Annals 57/2 (2008).
    """

    TITLE: ClassVar[str] = "scale of the coordinate measuring machine, or temperature of the part on it"
    LABEL: ClassVar[tuple[str, ...]] = ("direction",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale_um_per_m", "um/m", 5.0),)

    direction: Literal["x", "y", "z"]
    scale_um_per_m: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        k = "xyz".index(self.direction)
        yield Columns(INSTRUMENT, k, state.need("observed", self.name)[:, [k]] * 1e-3 * UM)


class MeasuringMachineSquareness(_Instrument, frozen=True, tag="cmm-squareness"):
    """Two axes of the measuring machine that measures a part are not square to each other.

    The first coordinate of the plane is read too long by angle x the second: the angle between the two axes, as the
    measuring machine takes them for square, exceeds 90 degrees by it. ISO 10360-2; ISO 230-1:2012.
    """

    TITLE: ClassVar[str] = "squareness of the coordinate measuring machine"
    LABEL: ClassVar[tuple[str, ...]] = ("plane",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("angle_urad", "urad", 5.0),)

    plane: Literal["xy", "xz", "yz"]
    angle_urad: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        first, second = ("xyz".index(letter) for letter in self.plane)
        yield Columns(INSTRUMENT, first, state.need("observed", self.name)[:, [second]] * URAD)


class AngleHarmonic(_Instrument, frozen=True, tag="tracker-angle"):
    """One harmonic of an angle encoder's error (eccentricity: 1 or 2 per turn).

    The circle reads sine sin(n angle) + cosine cos(n angle) too much.
    """

    TITLE: ClassVar[str] = "azimuth or elevation encoder of the tracker, one harmonic"
    LABEL: ClassVar[tuple[str, ...]] = ("circle", "harmonic")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sine_urad", "urad", 10.0),
        Parameter("cosine_urad", "urad", 10.0),
    )

    circle: Circle
    harmonic: Annotated[int, msgspec.Meta(ge=1)]
    sine_urad: float
    cosine_urad: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        _, sideways, upwards, angles = beam(state.need("observed", self.name))
        arm, angle = (sideways, angles[:, 0]) if self.circle == "azimuth" else (upwards, angles[:, 1])
        waves = np.stack([np.sin(self.harmonic * angle), np.cos(self.harmonic * angle)], axis=1) * URAD
        yield from _observed(arm[:, :, None] * waves[:, None, :])


class AngleStep(_Instrument, frozen=True, tag="tracker-angle-step"):
    """An angle encoder of the tracker loses counts where a circle passes an angle, and gains them on its way back.

    The circle reads step too much in all rows in which the other one, or the circle itself, is at `above_deg` or up to
    half a turn beyond it.
    """

    TITLE: ClassVar[str] = "azimuth or elevation encoder of the tracker, a step at one angle (lost counts)"
    LABEL: ClassVar[tuple[str, ...]] = ("circle", "over")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("step_urad", "urad", 10.0),)

    circle: Circle
    over: Circle
    """The circle whose reading decides."""
    above_deg: float
    step_urad: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        _, sideways, upwards, angles = beam(state.need("observed", self.name))
        beyond = angles[:, CIRCLES.index(self.over)] - np.radians(self.above_deg)
        here = np.mod(beyond, 2.0 * np.pi) < np.pi
        arm = sideways if self.circle == "azimuth" else upwards
        yield from _observed((arm * here[:, None])[:, :, None] * URAD)


class TargetOffset(_Instrument, frozen=True, tag="target-offset"):
    """The position of a target on the tool differs from its stated vector, in the tool's own directions.

    With `since_s` it holds from this time on: the target was taken out and seated again, or the tool has slipped.
    """

    TITLE: ClassVar[str] = "offset of a target in its nest"
    NEEDS: ClassVar[tuple[str, ...]] = ("target", "time")
    LABEL: ClassVar[tuple[str, ...]] = ("target",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 50.0),)

    target: str
    offset_um: Vector
    since_s: float | None = None

    @property
    def needs(self) -> tuple[str, ...]:
        """Time only with `since_s`."""
        return self.NEEDS[:1] if self.since_s is None else self.NEEDS

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        here = (state.need("target", self.name) == self.target) & _since(state, self.since_s, self.name)
        for k in range(3):
            yield Columns(TOOL, k, here[:, None] * UM * np.eye(3)[k])


class LateReadBack(_Instrument, frozen=True, tag="late-read-back"):
    """The axis positions of an observation are late, or the two clocks differ: the machine had moved on.

    Every axis is lag x velocity ahead of the recorded position: a following error with the opposite sign that is no
    error of the machine.
    """

    TITLE: ClassVar[str] = "late read-back of the axis positions (clock offset)"
    NEEDS: ClassVar[tuple[str, ...]] = ("velocity",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("lag_ms", "ms", 1.0),)

    lag_ms: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        velocity = state.need("velocity", self.name)
        for axis in machine.names:
            i, component, forward = own_motion(machine, axis)
            yield Columns(i, component, 1e-3 * forward * velocity[:, [i]])


class UnknownApproach(_Instrument, frozen=True, tag="unknown-approach"):
    """Error of an axis in the rows before its first move, where the direction of its approach is unknown.

    The direction decides on which side of its lost motion the axis was: half the reversal value of ISO 230-2, with
    either sign.
    """

    TITLE: ClassVar[str] = "error of an axis before its first move, approached from an unknown side"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset", BY_DIRECTION, 10.0),)

    axis: str
    offset: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        unknown = state.need("approach", self.name)[:, [i]] == 0.0
        yield Columns(i, component, forward * unit_of(self.axis)[1] * unknown)


class Outliers(_Instrument, frozen=True, tag="outliers"):
    """Rows of the data, counted from 0, that are wrong: the deviation x y z of each in the instrument's frame."""

    TITLE: ClassVar[str] = "outliers"
    NEEDS: ClassVar[tuple[str, ...]] = ()
    HAS_MEMORY: ClassVar[bool] = True
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("shift_um", "um", float("inf")),)

    rows: tuple[Annotated[int, msgspec.Meta(ge=0)], ...]
    shift_um: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shift_um) != 3 * len(self.rows):
            raise ValueError(f"{self.name}: three numbers for each of its {len(self.rows)} rows")
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        if max(self.rows, default=-1) >= len(state):
            raise UserError(f"{self.name}: there is no row {max(self.rows)} in {len(state)} rows")
        values = np.zeros((len(state), 3, len(self.shift_um)))
        for i, row in enumerate(self.rows):
            values[row, :, 3 * i : 3 * i + 3] = np.eye(3) * UM
        yield from _observed(values)


def _since(state: State, moment: float | None, by: str) -> np.ndarray:
    """Mask `(n,)` of the rows from a moment, s, on; all rows without one."""
    return np.ones(len(state), bool) if moment is None else np.asarray(state.need("time", by) >= moment)


def _hours(state: State, by: str) -> Array:
    """Time `(n, 1)`, h."""
    return np.asarray(state.need("time", by)[:, None] / HOUR)


def _observed(values: Array) -> Iterator[Columns]:
    """Columns of the observed x, y and z, from derivatives `(n, 3, parameters)`."""
    for k in range(3):
        yield Columns(INSTRUMENT, k, values[:, k])


def _moved(points: Array, weight: Array) -> Iterator[Columns]:
    """A weighted small motion of the instrument: three shifts (um), three turns about its origin (urad)."""
    values = np.empty((len(points), 3, 6))
    values[:, :, :3] = -np.eye(3) * UM
    values[:, :, 3:] = -by_turn(points) * URAD
    yield from _observed(values * weight[:, None, None])


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
