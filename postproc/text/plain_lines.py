"""Plain lines: words of addresses and numbers, which are nearly all lines of a CAM program, read without a grammar.

`read_plain` reads one text. `PlainLines` reads all lines of a piece of a program together, from its bytes to columns,
and shows which of them are plain; every byte of a plain line is accounted for. Lines with anything else, and words
whose meaning needs more than their number, are left to the reader of single lines.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.text.block import Block, Word

LONGEST = 120
"""Characters of a plain line, at most: no control refuses it, also with corrections of all its words."""
WIDEST = 12
"""Characters of the number of an axis, at most, without sign: its digits are an integer that a float holds exactly."""
MOST_DECIMALS = 9
LARGEST = 1e6
"""Number of an axis, at least, that is left to the reader of single lines."""
POWERS = 10.0 ** np.arange(23)
"""Powers of ten that a float holds exactly."""

_DIGIT, _POINT, _SIGN, _BLANK, _LINE, _RETURN, _LETTER, _OTHER = range(8)
_FOLLOWING = {
    _DIGIT: (_DIGIT, _POINT, _BLANK, _LINE, _RETURN, _LETTER),
    _POINT: (_DIGIT, _BLANK, _LINE, _RETURN, _LETTER),
    _SIGN: (_DIGIT, _POINT),
    _BLANK: (_DIGIT, _POINT, _SIGN, _BLANK, _LINE, _RETURN, _LETTER),
    _LINE: (_LETTER, _BLANK),
    _RETURN: (_LINE,),
    _LETTER: (_DIGIT, _POINT, _SIGN, _BLANK),
    _OTHER: (),
}
"""Classes of characters that may follow one another in plain lines."""
_ACROSS = {
    _DIGIT: (_LINE, _RETURN, _LETTER),
    _POINT: (_LINE, _RETURN, _LETTER),
    _LINE: (_LETTER,),
    _LETTER: (_DIGIT, _POINT, _SIGN),
}
"""Classes on both sides of blanks in plain lines."""
_NOT_FOLLOWING = bytes(i % 8 not in _FOLLOWING[i // 8] if i < 64 else 1 for i in range(256))
_NOT_ACROSS = np.array([[second not in _ACROSS.get(first, ()) for second in range(8)] for first in range(8)])


def read_plain(line: int, text: str, pattern: re.Pattern[str], part: re.Pattern[str]) -> Block | None:
    """The block of a text, None for one that the pattern does not match.

    pattern: its first group holds the words. part: one word, with the groups address, number, sign, digits.
    """
    match = pattern.fullmatch(text)
    if match is None:
        return None
    words = tuple(
        [
            Word(m[1].upper(), float(m[3] + m[4]), m.start(), m.start(2), m.end())
            for m in part.finditer(text, 0, match.end(1))
        ]
    )
    return Block(line, text, "words" if words else "blank", words)


@dataclass(frozen=True)
class PlainStyle:
    """The words of plain lines in a dialect; a line has no two words with one address."""

    other: str
    """Addresses of words that neither move an axis nor change the meaning of others."""
    motions: str
    """Digits of the motions that the word G may name."""

    def classes(self, axes: str) -> bytes:
        """Class of every byte, for the addresses `axes` of the axes."""
        classes = bytearray([_OTHER] * 256)
        letters = axes + self.other + "G"
        kinds = ((b"0123456789", _DIGIT), (b".", _POINT), (b"+-", _SIGN), (b" \t", _BLANK), (b"\n", _LINE))
        for characters, kind in (*kinds, (b"\r", _RETURN), ((letters + letters.lower()).encode(), _LETTER)):
            for character in characters:
                classes[character] = kind
        return bytes(classes)


class PlainLines:
    """The lines of a piece of a program that ends with a line feed; columns `(lines,)` and `(axes, lines)`.

    Values of words are defined for plain lines only.
    """

    def __init__(self, data: bytes, axes: str, style: PlainStyle) -> None:
        self.data, self.axes, self._style = data, axes, style
        self._bytes = np.frombuffer(data, np.uint8)
        self._classes = np.frombuffer(data.translate(style.classes(axes)), np.uint8)
        self._ends = np.flatnonzero(self._classes == _LINE).astype(np.int32)
        self.starts = np.concatenate([[0], self._ends + 1]).astype(np.int32)
        """Positions of the lines `(lines + 1,)`, and of the end."""

    def __len__(self) -> int:
        return len(self._ends)

    @cached_property
    def regular(self) -> NDArrayBool:
        """Lines with the characters of plain lines in an order that plain lines may have."""
        classes = self._classes
        regular = np.diff(self.starts) <= LONGEST
        pairs = (classes[:-1] << 3) | classes[1:]
        wrong = np.flatnonzero(np.frombuffer(pairs.tobytes().translate(_NOT_FOLLOWING), np.uint8)) + 1
        regular[self._line_of(wrong)] = False
        if classes[0] not in _FOLLOWING[_LINE]:
            regular[0] = False
        # blanks between words, and between an address and its number
        last = np.flatnonzero((classes[:-1] == _BLANK) & (classes[1:] != _BLANK))
        before = last - 1
        for _ in range(LONGEST):
            blank = (classes[before] == _BLANK) & (before >= 0)
            if not blank.any():
                break
            before -= blank
        across = _NOT_ACROSS[np.where(before < 0, _LINE, classes[before]), classes[last + 1]]
        regular[self._line_of(last[across] + 1)] = False
        # a point needs a digit beside it
        points = np.flatnonzero(classes == _POINT)
        alone = (classes[points - 1] != _DIGIT) & (classes[points + 1] != _DIGIT)
        regular[self._line_of(points[alone])] = False
        codes = np.flatnonzero((self._bytes | 0x20) == ord("g"))
        regular[self._line_of(codes[self._motions_at(codes) < 0])] = False
        return regular

    def _line_of(self, positions: np.ndarray) -> np.ndarray:
        return np.searchsorted(self._ends, positions)

    def _motions_at(self, codes: np.ndarray) -> np.ndarray:
        """Motions that G words at positions `codes` name, by a number of one or two digits; -1 for other numbers."""
        digits = [np.minimum(codes + i, len(self._bytes) - 1) for i in (1, 2, 3)]
        first, second = (self._bytes[i].astype(np.int8) for i in digits[:2])
        one, two = (self._classes[i] != _DIGIT for i in digits[1:])
        point = self._classes[digits[1]] == _POINT
        padded = (first == ord("0")) & ~one & two & (self._classes[digits[2]] != _POINT)
        motion = np.where(one & ~point, first, np.where(padded, second, 0)).astype(np.int8)
        known = np.isin(motion, np.frombuffer(self._style.motions.encode(), np.uint8))
        return np.where(known, motion - ord("0"), -1).astype(np.int8)

    @cached_property
    def _words(self) -> _Words:
        """The words of the regular lines."""
        classes, at = self._classes, np.flatnonzero(self._classes == _LETTER).astype(np.int32)
        counts = np.diff(np.searchsorted(at, self.starts))
        line = np.repeat(np.arange(len(self), dtype=np.int32), counts)
        if not self.regular.all():
            kept = self.regular[line]
            at, line = at[kept], line[kept]
        last = np.append(line[1:] != line[:-1], True)[: len(line)]
        end = np.append(at[1:], 0)[: len(at)].astype(np.int32)
        end[last] = self._ends[line[last]]
        start = at + 1
        for _ in range(LONGEST):
            blank = classes[start] == _BLANK
            if not blank.any():
                break
            start += blank
        for _ in range(LONGEST):
            blank = (classes[end - 1] == _BLANK) | (classes[end - 1] == _RETURN)
            if not blank.any():
                break
            end -= blank
        points = np.flatnonzero(classes == _POINT)
        if not self.regular.all():
            points = points[self.regular[self._line_of(points)]]
        word = np.searchsorted(at, points) - 1
        decimals = np.full(len(at), -1, np.int8)
        decimals[word] = end[word] - points - 1
        several = np.zeros(len(at), bool)
        several[word[1:][word[1:] == word[:-1]]] = True
        return _Words(line, self._bytes[at] & 0xDF, at, start, end.astype(np.int32), decimals, several)

    @cached_property
    def columns(self) -> PlainColumns:
        """The words of the axes as columns, and which lines are plain."""
        words, lines = self._words, len(self)
        plain = self.regular.copy()
        plain[words.line[words.several_points]] = False
        for letter in self._style.other.encode() + b"G":
            self._refuse_repeated(words.line[words.letter == letter], plain)
        letters = np.full(256, -1, np.int8)
        letters[np.frombuffer(self.axes.encode(), np.uint8)] = np.arange(len(self.axes))
        axis = letters[words.letter]
        chosen = np.flatnonzero(axis >= 0)
        axis, line = axis[chosen], words.line[chosen]
        at, start, end, decimals = (column[chosen] for column in (words.at, words.start, words.end, words.decimals))
        digits = start + (self._classes[start] == _SIGN)
        for i in range(len(self.axes)):
            self._refuse_repeated(line[axis == i], plain)
        plain[line[(end - digits > WIDEST) | (decimals > MOST_DECIMALS)]] = False
        numbers = np.abs(self._numbers(digits, end, decimals))
        plain[line[numbers >= LARGEST]] = False
        numbers[self._bytes[start] == ord("-")] *= -1.0
        shape, cell = (len(self.axes), lines), (axis, line)
        absent = np.full(lines, -1, np.int8)
        at_zero = np.zeros(shape, np.int32)
        ends = at_zero, at_zero.copy(), at_zero.copy()
        found = PlainColumns(plain, absent, *ends, np.zeros(shape, np.int8), np.zeros(shape), absent.copy())
        found.at[cell], found.start[cell], found.end[cell] = at, start, end
        found.decimals[cell], found.value[cell] = decimals, numbers
        codes = words.letter == ord("G")
        found.motion[words.line[codes]] = self._motions_at(words.at[codes])
        plain &= (found.end > 0).any(axis=0)
        several = np.flatnonzero(words.line[1:] == words.line[:-1]) + 1
        found.blank[words.line[several]] = self._classes[words.at[several] - 1] == _BLANK
        return found

    @staticmethod
    def _refuse_repeated(lines: np.ndarray, plain: NDArrayBool) -> None:
        """Mark lines `(k,)`, sorted, that occur twice as not plain."""
        plain[lines[1:][lines[1:] == lines[:-1]]] = False

    def _numbers(self, start: np.ndarray, end: np.ndarray, decimals: np.ndarray) -> Array:
        """Values `(k,)` of numbers without signs at these positions, each the float nearest to its digits."""
        values = np.zeros(len(start))
        for several in range(-1, MOST_DECIMALS + 1):
            rows = np.flatnonzero(decimals == several)
            if not len(rows):
                continue
            width = np.minimum(end[rows] - start[rows], WIDEST)
            places = np.arange(int(width.max()), dtype=np.int32)[:, None]
            digits = self._bytes[np.maximum(end[rows] - 1 - places, 0)] - np.uint8(ord("0"))
            digits *= places < width
            weights = np.concatenate([POWERS[:several], [0.0], POWERS[several:]]) if several >= 0 else POWERS
            values[rows] = (weights[: len(places)] @ digits.astype(float)) / POWERS[max(several, 0)]
        return values


@dataclass(frozen=True)
class _Words:
    """The words of lines in their order `(words,)`."""

    line: np.ndarray
    letter: np.ndarray
    """Address, upper case."""
    at: np.ndarray
    start: np.ndarray
    end: np.ndarray
    """Address at `at`, number from `start` to `end`."""
    decimals: np.ndarray
    """Decimals; -1 for a number without a point."""
    several_points: np.ndarray


@dataclass(frozen=True)
class PlainColumns:
    """The words of plain lines: columns `(lines,)`, and `(axes, lines)` with zeros where a line omits an axis."""

    plain: NDArrayBool
    motion: np.ndarray
    """Motion that the line names; -1 for none."""
    at: np.ndarray
    """Position of the address in the piece."""
    start: np.ndarray
    """Position of the number."""
    end: np.ndarray
    """Position behind the number; 0 where the line omits the axis."""
    decimals: np.ndarray
    """Decimals; -1 for a number without a point."""
    value: Array
    blank: np.ndarray
    """1 where a blank precedes the last word, 0 where none does; -1 for a single word."""
