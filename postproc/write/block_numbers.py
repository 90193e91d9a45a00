"""Numbers of Klartext blocks: the control requires a sequence, so blocks after added blocks are renumbered.

Nothing in Klartext refers to them: jumps and calls find labels. ISO and Siemens blocks need none, and jumps go to
them, so there the program's own stay and blocks of ncomp's own have none.
"""

from __future__ import annotations

import re

from postproc.text.block import Block

_NUMBER = re.compile(r"[ \t]*(\d+)(?=[ \t])")


class BlockNumbers:
    """Numbers the lines of a program, in their order; leaves those without a number, and all before the first one."""

    def __init__(self, *, klartext: bool) -> None:
        self._klartext = klartext
        self._added = 0
        self._last: int | None = None
        """The number of the last block; None where it has none."""

    def renumbered(self, block: Block, text: str) -> str:
        """What has become of a block, with lines of ncomp's own before and behind it."""
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

    def next_number(self) -> str:
        """What a line of ncomp's own begins with, behind those before it."""
        if self._last is None:
            return ""
        self._added += 1
        self._last += 1
        return f"{self._last} "
