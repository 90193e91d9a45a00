"""The characters and words of plain lines in a dialect."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import msgspec
import numpy as np

from kinematics.machine import NDArrayBool

DIGIT, POINT, SIGN, BLANK, LINE, RETURN, LETTER, OTHER, FLAG, HEAD = range(10)
_FOLLOWING = {
    DIGIT: (DIGIT, POINT, BLANK, LINE, RETURN, LETTER),
    POINT: (DIGIT, BLANK, LINE, RETURN, LETTER),
    SIGN: (DIGIT, POINT),
    BLANK: (DIGIT, POINT, SIGN, BLANK, LINE, RETURN, LETTER),
    LINE: (LETTER, BLANK),
    RETURN: (LINE,),
    LETTER: (DIGIT, POINT, SIGN, BLANK),
}
"""Classes of characters that may follow one another in plain lines."""
_ACROSS = {
    DIGIT: (LINE, RETURN, LETTER),
    POINT: (LINE, RETURN, LETTER),
    LINE: (LETTER,),
    LETTER: (DIGIT, POINT, SIGN),
}
"""Classes on both sides of blanks in plain lines."""
_WITH_HEAD = {
    DIGIT: (HEAD,),
    BLANK: (HEAD,),
    LINE: (DIGIT, HEAD),
    HEAD: (BLANK, LETTER),
    LETTER: (FLAG,),
    FLAG: (FLAG, BLANK, LINE, RETURN, LETTER),
}
_ACROSS_WITH_HEAD = {
    DIGIT: (HEAD,),
    LINE: (DIGIT, HEAD),
    HEAD: (LETTER,),
    FLAG: (LINE, RETURN, LETTER),
}
"""The same in lines that begin with a number and a head; these have flags too."""
FLAG_CHARACTER = b"\x01"
"""Stands for each further character of a word without a number; no text holds it."""
VECTOR_CHARACTERS = b"\x02\x03\x04\x05\x06\x07"
"""Stand for the addresses of vectors; no text holds them."""
VECTOR_HEAD = b"\x08"
"""Stands for the second character of the head of lines with vectors; no text holds it."""


def _refused(*tables: Mapping[int, tuple[int, ...]]) -> NDArrayBool:
    """True `(16, 16)` for pairs of classes that are in none of the tables."""
    refused = np.ones((16, 16), bool)
    for table in tables:
        for first, following in table.items():
            refused[first, list(following)] = False
    return refused


class PlainStyle(msgspec.Struct, frozen=True, dict=True):
    """The words of plain lines in a dialect; a line has no two words with one address."""

    other: str
    """Addresses of words that neither move an axis nor change the meaning of others."""
    motions: str = ""
    """Digits of the motions that the word G may name."""
    arcs: str = ""
    """Addresses of the centres and radii of arcs."""
    head: str = ""
    """First word of a straight line, behind the number of the block; empty if lines begin with any word."""
    rapid: str = ""
    """Word without a number of a rapid move; its first letter is one of `other`."""
    unchanged: str = ""
    """Address, one of `other`, that must have the number 0."""
    continued: str = ""
    """End of a line that the next one continues; empty for none."""
    marks: str = "."
    """Decimal marks."""
    tool: tuple[str, ...] = ()
    """Addresses of the components of tool vectors."""
    normal: tuple[str, ...] = ()
    """Those of surface normals: all or none of each vector are in a line that begins with `vector_head`."""
    vector_head: str = ""
    """The head of lines with vectors, which are in no other line; empty if they may be in any line."""

    @cached_property
    def vectors(self) -> tuple[str, ...]:
        """Addresses of the components of vectors."""
        return self.tool + self.normal

    @cached_property
    def letters(self) -> str:
        """Addresses other than those of axes and arcs."""
        return self.other + ("G" if self.motions else "")

    def classes(self, axes: str) -> bytes:
        """Class of every byte, for the addresses `axes` of the axes."""
        classes = bytearray([OTHER] * 256)
        letters = axes + self.arcs + self.letters
        kinds = (
            (b"0123456789", DIGIT),
            (self.marks.encode(), POINT),
            (b"+-", SIGN),
            (b" \t" + VECTOR_HEAD * bool(self.vector_head), BLANK),
            (VECTOR_CHARACTERS[: len(self.vectors)], LETTER),
            (b"\n", LINE),
            (b"\r", RETURN),
        )
        addresses = (letters + letters.lower()).encode(), LETTER
        for characters, kind in (*kinds, addresses, ((self.head + self.head.lower()).encode(), HEAD)):
            for character in characters:
                classes[character] = kind
        if self.rapid:
            classes[FLAG_CHARACTER[0]] = FLAG
        return bytes(classes)

    @cached_property
    def refused(self) -> bytes:
        """1 for every pair of classes that do not follow one another, by 16 times the first plus the second."""
        tables = (_FOLLOWING, _WITH_HEAD) if self.head else (_FOLLOWING,)
        return self._without_letters(_refused(*tables)).astype(np.uint8).tobytes()

    @cached_property
    def refused_across(self) -> NDArrayBool:
        """True for every pair of classes that do not occur on both sides of blanks, as `refused`."""
        return self._without_letters(_refused(*((_ACROSS, _ACROSS_WITH_HEAD) if self.head else (_ACROSS,)))).ravel()

    def _without_letters(self, refused: NDArrayBool) -> NDArrayBool:
        """No line begins with an address if lines begin with a head."""
        refused[LINE, LETTER] |= bool(self.head)
        return refused

    @cached_property
    def stand_ins(self) -> bytes:
        """Characters that stand for something else in a text with flags."""
        vectors = VECTOR_CHARACTERS[: len(self.vectors)] + VECTOR_HEAD * bool(self.vector_head)
        return FLAG_CHARACTER * bool(self.rapid) + vectors

    def with_flags(self, data: bytes) -> bytes:
        """The text with a flag for each character of a rapid word but the first, and a character for each address of a
        vector that stands behind a blank; blanks for the rest of these addresses.
        """
        for word in (self.rapid.encode(), self.rapid.lower().encode()) if self.rapid else ():
            data = data.replace(word, word[:1] + FLAG_CHARACTER * (len(word) - 1))
        for number, address in enumerate(self.vectors):
            character = VECTOR_CHARACTERS[number : number + 1]
            for word in (address.encode(), address.lower().encode()):
                data = data.replace(b" " + word, b" " + character + b" " * (len(word) - 1))
        for word in (self.vector_head.encode(), self.vector_head.lower().encode()) if self.vector_head else ():
            data = data.replace(word, word[:1] + VECTOR_HEAD)
        return data
