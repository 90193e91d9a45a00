"""Arcs of ISO blocks, by R or by I J K, and polar coordinates (G16)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from postproc.iso.modes import Modes
from postproc.iso.words import Content, Values
from postproc.motion.arcs import (
    Ends,
    arc_by_centre,
    arc_by_radius,
    begin_arc,
    centre_letters,
    centre_words,
    radius_alone,
)
from postproc.motion.circles import radius_fault
from postproc.motion.moves import Arc, AxisWord, Polar
from postproc.motion.recorder import Recorder
from postproc.text.block import Block


def read_arc(
    content: Content, sense: int, target: list[float], recorder: Recorder, values: Values, modes: Modes
) -> Arc:
    """The arc of a block to `target`, programmed coordinates; Refusal for words that give no arc."""
    block, other = content.block, content.other
    ends = begin_arc(block, recorder, modes.plane, sense, target)
    turns = _turns(content, values)
    i = radius_alone(block, other, "R")
    if i is not None:
        if turns:
            raise block.refuse("an arc of several turns (P) needs a centre I J K instead of R")
        form = "radius-absolute" if modes.arc_absolute else "radius"
        return arc_by_radius(block, ends, values.number(block, i, modes.unit), i, form)
    indices = centre_words(block, other, modes.plane, lambda i: block.words[i].value or 0.0, "R")
    if modes.arc_absolute and None in indices:
        raise block.refuse(f"an absolute centre (G90.1) takes both {' and '.join(centre_letters(modes.plane))}")
    x, y = (0.0 if i is None else values.number(block, i, modes.unit) for i in indices)
    hint = _hint(ends, (x, y), modes.arc_absolute)
    return arc_by_centre(block, ends, (x, y), indices, absolute=modes.arc_absolute, hint=hint)._replace(turns=turns)


def _turns(content: Content, values: Values) -> int:
    """Whole turns besides the arc: P counts the one that it ends in."""
    if "P" not in content.other:
        return 0
    turns = values.whole(content.block, content.other["P"])
    if turns < 1:
        raise content.refuse("P of the arc must be 1 or more: it counts the turns")
    return turns - 1


def _hint(ends: Ends, programmed: tuple[float, float], absolute: bool) -> str:
    """Advice where the centre fits only as an absolute position."""
    if absolute or radius_fault(ends.start, ends.end, programmed) is not None:
        return ""
    return '; its centre would fit as absolute: for such a control set arc_centres = "absolute" in the machine file'


# ---- polar coordinates


@dataclass
class PolarCoordinates:
    """Radius and angle that still hold, from G16 to G15."""

    radius: float | None = None
    """mm."""
    angle: float | None = None
    """Degrees, from the first axis of the plane towards the second."""

    def take(
        self, block: Block, axes: tuple[int, int], words: list[tuple[AxisWord, float]]
    ) -> tuple[list[tuple[AxisWord, float]], Polar | None]:
        """The words of other axes, and the polar position of the words in the plane; None while there is none yet.

        words: with their values, the angle in degrees.
        """
        programmed = {word.axis: (word.word, value) for word, value in words if word.axis in axes}
        self.radius = programmed.get(axes[0], (None, self.radius))[1]
        self.angle = programmed.get(axes[1], (None, self.angle))[1]
        others = [(word, value) for word, value in words if word.axis not in axes]
        if self.radius is None or self.angle is None:
            if programmed:
                raise block.refuse(
                    "polar coordinates (G16) need a radius and an angle before the first move: write both"
                )
            return others, None
        indices = [programmed[axis][0] if axis in programmed else None for axis in axes]
        return others, Polar(axes, self.radius, self.angle, (indices[0], indices[1]))


def position_of(polar: Polar) -> tuple[float, float]:
    """The position in the plane, mm."""
    angle = math.radians(polar.angle)
    return polar.radius * math.cos(angle), polar.radius * math.sin(angle)
