"""Drives and controls: reversal, pitch, table steps, lag."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from kinematics.effects.base import COMPONENTS, Cause, Columns, Component, Parameter, Remedy, unit_of
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array


class Backlash(Cause, frozen=True, tag="backlash"):
    """Lost motion at reversal: half the width behind the command, whichever way the axis came (ISO 230-2 reversal B).

    The width is that at position 0; wind-up adds to it in proportion to the position.
    """

    TITLE: ClassVar[str] = "backlash, constant and growing with position (wind-up)"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "bidirectional table"

    axis: str
    width: float
    """um, or urad of a rotary axis."""
    windup: float = 0.0
    """um per m, or urad per rad."""

    def quantities(self) -> tuple[Parameter, ...]:
        """Width and wind-up."""
        unit, rate = ("urad", "urad/rad") if self.axis[0] in "ABC" else ("um", "um/m")
        return Parameter("width", unit, 20.0), Parameter("windup", rate, 20.0)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        i = machine.index(self.axis)
        behind = -0.5 * state.need("approach", self.name)[:, i] * unit_of(self.axis[0])[1]
        metres = state.positions[:, i] * (1.0 if machine.axes[i].rotary else 1e-3)
        yield Columns(i, COMPONENTS.index(self.axis[0]), np.stack([behind, behind * metres], axis=1))


class Cyclic(Cause, frozen=True, tag="cyclic"):
    """An error that repeats with a period: screw lead, encoder pitch, gear."""

    TITLE: ClassVar[str] = "cyclic error (screw lead, encoder pitch), with harmonics"
    REMEDY: ClassVar[Remedy] = "table"

    component: Component
    axis: str
    period: Annotated[float, msgspec.Meta(gt=0)]
    """mm or degrees."""
    sine: tuple[float, ...]
    """Amplitudes of the fundamental, the second harmonic, ...; um or urad."""
    cosine: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.sine or len(self.sine) != len(self.cosine):
            raise ValueError(f"{self.name}: as many sine as cosine amplitudes, at least one")
        super().__post_init__()

    def quantities(self) -> tuple[Parameter, ...]:
        """Period and amplitudes."""
        unit = unit_of(self.component)[0]
        length = "deg" if self.axis[0] in "ABC" else "mm"
        return (
            Parameter("period", length, 0.01 * self.period, linear=False),
            Parameter("sine", unit, 5.0),
            Parameter("cosine", unit, 5.0),
        )

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        order, phase = self._phase(machine, state)
        sin, cos = np.sin(phase), np.cos(phase)
        slope = (cos * np.array(self.sine) - sin * np.array(self.cosine)) * -phase / self.period
        values = np.concatenate([slope.sum(axis=1, keepdims=True), sin, cos], axis=1)
        yield Columns(machine.index(self.axis), order, values * unit_of(self.component)[1])

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """See `Cause.contributions`."""
        order, phase = self._phase(machine, state)
        values = np.sin(phase) @ np.array(self.sine) + np.cos(phase) @ np.array(self.cosine)
        yield machine.index(self.axis), order, values * unit_of(self.component)[1]

    def _phase(self, machine: Machine, state: State) -> tuple[int, Array]:
        x = state.position(machine, self.axis)
        harmonics = np.arange(1, len(self.sine) + 1)
        return COMPONENTS.index(self.component), 2 * np.pi / self.period * x[:, None] * harmonics


class QuantisedCompensation(Cause, frozen=True, tag="quantised-compensation"):
    """The steps that a controller's table leaves: a saw tooth falling from + half a step to - half a step per pitch."""

    TITLE: ClassVar[str] = "steps of a controller's compensation table"
    REMEDY: ClassVar[Remedy] = "table"

    axis: str
    step: float
    """um, or urad of a rotary axis."""
    pitch: Annotated[float, msgspec.Meta(gt=0)]
    """mm or degrees."""
    offset: float = 0.0
    """Position of one step, mm or degrees."""

    def quantities(self) -> tuple[Parameter, ...]:
        """Step, pitch and offset."""
        length = "deg" if self.axis[0] in "ABC" else "mm"
        return (
            Parameter("step", unit_of(self.axis[0])[0], 5.0),
            Parameter("pitch", length, 0.01 * self.pitch, linear=False),
            Parameter("offset", length, 0.25 * self.pitch, linear=False),
        )

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`; the jumps themselves have no derivative."""
        teeth = (state.position(machine, self.axis) - self.offset) / self.pitch
        slope = np.full(len(teeth), self.step / self.pitch)
        values = np.stack([0.5 - teeth % 1.0, slope * teeth, slope], axis=1) * unit_of(self.axis[0])[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.axis[0]), values)

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """See `Cause.contributions`."""
        teeth = (state.position(machine, self.axis) - self.offset) / self.pitch
        values = self.step * (0.5 - teeth % 1.0) * unit_of(self.axis[0])[1]
        yield machine.index(self.axis), COMPONENTS.index(self.axis[0]), values


class FollowingError(Cause, frozen=True, tag="following-error"):
    """An axis in motion is behind its command: by a lag, and by a share of its acceleration.

    The same columns describe a read-back that is late, with the other sign.
    """

    TITLE: ClassVar[str] = "following error (lag, acceleration), late read-back"
    NEEDS: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")
    REMEDY: ClassVar[Remedy] = "none"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("lag_ms", "ms", 1.0),
        Parameter("compliance_ms2", "ms2", 10.0),
    )

    axis: str
    lag_ms: float
    compliance_ms2: float = 0.0

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        i = machine.index(self.axis)
        late = -1e-3 * state.need("velocity", self.name)[:, i]
        bent = -1e-6 * state.need("acceleration", self.name)[:, i]
        yield Columns(i, COMPONENTS.index(self.axis[0]), np.stack([late, bent], axis=1))


class Settling(Cause, frozen=True, tag="settling"):
    """An axis at rest that has not quite arrived: short by a share of its last move (friction, slow position loop)."""

    TITLE: ClassVar[str] = "settling: short by a share of the last move"
    NEEDS: ClassVar[tuple[str, ...]] = ("last_move",)
    REMEDY: ClassVar[Remedy] = "none"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("share_ppm", "ppm", 20.0),)

    axis: str
    share_ppm: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        i = machine.index(self.axis)
        yield Columns(i, COMPONENTS.index(self.axis[0]), -1e-6 * state.need("last_move", self.name)[:, [i]])


class FirstCycle(Cause, frozen=True, tag="first-cycle"):
    """The first measuring cycle differs from all later ones: play that is taken up, a machine not yet run in."""

    TITLE: ClassVar[str] = "first-cycle transient"
    NEEDS: ClassVar[tuple[str, ...]] = ("cycle",)
    REMEDY: ClassVar[Remedy] = "none"

    component: Component
    axis: str
    offset: float

    def quantities(self) -> tuple[Parameter, ...]:
        """Its offset."""
        return (Parameter("offset", unit_of(self.component)[0], 10.0),)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Cause.columns`."""
        first = (state.need("cycle", self.name) == 0)[:, None] * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), first)
