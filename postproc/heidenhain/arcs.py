"""Klartext moves round a pole and from it: CC, C, CR, CT, CP, CTP, and LP, which goes straight to polar coordinates.

A pole lies in the plane of X Y, Y Z or Z X. Polar angles count from the first of the two, towards the second. For
words that a polar block omits, and as the base of its increments, the present position about the pole counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from postproc.control.words import Content, value_of
from postproc.heidenhain.channel import Channel
from postproc.heidenhain.codes import DIRECTIONS
from postproc.heidenhain.words import straight
from postproc.motion.arcs import Ends, arc_by_centre, arc_by_radius, begin_arc
from postproc.motion.circles import SAME_POINT_MM, Point, same, sweep, tangent_circle
from postproc.motion.moves import Arc, AxisWord, Kind, PolarEnd
from postproc.text.block import Block

Plane = tuple[int, int, int]


class _Pole(NamedTuple):
    """A pole as a CC has put it."""

    at: Point
    plane: Plane
    number: int
    """Number of the pole in the program."""
    sure: bool
    """Both coordinates are programmed, and not as increments: the control has them as they are here."""
    frame: int
    """Number of changes of the frame before the pole, which is valid in its own frame only."""


class _PolarPosition(NamedTuple):
    """The end of a polar block: its coordinates and their words."""

    radius: float
    angle: float
    """rad"""
    turned: float | None
    """rad, where the angle is an increment."""
    words: tuple[int | None, int | None]
    at: Point
    programmed: bool
    """The block alone gives the end, independent of the position before it."""


@dataclass
class Arcs:
    """Moves of one control that have to do with a pole."""

    channel: Channel
    pole: _Pole | None = None
    block: int = -1
    """Index of the block of the pole in the chunk; -1 if an earlier chunk contains it."""
    words: tuple[int | None, int | None] = (None, None)
    """Indices of the coordinates of the pole in that block."""
    count: int = 0
    """Number of poles read."""

    def new_chunk(self) -> None:
        """The blocks before are written: their words can no longer be edited."""
        self.block, self.words = -1, (None, None)

    @property
    def planes(self) -> tuple[Plane, Plane, Plane]:
        """The working plane first."""
        x, y, z = self.channel.x_y_z
        return (x, y, z), (y, z, x), (z, x, y)

    # ---- poles

    def set_pole(self, index: int, block: Block) -> None:
        """CC."""
        channel = self.channel
        recorder = channel.recorder
        words = channel.axis_words(block, range(len(block.words)))
        axes = [word.axis for word, _ in words]
        if len(set(axes)) < len(axes):
            raise block.refuse("the pole (CC) has one coordinate twice: write each once")
        before = self._present()
        plane = self._plane_of(block, axes, before)
        relative = [word.axis for word, _ in words if word.incremental] if words else plane[:2]
        if not all(recorder.known[axis] for axis in relative):
            raise block.refuse(
                "the pole (CC) counts from a position that the program has not given: write it in absolute coordinates"
            )
        here = [recorder.position[axis] for axis in plane[:2]]
        kept: tuple[float | None, ...] = before.at if before is not None and before.plane == plane else (None, None)
        pole: list[float | None] = list(kept) if words else list(here)
        word_indices: list[int | None] = [None, None]
        for word, value in words:
            i = plane.index(word.axis)
            pole[i] = here[i] + value if word.incremental else value
            word_indices[i] = None if word.incremental else word.word
        if pole[0] is None or pole[1] is None:
            raise block.refuse("the pole (CC) has one coordinate, and no earlier pole gives the other: write both")
        self.count += 1
        sure = None not in word_indices
        self.pole = _Pole((pole[0], pole[1]), plane, self.count, sure, channel.frames)
        self.block, self.words = index, (word_indices[0], word_indices[1])

    def _plane_of(self, block: Block, axes: list[int], before: _Pole | None) -> Plane:
        possible = [plane for plane in self.planes if set(axes) <= set(plane[:2])]
        if not possible:
            raise block.refuse("the coordinates of the pole (CC) are in no plane: write X Y, Y Z or Z X")
        if len(possible) > 1 and before is not None and before.plane in possible:
            return before.plane
        return possible[0]

    def _present(self) -> _Pole | None:
        """The pole, if it was put in the present frame."""
        return self.pole if self.pole is not None and self.pole.frame == self.channel.frames else None

    def _pole(self, block: Block) -> _Pole:
        pole = self._present()
        if pole is None:
            raise block.refuse("the block has no pole in the present frame: write CC before it")
        return pole

    # ---- arcs to a point

    def circle(self, index: int, block: Block, content: Content) -> None:
        """C, CR and CT."""
        channel = self.channel
        sense = self._sense(block, content) if block.kind != "tangent" else 0
        words = channel.axis_words(block, content.axes)
        if not words:
            raise block.refuse("the arc has no end point: write its coordinates")
        target = channel.target(block, words)
        plane = self._pole(block).plane if block.kind == "circle" else self.planes[0]
        ends = begin_arc(block, channel.recorder, self._letters(plane), sense, target)
        match block.kind:
            case "circle":
                arc = self._about_pole(block, ends)
            case "tangent":
                arc = self._tangent(block, plane, ends.start, ends.end)
            case _:
                arc = self._by_radius(block, ends)
        channel.move(index, Kind.ARC, target, words, arc)

    def _sense(self, block: Block, content: Content) -> int:
        senses = DIRECTIONS.keys() & content.other.keys()
        if len(senses) != 1:
            raise block.refuse("the arc has no single sense of rotation: write DR+ or DR-")
        return DIRECTIONS[senses.pop()]

    def _letters(self, plane: Plane) -> str:
        return "".join(self.channel.machine.names[axis] for axis in plane)

    def _about_pole(self, block: Block, ends: Ends) -> Arc:
        pole = self._pole(block)
        arc = arc_by_centre(block, ends, pole.at, self.words, absolute=True)
        return arc._replace(form="pole", pole_block=self.block, pole=pole.number)

    def _by_radius(self, block: Block, ends: Ends) -> Arc:
        for i, word in enumerate(block.words):
            if word.address == "R" and word.start < word.end:
                radius = value_of(block, word) * self.channel.modal.unit
                return arc_by_radius(block, ends, radius, i, notes=self.channel.notes)._replace(pole=self._number)
        raise block.refuse("CR has no radius: write R")

    def _tangent(self, block: Block, plane: Plane, start: Point, end: Point) -> Arc:
        """The arc from start to end that leaves the start as the move before arrived there."""
        if self.channel.modal.cornered:
            raise block.refuse(
                "a tangential arc (CT) directly after RND or CHF is not corrected: write it with CR or CC and C"
            )
        heading = self.channel.recorder.heading(plane)
        if heading is None:
            raise block.refuse(
                "a tangential arc needs a move in its plane directly before it: write the arc with a radius or a centre"
            )
        found = tangent_circle(start, end, heading)
        if found is None:
            raise block.refuse("the tangential arc is a straight line: write L")
        centre, sense = found
        return Arc(plane, sense, centre, False, "tangent", (None, None), pole=self._number)

    @property
    def _number(self) -> int:
        """Number of the active pole, changed if a helix replaces an arc; without one, below 0 and of the frame."""
        pole = self._present()
        return pole.number if pole is not None else -1 - self.channel.frames

    # ---- polar coordinates

    def polar(self, index: int, block: Block, content: Content) -> None:
        """LP, CP and CTP."""
        channel = self.channel
        pole = self._pole(block)
        words = channel.axis_words(block, content.axes)
        if any(word.axis in pole.plane[:2] for word, _ in words):
            raise block.refuse("Cartesian and polar coordinates are mixed in the plane of the pole: write one kind")
        target = channel.target(block, words)
        first, second, _ = pole.plane
        recorder = channel.recorder
        start = recorder.position[first], recorder.position[second]
        position = self._polar_position(block, pole, start)
        if not (recorder.known[first] and recorder.known[second]) and (
            block.kind != "polar_line" or not position.programmed
        ):
            raise block.refuse(
                "the polar coordinates count from a position that the program has not given: write it before them"
            )
        target[first], target[second] = position.at
        kind, arc = straight(content), None
        if block.kind == "polar_circle":
            kind, arc = Kind.ARC, self._polar_arc(block, content, pole, (start, position))
        elif block.kind == "polar_tangent":
            kind, arc = Kind.ARC, self._tangent(block, pole.plane, start, position.at)
        recorder.record_polar_end(index, PolarEnd(pole.plane, pole.at, pole.number, pole.sure, *position.words))
        if not position.programmed and recorder.known[first] != recorder.known[second]:
            recorder.mark_uncertain(pole.plane[:2])
        words += [(AxisWord(axis, -1, not position.programmed), target[axis]) for axis in (first, second)]
        channel.move(index, kind, target, words, arc)

    def _polar_position(self, block: Block, pole: _Pole, start: Point) -> _PolarPosition:
        x, y = start[0] - pole.at[0], start[1] - pole.at[1]
        radius, angle, turned = math.hypot(x, y), math.atan2(y, x), None
        found: dict[str, int] = {}
        counted = False
        for i, word in enumerate(block.words):
            name = word.address.removeprefix("I")
            if name not in ("PR", "PA"):
                continue
            if name in found:
                raise block.refuse(f"the block has two {name} words: write one")
            found[name] = i
            value, more = value_of(block, word), word.address[0] == "I"
            counted |= more
            if name == "PR":
                radius = radius * more + value * self.channel.modal.unit
            else:
                turned = math.radians(value) if more else None
                angle = (angle if more else 0.0) + math.radians(value)
        if not found or ("PA" not in found and block.kind != "polar_line"):
            raise block.refuse(
                "the block has no polar angle: write PA or IPA"
                if found
                else "the block has no polar coordinates: write PR and PA"
            )
        if radius < SAME_POINT_MM:
            raise block.refuse("the polar radius PR is not above 0: write a positive radius")
        at = (pole.at[0] + radius * math.cos(angle), pole.at[1] + radius * math.sin(angle))
        return _PolarPosition(
            radius, angle, turned, (found.get("PR"), found.get("PA")), at, len(found) == 2 and not counted
        )

    def _polar_arc(self, block: Block, content: Content, pole: _Pole, ends: tuple[Point, _PolarPosition]) -> Arc:
        """CP: round the pole at the radius of the start, by an increment also more than once."""
        sense = self._sense(block, content)
        start, position = ends
        if position.words[0] is not None:
            raise block.refuse(
                "CP takes no radius PR: the radius of the arc is the distance of its start from the pole"
            )
        if position.turned is None:
            if same(start, position.at):
                raise block.refuse(
                    "CP ends at the angle at which it starts, which is a full circle or no move: write IPA"
                )
            return Arc(pole.plane, sense, pole.at, False, "polar", self.words, self.block, pole=pole.number)
        if position.turned == 0.0 or (position.turned > 0.0) != (sense > 0):
            raise block.refuse("IPA and DR have different signs: write the same sense of rotation in both")
        turned = abs(position.turned)
        full = same(start, position.at) and turned > math.pi
        once = abs(sweep(start, position.at, pole.at, sense, full))
        turns = round((turned - once) / math.tau)
        return Arc(pole.plane, sense, pole.at, full, "polar", self.words, self.block, turns, pole.number)
