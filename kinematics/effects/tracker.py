"""The beam of a laser tracker: errors of its ranges and of its angles, which leave the data with those of instruments.

Its beam starts in the origin of the instrument's frame; azimuth about z from x, elevation from the x y plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from kinematics.effects.base import URAD
from kinematics.effects.combined.when import Always, AtRate, FromMoment
from kinematics.effects.combined.where import InAir, InRange, OfInstrument, beam, in_station, observed
from kinematics.effects.instrument import WARM_UP
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

THREE_STATIONS = "three stations at very different azimuths, or both faces of the tracker"
Circle = Literal["azimuth", "elevation"]
CIRCLES: tuple[Circle, ...] = ("azimuth", "elevation")
"""Circles of a tracker, in the order of `Beam.angles`."""


class RangeOffset(InRange, Always, frozen=True, tag="tracker-range"):
    """All ranges are read too long by the same length (birdbath, ADM offset)."""

    TITLE: ClassVar[str] = "range offset of the tracker"
    SHOWN_OVER = "range"
    SHOWN_BY = "a calibrated bar, or fixed references of known distance (a second station helps)"
    WORKSHOP = Workshop(
        "The home position (birdbath) or the constant of the reflector is wrong.", "Set the home position again."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 10.0),)

    offset_um: float


class RangeJump(InRange, FromMoment, frozen=True, tag="range-jump"):
    """The ranges of one station are read too long from a moment on: a break of the beam that was not noticed."""

    TITLE: ClassVar[str] = "jump of the ranges of a station at a moment (counts lost at a break of the beam)"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "station", "time")
    LABEL: ClassVar[tuple[str, ...]] = ("station",)
    RARE = True
    SHOWN_OVER = "time"
    SHOWN_BY = "positions measured once more behind the moment"
    WORKSHOP = Workshop(
        "The beam was interrupted, or the reflector turned too far, and counts were lost.",
        "Begin a new run in the file where the beam was broken.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 20.0),)

    station: str
    offset_um: float
    since_s: float | None = None

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`: in one station."""
        return super().at_place(machine, state, course * in_station(state, self.station, self.name))


class AirScale(InAir, Always, frozen=True, tag="air-scale"):
    """All ranges are read too long in proportion: refractive index of the air, wavelength."""

    TITLE: ClassVar[str] = "scale of the instrument (refractive index of the air)"
    SHOWN_OVER = "range"
    SHOWN_BY = "a length standard (calibrated bar, interferometer), or barometer and thermometer of the air"
    WORKSHOP = Workshop(
        "Wrong air temperature, pressure or humidity in the instrument.", "Check the weather station; measure again."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale_um_per_m", "um/m", 2.0),)

    scale_um_per_m: float


class RangeDrift(InRange, AtRate, frozen=True, tag="tracker-range-drift"):
    """The range offset grows with time, from time 0, at a constant rate: the tracker's head or its ADM warms up.

    At one station, where one is named: the air changes along a dead path that the instrument does not correct.

    Muralikrishnan, Phillips, Sawyer: Laser trackers for large-scale dimensional metrology, a review. Precision
    Engineering 44 (2016).
    """

    TITLE: ClassVar[str] = "drift of the tracker's range offset with time"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "station", "time")
    RARE = True
    SHOWN_OVER = "time"
    SHOWN_BY = "fixed references, measured again and again, at two distances in line with the tracker"
    WORKSHOP = Workshop("The range unit of the instrument drifts.", WARM_UP)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_um_per_h", "um/h", 10.0),)

    rate_um_per_h: float
    station: str | None = None

    @property
    def name(self) -> str:
        """With the station, where one is named."""
        return self.kind if self.station is None else f"{self.kind} {self.station}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The station only where one is named."""
        return tuple(name for name in self.NEEDS if name != "station" or self.station is not None)

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`: in all stations, or in one."""
        here = 1.0 if self.station is None else in_station(state, self.station, self.name)
        return super().at_place(machine, state, course * here)


class AirDrift(InAir, AtRate, frozen=True, tag="air-scale-drift"):
    """The scale of the instrument grows with time, from time 0, at a constant rate: the air warms, or its pressure
    falls, and the instrument does not know it.

    Ranges are read too short by 1 um/m for each K that the air is warmer than the instrument assumes, and by 0.27 um/m
    for each hPa less (Edlen's formula, in Muralikrishnan et al., Precision Engineering 44 (2016)).
    """

    TITLE: ClassVar[str] = "drift of the instrument's scale with time (temperature and pressure of the air)"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "time")
    RARE = True
    SHOWN_OVER = "time"
    SHOWN_BY = "a length standard, measured again and again, or barometer and thermometer of the air"
    WORKSHOP = Workshop(
        "The air has changed since the weather values were entered.", "Connect the weather station to the instrument."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_um_per_m_per_h", "um/m/h", 2.0),)

    rate_um_per_m_per_h: float


class AngleHarmonic(OfInstrument, frozen=True, tag="tracker-angle"):
    """One harmonic of an angle encoder's error (eccentricity: 1 or 2 per turn).

    The circle reads sine sin(n angle) + cosine cos(n angle) too much.
    """

    TITLE: ClassVar[str] = "azimuth or elevation encoder of the tracker, one harmonic"
    LABEL: ClassVar[tuple[str, ...]] = ("circle", "harmonic")
    SHOWN_OVER = "angle"
    SHOWN_BY = THREE_STATIONS
    WORKSHOP = Workshop(
        "Eccentric angle encoder or axes of the instrument that are not square.",
        "Compensate the instrument (two-face test), and send it to its maker if the error stays.",
    )
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
        yield from observed(arm[:, :, None] * waves[:, None, :])


class AngleStep(OfInstrument, frozen=True, tag="tracker-angle-step"):
    """An angle encoder of the tracker loses counts where a circle passes an angle, and gains them on its way back.

    The circle reads step too much in all rows in which the other one, or the circle itself, is at `above_deg` or up to
    half a turn beyond it.
    """

    TITLE: ClassVar[str] = "azimuth or elevation encoder of the tracker, a step at one angle (lost counts)"
    LABEL: ClassVar[tuple[str, ...]] = ("circle", "over")
    DIAGNOSED_AS = "tracker-angle"
    RARE = True
    SHOWN_OVER = "angle of a step"
    SHOWN_BY = THREE_STATIONS
    WORKSHOP = Workshop(
        "Dirt on an angle encoder's disc, a damaged cable, or an axis of the instrument that gives way there.",
        "Clean and compensate the instrument; measure again from another place.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("step_urad", "urad", 10.0),)

    circle: Circle
    over: Circle
    """The circle whose reading decides."""
    above_deg: float
    step_urad: float

    @property
    def conditions(self) -> tuple[str, ...]:
        """The angle of the step."""
        return (f"from {self.over} {self.above_deg:.4g} deg on",)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        _, sideways, upwards, angles = beam(state.need("observed", self.name))
        beyond = angles[:, CIRCLES.index(self.over)] - np.radians(self.above_deg)
        here = np.mod(beyond, 2.0 * np.pi) < np.pi
        arm = sideways if self.circle == "azimuth" else upwards
        yield from observed((arm * here[:, None])[:, :, None] * URAD)
