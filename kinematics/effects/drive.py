"""Drives and controls: reversal, pitch, table steps, lag.

Errors along an axis are counted in the direction of a positive command, also if the axis runs against its letter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from kinematics.basis import Basis, Interval
from kinematics.effects.base import (
    BY_AXIS,
    BY_DIRECTION,
    COMPONENTS,
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


class Backlash(EffectBase, frozen=True, tag="backlash"):
    """Lost motion at reversal: the axis is half the width behind its command in both directions.

    Forward deviation minus backward deviation, the reversal value B_i of ISO 230-2 at a position, is minus the width;
    the reversal value B of the axis is the largest of its sizes. `width` is that at position 0, `windup` (of a screw)
    adds to it in proportion to the position. The error of an axis that has not moved yet is zero.
    """

    TITLE: ClassVar[str] = "backlash, constant and growing with position (wind-up)"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "bidirectional table"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", BY_DIRECTION, 20.0),
        Parameter("windup", "um/m or urad/rad", 20.0),
    )

    axis: str
    width: float
    windup: float | None = None

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

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
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "bidirectional table"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("differences", BY_DIRECTION, 10.0),)

    component: Component
    axis: str
    basis: Basis
    differences: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.differences) != self.basis.size:
            raise ValueError(f"{self.name}: its basis takes {self.basis.size} values, got {len(self.differences)}")
        super().__post_init__()

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.basis.interval}

    @property
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: self.basis}

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
    def position_bases(self) -> Mapping[str, Basis | None]:
        """See `EffectBase.position_bases`."""
        return {self.axis: None}

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
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("share_ppm", "ppm", 20.0),)

    axis: str
    share_ppm: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        yield Columns(i, component, -1e-6 * forward * state.need("last_move", self.name)[:, [i]])


class FirstCycle(EffectBase, frozen=True, tag="first-cycle"):
    """The first measuring cycle differs from all later ones: backlash is taken up, or the machine is not yet run in."""

    TITLE: ClassVar[str] = "first-cycle transient"
    NEEDS: ClassVar[tuple[str, ...]] = ("cycle",)
    REMEDY: ClassVar[Remedy] = "none"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset", BY_DIRECTION, 10.0),)

    component: Component
    axis: str
    offset: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        first = (state.need("cycle", self.name) == 0)[:, None] * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), first)
