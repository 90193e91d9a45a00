"""Words of drawn programs: places, angles and feeds at random, in the form of a dialect."""

from __future__ import annotations

import random

REACH = 60.0
"""Largest coordinate, mm."""


class Words:
    """Draws the words of a program; a dialect gives the forms of its numbers."""

    SIGN = ""
    """`+` where every number has its sign."""
    POINT = ""
    """What ends a whole number."""

    def __init__(self, rng: random.Random, rotary: str) -> None:
        self.rng, self.rotary = rng, rotary

    def number(self, mm: float) -> str:
        """Text of a length."""
        raise NotImplementedError

    def far(self, reach: float = REACH) -> float:
        return self.rng.uniform(-reach, reach)

    def angle(self) -> str:
        return self.degrees(self.rng.uniform(5, 40))

    def some(self, axes: str = "XYZ") -> str:
        return "".join(sorted(self.rng.sample(axes, self.rng.randint(1, len(axes)))))

    def feed(self) -> str:
        return f"F{self.rng.choice((100, 250, 800))}{self.POINT}"

    def places(self, axes: str, reach: float = REACH, by: str = "") -> str:
        """Words of axes at random places; by: what stands before each, such as the I of an increment."""
        drawn = ((a, self.rng.uniform(5, 40) if a in "ABC" else self.far(reach)) for a in axes)
        return " ".join(by + self.word(a, value) for a, value in drawn)

    def word(self, axis: str, value: float) -> str:
        """A word of an axis at a position, mm or degrees."""
        return axis + (self.degrees(value) if axis in "ABC" else self.number(value))

    def degrees(self, value: float) -> str:
        """Text of an angle."""
        return f"{value:{self.SIGN}.3f}"
