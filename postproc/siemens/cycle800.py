"""CYCLE800 of Siemens programs: a tilted plane, to which the machine's own rotary axes turn the tool."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from postproc.control.tilted_planes import normal_of, perpendicular
from postproc.motion.frames import Placement, rotated_in_turn, shifted
from postproc.motion.moves import AxisWord
from postproc.siemens.channel import Channel
from postproc.siemens.variables import EMPTY
from postproc.siemens.words import Content
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown, Scope, number

ARGUMENTS = ("FR", "TC", "ST", "MODE", "X0", "Y0", "Z0", "A", "B", "C", "X1", "Y1", "Z1", "DIR", "FR_I")
"""Parameters of CYCLE800 in their order; parameters for the display follow them."""
STATES = {0: "new", 10: "new", 200000: "new", 200010: "new", 1: "added", 11: "added", 200001: "added", 200011: "added"}
"""ST: a new plane, or one within the last plane; the control may keep the tool tip in place during the turn."""


class TiltedPlane(NamedTuple):
    """The plane of a call."""

    plane: Placement
    added: bool
    lower: bool
    """The solution with the lower angle of the axis that tilts, of the two solutions for the rotary axes."""


def tilt(channel: Channel, index: int, block: Block, content: Content) -> None:
    """CYCLE800: turns the rotary axes on a path that the control chooses, and tilts the coordinates with them."""
    modal, transformations = channel.modal, channel.modal.transformations
    plane = _read_tilted_plane(block, block.words[content.names["CYCLE800"]], channel.scope, modal.unit)
    if content.axes or content.g or len(content.names) > 1 or modal.tcp:
        raise block.refuse("CYCLE800 must be alone in its block, and TRAORI must be off: write TRAFOOF before it")
    modal.polar.clear()
    if plane is None:
        transformations.tilt(None)
        channel.notes.add("CYCLE800(): the rotary axes are taken to keep their positions", block.line)
    else:
        before = transformations.tilted
        if plane.added and before is not None:
            plane = plane._replace(plane=before.then(plane.plane))
        positions = _rotary_positions(block, channel, plane)
        words = tuple(AxisWord(i, 0, False) for i in positions)
        channel.recorder.move_to_machine_position(index, positions, words)
        listed = " ".join(f"{channel.machine.names[i]}{angle:g}" for i, angle in positions.items())
        channel.notes.add(f"CYCLE800 is taken to turn the rotary axes to {listed}", block.line)
        tilts = plane.plane != Placement() or any(positions.values())
        transformations.tilt(plane.plane if tilts else None)
    channel.change_frame(range(len(channel.machine.axes)))
    channel.recorder.mark_unknown(list(channel.x_y_z))


def _read_tilted_plane(block: Block, word: Word, scope: Scope, unit: float) -> TiltedPlane | None:
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
        raise block.refuse(f"CYCLE800 with ST = {values['ST']:g} is not followed: write one of ST = {known}")
    if direction not in (-1.0, 1.0):
        raise block.refuse(f"CYCLE800 with DIR = {direction:g} is not followed: write DIR = -1 or DIR = 1")
    turn = _turned(block, int(values.get("MODE", 0.0)), [values.get(name, 0.0) for name in "ABC"])
    before = shifted(*(values.get(name, 0.0) * unit for name in ("X0", "Y0", "Z0")))
    behind = shifted(*(values.get(name, 0.0) * unit for name in ("X1", "Y1", "Z1")))
    return TiltedPlane(before.then(turn).then(behind), state == "added", direction < 0.0)


def _turned(block: Block, mode: int, angles: list[float]) -> Placement:
    """Axis by axis, each as rotated before; two bits of `mode` for each axis."""
    axes = [" XYZ"[mode >> shift & 3] for shift in (0, 2, 4)]
    if mode >> 6 or " " in axes:
        raise block.refuse(
            f"CYCLE800 with MODE = {mode} is not followed: write rotations axis by axis, as with MODE = 57"
        )
    return rotated_in_turn("".join(axes), angles)


def _rotary_positions(block: Block, channel: Channel, tilt: TiltedPlane) -> dict[int, float]:
    """Positions, degrees by column, with the tool perpendicular to the plane; nearest to 0 of equivalent ones.

    The direction that the call prefers is that of the axis that tilts: the one whose angle differs between the two
    solutions, and whose travel ends.
    """
    machine, rotary = channel.machine, channel.rotary_axes
    if not rotary:
        raise block.refuse(f"a tilted plane needs a rotary axis, and machine {machine.name} has none")
    found, _ = perpendicular(machine, normal_of(tilt.plane), dict.fromkeys(rotary, 0.0))
    if not found:
        raise block.refuse(
            "no position of the rotary axes within their travel makes the tool perpendicular to this "
            "plane: check the angles and the travel in the machine file"
        )
    tilting = min(rotary, key=lambda i: np.ptp(machine.axes[i].travel))
    sign = 1.0 if tilt.lower else -1.0
    return min(found, key=lambda at: (sign * at[tilting], sum(abs(angle) for angle in at.values()), -sum(at.values())))
