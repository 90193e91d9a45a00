"""Blocks that ncomp adds to those of the program: their text, and the tags by which they are recognised."""

from __future__ import annotations

import math
import re
from enum import StrEnum
from functools import lru_cache

import msgspec

from postproc.control.codes import DISTANCES
from postproc.iso.codes import FEED_MODES, UNITS
from postproc.siemens.codes import CALCULATED_ARCS
from postproc.text.block import Block, Word
from postproc.text.editing import PLAIN, Form, Iterations, Layout, rank_of

ARCS = frozenset((2.0, 3.0))
MODES = DISTANCES | FEED_MODES | UNITS.keys()
NO_INSERTION = "no block can be added beside it (jump, call, cutter compensation, rounded corner, cycle or tool vector)"
"""Reason why no block may be added next to a block."""
START_M = frozenset((3.0, 4.0, 7.0, 8.0, 13.0, 14.0))
"""M functions that every control runs before the move of their block: they stay with its first segment."""
END_M = frozenset((0.0, 1.0, 2.0, 30.0))
"""M functions that every control runs after the move of their block: they go to its last segment."""
EXACT_STOP = 9.0
"""G9: exact stop at the end of its block."""
SINGLE_FEEDS = frozenset(("FB", "FT", "FMAXT"))
"""Addresses of feeds that are in force for one block only."""
TURN_WORDS = frozenset(("P", "TURN"))
"""ISO and Siemens: addresses of the number of turns of an arc."""


class Tag(StrEnum):
    """Kind of an added block, in its comment; upper case and plain characters, so that the oldest control reads it."""

    TAKE_UP = "NCOMP TAKE-UP"
    PIECE = "NCOMP ARC"
    """Segment of an arc, from a reversal of an axis."""
    PART = "NCOMP FROM"
    """Segment of a move, with its start fraction: NCOMP FROM 3/8."""


LARGEST_DENOMINATOR = 1 << 20
"""Largest denominator of a share that is shortened."""
_SHARE = re.compile(rf"{Tag.PART} (\d+)/(\d+)")


def tag_of(text: str) -> Tag | None:
    """Tag of an added block; None for a block of the program."""
    return next((tag for tag in Tag if tag in text), None) if "NCOMP" in text else None


def start_fraction_of(text: str) -> float:
    """Share of its programmed move at which an added block begins; nan if its comment has no share."""
    match = _SHARE.search(text)
    return int(match[1]) / max(int(match[2]), 1) if match else math.nan


@lru_cache(maxsize=1 << 12)
def part(start_fraction: float) -> str:
    """Comment of a block that begins at a share of its programmed move."""
    from fractions import Fraction

    share = Fraction(start_fraction).limit_denominator(LARGEST_DENOMINATOR)
    if float(share) != start_fraction:
        share = Fraction(start_fraction)
    count, of = share.as_integer_ratio()
    return f"{Tag.PART} {count}/{of}"


def mode_words(block: Block) -> list[str]:
    """G codes of a block for distances, feed and unit: a block added before it needs them too."""
    return [block.text[word.at : word.end] for word in block.words if word.address == "G" and word.value in MODES]


def feed_words(block: Block) -> list[str]:
    """Feed words of a block, as written."""
    return [block.text[word.at : word.end] for word in block.words if word.address in ("F", "FU", "FZ", "FAUTO")]


def end_words(block: Block) -> list[Word]:
    """Words of a block that take effect at its end: M functions and exact stop."""
    return [
        word
        for word in block.words
        if (word.address == "M" and word.value in END_M) or (word.address == "G" and word.value == EXACT_STOP)
    ]


def feed_index(block: Block) -> int | None:
    """Index of the F word; None if there is none."""
    return next((i for i, word in enumerate(block.words) if word.address == "F"), None)


def lacks_motion(block: Block) -> bool:
    """True for the block of an arc without a word for it: G2 or G3 is in force from an earlier block."""
    programmed = (w.address in CALCULATED_ARCS or (w.address == "G" and w.value in ARCS) for w in block.words)
    return block.kind == "words" and not any(programmed)


class AddedBlock(msgspec.Struct):
    """Block that is added next to a block of the program, built word by word in the style of the program."""

    beside: Block
    layout: Layout
    tag: str
    sense: int = 0
    """Sense of an arc, +1 counter-clockwise; 0 for a straight line."""
    rapid: bool = False
    preface: str = ""
    """Text of a block before it; empty for none."""
    iterations: Iterations | None = None
    """Iterations of the block next to it, if that may run several times."""
    number: int = 0
    """Number among the blocks that are added next to one block, from 0."""
    modes: list[str] = msgspec.field(default_factory=list)
    """Words for distances, feed and unit."""
    feed: list[str] = msgspec.field(default_factory=list)
    """Feed words."""
    functions: list[str] = msgspec.field(default_factory=list)
    """Words that take effect at the end of the move."""
    _words: list[tuple[str, str]] = msgspec.field(default_factory=list)

    @property
    def klartext(self) -> bool:
        """True next to a block of Klartext."""
        return self.beside.kind != "words"

    @property
    def beside_absolute_centre(self) -> bool:
        """True next to a Siemens block with an absolute centre: I, J or K by AC."""
        return any(word.mode == "AC" and word.address in "IJK" for word in self.beside.words)

    @property
    def empty(self) -> bool:
        """True while it names no axis."""
        return not self._words

    def names(self, axis: str) -> bool:
        """True if it has a word for the axis."""
        return any(address == axis for address, _ in self._words)

    def agreed(self, name: str, number: float, decimals: int) -> float:
        """The number of this word in the first iteration of the block, if it is near enough; otherwise `number`."""
        own = f"{self.number} {name}"
        return number if self.iterations is None else self.iterations.agreed(own, number, decimals)

    def add(self, address: str, target: float, held: float, decimals: int, form: Form = PLAIN) -> float:
        """Add a word if the rounded target differs from the value in force; returns the value on the control then."""
        number = None if round(target - held, decimals) == 0.0 else round(target, decimals)
        if self.iterations is not None:
            number = self.iterations.added(f"{self.number} {address}", number, target, held, decimals)
        if number is None:
            return held
        self.insert(address, form.number(number), decimals, form.mode)
        return number

    def insert(self, address: str, value: float, decimals: int, mode: str = "") -> None:
        """Add a word; mode: of a Siemens word, DC."""
        text = self.layout.numbers.write(value, decimals)
        self._words.append((address, f"={mode}({text})" if mode else text))

    def feed_of(self, value: float) -> None:
        """Add an F word with this value, with six digits."""
        digits = max(0, 6 - len(f"{value:.0f}"))
        self.feed.append(f"F{self.layout.numbers.write(value, max(1, digits)).lstrip('+')}")

    def centre_before(self, words: list[tuple[str, float]], decimals: int) -> None:
        """Klartext: put the pole of an arc before the block."""
        body = " ".join(address + self.layout.numbers.write(value, decimals) for address, value in words)
        self.preface = f"CC {body}"

    def end_by_angle(self, axes: list[str], angle: float, decimals: int) -> None:
        """Klartext: replace the words of axes by an angle, degrees, about the pole, as a helix requires."""
        self._words = [word for word in self._words if word[0] not in axes]
        self.insert("IPA", angle, decimals)

    def lines(self, comment: str) -> list[str]:
        """The block and its preface, without line ends; `comment`: format of a comment, for the tag."""
        ordered = [address + number for address, number in sorted(self._words, key=lambda w: rank_of(w[0]))]
        if self.klartext:
            heads = {"R": "CR", "IPA": "CP"}
            head = next((heads[address] for address, _ in self._words if address in heads), "C" if self.sense else "L")
            ordered += ["DR+" if self.sense > 0 else "DR-"] if self.sense else ["FMAX"] if self.rapid else []
        else:
            head = ("G0" if self.rapid else "G1") if not self.sense else "G3" if self.sense > 0 else "G2"
        blank = " " if self.klartext or self.layout.blank else ""
        words = blank.join([*self.modes, head, *ordered, *self.feed, *self.functions])
        lower = self.beside.words and self.beside.text[self.beside.words[0].at].islower()
        line = f"{words.lower() if lower else words}{blank}{comment.format(self.tag)}"
        return [self.preface, line] if self.preface else [line]
