"""Arcs of Siemens programs: G2 and G3 with a centre, a radius, an angle, or round a pole."""

from __future__ import annotations

import math
from typing import NamedTuple

from postproc.control.arcs import arc_ends, centre_of, read_arc
from postproc.control.channel import AxisWords, Channel
from postproc.control.words import given_as, value_of, with_word
from postproc.motion.arcs import CENTRES, centre_letters
from postproc.motion.circles import Point, circle_through, point_at, tangent_circle
from postproc.motion.moves import Arc, AxisWord, Known
from postproc.motion.recorder import Recorder
from postproc.siemens.codes import CALCULATED_ARCS, MIDDLES
from postproc.siemens.words import Content, plain_of
from postproc.text.block import Block

ARC_WORDS = frozenset((*CENTRES, *MIDDLES, "CR", "AR", "TURN"))


def arc_of(channel: Channel, block: Block, content: Content, target: list[float]) -> Arc:
    """The circle of an arc to `target`, programmed coordinates, mm; Refusal where the words give none.

    The centre of a helix is a point with I, J and K (NC programming, 12/2019, 2.9.7), of which the plane needs two.
    """
    turns = value_of(block, block.words[content.other["TURN"]]) if "TURN" in content.other else 0.0
    if turns != int(turns) or turns < 0.0:
        raise block.refuse(f"TURN={turns:g} is no number of turns: write a whole number of 0 or more")
    absolute = _is_absolute(channel, block, content)
    across = next(letter for letter in CENTRES if letter not in centre_letters(channel.modal.plane))
    if across in content.other and channel.number(block, content.other[across], 1.0):
        channel.notes.add(
            f"{across} of an arc lies across the plane of its circle: taken as without effect", block.line
        )
    return read_arc(
        channel, block, content.other, target, radius="CR", turns=int(turns), absolute=absolute, in_space=True
    )


def _is_absolute(channel: Channel, block: Block, content: Content) -> bool:
    """True for a centre by AC; Refusal where its two words differ."""
    words = [
        block.words[content.other[letter]] for letter in centre_letters(channel.modal.plane) if letter in content.other
    ]
    modes = {"" if word.mode == "IC" else word.mode for word in words}
    if len(modes) > 1 or not modes <= {"", "AC"}:
        raise block.refuse(
            "one coordinate of the centre is absolute and the other incremental: write both in the same way"
        )
    return modes == {"AC"}


# ---- AR: the angle of an arc, with its end or with its centre


class Programmed(NamedTuple):
    """A block whose words are replaced by coordinates or a radius, and its end point."""

    block: Block
    words: AxisWords
    """Axis words with their values, mm or degrees."""
    others: dict[int, float]
    """Targets, mm, of axes that have no word."""

    def target(self, recorder: Recorder) -> list[float]:
        """Where the move ends, programmed coordinates."""
        target = recorder.target(self.block, self.words)
        for axis, value in self.others.items():
            target[axis] = value
        return target


def with_angle(channel: Channel, block: Block, content: Content, programmed: Programmed) -> Programmed:
    """An arc by its angle AR, with the radius or the end that a correction writes instead.

    With an end in the plane AR gives the radius, with a centre the end; the end is an increment under G91.
    """
    index, recorder = content.other.pop("AR"), channel.recorder
    angle = plain_of(block, block.words[index])
    if not 0.0 < angle < 360.0:
        raise block.refuse(f"AR={angle:g} is no angle of an arc: write an angle between 0 and 360 degrees")
    first, second, _ = channel.modal.plane_columns
    _, _, start, end = arc_ends(channel, block, programmed.target(recorder))
    if not any(word.axis in (first, second) for word, _ in programmed.words):
        if recorder.known[first] != Known.PROGRAM or recorder.known[second] != Known.PROGRAM:
            raise block.refuse(
                "the arc starts at a position that the program has not given in this frame: write its start before it"
            )
        absolute = _is_absolute(channel, block, content)
        letters = centre_letters(channel.modal.plane)
        shift = centre_of(
            channel, block, (content.other.get(letters[0]), content.other.get(letters[1])), absolute=absolute
        )
        base = (0.0, 0.0) if absolute else start
        centre = (base[0] + shift[0], base[1] + shift[1])
        end = point_at(start, centre, channel.modal.sense * math.radians(angle))
        value = end[0] - (0.0 if channel.modal.absolute else start[0])
        coordinate = given_as(block.words[index], channel.modal.plane[0], value / channel.modal.unit)
        words = [*programmed.words, (AxisWord(first, index, not channel.modal.absolute), value)]
        return Programmed(with_word(block, index, coordinate), words, {second: end[1]})
    if content.other.keys() & set(CENTRES):
        raise block.refuse("the arc has AR, an end point and a centre: write AR with one of the others")
    radius = math.dist(start, end) / 2.0 / math.sin(math.radians(angle) / 2.0)
    if radius == 0.0:
        raise block.refuse("the arc with AR ends where it starts: write a full circle with a centre I J K")
    content.other["CR"] = index
    by_radius = given_as(block.words[index], "CR", math.copysign(radius, 180.0 - angle) / channel.modal.unit)
    return programmed._replace(block=with_word(block, index, by_radius))


# ---- CIP and CT: circles that the control calculates; a corrected block has G2 or G3, and the centre


def _middle(channel: Channel, block: Block, content: Content, start: Point) -> Point:
    """The intermediate point of CIP, mm."""
    names = [MIDDLES["XYZ".index(axis)] for axis in channel.modal.plane]
    if not all(name in content.other for name in names[:2]) or names[2] in content.other:
        raise block.refuse(f"CIP takes {names[0]} and {names[1]}: write both, and no {names[2]}")
    words = [block.words[content.other[name]] for name in names[:2]]
    if {word.mode for word in words} - {"", "AC", "IC"}:
        raise block.refuse("the intermediate point of CIP must be absolute (AC) or incremental (IC)")
    first, second = (
        value_of(block, word) * channel.modal.unit
        + base * (word.mode == "IC" or (not word.mode and not channel.modal.absolute))
        for word, base in zip(words, start, strict=True)
    )
    return first, second


def calculated_arc(channel: Channel, block: Block, content: Content, target: list[float]) -> Arc:
    """The arc of CIP or CT to `target`; Refusal for one that leaves its plane."""
    _, _, start, end = arc_ends(channel, block, target)
    columns = channel.modal.plane_columns
    if target[columns[2]] != channel.recorder.position[columns[2]]:
        raise block.refuse(
            "CIP or CT leaves the working plane: circles in space and tangential helices are not corrected"
        )
    if content.other.keys() & (ARC_WORDS - {*MIDDLES}):
        raise block.refuse("CIP or CT has a centre, a radius or turns: write G2 or G3 with them")
    name = next(name for name in CALCULATED_ARCS if name in content.names)
    if name == "CIP":
        found = circle_through(start, _middle(channel, block, content, start), end)
    else:
        heading = channel.recorder.heading(columns)
        if heading is None or content.other.keys() & {*MIDDLES}:
            raise block.refuse("CT needs a move in its plane directly before it and takes no intermediate point")
        found = tangent_circle(start, end, heading)
    if found is None:
        raise block.refuse(f"the circle of {name} is a straight line: write G1")
    centre, sense = found
    return Arc(columns, sense, centre, False, "calculated", (None, None))
