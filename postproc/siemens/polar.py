"""Polar coordinates of Siemens programs: AP and RP round a pole that G110, G111 or G112 sets.

A corrected move has X and Y (or the axes of another plane) instead, and the centre of an arc about the pole.
"""

from __future__ import annotations

from dataclasses import dataclass

from postproc.control.arcs import arc_ends
from postproc.control.channel import Channel
from postproc.control.words import given_as, value_of, with_word
from postproc.motion.arcs import arc_by_centre
from postproc.motion.circles import Point, point_around, same
from postproc.motion.moves import Arc, AxisWord, Known
from postproc.siemens.arcs import Programmed
from postproc.siemens.words import Content, plain_of
from postproc.text.block import Block, Word

POLAR = frozenset(("AP", "RP"))
FROM_POSITION, FROM_POLE = 110.0, 112.0


@dataclass
class Polar:
    """The pole, and the last polar coordinates."""

    pole: Point = (0.0, 0.0)
    """In the plane, programmed coordinates, mm."""
    radius: float | None = None
    """mm; None where no block has given one for this pole."""
    angle: float | None = None
    """Degrees."""

    def clear(self) -> None:
        """The tool moves without these coordinates."""
        self.radius = self.angle = None

    def set_pole(self, channel: Channel, block: Block, content: Content, code: float) -> None:
        """G110 from the present position, G111 from the zero, G112 from the last pole."""
        first, second, _ = channel.modal.plane_columns
        recorder = channel.recorder
        if code == FROM_POSITION and not (recorder.known[first] and recorder.known[second]):
            raise block.refuse(
                "the pole counts from a position that the program has not given: write G111 with its coordinates"
            )
        position = recorder.position
        base = {FROM_POSITION: (position[first], position[second]), FROM_POLE: self.pole}.get(code, (0.0, 0.0))
        if content.other.keys() >= POLAR and not content.axes:
            angle, radius = (plain_of(block, block.words[content.other[address]]) for address in ("AP", "RP"))
            shift = point_around((0.0, 0.0), radius * channel.modal.unit, angle)
        else:
            if POLAR & content.other.keys():
                raise block.refuse("a pole has AP and RP or Cartesian coordinates: write one kind")
            shift = self._shift(channel, block, content)
        self.pole = (base[0] + shift[0], base[1] + shift[1])
        self.clear()

    @staticmethod
    def _shift(channel: Channel, block: Block, content: Content) -> Point:
        words = {block.words[i].address: plain_of(block, block.words[i]) * channel.modal.unit for i in content.axes}
        first, second = channel.modal.plane[0], channel.modal.plane[1]
        outside = sorted(words.keys() - {first, second})
        if outside:
            raise block.refuse(f"{outside[0]} is no coordinate of a pole here: write {first} and {second}")
        return words.get(first, 0.0), words.get(second, 0.0)

    def coordinates(self, channel: Channel, block: Block, content: Content, programmed: Programmed) -> Programmed:
        """The block with coordinates in place of AP and RP; `programmed`: its other axis words.

        With G91 words are increments, of coordinates too.
        """
        recorder, absolute = channel.recorder, channel.modal.absolute
        first, second, _ = channel.modal.plane_columns
        if any(word.axis in (first, second) for word, _ in programmed.words):
            raise block.refuse("Cartesian and polar coordinates are mixed in the working plane: write one kind")
        indices = {address: content.other.pop(address) for address in ("AP", "RP") if address in content.other}
        words = {address: block.words[index] for address, index in indices.items()}
        self.angle = self._value(block, words.get("AP"), self.angle, 1.0, absolute)
        if "RP" in words or self.radius is None:
            self.radius = self._value(block, words.get("RP"), self.radius, channel.modal.unit, absolute)
        if self.radius < 0.0:
            raise block.refuse("the polar radius RP is negative: write a radius of 0 or more")
        not_programmed = "RP" not in words or not absolute
        if not_programmed and any(recorder.known[axis] != Known.PROGRAM for axis in channel.modal.plane_columns):
            raise block.refuse(
                "the polar coordinates count from a position that the program has not given in this frame: write AP "
                "and RP with G90"
            )
        end = point_around(self.pole, self.radius, self.angle)
        found, others = [*programmed.words], {**programmed.others, second: end[1]}
        for axis, index, value in zip((first, second), indices.values(), end, strict=False):
            letter = channel.machine.names[axis]
            base = 0.0 if absolute else recorder.position[axis]
            block = with_word(block, index, given_as(block.words[index], letter, (value - base) / channel.modal.unit))
            found.append((AxisWord(axis, index, not absolute), value - base))
            others.pop(axis, None)
        return Programmed(block, found, others)

    @staticmethod
    def _value(block: Block, word: Word | None, before: float | None, unit: float, absolute: bool) -> float:
        if word is None:
            raise block.refuse(
                "the polar coordinates are not complete: write AP, and RP in this block or in one before"
            )
        value = value_of(block, word) * unit
        if word.mode == "AC" or (not word.mode and absolute):
            return value
        if word.mode not in ("", "IC"):
            raise block.refuse(f"{word.mode} has no meaning in a polar coordinate: write AC or IC")
        if before is None:
            raise block.refuse(
                "an increment of a polar coordinate needs a value from an earlier block: write the absolute value"
            )
        return before + value

    def arc(self, channel: Channel, block: Block, content: Content, target: list[float]) -> Arc:
        """The arc round the pole to polar coordinates."""
        ends = arc_ends(channel, block, target)
        if content.other.keys() & {"I", "J", "K", "CR", "AR", "TURN"}:
            raise block.refuse("the arc about the pole has a second centre or radius: write AP and RP only")
        if same(ends.start, ends.end):
            raise block.refuse("the arc about the pole ends at its start: write a full circle with a centre I J K")
        return arc_by_centre(block, ends, self.pole, (None, None), absolute=True)._replace(form="incremental")
