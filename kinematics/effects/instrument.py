"""The instrument: errors of the measurement, which leave the data and never enter the machine.

Observations are points in the instrument's frame, its beam starting in the origin; azimuth about z from x, elevation
from the x y plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from kinematics.effects.base import HOUR, INSTRUMENT, TOOL, UM, URAD, Cause, Columns, Parameter, Remedy
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

SIX = (Parameter("shift_um", "um", 20.0), Parameter("turn_urad", "urad", 20.0))
Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


class _Instrument(Cause, frozen=True):
    ACTS_ON = "instrument"
    REMEDY: ClassVar[Remedy] = "none"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed",)


class StationShift(_Instrument, frozen=True, tag="station-shift"):
    """One set-up of the instrument stands elsewhere than its registration says."""

    TITLE: ClassVar[str] = "shift of an instrument station"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "station")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = SIX

    station: str
    shift_um: Vector = ZERO
    turn_urad: Vector = ZERO

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        here = (state.need("station", self.name) == self.station).astype(float)
        yield from _rigid(state.need("observed", self.name), here)


class TrackerDrift(_Instrument, frozen=True, tag="tracker-drift"):
    """The instrument moves on its stand with time: um and urad per hour."""

    TITLE: ClassVar[str] = "drift of the instrument on its stand"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "time")

    shift_um: Vector = ZERO
    """Per hour."""
    turn_urad: Vector = ZERO
    """Per hour."""

    def quantities(self) -> tuple[Parameter, ...]:
        """Rates."""
        return Parameter("shift_um", "um/h", 10.0), Parameter("turn_urad", "urad/h", 10.0)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        yield from _rigid(state.need("observed", self.name), state.need("time", self.name) / HOUR)


class RangeOffset(_Instrument, frozen=True, tag="tracker-range"):
    """All ranges are too long by the same length (birdbath, ADM offset)."""

    TITLE: ClassVar[str] = "range offset of the tracker"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 10.0),)

    offset_um: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        beam, _, _, _ = _beam(state.need("observed", self.name))
        yield from _along(beam * UM)


class AirScale(_Instrument, frozen=True, tag="air-scale"):
    """All ranges are too long in proportion: refractive index of the air, wavelength. um per m."""

    TITLE: ClassVar[str] = "scale of the instrument (refractive index of the air)"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale_um_per_m", "um/m", 2.0),)

    scale_um_per_m: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        yield from _along(state.need("observed", self.name) * 1e-3 * UM)


class AngleHarmonic(_Instrument, frozen=True, tag="tracker-angle"):
    """One harmonic of an angle encoder's error (eccentricity: 1 or 2 per turn)."""

    TITLE: ClassVar[str] = "azimuth or elevation encoder of the tracker, one harmonic"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sine_urad", "urad", 10.0),
        Parameter("cosine_urad", "urad", 10.0),
    )

    circle: Literal["azimuth", "elevation"]
    harmonic: Annotated[int, msgspec.Meta(ge=1)]
    sine_urad: float
    cosine_urad: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        _, sideways, upwards, angles = _beam(state.need("observed", self.name))
        arm, angle = (sideways, angles[:, 0]) if self.circle == "azimuth" else (upwards, angles[:, 1])
        waves = np.stack([np.sin(self.harmonic * angle), np.cos(self.harmonic * angle)], axis=1) * URAD
        for k in range(3):
            yield Columns(INSTRUMENT, k, arm[:, [k]] * waves)


class TargetOffset(_Instrument, frozen=True, tag="target-offset"):
    """A target sits elsewhere in its nest than its vector says; in the tool's own directions."""

    TITLE: ClassVar[str] = "offset of a target in its nest"
    NEEDS: ClassVar[tuple[str, ...]] = ("target",)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 50.0),)

    target: str
    offset_um: Vector

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        here = (state.need("target", self.name) == self.target).astype(float)
        for k in range(3):
            values = np.zeros((len(state), 3))
            values[:, k] = here * UM
            yield Columns(TOOL, k, values)


class Outliers(_Instrument, frozen=True, tag="outliers"):
    """Rows that do not belong to the rest: three numbers each, x y z in the instrument's frame."""

    TITLE: ClassVar[str] = "outliers"
    HAS_MEMORY: ClassVar[bool] = True  # it names rows by their number
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("shift_um", "um", float("inf")),)

    rows: tuple[int, ...]
    shift_um: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shift_um) != 3 * len(self.rows):
            raise ValueError(f"{self.name}: three numbers for each of its {len(self.rows)} rows")
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `Cause.columns`."""
        for k in range(3):
            values = np.zeros((len(state), len(self.shift_um)))
            values[list(self.rows), np.arange(k, len(self.shift_um), 3)] = UM
            yield Columns(INSTRUMENT, k, values)


def _rigid(points: Array, weight: Array) -> Iterator[Columns]:
    """A weighted small rigid motion of all points about the origin: three shifts (um), three turns (urad)."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        values = np.zeros((len(points), 6))
        values[:, k] = UM
        values[:, 3 + i] = points[:, j] * URAD
        values[:, 3 + j] = -points[:, i] * URAD
        yield Columns(INSTRUMENT, k, values * weight[:, None])


def _along(displacement: Array) -> Iterator[Columns]:
    for k in range(3):
        yield Columns(INSTRUMENT, k, displacement[:, [k]])


def _beam(points: Array) -> tuple[Array, Array, Array, Array]:
    """Unit beams, and the arms (mm per rad) of azimuth and elevation, each `(n, 3)`; azimuth and elevation `(n, 2)`."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    length = np.sqrt(flat**2 + z**2)
    azimuth, elevation = np.arctan2(y, x), np.arctan2(z, flat)
    sideways = np.stack([-y, x, np.zeros_like(x)], axis=1)
    upwards = np.stack([-z * np.cos(azimuth), -z * np.sin(azimuth), flat], axis=1)
    return points / length[:, None], sideways, upwards, np.stack([azimuth, elevation], axis=1)
