"""Friction and play at a reversal: across the guide, along the distance since the last reversal, between two drives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from kinematics.effects.base import (
    BY_AXIS,
    BY_DIRECTION,
    COMPONENTS,
    Component,
    EffectBase,
    Remedy,
    own_component,
    own_motion,
    unit_of,
)
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array


class LateralPlay(EffectBase, frozen=True, tag="lateral-play"):
    """Play across the guide: the carriage is shifted sideways, rolls, pitches or yaws at each reversal of its axis.

    `play` is the error motion forward minus the one backward, all along the axis; each direction has half of it. The
    error of an axis that has not moved yet is zero. ISO 230-4 (circular tests), whose evaluation calls it lateral play.
    """

    TITLE: ClassVar[str] = "play across the guide at reversal (lateral play, roll, pitch, yaw)"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "bidirectional table"
    POSITIONS = "of its axis"
    RARE = True
    SHOWN_OVER = "position by direction"
    SHOWN_BY = "positions approached from both sides, with two targets far apart on the tool"
    WORKSHOP = Workshop(
        "Worn or loose gibs and carriages: the slide tilts or steps aside when it turns back.",
        "Set the gibs or the preload of the carriages.",
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "Play of the bearing: the axis tilts or steps aside when it turns back.", "Set or replace the bearing."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("play", BY_DIRECTION, 10.0),)

    component: Component
    axis: str
    play: float

    def __post_init__(self) -> None:
        if self.component == own_component(self.axis):
            raise ValueError(f"{self.name}: along its own line the play of an axis is its backlash")
        super().__post_init__()

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i = machine.index(self.axis)
        half = 0.5 * unit_of(self.component)[1] * state.need("approach", self.name)[:, [i]]
        yield Columns(i, COMPONENTS.index(self.component), half)


class _SinceReversal(EffectBase, frozen=True):
    """Errors along an axis that depend on its distance s since its last reversal by exp(-s / length)."""

    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "none"
    HAS_MEMORY: ClassVar[bool] = True

    axis: str

    def _decay(self, machine: Machine, state: State, length: float) -> tuple[int, int, Array, Array, Array]:
        """Column and component; by row: direction of approach in mm or rad per unit, decay, its derivative."""
        i, component, forward = own_motion(machine, self.axis)
        side = forward * unit_of(self.axis)[1] * state.need("approach", self.name)[:, i]
        relative = way_since_reversal(machine, state, self.axis, self.name) / length
        decay = np.exp(-relative)
        slope = np.where(decay > 0, relative, 0.0) * decay / length
        return i, component, side, decay, slope


class Hysteresis(_SinceReversal, frozen=True, tag="hysteresis"):
    """Lost motion that is taken up after a reversal: friction winds up the drive before the axis follows.

    At the distance s since the last reversal the axis is behind its command by width / 2 (1 - exp(-s / length)), in
    both directions; far from reversals this is a backlash of the width. The distance is counted from row to row; at the
    first row it is long. Armstrong-Helouvry et al., Automatica 30/7 (1994); Slocum, Precision Machine Design (1992).
    """

    TITLE: ClassVar[str] = "hysteresis: lost motion that grows with the distance since the last reversal"
    RARE = True
    SHOWN_OVER = "distance since reversal"
    SHOWN_BY = "positions at different ways behind a reversal: short steps back, and long ones"
    WORKSHOP = Workshop(
        "Elastic parts between drive and scale with friction: seals, covers, cable chain, dry guides.",
        "Lubricate the guides, check covers and the cable chain, and the mounting of the scale.",
    )
    WORKSHOP_OF_ROTARY = Workshop(
        "Elastic parts between motor and load with friction: gear, belt, seals, cables.",
        "Check the gear and the cables, or use an encoder on the side of the load.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", BY_DIRECTION, 20.0),
        Parameter("length", BY_AXIS, 0.3, linear=False, share_of="length", lower=0.0),
    )

    width: float
    length: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, side, decay, slope = self._decay(machine, state, self.length)
        behind = np.stack([decay - 1.0, self.width * slope], axis=1)
        yield Columns(i, component, 0.5 * side[:, None] * behind)


class ReversalSpike(_SinceReversal, frozen=True, tag="reversal-spike"):
    """A local error just after a reversal: the axis sticks, and the control's friction compensation is late or early.

    At the distance s since the last reversal the axis is behind its command by height exp(-s / length), in both
    directions; a negative height is too much compensation. The distance is counted as in `hysteresis`. ISO 230-4
    (circular tests), whose evaluation calls it a reversal spike.
    """

    TITLE: ClassVar[str] = "reversal spike: a local error after a reversal that decays with the distance"
    RARE = True
    SHOWN_OVER = "distance since reversal"
    SHOWN_BY = "positions at short steps behind a reversal"
    WORKSHOP = Workshop(
        "Friction at standstill that the drive overcomes late.", "Set the friction compensation of the drive."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("height", BY_DIRECTION, 10.0),
        Parameter("length", BY_AXIS, 0.3, linear=False, share_of="length", lower=0.0),
    )

    height: float
    length: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, side, decay, slope = self._decay(machine, state, self.length)
        yield Columns(i, component, -side[:, None] * np.stack([decay, self.height * slope], axis=1))


class ServoMismatch(EffectBase, frozen=True, tag="servo-mismatch"):
    """The position loops of two axes have different gains: on a path of both, one lags behind the other.

    `lag_ms` is the lag of `axis` minus that of `other`; each has half of it, with its sign: a line at an angle shifts
    sideways and a circle becomes an ellipse at 45 degrees. The mean lag of both lies along the path. ISO 230-4.
    """

    TITLE: ClassVar[str] = "servo mismatch: the following errors of two axes differ"
    NEEDS: ClassVar[tuple[str, ...]] = ("velocity",)
    REMEDY: ClassVar[Remedy] = "none"
    RARE = True
    SHOWN_OVER = "velocity"
    SHOWN_BY = "a circle or a line at 45 degrees in both directions, at two feeds"
    WORKSHOP = Workshop(
        "Two axes have different position gains, so that a circle becomes an ellipse.",
        "Match the position gains of the axes.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("lag_ms", "ms", 0.5),)

    axis: str
    other: str
    lag_ms: float

    @property
    def name(self) -> str:
        """`servo-mismatch X Y`."""
        return f"{self.kind} {self.axis} {self.other}"

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        velocity = state.need("velocity", self.name)
        for axis, half in ((self.axis, -0.5e-3), (self.other, 0.5e-3)):
            i, component, forward = own_motion(machine, axis)
            yield Columns(i, component, half * forward * velocity[:, [i]])


def way_since_reversal(machine: Machine, state: State, axis: str, by: str) -> Array:
    """Way `(n,)` of an axis since its last reversal, mm or degrees, from the order of rows; unlimited before the first.

    by: name of the effect, for the UserError where the direction of approach is not known.
    The row in which the direction of approach changes has covered all its distance in the new direction.
    """
    i = machine.index(axis)
    side, position = state.need("approach", by)[:, i], state.position(machine, axis)
    ways = np.cumsum(np.abs(np.diff(position, prepend=position[:1])))
    turned = np.append(False, (side[1:] != side[:-1]) & (side[1:] != 0))[: len(side)]
    last = np.maximum.accumulate(np.where(turned, np.arange(len(side)), 0))
    # the distance before the row that turned
    before = np.append(0.0, ways)[last]
    return np.where(last > 0, ways - before, np.inf)
