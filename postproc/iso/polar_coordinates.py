"""Polar coordinates of ISO programs (G16)."""

from __future__ import annotations

import msgspec

from postproc.control.channel import AxisWords
from postproc.motion.moves import Polar
from postproc.text.block import Block


class PolarCoordinates(msgspec.Struct):
    """Radius and angle in force, from G16 to G15."""

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
