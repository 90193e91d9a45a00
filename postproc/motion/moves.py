"""What one move is: its kind, its words, its circle, hole or polar place; and where its axes' places are from."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Kind(IntEnum):
    """What a move is."""

    RAPID = 0
    LINE = 1
    ARC = 2
    MACHINE = 3
    """To machine coordinates (G53, M91): recorded for what it leaves behind, never corrected."""
    TAKE_UP = 4
    """Of ncomp's own: takes up the play of axes that are about to go back. Its known axes are those that it moves."""

    CYCLE = 5
    """Of a canned cycle, to the bottom of a hole; then back, to where the next move starts."""
    PRESET = 6
    """No move: says what the place where the tool stands is called (G92), in the frame that this makes."""

    PATTERN = 7
    """To a hole of a pattern behind its first: it goes with that one."""


class Known(IntEnum):
    """Where the position of an axis comes from."""

    ASSUMED = 0
    """The program has not said it; taken at home."""
    MACHINE = 1
    """Said in machine coordinates, or in a frame that has been left since. Where that is in the present frame is only
    as sure as the offsets that were given, so the axis is neither corrected nor ever named by a word of ours."""
    PROGRAM = 2
    """Said in the programmed frame: the axis stands at a corrected position."""


class AxisWord(NamedTuple):
    """The word of a block that names an axis."""

    axis: int
    word: int
    """Index into the words of the block; -1 where it says the axis in another way."""
    incremental: bool


class Arc(NamedTuple):
    """The circle of an arc move, in programmed coordinates (mm)."""

    plane: tuple[int, int, int]
    """Columns of the first, second and normal axis, right-handed: G17 X Y Z, G18 Z X Y, G19 Y Z X."""
    sense: int
    """+1 counter-clockwise seen from the normal axis' positive end."""
    centre: tuple[float, float]
    full: bool
    """True when start and end coincide and the move goes once round."""
    form: str
    """How the program gives the circle: `incremental` or `absolute` (I J K), `radius`, or `radius-absolute` where I J K
    instead would be positions; in Klartext `pole` (CC), `polar` (CC, and the end by an angle), or `tangent`; by
    Siemens CIP and CT `worked-out`, which a correction writes as `incremental`."""
    words: tuple[int | None, int | None]
    """Indices of the centre words in the block; of the radius word, and None, for both kinds of `radius`."""
    pole_block: int = -1
    """For `pole` and `polar`: the block of the chunk that holds the CC, -1 when it came earlier."""
    turns: int = 0
    """Whole turns of a helix besides the arc from start to end, or besides the full circle."""
    pole: int = 0
    """Number of the pole among those of the program, 0 for none."""


class PolarEnd(NamedTuple):
    """How a Klartext block says its end: by an angle about a pole and, unless it is an arc, the distance from it."""

    plane: tuple[int, int, int]
    pole: tuple[float, float]
    """In programmed coordinates, mm."""
    number: int
    """Of the pole, among those of the program."""
    sure: bool
    """The control holds the pole as it is here, as long as no arc of ncomp's has moved it."""
    radius: int | None
    """Index of the word PR or IPR."""
    angle: int | None
    """Of PA or IPA."""


class Cycle(NamedTuple):
    """A hole of a canned cycle; values in programmed coordinates, mm."""

    axis: int
    """Column of the axis that drills."""
    word: int | None
    """Index of the word that says the depth, None where that of a block before still holds."""
    retract_word: int | None
    """Index of R, likewise."""
    clear: float
    """The level that R says, where the feed begins."""
    incremental: bool
    """The depth counts from R, and R from the level before the cycle."""
    to_retract: bool | None
    """The cycle ends at R (G99) and not at the level before it (G98); None where the program says neither."""
    first: bool
    """Where the axis stands before it is the level before the cycle."""
    switched: bool = False
    """Its block is in G90 and the start of the cycle in G91, or the reverse."""


class Polar(NamedTuple):
    """The place in a plane by radius, mm, and angle, degrees, round the programmed origin."""

    axes: tuple[int, int]
    """Columns; the angle is counted from the first towards the second."""
    radius: float
    angle: float
    words: tuple[int | None, int | None]
    """Indices of the words of radius and angle, None where that of a block before still holds."""
