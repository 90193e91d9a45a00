"""Loads and stiffness: weights that bend joints and rams, and a moved mass that bends the guides of another axis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from kinematics.basis import Interval, Legendre
from kinematics.effects.base import BY_DIRECTION, COMPONENTS, UM, URAD, Component, EffectBase, own_motion, unit_of
from kinematics.effects.geometric import TYPICAL_MOTION_UM, shift_of, with_shift
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.forward import axis_pose
from kinematics.machine import Machine, Vector
from kinematics.state import State, general_state
from kinematics.transforms import IDENTITY, ROUNDING_OF_DIRECTION, Array, Pose, read_only, turn
from kinematics.user_error import UserError

DOWN = read_only(np.array([0.0, 0.0, -1.0]))
"""Direction of gravity in the frame of the bed."""
NONE = 1e-9
"""um: typical size of a coefficient that has an effect of its own, and stays at 0 in a fit."""


class JointCompliance(EffectBase, frozen=True, tag="joint-compliance"):
    """A rotary axis in the head, or a robot's joint, yields under the weight at the tool: torque of gravity.

    The axis turns by the compliance x the horizontal lever, m, of the tool reference point about its line, downwards;
    about a vertical line there is no torque. In an arm the lever is a sum of sines and cosines of this axis and of
    those behind it. The weight of the links alone bends an axis by a wave of its own angle, which is part of its error
    motion. Gravity points to -z of the bed. Slocum, Precision Machine Design (1992); Khalil, Dombre, Modeling,
    Identification and Control of Robots (2002), flexible joints.
    """

    TITLE: ClassVar[str] = "compliance of a rotary axis under the weight at the tool (gravity)"
    RARE = True
    SHOWN_OVER = "rows over position"
    SHOWN_BY = "the same pose with another weight at the tool, and with the arm stretched and folded"
    WORKSHOP = Workshop(
        "Gears and bearings of the rotary axis yield under the weight of the tool or the workpiece.",
        "Reduce the load, clamp the axis while cutting, or tighten the gear.",
    )
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
    RARE = True
    SHOWN_OVER = "rows over position"
    SHOWN_BY = "both axes of the ram in and out, independently of each other"
    WORKSHOP = Workshop(
        "The weight of the ram bends it as it comes out.", "Set the hydraulic or electric sag compensation of the ram."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("sag_um_per_m3", "um/m3", 30.0),)

    axis: str
    sag_um_per_m3: float
    support: float
    extends: Literal[1, -1] = 1
    other: str | None = None

    @property
    def angular(self) -> bool:
        """True: it also turns the ram."""
        return True

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
        outward = self.extends * machine.axes[machine.index(self.axis)].unit_direction
        overhang = self.extends * (state.position(machine, self.axis) - self.support)
        if self.other is not None:
            parallel = machine.axes[machine.index(self.other)].unit_direction @ outward
            overhang = overhang + parallel * state.position(machine, self.other)
        metres = np.maximum(overhang, 0.0)[:, None] * 1e-3
        sizes = np.repeat([metres**3 * UM, 1.5 * metres**2 * URAD], 3, axis=0)[:, :, 0].T
        values = self._directions(machine, state) * sizes
        (anywhere,) = self._directions(machine, general_state(machine))
        for k in np.flatnonzero(np.abs(anywhere) > ROUNDING_OF_DIRECTION):
            yield Columns(machine.index(self.axis), int(k), np.broadcast_to(values[:, [k]], (len(state), 1)))

    def _directions(self, machine: Machine, state: State) -> Array:
        """Directions `(1 or n, 6)`, in the error frame of the axis, in which the end sinks and about which it tilts."""
        axis = machine.axes[machine.index(self.axis)]
        own, _ = _from_bed(machine, state, self.axis, self.name)
        outward = self.extends * axis.unit_direction
        down = turn(own.inverse().rotation, DOWN)
        across = down - (down @ outward)[:, None] * outward
        return np.concatenate([across @ axis.error_frame, np.cross(outward, across) @ axis.error_frame], axis=1)


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


class CrossAxis(EffectBase, frozen=True, tag="cross-axis"):
    """An error motion of one axis that also depends on the position of another: sag, twist, mass shift.

    Products P_i(own) P_j(other) of Legendre polynomials over both intervals, i = 0 ... own_degree, j = 1 ...
    other_degree, i running first; the part that does not depend on the other axis (j = 0) is the error motion itself.
    Between linear axes the product P_0 P_1 of a translation is a squareness, a scale, or a turn of the part. It has an
    effect of its own, so a fit leaves its coefficient at 0. An angular error turns the carriage about the point `about`
    in the axis' error frame, mm from the axis' own point; without it, about the latter.
    """

    TITLE: ClassVar[str] = "error motion that also depends on another axis (sag, twist, mass shift)"
    COEFFICIENTS: ClassVar[bool] = True
    SHOWN_OVER = "two axes"
    SHOWN_BY = "positions in which both axes move independently, over their whole travel"
    WORKSHOP = Workshop(
        "The moving mass bends the structure: sag of an arm, twist of a column, shift of the table's weight.",
        "Counterbalance or stiffen the structure; otherwise a cross-axis table or the corrected program.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("coefficients", BY_DIRECTION, TYPICAL_MOTION_UM / 3),)

    component: Component
    axis: str
    other: str
    own_interval: Interval
    other_interval: Interval
    own_degree: Annotated[int, msgspec.Meta(ge=0, le=12)]
    other_degree: Annotated[int, msgspec.Meta(ge=1, le=12)]
    coefficients: tuple[float, ...]
    about: Vector | msgspec.UnsetType = msgspec.UNSET

    def __post_init__(self) -> None:
        own, other = self._bases()
        if len(self.coefficients) != own.size * (other.size - 1):
            raise ValueError(
                f"{self.name}: these degrees take {own.size * (other.size - 1)} coefficients, "
                f"got {len(self.coefficients)}"
            )
        super().__post_init__()

    @property
    def name(self) -> str:
        """E_ZX(Y), ..."""
        return f"E_{self.component}{self.axis}({self.other})"

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """See `EffectBase.intervals`."""
        return {self.axis: self.own_interval, self.other: self.other_interval}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`."""
        own, other = self._bases()
        return {self.axis: own.feature_length, self.other: other.feature_length}

    @property
    def conditions(self) -> tuple[str, ...]:
        """Its largest size over the measured ranges."""
        return (f"up to {self.at_corners:.2g} {self.parameter_table[0].unit} at the corners of the measured ranges",)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        bases = zip((self.axis, self.other), self._bases(), strict=True)
        own, other = (state.basis_columns(machine, axis, basis) for axis, basis in bases)
        products = (other[:, 1:, None] * own[:, None, :]).reshape(len(state), len(self.coefficients))
        errors = products * unit_of(self.component)[1]
        found = Columns(machine.index(self.axis), COMPONENTS.index(self.component), errors)
        yield from [found] if self.about is msgspec.UNSET else with_shift(found, shift_of(self.component, self.about))

    @property
    def parameter_table(self) -> tuple[Parameter, ...]:
        """See `EffectBase.parameter_table`; a coefficient that is a line of an axis is expected at 0."""
        first, *others = super().parameter_table
        return first._replace(typical=NONE, held=True) if self._line_first else first, *others

    @property
    def typical(self) -> tuple[float, ...]:
        """See `EffectBase.typical`."""
        return tuple(parameter.typical for parameter in self.parameter_table)

    @property
    def at_corners(self) -> float:
        """Largest size at the four corners of both intervals, um or urad."""
        own, other = (basis.columns(np.array(basis.interval)) for basis in self._bases())
        products = other[:, None, 1:, None] * own[None, :, None, :]
        return float(np.abs(products.reshape(4, -1) @ np.array(self.coefficients)).max())

    @property
    def _line_first(self) -> bool:
        """True where the first product is the line of an axis: a squareness, a scale, or a turn of the part."""
        return not self.angular and self.axis[0] not in "ABC" and self.other[0] not in "ABC"

    def _bases(self) -> tuple[Legendre, Legendre]:
        return Legendre(self.own_interval, self.own_degree), Legendre(self.other_interval, self.other_degree)
