"""Polar coordinates of Siemens programs: AP and RP round a pole that G110, G111 or G112 sets.

A corrected move has X and Y (or the axes of another plane) instead, and the centre of an arc about the pole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from postproc.motion.arcs import arc_by_centre
from postproc.motion.circles import Point, same
from postproc.motion.moves import Arc, AxisWord, Known
from postproc.motion.recorder import Recorder
from postproc.siemens.arcs import Programmed, Turn
from postproc.siemens.words import Content, given_as, plain_of, value_of, with_word
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

    def mark_unknown(self) -> None:
        """The tool moves without these coordinates."""
        self.radius = self.angle = None

    def set_pole(self, block: Block, content: Content, recorder: Recorder, turn: Turn, code: float) -> None:
        """G110 from the present position, G111 from the zero, G112 from the last pole."""
        first, second, _ = turn.columns(recorder)
        if code == FROM_POSITION and not (recorder.known[first] and recorder.known[second]):
            raise block.refuse("a pole from a position that the program has not given")
        position = recorder.position
        base = {FROM_POSITION: (position[first], position[second]), FROM_POLE: self.pole}.get(code, (0.0, 0.0))
        if content.other.keys() >= POLAR and not content.axes:
            angle, radius = (plain_of(block, block.words[content.other[address]]) for address in ("AP", "RP"))
            shift = _around((0.0, 0.0), radius * turn.unit, angle)
        else:
            if POLAR & content.other.keys():
                raise block.refuse("a pole has AP and RP or Cartesian coordinates: write one kind")
            shift = self._shift(block, content, turn)
        self.pole = (base[0] + shift[0], base[1] + shift[1])
        self.mark_unknown()

    @staticmethod
    def _shift(block: Block, content: Content, turn: Turn) -> Point:
        words = {block.words[i].address: plain_of(block, block.words[i]) * turn.unit for i in content.axes}
        stray = sorted(words.keys() - set(turn.plane[:2]))
        if stray:
            raise block.refuse(f"{stray[0]} is no coordinate of a pole in the plane of {' and '.join(turn.plane[:2])}")
        return words.get(turn.plane[0], 0.0), words.get(turn.plane[1], 0.0)

    def coordinates(
        self, block: Block, content: Content, recorder: Recorder, turn: Turn, programmed: Programmed, absolute: bool
    ) -> Programmed:
        """The block with coordinates in place of AP and RP; `programmed`: its other axis words.

        Without `absolute`, G91, words are increments, of coordinates too.
        """
        first, second, _ = turn.columns(recorder)
        if any(word.axis in (first, second) for word, _ in programmed.words):
            raise block.refuse("Cartesian and polar coordinates are mixed in the working plane: write one kind")
        indices = {address: content.other.pop(address) for address in ("AP", "RP") if address in content.other}
        words = {address: block.words[index] for address, index in indices.items()}
        self.angle = self._value(block, words.get("AP"), self.angle, 1.0, absolute)
        if "RP" in words or self.radius is None:
            self.radius = self._value(block, words.get("RP"), self.radius, turn.unit, absolute)
        if self.radius < 0.0:
            raise block.refuse("a negative polar radius")
        not_programmed = "RP" not in words or not absolute
        if not_programmed and any(recorder.known[axis] != Known.PROGRAM for axis in turn.columns(recorder)):
            raise block.refuse("polar coordinates from a position that the program has not given in this frame")
        place = _around(self.pole, self.radius, self.angle)
        found, others = [*programmed.words], {**programmed.others, second: place[1]}
        for axis, index, value in zip((first, second), indices.values(), place, strict=False):
            letter = recorder.machine.names[axis]
            base = 0.0 if absolute else recorder.position[axis]
            block = with_word(block, index, given_as(block.words[index], letter, (value - base) / turn.unit))
            found.append((AxisWord(axis, index, not absolute), value - base))
            others.pop(axis, None)
        return Programmed(block, found, others)

    @staticmethod
    def _value(block: Block, word: Word | None, before: float | None, unit: float, absolute: bool) -> float:
        if word is None:
            raise block.refuse("polar coordinates without AP, or without RP from a block before")
        value = value_of(block, word) * unit
        if word.mode == "AC" or (not word.mode and absolute):
            return value
        if word.mode not in ("", "IC"):
            raise block.refuse(f"{word.mode} of a polar coordinate")
        if before is None:
            raise block.refuse(
                "an increment of a polar coordinate needs a value from an earlier block: write the absolute value"
            )
        return before + value

    def arc(self, block: Block, content: Content, recorder: Recorder, turn: Turn, target: list[float]) -> Arc:
        """The arc round the pole to polar coordinates."""
        ends = turn.ends(block, recorder, target)
        if content.other.keys() & {"I", "J", "K", "CR", "AR", "TURN"}:
            raise block.refuse("the arc about the pole has a second centre or radius: write AP and RP only")
        if same(ends.start, ends.end):
            raise block.refuse("the arc about the pole ends at its start: write a full circle with a centre I J K")
        return arc_by_centre(block, ends, self.pole, (None, None), absolute=True)._replace(form="incremental")


def _around(pole: Point, radius: float, degrees: float) -> Point:
    angle = math.radians(degrees)
    return pole[0] + radius * math.cos(angle), pole[1] + radius * math.sin(angle)
