"""Blocks of words and a comment, which are nearly all blocks of a CAM program, read without a grammar."""

from __future__ import annotations

import re

from postproc.text.block import Block, Word


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
