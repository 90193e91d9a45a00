"""Numbers of Klartext blocks: the control requires a sequence, so blocks after added blocks are renumbered.

Nothing in Klartext refers to block numbers: jumps and calls refer to labels. In ISO and Siemens programs blocks need
no numbers and jumps refer to them: there the blocks of the program keep their numbers and added blocks have none.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from postproc.text.block import Block

_NUMBER = re.compile(r"[ \t]*(\d+)(?=[ \t])")

_NUMBER_IN_BYTES = re.compile(rb"^([ \t]*)(\d+)(?=[ \t])", re.MULTILINE)
MOST_DIGITS = 17
"""Digits of a block number that fit into a column."""


class BlockNumbers:
    """Renumbers the lines of a program in their order; blocks without a number stay without one."""

    def __init__(self, *, klartext: bool) -> None:
        self._klartext = klartext
        self._added = 0
        self._last: int | None = None
        """Number of the last block; None if it has none."""

    def renumbered(self, block: Block, text: str) -> str:
        """Text `text` of a block, with the lines added before and after it, renumbered."""
        own = _NUMBER.match(block.text) if self._klartext else None
        if own is None:
            self._last = None if block.kind != "blank" else self._last
            return text
        if text == block.text and not self._added:
            self._last = int(own[1])
            return text
        lines = text.splitlines(keepends=True)
        at = next(i for i, line in enumerate(lines) if line.startswith(own[0]))
        behind = at + len(block.text.splitlines())
        before = self._numbered(lines[:at])
        number = int(own[1]) + self._added
        self._last = number
        start, end = own.span(1)
        kept = lines[at][:start] + str(number) + lines[at][end:]
        return "".join([*before, kept, *lines[at + 1 : behind], *self._numbered(lines[behind:])])

    def _numbered(self, lines: Sequence[str]) -> list[str]:
        """Added lines with their numbers, which a line that continues the one before it does not have."""
        continued = [False, *(line.rstrip().endswith("~") for line in lines)]
        return [line if goes_on else self.next_number() + line for line, goes_on in zip(lines, continued, strict=False)]

    def renumbered_lines(self, data: bytes) -> bytes:
        """Text of plain lines, renumbered."""
        if not self._klartext:
            self._last = None
            return data
        last = _NUMBER_IN_BYTES.match(data, data.rfind(b"\n", 0, len(data) - 1) + 1)
        self._last = int(last[2]) + self._added if last else None
        return _raised(data, self._added) if self._added else data

    def next_number(self) -> str:
        """Number and blank at the start of the next added line; empty if the block before has no number."""
        if self._last is None:
            return ""
        self._added += 1
        self._last += 1
        return f"{self._last} "


def _raised(data: bytes, by: int) -> bytes:
    """Text of lines with larger block numbers, in columns where all of them keep their lengths."""
    text = np.frombuffer(data + b"\n" * (MOST_DIGITS + 1), np.uint8).copy()
    at = np.append(0, np.flatnonzero(text[: len(data) - 1] == ord("\n")) + 1)
    while (indented := _blank(text[at])).any():
        at = at + indented
    number, length, more = np.zeros(len(at), np.int64), np.zeros(len(at), int), np.ones(len(at), bool)
    for place in range(MOST_DIGITS):
        digit = text[at + place] - np.uint8(ord("0"))  # other characters become large
        more &= digit < 10
        if not more.any():
            break
        number = np.where(more, number * 10 + digit, number)
        length += more
    numbered = (length > 0) & _blank(text[at + length])
    last, number, length = (at + length - 1)[numbered], number[numbered] + by, length[numbered]
    powers = 10 ** np.arange(MOST_DIGITS + 1)
    if more.any() or (number >= powers[length]).any() or ((number < powers[length - 1]) & (length > 1)).any():
        return _NUMBER_IN_BYTES.sub(lambda found: b"%s%d" % (found[1], int(found[2]) + by), data)
    for place in range(int(length.max(initial=0))):
        some = length > place
        text[(last - place)[some]] = ord("0") + number[some] % 10
        number = number // 10
    return text[: len(data)].tobytes()


def _blank(characters: np.ndarray) -> np.ndarray:
    """True for a blank or a tabulator."""
    return np.asarray((characters == ord(" ")) | (characters == ord("\t")))
