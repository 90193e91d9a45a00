"""Programmable frames of Siemens programs: TRANS, ROT, SCALE, MIRROR, ATRANS and its kin, and tilted planes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from postproc.control.channel import Channel
from postproc.motion.frames import Placement, mirrored, rotated, scaled, shifted, spatial
from postproc.siemens.codes import SPATIAL_NAMES
from postproc.siemens.words import Content, plain_of
from postproc.text.block import Block


@dataclass
class DatumTransformations:
    """The shifts and rotations of X Y Z in force, and the shifts of rotary axes."""

    programmed: Placement = field(default_factory=Placement)
    tilted: Placement | None = None
    """A tilted plane, which contains the programmed frame."""
    rotary_shifts: dict[str, float] = field(default_factory=dict)
    """Shifts of rotary axes, degrees."""

    @property
    def placement(self) -> Placement:
        """The placement of X Y Z by both."""
        return self.programmed if self.tilted is None else self.tilted.then(self.programmed)

    def tilt(self, plane: Placement | None) -> None:
        """Program in a tilted plane, without any frame in it; None for the end of it."""
        self.tilted, self.programmed, self.rotary_shifts = plane, Placement(), {}

    def change(self, channel: Channel, block: Block, content: Content) -> set[str]:
        """Apply the frame statement of a block, absolute or additive (with an A); returns the axes that it shifts."""
        machine = channel.machine
        (name,) = content.frames
        if name in SPATIAL_NAMES:
            raise block.refuse(f"{name} rotates by angles in space, which is not followed: write ROT or AROT")
        kind = name.removeprefix("A")
        words = {block.words[i].address: plain_of(block, block.words[i]) for i in content.axes}
        turned = {axis: value for axis, value in words.items() if axis not in "XYZ"}
        for axis in turned:
            if axis not in machine.names:
                raise block.refuse(
                    f"machine {machine.name} ({machine.chain}) has no axis {axis}: check --machine, or the block"
                )
        if turned and kind != "TRANS":
            raise block.refuse(f"{name} has a rotary axis: write TRANS or ATRANS, which alone shift rotary axes")
        inner = _inner(channel, block, content, kind, {a: v for a, v in words.items() if a in "XYZ"})
        if kind == name:
            self.programmed, self.rotary_shifts = Placement(), {}
        self.programmed = self.programmed.then(inner)
        for axis, value in turned.items():
            self.rotary_shifts[axis] = self.rotary_shifts.get(axis, 0.0) + value
        return set(words) if kind == "TRANS" else set()


def _inner(channel: Channel, block: Block, content: Content, kind: str, words: Mapping[str, float]) -> Placement:
    """The placement of a statement without its A; words: its values by axis, in units of the program."""
    if kind == "TRANS":
        return shifted(*(words.get(axis, 0.0) * channel.modal.unit for axis in "XYZ"))
    if kind == "MIRROR":
        return mirrored("".join(words))
    if kind == "SCALE":
        if any(factor <= 0.0 for factor in words.values()):
            raise block.refuse(f"{kind} has a factor that is not above 0: write a positive factor")
        return scaled(*(words.get(axis, 1.0) for axis in "XYZ"))
    angle = content.other.get("RPL")
    if angle is not None:
        if words:
            raise block.refuse("RPL and an axis letter exclude each other: write one of them")
        return rotated(plain_of(block, block.words[angle]), channel.modal.plane)
    if len(words) > 1:
        channel.notes.add("rotations in one block are taken in the order Z, Y, X (RPY: MD10600 = 1)", block.line)
    return spatial(*(words.get(axis, 0.0) for axis in "XYZ"))
