"""Arcs of Siemens programs: G2 and G3 with a centre, a radius, an angle, or round a pole."""

from __future__ import annotations

import math
from typing import NamedTuple

from postproc.motion.arcs import (
    CENTRES,
    Ends,
    arc_by_centre,
    arc_by_radius,
    begin_arc,
    centre_letters,
    centre_words,
    radius_alone,
)
from postproc.motion.circles import Point, circle_through, point_at, tangent_circle
from postproc.motion.moves import Arc, AxisWord, Known
from postproc.motion.recorder import Recorder
from postproc.siemens.codes import CALCULATED_ARCS, MIDDLES
from postproc.siemens.words import Content, given_as, plain_of, value_in, value_of, with_word
from postproc.text.block import Block

ARC_WORDS = frozenset((*CENTRES, *MIDDLES, "CR", "AR", "TURN"))


class Turn(NamedTuple):
    """How an arc is run."""

    plane: str
    """Its first, second and normal axis."""
    sense: int
    """+1 counter-clockwise seen from the end of the normal."""
    unit: float
    """mm per unit of its words."""

    def ends(self, block: Block, recorder: Recorder, target: list[float]) -> Ends:
        """Start and end in the plane; Refusal for a start that the program has not given."""
        return begin_arc(block, recorder, self.plane, self.sense, target)

    def columns(self, recorder: Recorder) -> tuple[int, int, int]:
        """Of the axes of the plane."""
        first, second, normal = (recorder.machine.index(axis) for axis in self.plane)
        return first, second, normal

    @property
    def letters(self) -> tuple[str, str]:
        """Of the words of a centre."""
        return centre_letters(self.plane)


def arc_of(block: Block, content: Content, recorder: Recorder, turn: Turn, target: list[float]) -> Arc:
    """The circle of an arc to `target`, programmed coordinates, mm; Refusal where the words give none."""
    ends = turn.ends(block, recorder, target)
    turns = value_in(block, content, "TURN") or 0.0
    if turns != int(turns) or turns < 0.0:
        raise block.refuse(f"TURN={turns:g} is no number of turns")
    index = radius_alone(block, content.other, "CR")
    if index is None:
        return _by_centre(block, content, turn, ends)._replace(turns=int(turns))
    if turns:
        raise block.refuse("TURN needs an arc with a centre: a radius or an angle AR excludes it")
    return arc_by_radius(block, ends, value_of(block, block.words[index]) * turn.unit, index)


def _by_centre(block: Block, content: Content, turn: Turn, ends: Ends) -> Arc:
    indices = centre_words(block, content.other, turn.plane, lambda i: value_of(block, block.words[i]), "CR")
    programmed, absolute = _centre(block, content, turn)
    return arc_by_centre(block, ends, programmed, indices, absolute=absolute)


def _centre(block: Block, content: Content, turn: Turn) -> tuple[Point, bool]:
    """The values of the words of a centre, mm, and whether they are absolute and not from the start."""
    indices = [content.other.get(letter) for letter in turn.letters]
    words = [None if i is None else block.words[i] for i in indices]
    modes = {"" if word.mode == "IC" else word.mode for word in words if word is not None}
    if len(modes) > 1 or not modes <= {"", "AC"}:
        raise block.refuse(
            "one coordinate of the centre is absolute and the other incremental: write both in the same way"
        )
    absolute = modes == {"AC"}
    if absolute and None in indices:
        raise block.refuse(f"an absolute centre takes both {' and '.join(turn.letters)}")
    first, second = (0.0 if word is None else value_of(block, word) * turn.unit for word in words)
    return (first, second), absolute


# ---- AR: the angle of an arc, with its end or with its centre


class Programmed(NamedTuple):
    """A block whose words are replaced by coordinates or a radius, and its end point."""

    block: Block
    words: list[tuple[AxisWord, float]]
    """Axis words with their values, mm or degrees."""
    others: dict[int, float]
    """Targets, mm, of axes that have no word."""

    def target(self, recorder: Recorder) -> list[float]:
        """Where the move ends, programmed coordinates."""
        target = recorder.target(self.block, self.words)
        for axis, value in self.others.items():
            target[axis] = value
        return target


def with_angle(
    block: Block, content: Content, recorder: Recorder, turn: Turn, programmed: Programmed, absolute: bool
) -> Programmed:
    """An arc by its angle AR, with the radius or the end that a correction writes instead.

    Beside an end in the plane AR gives the radius, beside a centre the end; without `absolute`, G91, by an increment.
    """
    index = content.other.pop("AR")
    angle = plain_of(block, block.words[index])
    if not 0.0 < angle < 360.0:
        raise block.refuse(f"an arc of {angle:g} degrees")
    first, second, _ = turn.columns(recorder)
    _, _, start, end = turn.ends(block, recorder, programmed.target(recorder))
    if not any(word.axis in (first, second) for word, _ in programmed.words):
        if recorder.known[first] != Known.PROGRAM or recorder.known[second] != Known.PROGRAM:
            raise block.refuse("an arc from a position that the program has not given in this frame")
        shift, placed = _centre(block, content, turn)
        base = (0.0, 0.0) if placed else start
        centre = (base[0] + shift[0], base[1] + shift[1])
        end = point_at(start, centre, turn.sense * math.radians(angle))
        value = end[0] - (0.0 if absolute else start[0])
        coordinate = given_as(block.words[index], turn.plane[0], value / turn.unit)
        words = [*programmed.words, (AxisWord(first, index, not absolute), value)]
        return Programmed(with_word(block, index, coordinate), words, {second: end[1]})
    if content.other.keys() & set(CENTRES):
        raise block.refuse("the arc has AR, an end point and a centre: write AR with one of the others")
    radius = math.dist(start, end) / 2.0 / math.sin(math.radians(angle) / 2.0)
    if radius == 0.0:
        raise block.refuse("AR of an arc that ends where it starts")
    content.other["CR"] = index
    by_radius = given_as(block.words[index], "CR", math.copysign(radius, 180.0 - angle) / turn.unit)
    return programmed._replace(block=with_word(block, index, by_radius))


# ---- CIP and CT: circles that the control calculates; a corrected block has G2 or G3, and the centre


def _middle(block: Block, content: Content, turn: Turn, start: Point, *, absolute: bool) -> Point:
    """The intermediate point of CIP, mm."""
    names = [MIDDLES["XYZ".index(axis)] for axis in turn.plane]
    if not all(name in content.other for name in names[:2]) or names[2] in content.other:
        raise block.refuse(f"CIP takes {names[0]} and {names[1]}: a circle in its plane")
    x, y = (block.words[content.other[name]] for name in names[:2])
    if {x.mode, y.mode} - {"", "AC", "IC"}:
        raise block.refuse("the intermediate point of CIP must be absolute (AC) or incremental (IC)")
    programmed = [value_of(block, word) * turn.unit for word in (x, y)]
    counts = [word.mode == "IC" or (not word.mode and not absolute) for word in (x, y)]
    first, second = (value + base * more for value, base, more in zip(programmed, start, counts, strict=True))
    return first, second


def calculated_arc(
    block: Block, content: Content, recorder: Recorder, turn: Turn, target: list[float], *, absolute: bool
) -> Arc:
    """The arc of CIP or CT to `target`, with G90 (`absolute`) or G91; Refusal for one that leaves its plane."""
    _, _, start, end = turn.ends(block, recorder, target)
    columns = turn.columns(recorder)
    if target[columns[2]] != recorder.position[columns[2]]:
        raise block.refuse(
            "CIP or CT leaves the working plane: circles in space and tangential helices are not corrected"
        )
    if content.other.keys() & (ARC_WORDS - {*MIDDLES}):
        raise block.refuse("CIP or CT with a centre, a radius or turns")
    name = next(name for name in CALCULATED_ARCS if name in content.names)
    if name == "CIP":
        found = circle_through(start, _middle(block, content, turn, start, absolute=absolute), end)
    else:
        heading = recorder.heading(columns)
        if heading is None or content.other.keys() & {*MIDDLES}:
            raise block.refuse("CT needs a move in its plane directly before it and takes no intermediate point")
        found = tangent_circle(start, end, heading)
    if found is None:
        raise block.refuse(f"{name} that is a straight line")
    centre, sense = found
    return Arc(columns, sense, centre, False, "worked-out", (None, None))
