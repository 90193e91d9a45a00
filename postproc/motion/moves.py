"""Parts of one move: kind, words, circle, hole, polar position, and the source of its axis positions."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple

import msgspec


class Kind(IntEnum):
    """Kind of a move."""

    RAPID = 0
    LINE = 1
    ARC = 2
    MACHINE = 3
    """To machine coordinates (G53, M91): recorded for the position at its end, never corrected."""
    TAKE_UP = 4
    """Backlash take-up, added by ncomp before axes reverse. Its known axes are the axes that it moves."""

    CYCLE = 5
    """Canned cycle: to the bottom of a hole, then back to the start of the next move."""
    PRESET = 6
    """No move: sets the coordinates of the current position (G92), in the frame that results."""

    PATTERN = 7
    """To a later hole of a pattern: it gets the correction of the first hole."""


class Known(IntEnum):
    """Source of the position of an axis."""

    ASSUMED = 0
    """Not programmed; assumed at home."""
    MACHINE = 1
    """Programmed in machine coordinates, or in an earlier frame. Its coordinate in the present frame depends on the
    given offsets, so the axis is not corrected and no word is added for it."""
    PROGRAM = 2
    """Programmed in the present frame: the axis is at a corrected position."""


class StartPosition(msgspec.Struct):
    """The position of the axes when the program starts, as the user declares it: where the tool stands, uncorrected."""

    at: dict[int, float] = msgspec.field(default_factory=dict)
    """Axes that are still there, by column; mm or degrees, in the coordinates that are in force at the first move."""
    begun: bool = False
    """Something has moved."""

    @property
    def pending(self) -> dict[int, float]:
        """The positions as long as nothing has moved: they hold in every frame until then."""
        return {} if self.begun else dict(self.at)

    def leave(self, axes: Iterable[int]) -> None:
        """Some axes have moved, or are named."""
        self.begun = True
        for axis in axes:
            self.at.pop(axis, None)


class AxisWord(NamedTuple):
    """The word of a block that names an axis."""

    axis: int
    word: int
    """Index into the words of the block; -1 if the block gives the axis in another form."""
    incremental: bool


class Arc(NamedTuple):
    """Circle of an arc move, mm, programmed coordinates."""

    plane: tuple[int, int, int]
    """Columns of the first, second and normal axis, right-handed: G17 X Y Z, G18 Z X Y, G19 Y Z X."""
    sense: int
    """Sense of rotation: +1 counter-clockwise seen from the positive end of the normal axis, otherwise -1."""
    centre: tuple[float, float]
    full: bool
    """True if start and end coincide and the move is a full circle."""
    form: str
    """Form of the programmed circle: `incremental` or `absolute` (I J K); `radius`, or `radius-absolute` if I J K would
    be positions; Klartext `pole` (CC), `polar` (CC, and the end by an angle) or `tangent`; Siemens `calculated` (CIP
    and CT), which a correction writes as `incremental`."""
    words: tuple[int | None, int | None]
    """Indices of the centre words in the block; for both kinds of `radius`: of the radius word, and None."""
    pole_block: int = -1
    """For `pole` and `polar`: index of the block with the CC in the chunk; -1 if it is in an earlier chunk."""
    turns: int = 0
    """Whole turns of a helix in addition to the arc from start to end, or to the full circle."""
    pole: int = 0
    """Number of the pole in the program; 0 for none."""


class PolarEnd(NamedTuple):
    """Polar end of a Klartext block: an angle about a pole and, except for arcs, the distance from it."""

    plane: tuple[int, int, int]
    pole: tuple[float, float]
    """Pole, mm, programmed coordinates."""
    number: int
    """Number of the pole in the program."""
    sure: bool
    """True if the pole on the control is `pole`, unless an added arc has moved it."""
    radius: int | None
    """Index of the word PR or IPR."""
    angle: int | None
    """Index of the word PA or IPA."""


class Cycle(NamedTuple):
    """Hole of a canned cycle; values in programmed coordinates, mm."""

    axis: int
    """Column of the drilling axis."""
    word: int | None
    """Index of the depth word; None if the depth of an earlier block is in force."""
    retract_word: int | None
    """Index of the R word; None if the R of an earlier block is in force."""
    clear: float
    """Level R, at which the feed begins, mm."""
    incremental: bool
    """True if the depth is measured from R, and R from the level before the cycle."""
    to_retract: bool | None
    """True if the cycle ends at R (G99), False at the level before it (G98); None if neither is programmed."""
    first: bool
    """True if the position of the axis before this hole is the level before the cycle."""
    switched: bool = False
    """True if its block is in G90 and the start of the cycle in G91, or the reverse."""


class Spline(NamedTuple):
    """A block of a spline, whose curve the control works out from the programmed points."""

    name: str
    """`ASPLINE`: Akima spline through the points; `CSPLINE`: cubic spline through them; `BSPLINE`: they control it."""
    points: tuple[tuple[float, ...], ...]
    """The last points of the spline, with that of this block, on which the curve up to it depends."""


class Polar(NamedTuple):
    """Position in a plane by radius, mm, and angle, degrees, about the programmed origin."""

    axes: tuple[int, int]
    """Columns; the angle is measured from the first axis towards the second."""
    radius: float
    angle: float
    words: tuple[int | None, int | None]
    """Indices of the radius and angle words; None if the value of an earlier block is in force."""


class Paced(NamedTuple):
    """A feed move whose F is written such that it takes the programmed time.

    It is a corrected move of rotary axes alone, or a move that is converted between tool point and axes.
    """

    minutes: float
    """Time of all rows that share this object: they divide it by the lengths of their paths."""
    feed: float
    """F in force, mm/min or deg/min in the units of the program."""
    form: str
    """`inverse-time`: by G93; `linear`: by an F for the path of X Y Z; `all-axes`: by an F for all axes together;
    `combined`: its F counts all axes and stays; `programmed`: the F in force is written once more."""
    mode: str = ""
    """Code of the feed mode that is written before the words of the block; empty for none."""
    restored: bool = True
    """A line behind the move restores the feed."""
