"""Polar coordinates of ISO programs (G16): the first axis of the plane says a radius, the second an angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from postproc.motion.moves import AxisWord, Polar
from postproc.text.block import Block


@dataclass
class PolarPlaces:
    """Radius and angle that still hold, from G16 to G15."""

    radius: float | None = None
    """mm."""
    angle: float | None = None
    """Degrees, from the first axis of the plane towards the second."""

    def take(
        self, block: Block, axes: tuple[int, int], words: list[tuple[AxisWord, float]]
    ) -> tuple[list[tuple[AxisWord, float]], Polar | None]:
        """The words of other axes, and the place that those of the plane say; None while there is none yet.

        words: with their values, the angle in degrees.
        """
        said = {word.axis: (word.word, value) for word, value in words if word.axis in axes}
        self.radius = said.get(axes[0], (None, self.radius))[1]
        self.angle = said.get(axes[1], (None, self.angle))[1]
        others = [(word, value) for word, value in words if word.axis not in axes]
        if self.radius is None or self.angle is None:
            if said:
                raise block.refuse("a polar coordinate without the other")
            return others, None
        indices = [said[axis][0] if axis in said else None for axis in axes]
        return others, Polar(axes, self.radius, self.angle, (indices[0], indices[1]))


def place_of(polar: Polar) -> tuple[float, float]:
    """The place in the plane, mm."""
    angle = math.radians(polar.angle)
    return polar.radius * math.cos(angle), polar.radius * math.sin(angle)
