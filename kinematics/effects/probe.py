"""The touch probe: pre-travel that depends on the direction of the touch in the frame of the probe."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from kinematics.effects.base import TOOL, UM
from kinematics.effects.combined.where import OfInstrument
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.forward import axis_pose
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import IDENTITY, Array

LEAST_ACROSS_PROBE = 0.5
"""Least length of the part of x across the probe, of which the touches are in the direction."""


class ProbeLobing(OfInstrument, frozen=True, tag="probe-lobing"):
    """The pre-travel of a touch probe on three balls has three lobes: cosine cos 3 a + sine sin 3 a in direction a.

    a is counted about the axis of the probe, in its frame. A sphere is touched along x and y of the bed, from both
    sides: its centre moves on a circle as rotary axes of the head turn the probe about its axis. What the probe does
    in one orientation is part of its calibrated tip. Weckenmann et al., CIRP Annals 53/2 (2004), probing systems.
    """

    TITLE: ClassVar[str] = "pre-travel of a touch probe that depends on the direction of the touch"
    NEEDS: ClassVar[tuple[str, ...]] = ()
    RARE = True
    SHOWN_OVER = "turn of the probe"
    SHOWN_BY = "the same sphere with the probe turned about its own axis, by steps of 30 degrees"
    WORKSHOP = Workshop(
        "Three balls carry the stylus: the force that lifts it differs by direction, and bends the stylus differently.",
        "Calibrate the probe in each direction, use a shorter stylus, or turn the spindle with the touch.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("cosine_um", "um", 3.0),
        Parameter("sine_um", "um", 3.0),
    )

    cosine_um: float
    sine_um: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`: the tip is taken for the centre, from which it is off by the pre-travel."""
        turned = 4.0 * turn_of_probe(machine, state)
        cosine, sine = np.cos(turned) * UM, np.sin(turned) * UM
        yield Columns(TOOL, 0, np.stack([-cosine, sine], axis=1))
        yield Columns(TOOL, 1, np.stack([sine, cosine], axis=1))


def turn_of_probe(machine: Machine, state: State) -> Array:
    """Angle `(n,)`, rad, of the probe about its own axis, from the direction x of the bed across it."""
    pose = IDENTITY
    for axis, q in zip(machine.axes, state.positions.T, strict=True):
        if axis.side == "tool":
            pose = pose @ axis_pose(axis, q)
    (xx, xy), (yx, yy) = np.moveaxis(np.broadcast_to(pose.rotation, (len(state), 3, 3))[:, :2, :2], 0, 2)
    return np.asarray(np.where(np.hypot(xx, xy) >= LEAST_ACROSS_PROBE, np.arctan2(-xy, xx), np.arctan2(yx, yy)))
