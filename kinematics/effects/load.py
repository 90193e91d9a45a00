"""Loads and stiffness: weights that bend joints and rams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np

from kinematics.effects.base import UM, URAD, Columns, EffectBase, Parameter, own_motion
from kinematics.forward import axis_pose
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import IDENTITY, Pose, read_only, turn
from kinematics.user_error import UserError

DOWN = read_only(np.array([0.0, 0.0, -1.0]))
"""Direction of gravity in the frame of the bed."""


class JointCompliance(EffectBase, frozen=True, tag="joint-compliance"):
    """A rotary axis in the head, or a robot's joint, yields under the weight at the tool: torque of gravity.

    The axis turns by the compliance x the horizontal lever, m, of the tool reference point about its line, downwards;
    about a vertical line there is no torque. In an arm the lever is a sum of sines and cosines of this axis and of
    those behind it. The weight of the links alone bends an axis by a wave of its own angle, which is part of its error
    motion. Gravity points to -z of the bed. Slocum, Precision Machine Design (1992); Khalil, Dombre, Modeling,
    Identification and Control of Robots (2002), flexible joints.
    """

    TITLE: ClassVar[str] = "compliance of a rotary axis under the weight at the tool (gravity)"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("compliance_urad_per_m", "urad/m", 20.0),)

    axis: str
    compliance_urad_per_m: float

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`: half a turn."""
        return {self.axis: 180.0}

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        own, tool = _from_bed(machine, state, self.axis, self.name)
        lever = tool.translation - own.apply(machine.axes[i].point)
        torque = np.cross(turn(own.rotation, machine.axes[i].unit_direction), lever) @ DOWN
        yield Columns(i, component, np.broadcast_to(torque * forward * 1e-3 * URAD, len(state))[:, None])


class RamSag(EffectBase, frozen=True, tag="ram-sag"):
    """A ram sags under its weight: its end sinks with the cube of its overhang and tilts with the square.

    A beam held at one end and loaded at the other sinks by sag x overhang^3 and tilts by 3/2 sag x overhang^2. The
    overhang is zero where `axis` is at `support`, and grows in the direction `extends`; a second axis `other` along the
    same line lengthens it, so that no error motion of one axis can contain the sag. A vertical ram does not sag.
    Gravity points to -z of the bed. Slocum, Precision Machine Design (1992), beams.
    """

    TITLE: ClassVar[str] = "sag of a ram under its weight, with the cube of its overhang"
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("sag_um_per_m3", "um/m3", 30.0),)

    axis: str
    sag_um_per_m3: float
    support: float
    extends: Literal[1, -1] = 1
    other: str | None = None

    @property
    def axes(self) -> tuple[str, ...]:
        """See `EffectBase.axes`."""
        return (self.axis,) if self.other is None else (self.axis, self.other)

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`: the sag is curved over the first metre."""
        return dict.fromkeys(self.axes, 1000.0)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i = machine.index(self.axis)
        axis = machine.axes[i]
        own, _ = _from_bed(machine, state, self.axis, self.name)
        outward = self.extends * axis.unit_direction
        overhang = self.extends * (state.position(machine, self.axis) - self.support)
        if self.other is not None:
            parallel = machine.axes[machine.index(self.other)].unit_direction @ outward
            overhang = overhang + parallel * state.position(machine, self.other)
        metres = np.maximum(overhang, 0.0) * 1e-3
        down = turn(own.inverse().rotation, DOWN)
        across = down - (down @ outward)[:, None] * outward
        sunk = (across @ axis.error_frame) * metres[:, None] ** 3 * UM
        tilted = (np.cross(outward, across) @ axis.error_frame) * (1.5 * metres[:, None] ** 2 * URAD)
        for k, values in enumerate(np.concatenate([sunk, tilted], axis=1).T):
            if values.any():
                yield Columns(i, k, values[:, None])


def _from_bed(machine: Machine, state: State, name: str, by: str) -> tuple[Pose, Pose]:
    """Nominal poses, in the frame of the bed, of an axis of the tool's side and of the tool reference point."""
    pose, found = IDENTITY, None
    for axis, q in zip(machine.axes, state.positions.T, strict=True):
        if axis.side == "tool":
            found = pose if axis.name == name else found
            pose = pose @ axis_pose(axis, q)
    if found is None:
        raise UserError(
            f"{by}: {name} carries the workpiece; the weight at the tool loads axes on the side of the tool"
        )
    return found, pose
