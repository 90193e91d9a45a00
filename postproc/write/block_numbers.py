"""Numbers of Klartext blocks: the control requires a sequence, so blocks after added blocks are renumbered.

Nothing in Klartext refers to block numbers: jumps and calls refer to labels. In ISO and Siemens programs blocks need
no numbers and jumps refer to them: there the blocks of the program keep their numbers and added blocks have none.
"""

from __future__ import annotations

import re

from postproc.text.block import Block

_NUMBER = re.compile(r"[ \t]*(\d+)(?=[ \t])")

_NUMBER_IN_BYTES = re.compile(rb"^([ \t]*)(\d+)(?=[ \t])", re.MULTILINE)


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
        before = [self.next_number() + line for line in lines[:at]]
        number = int(own[1]) + self._added
        self._last = number
        start, end = own.span(1)
        kept = lines[at][:start] + str(number) + lines[at][end:]
        after = [self.next_number() + line for line in lines[behind:]]
        return "".join([*before, kept, *lines[at + 1 : behind], *after])

    def renumbered_lines(self, data: bytes) -> bytes:
        """Text of plain lines, renumbered."""
        if not self._klartext:
            self._last = None
            return data
        last = _NUMBER_IN_BYTES.match(data, data.rfind(b"\n", 0, len(data) - 1) + 1)
        self._last = int(last[2]) + self._added if last else None
        return _NUMBER_IN_BYTES.sub(self._moved, data) if self._added else data

    def _moved(self, number: re.Match[bytes]) -> bytes:
        return b"%s%d" % (number[1], int(number[2]) + self._added)

    def next_number(self) -> str:
        """Number and blank at the start of the next added line; empty if the block before has no number."""
        if self._last is None:
            return ""
        self._added += 1
        self._last += 1
        return f"{self._last} "
