"""Arcs of ISO blocks, by R or by I J K, and polar coordinates (G16)."""

from __future__ import annotations

import msgspec

from postproc.control.arcs import read_arc
from postproc.control.interpreter import AxisWords
from postproc.control.words import whole_of
from postproc.iso.modal_state import ModalState
from postproc.iso.words import Content
from postproc.motion.moves import Arc, Polar
from postproc.text.block import Block

HINT = '. With an absolute centre it is a circle: for such a control set arc_centres = "absolute" in the machine file'


def arc_of(control: ModalState, content: Content, target: list[float]) -> Arc:
    """The arc of a block to `target`, programmed coordinates; Refusal for words that give no arc."""
    block, turns, absolute = content.block, _turns(content), control.arc_absolute
    return read_arc(control, block, content.other, target, radius="R", turns=turns, absolute=absolute, hint=HINT)


def _turns(content: Content) -> int:
    """Whole turns besides the arc: P counts the one that it ends in."""
    if "P" not in content.other:
        return 0
    turns = whole_of(content.block, content.block.words[content.other["P"]])
    if turns < 1:
        raise content.refuse("P of the arc must be 1 or more: it counts the turns")
    return turns - 1


# ---- polar coordinates


class PolarCoordinates(msgspec.Struct):
    """Radius and angle that still hold, from G16 to G15."""

    radius: float | None = None
    """mm."""
    angle: float | None = None
    """Degrees, from the first axis of the plane towards the second."""

    def take(self, block: Block, axes: tuple[int, int], words: AxisWords) -> tuple[AxisWords, Polar | None]:
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
