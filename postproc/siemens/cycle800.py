"""CYCLE800 of Siemens programs: a tilted plane, to which the machine's own rotary axes turn the tool."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from kinematics.inverse import inverse
from kinematics.machine import Machine
from postproc.motion.frames import Placement, rotated, shifted
from postproc.siemens.frames import NORMALS
from postproc.siemens.variables import EMPTY
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown, Scope, number

ARGUMENTS = ("FR", "TC", "ST", "MODE", "X0", "Y0", "Z0", "A", "B", "C", "X1", "Y1", "Z1", "DIR", "FR_I")
"""Of CYCLE800, in their order; more follow for the display."""
STATES = {0: "new", 10: "new", 200000: "new", 200010: "new", 1: "added", 11: "added", 200001: "added", 200011: "added"}
"""ST: whether the plane stands for itself or in the last one; the tool tip may be kept in place on the way."""


class Swivel(NamedTuple):
    """What a call says."""

    plane: Placement
    added: bool
    lower: bool
    """Of two positions of the rotary axes, that with the lower angle of the axis that tilts."""


def read_swivel(block: Block, word: Word, scope: Scope, unit: float) -> Swivel | None:
    """The plane of a call of CYCLE800, None for the call that ends it; Refusal for forms that are not followed."""
    given = word.arguments or ()
    if all(argument == EMPTY for argument in given):
        return None
    values: dict[str, float] = {}
    for name, argument in zip(ARGUMENTS, given, strict=False):
        if argument != EMPTY and name != "TC":
            try:
                values[name] = number(argument, scope)
            except NotKnown as reason:
                raise block.refuse(f"{name} of CYCLE800: {reason}") from None
    state, direction = STATES.get(int(values.get("ST", 0.0))), values.get("DIR", -1.0)
    if state is None:
        known = ", ".join(map(str, STATES))
        raise block.refuse(f"CYCLE800 with ST = {values['ST']:g} is not followed, only with ST = {known}")
    if direction not in (-1.0, 1.0):
        raise block.refuse("CYCLE800 that turns no axis (DIR = 0)")
    turn = _turned(block, int(values.get("MODE", 0.0)), [values.get(name, 0.0) for name in "ABC"])
    before = shifted(*(values.get(name, 0.0) * unit for name in ("X0", "Y0", "Z0")))
    behind = shifted(*(values.get(name, 0.0) * unit for name in ("X1", "Y1", "Z1")))
    return Swivel(before.then(turn).then(behind), state == "added", direction < 0.0)


def _turned(block: Block, mode: int, angles: list[float]) -> Placement:
    """Axis by axis, each about what the turns before it made of it; two bits of `mode` say which axis."""
    axes = [" XYZ"[mode >> shift & 3] for shift in (0, 2, 4)]
    if mode >> 6 or " " in axes:
        raise block.refuse(f"CYCLE800 with MODE = {mode}: only planes turned axis by axis are followed")
    result = Placement()
    for axis, angle in zip(axes, angles, strict=True):
        result = result.then(rotated(angle, NORMALS[axis]))
    return result


def rotary_positions(block: Block, machine: Machine, swivel: Swivel) -> dict[int, float]:
    """Positions, degrees by column, at which the tool stands upright on the plane; nearest to 0 of what is the same.

    The direction that the call prefers is that of the axis that tilts: the one whose angle differs between the two
    solutions, and whose travel ends.
    """
    rotary = [i for i, axis in enumerate(machine.axes) if axis.rotary]
    if not rotary:
        raise block.refuse(f"a tilted plane on machine {machine.name}, which has no axis that turns")
    upright = np.array(swivel.plane.turn).reshape(3, 3)[:, 2]
    found: list[dict[int, float]] = []
    for start in itertools.product(*(_starts(machine, i) for i in rotary)):
        q = np.zeros(len(machine.axes))
        q[rotary] = np.deg2rad(start)
        solved = inverse(machine, np.zeros((1, 3)), upright, start=q, respect_travel=False).q[0]
        if np.isfinite(solved).all():
            places = {i: _within(machine, i, float(np.rad2deg(solved[i]))) for i in rotary}
            found += [{i: angle for i, angle in places.items() if angle is not None}]
    found = [at for at in found if len(at) == len(rotary)]
    if not found:
        raise block.refuse("no position of the rotary axes sets the tool upright on this plane")
    tilting = min(rotary, key=lambda i: np.ptp(machine.axes[i].travel))
    sign = 1.0 if swivel.lower else -1.0
    return min(found, key=lambda at: (sign * at[tilting], sum(abs(angle) for angle in at.values()), -sum(at.values())))


def _starts(machine: Machine, axis: int) -> list[float]:
    low, high = machine.axes[axis].travel
    return [angle for angle in (0.0, -90.0, 90.0, 180.0, -180.0) if low <= angle <= high] or [low]


def _within(machine: Machine, axis: int, angle: float) -> float | None:
    """The angle nearest to 0 that differs by whole turns and lies within the travel, None where there is none."""
    low, high = machine.axes[axis].travel
    wound = [round(math.remainder(angle, 360.0) + turns, 9) + 0.0 for turns in (0.0, 360.0, -360.0)]
    return next((place for place in wound if low - 1e-9 <= place <= high + 1e-9), None)
