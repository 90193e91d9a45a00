"""Drives and controls: reversal, pitch, table steps, lag.

Errors along an axis are counted in the direction of a positive command, also if the axis runs against its letter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from kinematics.basis import Basis
from kinematics.effects.base import (
    BY_AXIS,
    BY_DIRECTION,
    COMPONENTS,
    Component,
    EffectBase,
    Remedy,
    own_motion,
    unit_of,
)
from kinematics.effects.records import Columns, InControl, Parameter, Workshop
from kinematics.machine import TURN_DEG, Machine
from kinematics.state import State

GEAR = (
    "Set the play of the gear, or replace the gear, the belt or the bearing; otherwise set the backlash of the control."
)
ORDER_OF_TURN_DIFFERENCE = 0.02
"""Relative difference of a period from a whole part of the turn up to which its order is given."""
SMALL_WAVE = 0.05
"""Least amplitude of a harmonic in words, as a share of the largest."""
DEGREES_FROM_URAD = 1000.0
"""Amplitude, urad, above which it is also given in degrees."""


class Backlash(EffectBase, frozen=True, tag="backlash"):
    """Lost motion at reversal: the axis is half the width behind its command in both directions.

    Forward deviation minus backward deviation, the reversal value B_i of ISO 230-2 at a position, is minus the width;
    the reversal value B of the axis is the largest of its sizes. `width` is that at position 0, `windup` (of a screw)
    adds to it in proportion to the position. The error of an axis that has not moved yet is zero.
    """

    TITLE: ClassVar[str] = "backlash, constant and growing with position (wind-up)"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "bidirectional table"
    POSITIONS = "of its axis"
    CONTROL_PARAMETER = "backlash"
    IN_POSITIONING = "reversal"
    SHOWN_OVER = "position by direction"
    SHOWN_BY = "positions approached from both sides, in an order in which neither side comes later"
    WORKSHOP = Workshop(
        "Play in nut, gear or bearing, or wind-up of a screw in an axis without a direct scale.",
        "Preload or replace the nut and the thrust bearing; otherwise set the backlash of the control.",
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "Play in the gear, the belt or the bearing, or wind-up of the drive of the axis.", GEAR
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", BY_DIRECTION, 20.0),
        Parameter("windup", "um/m or urad/rad", 20.0),
    )

    axis: str
    width: float
    windup: float | None = None

    def in_control(self, machine: Machine) -> InControl:  # noqa: ARG002  the same on any machine
        """Width, and wind-up if there is one."""
        width, *more = self.quantities()
        windup = "" if self.windup is None else f", and {self.windup:.3f} {more[0].unit}"
        value = f"{self.width:.3f} {width.unit}{windup} (forward minus backward: {-self.width:.3f} {width.unit})"
        return InControl(f"backlash of {self.axis}", value)

    @property
    def remarks(self) -> tuple[str, ...]:
        """The meaning of a negative width."""
        if self.width >= 0.0:
            return ()
        return (
            "a negative width: the axis runs beyond its command after a reversal; the control's own backlash value is "
            f"probably larger than the real backlash by {-self.width:.2g} {self.parameter_table[0].unit}, or the sign "
            "of the readings or the directions of the runs are exchanged: check them, and measure a reversal while it "
            "is set to 0",
        )

    @property
    def finding(self) -> str:
        """The meaning of a width that is negative beyond its uncertainty (k = 2)."""
        if self.width >= -2.0 * self.uncertainties[0]:
            return ""
        size = f"{-self.width:.2g} {self.parameter_table[0].unit}"
        return (
            f"the backlash of {self.axis} is negative: after a reversal the axis is {size} beyond its command. The "
            "sign of the readings or the directions of the runs are exchanged, or the control's own backlash value is "
            f"larger than the backlash by {size}: check them, and measure a reversal while it is set to 0"
        )

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        behind = -0.5 * forward * unit_of(self.axis)[1] * state.need("approach", self.name)[:, [i]]
        if self.windup is not None:
            position = state.positions[:, [i]] * (1.0 if machine.axes[i].rotary else 1e-3)
            behind = np.concatenate([behind, behind * position], axis=1)
        yield Columns(i, component, behind)


class Reversal(EffectBase, frozen=True, tag="reversal"):
    """An error motion that differs between forward and backward: backlash in guides, a carriage that tips at reversal.

    `differences` are those of the error motion going forward minus going backward, as a function of the axis' own
    position; each direction has half of them. The error of an axis that has not moved yet is zero.
    """

    TITLE: ClassVar[str] = "difference of an error motion between forward and backward"
    COEFFICIENTS: ClassVar[bool] = True
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "bidirectional table"
    POSITIONS = "of its axis"
    RARE = True
    ALONG_OWN_AXIS = "backlash"
    IN_POSITIONING = "reversal"
    SHOWN_OVER = "position by direction"
    SHOWN_BY = "positions approached from both sides, over the whole travel"
    WORKSHOP = Workshop(
        "Play or friction that differs along the travel, by wear at the positions that are used most.",
        "Replace the worn part of the drive, or a bidirectional table.",
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "Play or friction that differs with the angle, by wear of the gear where it works most.", GEAR
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("differences", BY_DIRECTION, 10.0),)

    component: Component
    axis: str
    basis: Basis
    differences: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.differences) != self.basis.size:
            raise ValueError(f"{self.name}: its basis takes {self.basis.size} values, got {len(self.differences)}")
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i = machine.index(self.axis)
        half = 0.5 * unit_of(self.component)[1] * state.need("approach", self.name)[:, [i]]
        yield Columns(i, COMPONENTS.index(self.component), half * state.basis_columns(machine, self.axis, self.basis))


class Cyclic(EffectBase, frozen=True, tag="cyclic"):
    """An error that repeats with a period: screw lead, encoder pitch, gear; axial motion of a rotary axis (360 deg).

    sum of sine[k] sin(2 pi (k + 1) q / period) + cosine[k] cos(2 pi (k + 1) q / period), counted as the error motion of
    that component, from position 0.
    """

    TITLE: ClassVar[str] = "cyclic error (screw lead, encoder pitch), with harmonics"
    REMEDY: ClassVar[Remedy] = "table"
    POSITIONS = "of its axis"
    PERIODIC = True
    IN_POSITIONING = "mean"
    SHOWN_OVER = "period"
    SHOWN_BY = "positions at irregular, finer spacing"
    WORKSHOP = Workshop(
        "Eccentric screw, pinion or encoder, or an encoder signal that is not a clean sine.",
        "Clean and align the reading head, check the coupling and the bearing of the screw.",
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "Eccentric encoder, pinion or gear, teeth of a reducer, or an encoder signal that is not a clean sine.",
        "Centre and clean the encoder, check the gear; otherwise a table of the axis.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("period", BY_AXIS, 0.01, linear=False, share_of="period", lower=0.0),
        Parameter("sine", BY_DIRECTION, 5.0),
        Parameter("cosine", BY_DIRECTION, 5.0),
    )

    component: Component
    axis: str
    period: float
    sine: tuple[float, ...]
    cosine: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.sine or len(self.sine) != len(self.cosine):
            raise ValueError(f"{self.name}: as many sine as cosine amplitudes, at least one")
        super().__post_init__()

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`: half the shortest wave."""
        return {self.axis: self.period / (2 * len(self.sine))}

    @property
    def meaning(self) -> str:
        """Its period."""
        return f"period {self.period:.4g} {self._position_unit}"

    @property
    def waves(self) -> tuple[str, ...]:
        """Orders of the turn of a rotary axis or lengths, and amplitudes of its largest harmonics."""
        order, unit = round(TURN_DEG / self.period), self.parameter_table[1].unit
        whole = (
            self.axis[0] in "ABC" and order > 0 and abs(order * self.period / TURN_DEG - 1.0) < ORDER_OF_TURN_DIFFERENCE
        )
        amplitudes = list(map(math.hypot, self.sine, self.cosine))
        found = []
        for k, amplitude in enumerate(amplitudes, start=1):
            if amplitude >= SMALL_WAVE * max(amplitudes):
                length = f"wave of {self.period / k:.4g} {self._position_unit}"
                name = f"order {order * k} of the turn" if whole else length
                large = unit == "urad" and amplitude > DEGREES_FROM_URAD
                degrees = f" ({math.degrees(amplitude * 1e-6):.3g} deg)" if large else ""
                found.append(f"{name}: amplitude {amplitude:.4g} {unit}{degrees}")
        return tuple(found)

    @property
    def _position_unit(self) -> str:
        """Unit of its period."""
        return "deg" if self.axis[0] in "ABC" else "mm"

    @property
    def shortest_wave(self) -> tuple[str, float]:
        """See `EffectBase.shortest_wave`."""
        return self.axis, self.period / len(self.sine)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        harmonics = 2 * np.pi / self.period * np.arange(1, len(self.sine) + 1)
        phase = state.position(machine, self.axis)[:, None] * harmonics
        sin, cos = np.sin(phase), np.cos(phase)
        slope = (cos * self.sine - sin * self.cosine) * -phase / self.period
        values = np.concatenate([slope.sum(axis=1, keepdims=True), sin, cos], axis=1)
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), values * unit_of(self.component)[1])


class QuantisedCompensation(EffectBase, frozen=True, tag="quantised-compensation"):
    """The remaining steps of a controller's compensation table: a sawtooth.

    At `offset`, and a pitch apart, the control adds its next increment: going forward the axis jumps ahead by `step`,
    from half a step behind to half a step ahead, and loses it again until the next jump.
    """

    TITLE: ClassVar[str] = "steps of a controller's compensation table"
    REMEDY: ClassVar[Remedy] = "table"
    PERIODIC = True
    IN_POSITIONING = "mean"
    SHOWN_OVER = "period"
    SHOWN_BY = "positions at irregular, finer spacing"
    WORKSHOP = Workshop(
        "A compensation table of the control with nodes that are far apart or not interpolated.",
        "Write a table with closer nodes, or switch interpolation on.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("step", BY_DIRECTION, 5.0),
        Parameter("pitch", BY_AXIS, 0.01, linear=False, share_of="pitch", lower=0.0),
        Parameter("offset", BY_AXIS, 0.25, linear=False, share_of="pitch"),
    )

    axis: str
    step: float
    pitch: float
    offset: float = 0.0

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`: half a tooth."""
        return {self.axis: self.pitch / 2}

    @property
    def shortest_wave(self) -> tuple[str, float]:
        """See `EffectBase.shortest_wave`: a tooth."""
        return self.axis, self.pitch

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`; the jumps themselves have no derivative."""
        i, component, forward = own_motion(machine, self.axis)
        periods = (state.position(machine, self.axis) - self.offset) / self.pitch
        slope = np.full(len(periods), self.step / self.pitch)
        values = np.stack([0.5 - periods % 1.0, slope * periods, slope], axis=1)
        yield Columns(i, component, forward * unit_of(self.axis)[1] * values)


class FollowingError(EffectBase, frozen=True, tag="following-error"):
    """An axis in motion is behind its command by lag x velocity, and yields by compliance x acceleration.

    The compliance of a load on a spring is 1 / (natural angular frequency)^2.
    """

    TITLE: ClassVar[str] = "following error (lag of the position loop, acceleration)"
    NEEDS: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")
    REMEDY: ClassVar[Remedy] = "none"
    SHOWN_OVER = "velocity"
    SHOWN_BY = "the same path at two feeds, and in both directions"
    WORKSHOP = Workshop(
        "Lag of the position loop with the feed, or elastic deformation with the acceleration.",
        "Set the gain and the feed forward of the drive; finish at a lower feed.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("lag_ms", "ms", 1.0),
        Parameter("compliance_ms2", "ms2", 10.0),
    )

    axis: str
    lag_ms: float
    compliance_ms2: float | None = None

    @property
    def needs(self) -> tuple[str, ...]:
        """Acceleration only with a compliance."""
        return self.NEEDS[:1] if self.compliance_ms2 is None else self.NEEDS

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        values = -1e-3 * forward * state.need("velocity", self.name)[:, [i]]
        if self.compliance_ms2 is not None:
            bent = -1e-6 * forward * state.need("acceleration", self.name)[:, [i]]
            values = np.concatenate([values, bent], axis=1)
        yield Columns(i, component, values)


class Settling(EffectBase, frozen=True, tag="settling"):
    """An axis at rest has not quite reached its command: it is short by a share of its last move (friction, slow
    position loop).
    """

    TITLE: ClassVar[str] = "settling: short by a share of the last move"
    NEEDS: ClassVar[tuple[str, ...]] = ("last_move",)
    REMEDY: ClassVar[Remedy] = "none"
    RARE = True
    SHOWN_OVER = "last move"
    SHOWN_BY = "moves of different lengths to the same positions, and dwell times"
    WORKSHOP = Workshop(
        "The axis was measured before it had settled.", "Use a longer dwell, and check the positioning window."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("share_ppm", "ppm", 20.0),)

    axis: str
    share_ppm: float

    @property
    def remarks(self) -> tuple[str, ...]:
        """The meaning of a negative share."""
        if self.share_ppm >= 0.0:
            return ()
        return (
            f"a negative share: the axis is beyond its command by {-self.share_ppm:.2g} ppm of its last move; the "
            "position loop overshoots, or the reading came early, while the axis still swung back: check the dwell "
            "time before a reading, and the gain of the position loop",
        )

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        yield Columns(i, component, -1e-6 * forward * state.need("last_move", self.name)[:, [i]])


OF_ITS_RUN = "runs without a new zero of the instrument: the zero of the first run contains it"
"""Measurement that shows a transient of the first run where there are several runs."""


class FirstCycle(EffectBase, frozen=True, tag="first-cycle"):
    """The first measuring cycle differs from all later ones: backlash is taken up, or the machine is not yet run in."""

    TITLE: ClassVar[str] = "first-cycle transient"
    NEEDS: ClassVar[tuple[str, ...]] = ("cycle",)
    REMEDY: ClassVar[Remedy] = "none"
    RARE = True
    SHOWN_OVER = "cycle"
    SHOWN_BY = "a second run of the same positions"
    WORKSHOP = Workshop(
        "Oil film, preload or temperature differ in the first cycle.", "Move the axes for some minutes before a test."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset", BY_DIRECTION, 10.0),)

    component: Component
    axis: str
    offset: float

    def shown_by(self, state: State) -> str:
        """See `EffectBase.shown_by`: the zero of the instrument in the first of several runs contains it."""
        several = state.cycle is not None and bool(np.any(state.cycle > 0))
        return (
            "runs without a new zero of the instrument: that of the first run contains it" if several else self.SHOWN_BY
        )

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        first = (state.need("cycle", self.name) == 0)[:, None] * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), first)
