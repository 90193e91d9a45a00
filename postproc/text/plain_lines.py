"""Plain lines: words of addresses and numbers, which are nearly all lines of a CAM program, read without a grammar.

`read_plain` reads one text. `PlainLines` reads all lines of a piece of a program together, from its bytes to columns,
and shows which of them are plain; every byte of a plain line is accounted for. Lines with anything else, and words
whose meaning needs more than their number, are left to the reader of single lines.
"""

from __future__ import annotations

import re
from functools import cached_property
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from kinematics.machine import NDArrayBool
from postproc.text.block import Block, Word
from postproc.text.number_style import MOST_DECIMALS
from postproc.text.plain_columns import (
    NUMBER_CHARACTERS,
    NumberMarks,
    PlainColumns,
    PlainVectors,
    ReadWords,
    values_of,
)
from postproc.text.plain_style import (
    BLANK,
    DIGIT,
    FLAG,
    HEAD,
    LETTER,
    LINE,
    OTHER,
    POINT,
    RETURN,
    SIGN,
    VECTOR_CHARACTERS,
    VECTOR_HEAD,
    PlainStyle,
)

PLAIN_LINE_CHARACTERS = 180
"""Characters of a plain line, at most: no control refuses it, also with corrections of all its words."""
LARGEST_PLAIN_NUMBER = 1e6
"""Number of an axis, at least, that is left to the reader of single lines."""


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


class PlainLines:
    """The lines of a piece of a program that ends with a line feed; columns `(lines,)` and `(addresses, lines)`.

    Values of words are defined for plain lines only.
    """

    def __init__(self, data: bytes, axes: str, style: PlainStyle) -> None:
        self.data, self.axes, self._style = data, axes, style
        self._ends = np.flatnonzero(self._bytes == ord("\n")).astype(np.int32)
        self.starts = np.concatenate([[0], self._ends + 1]).astype(np.int32)
        """Positions of the lines `(lines + 1,)`, and of the end."""

    def __len__(self) -> int:
        return len(self._ends)

    def __getstate__(self) -> dict[str, Any]:
        """The state without quickly calculated attributes, and without the words, once they are columns."""
        left_out = {"blocks", "_bytes", "_flagged", "_classes", "_letters_at", "_letters", "_points"} | (
            {"_words", "_read"} if {"columns", "vectors"} <= vars(self).keys() else set()
        )
        return {name: value for name, value in vars(self).items() if name not in left_out}

    @cached_property
    def blocks(self) -> dict[int, Block]:
        """Blocks of lines, by their numbers, that were made on demand."""
        return {}

    @cached_property
    def _bytes(self) -> np.ndarray:
        return np.frombuffer(self.data, np.uint8)

    @cached_property
    def _flagged(self) -> bytes:
        """The text with its flags."""
        return self._style.with_flags(self.data)

    @cached_property
    def _classes(self) -> np.ndarray:
        """Class of each byte."""
        style, data = self._style, self.data
        if any(character in data for character in style.stand_ins):
            return np.full(len(data), OTHER, np.uint8)
        return np.frombuffer(self._flagged.translate(style.classes(self.axes)), np.uint8)

    @cached_property
    def addresses(self) -> str:
        """Addresses of the columns: the axes, and those of arcs that occur."""
        return self.axes + "".join(letter for letter in self._style.arcs if (self._words.letter == ord(letter)).any())

    @cached_property
    def regular(self) -> NDArrayBool:
        """Lines with the characters of plain lines in an order that plain lines may have."""
        classes = self._classes
        regular = np.diff(self.starts) <= PLAIN_LINE_CHARACTERS
        pairs = (classes[:-1] << 4) | classes[1:]
        wrong = np.flatnonzero(np.frombuffer(pairs.tobytes().translate(self._style.refused), np.uint8)) + 1
        regular[self._line_of(wrong)] = False
        regular[0] &= not self._style.refused[LINE << 4 | int(classes[0])]
        # blanks between words, and between an address and its number
        last = np.flatnonzero((classes[:-1] == BLANK) & (classes[1:] != BLANK))
        before = last - 1
        for _ in range(PLAIN_LINE_CHARACTERS):  # one before the first line finds the line feed at the end
            blank = classes[before] == BLANK
            if not blank.any():
                break
            before -= blank
        across = self._style.refused_across[(classes[before] << 4) | classes[last + 1]]
        regular[self._line_of(last[across] + 1)] = False
        # a point needs a digit beside it
        points = self._points
        alone = (classes[points - 1] != DIGIT) & (classes[points + 1] != DIGIT)
        regular[self._line_of(points[alone])] = False
        if self._style.motions:
            codes = self._letters_at[self._letters == ord("G")]
            regular[self._line_of(codes[self._motions_at(codes) < 0])] = False
        if self._style.head:
            regular &= self._headed(points)
        return regular

    def _headed(self, points: np.ndarray) -> NDArrayBool:
        """Lines with one head, before it at most a number without leading zeros, and no unchanged word but 0."""
        classes = self._classes
        heads = np.flatnonzero(classes == HEAD)
        line = self._line_of(heads)
        found = np.bincount(line, minlength=len(self)) == 1
        head = np.zeros(len(self), np.int32)
        head[line] = heads
        found[(line_of_points := self._line_of(points))[points < head[line_of_points]]] = False
        first = self.starts[:-1].copy()
        for _ in range(PLAIN_LINE_CHARACTERS):
            blank = classes[first] == BLANK
            if not blank.any():
                break
            first += blank
        second = np.minimum(first + 1, len(classes) - 1)
        found &= (self._bytes[first] != ord("0")) | (classes[second] != DIGIT)
        words = np.flatnonzero((self._bytes & 0xDF) == ord(self._style.unchanged))
        ends = np.minimum(words + 2, len(classes) - 1)
        changing = (self._bytes[words + 1] != ord("0")) | (classes[ends] == DIGIT) | (classes[ends] == POINT)
        found[self._line_of(words[changing])] = False
        return np.asarray(found)

    def _line_of(self, positions: np.ndarray) -> np.ndarray:
        return np.searchsorted(self._ends, positions)

    def _motions_at(self, codes: np.ndarray) -> np.ndarray:
        """Motions that G words at positions `codes` name, by a number of one or two digits; -1 for other numbers."""
        digits = [np.minimum(codes + i, len(self._bytes) - 1) for i in (1, 2, 3)]
        first, second = (self._bytes[i].astype(np.int8) for i in digits[:2])
        one, two = (self._classes[i] != DIGIT for i in digits[1:])
        point = self._classes[digits[1]] == POINT
        padded = (first == ord("0")) & ~one & two & (self._classes[digits[2]] != POINT)
        motion = np.where(one & ~point, first, np.where(padded, second, 0)).astype(np.int8)
        known = np.isin(motion, np.frombuffer(self._style.motions.encode(), np.uint8))
        return np.where(known, motion - ord("0"), -1).astype(np.int8)

    @cached_property
    def _letters_at(self) -> np.ndarray:
        """Positions of the addresses in all lines."""
        return np.flatnonzero(self._classes == LETTER).astype(np.int32)

    @cached_property
    def _letters(self) -> np.ndarray:
        """The addresses, upper case."""
        return np.asarray(np.frombuffer(self._flagged, np.uint8)[self._letters_at] & 0xDF)

    @cached_property
    def _points(self) -> np.ndarray:
        """Positions of the decimal marks in all lines."""
        return np.flatnonzero(self._classes == POINT)

    @cached_property
    def _words(self) -> ReadWords:
        """The words of the regular lines."""
        classes, at, letter = self._classes, self._letters_at, self._letters
        counts = np.diff(np.searchsorted(at, self.starts))
        line = np.repeat(np.arange(len(self), dtype=np.int32), counts)
        if not self.regular.all():
            kept = self.regular[line]
            at, line, letter = at[kept], line[kept], letter[kept]
        last = np.append(line[1:] != line[:-1], True)[: len(line)]
        end = np.append(at[1:], 0)[: len(at)].astype(np.int32)
        end[last] = self._ends[line[last]]
        start = at + 1
        for _ in range(PLAIN_LINE_CHARACTERS):
            blank = classes[start] == BLANK
            if not blank.any():
                break
            start += blank
        for _ in range(PLAIN_LINE_CHARACTERS):
            before = classes[end - 1]
            blank = (before == BLANK) | (before == RETURN)
            if not blank.any():
                break
            end -= blank
        points = self._points
        if not self.regular.all():
            points = points[self.regular[self._line_of(points)]]
        word = np.searchsorted(at, points) - 1
        decimals = np.full(len(at), -1, np.int8)
        decimals[word] = end[word] - points - 1
        several = np.zeros(len(at), bool)
        several[word[1:][word[1:] == word[:-1]]] = True
        return ReadWords(line, letter, at, start, end.astype(np.int32), decimals, several)

    @cached_property
    def columns(self) -> PlainColumns:
        """The words of axes and arcs as columns, and which lines are plain."""
        found, last = self._read, len(self.addresses)
        return PlainColumns(*(of[:last] if of.ndim > 1 else of for of in msgspec.structs.astuple(found)))

    @cached_property
    def vectors(self) -> PlainVectors | None:
        """The vectors of the lines; None if no line has one."""
        first, tool = len(self.addresses), len(self._style.tool)
        named, value = self._read.end[first:] > 0, self._read.value[first:]
        if not len(named):
            return None
        along = named[:tool].any(axis=0)
        return PlainVectors(np.where(along, value[:tool], np.nan).T, np.asarray(named[tool:].any(axis=0)))

    def _vectors_whole(self, named: NDArrayBool) -> NDArrayBool:
        """Lines `(lines,)` with complete vectors behind the head of vectors; named `(addresses, lines)`."""
        if not self._style.vector_head:
            return np.ones(len(self), bool)
        headed = np.zeros(len(self), bool)
        headed[self._line_of(np.flatnonzero(np.frombuffer(self._flagged, np.uint8) == VECTOR_HEAD[0]))] = True
        if not len(named):
            return ~headed
        each = named[:3].sum(axis=0), named[3:].sum(axis=0)
        complete = np.all([(count == 0) | (count == 3) for count in each], axis=0)
        return np.asarray(complete & (headed == named.any(axis=0)))

    def _codes_of_vectors(self, words: ReadWords, plain: NDArrayBool) -> bytes:
        """The characters of vectors, empty if no line has one; a line where a letter follows one is not plain."""
        codes = VECTOR_CHARACTERS[: len(self._style.vectors)]
        pointing = np.flatnonzero(np.isin(words.letter, np.frombuffer(codes, np.uint8)))
        ended = np.isin(self._classes[words.end[pointing]], (BLANK, RETURN, LINE))
        plain[words.line[pointing[~ended]]] = False
        return codes * bool(len(pointing))

    def _name_motions(self, words: ReadWords, motion: np.ndarray) -> None:
        """Set the motions `(lines,)` that the words name."""
        if self._style.rapid:
            rapid = (words.letter == ord(self._style.rapid[0])) & (self._classes[words.at + 1] == FLAG)
            motion[:] = 1
            motion[words.line[rapid]] = 0
        if self._style.motions:
            codes = words.letter == ord("G")
            motion[words.line[codes]] = self._motions_at(words.at[codes])

    @cached_property
    def _read(self) -> PlainColumns:
        """The columns, and behind those of `addresses` the ones of vectors if a line has any."""
        words, lines = self._words, len(self)
        plain = self.regular.copy()
        plain[words.line[words.several_points]] = False
        for letter in self._style.letters.encode():
            self._refuse_repeated(words.line[words.letter == letter], plain)
        addresses = self.addresses.encode() + self._codes_of_vectors(words, plain)
        letters = np.full(256, -1, np.int8)
        letters[np.frombuffer(addresses, np.uint8)] = np.arange(len(addresses))
        column = letters[words.letter]
        chosen = np.flatnonzero(column >= 0)
        column, line = column[chosen], words.line[chosen]
        at, start, end, decimals = (of[chosen] for of in (words.at, words.start, words.end, words.decimals))
        digits = start + (self._classes[start] == SIGN)
        for i in range(len(addresses)):
            self._refuse_repeated(line[column == i], plain)
        plain[line[(end - digits > NUMBER_CHARACTERS) | (decimals > MOST_DECIMALS)]] = False
        numbers = np.abs(values_of(self.data, digits, end, decimals))
        plain[line[numbers >= LARGEST_PLAIN_NUMBER]] = False
        numbers = np.where(self._bytes[start] == ord("-"), -numbers, numbers)
        shape, cell = (len(addresses), lines), column * np.int64(lines) + line
        absent = np.full(lines, -1, np.int8)
        at_zero = np.zeros(shape, np.int32)
        ends = at_zero, at_zero.copy(), at_zero.copy()
        found = PlainColumns(plain, absent, *ends, np.zeros(shape, np.int8), np.zeros(shape), absent.copy())
        named = found.at, found.start, found.end, found.decimals, found.value
        for words_of, values in zip(named, (at, start, end, decimals, numbers), strict=True):
            words_of.ravel()[cell] = values
        self._name_motions(words, found.motion)
        plain &= (found.end[: len(self.axes)] > 0).any(axis=0)
        plain &= self._vectors_whole(found.end[len(self.addresses) :] > 0)
        last = np.append(words.line[1:] != words.line[:-1], True)[: len(words.line)]
        several = np.flatnonzero(last[1:] & ~last[:-1]) + 1  # the last words of lines with more than one
        found.blank[words.line[several]] = self._classes[words.at[several] - 1] == BLANK
        return found

    @cached_property
    def with_feeds(self) -> PlainColumns:
        """The columns, and behind those of `addresses` the column of F, and that of the last word of each line.

        The last word has neither decimals nor a value.
        """
        words, found = self._words, self.columns
        last = np.append(words.line[1:] != words.line[:-1], True)[: len(words.line)]
        feeds = np.flatnonzero((words.letter == ord("F")) & (self._classes[words.at + 1] != FLAG))
        columns = [np.zeros((2, len(self)), of.dtype) for of in (found.at, found.start, found.end, found.decimals)]
        for row, chosen in enumerate((feeds, np.flatnonzero(last))):
            for column, of in zip(columns, (words.at, words.start, words.end, words.decimals), strict=True):
                column[row, words.line[chosen]] = of[chosen]
        value = np.zeros((2, len(self)))
        for i, line in zip(feeds.tolist(), words.line[feeds].tolist(), strict=True):
            value[0, line] = float(self.data[words.start[i] : words.end[i]].replace(b",", b"."))
        both = zip((found.at, found.start, found.end, found.decimals, found.value), (*columns, value), strict=True)
        at, start, end, decimals, values = (np.vstack(pair) for pair in both)
        return replace(found, at=at, start=start, end=end, decimals=decimals, value=values)

    def order_of(self, column: int, lines: np.ndarray) -> np.ndarray:
        """Index `(k,)` of a word among the words of its line, for `lines` `(k,)` that have it."""
        at = self._letters_at
        word = np.searchsorted(at, self.columns.at[column, lines])
        return np.asarray(word - np.searchsorted(at, self.starts[lines]))

    @cached_property
    def usual_numbers(self) -> bool:
        """True if all words of the columns have a digit before the point, which is no comma, and no plus."""
        marks = self.marks(self.columns)
        return not (marks.plus.any() or marks.bare.any() or marks.comma.any())

    def marks(self, words: PlainColumns) -> NumberMarks:
        """How the numbers of these words are written."""
        named, first = words.end > 0, self._bytes[words.start]
        plus, minus = named & (first == ord("+")), named & (first == ord("-"))
        digit = words.start + (plus | minus)
        bare = named & (self._classes[digit] == POINT)
        zero = named & (self._bytes[digit] == ord("0")) & (self._classes[digit + named] == POINT)
        comma = np.zeros_like(named)
        if "," in self._style.marks and b"," in self.data:
            comma = named & (words.decimals >= 0) & (self._bytes[words.end - 1 - words.decimals] == ord(","))
        return NumberMarks(plus, minus, bare, zero, comma)

    @staticmethod
    def _refuse_repeated(lines: np.ndarray, plain: NDArrayBool) -> None:
        """Mark lines `(k,)`, sorted, that occur twice as not plain."""
        plain[lines[1:][lines[1:] == lines[:-1]]] = False


def whole(piece: bytes) -> bytes:
    """A piece up to its last line feed."""
    return piece[: piece.rfind(b"\n") + 1]


def whole_lines(piece: bytes, axes: str, style: PlainStyle) -> PlainLines:
    """The lines of a piece up to its last line feed."""
    return PlainLines(whole(piece), axes, style)
