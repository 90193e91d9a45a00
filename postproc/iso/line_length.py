"""Largest length of a line of an ISO program for LinuxCNC."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from kinematics.machine import Control
from postproc.text.block import Block

LINUXCNC = 253
"""Characters, end of line included, that LinuxCNC 2.9 reads at most (its buffer has 255)."""


def refuse_long_line(control: Control, block: Block) -> None:
    """Refuse a line of the program, comments among them, that LinuxCNC can't read, where the control is one."""
    if control.family == "linuxcnc" and len(block.text) > LINUXCNC and _longest(block.text) > LINUXCNC:
        raise block.refuse(f"a line of {_longest(block.text)} characters: LinuxCNC reads {LINUXCNC}")


def refuse_lengthened(control: Control, blocks: Sequence[Block], texts: Iterable[str]) -> None:
    """Refuse blocks that have become too long for LinuxCNC, unless the control is another; `texts`: as they are now."""
    if control.family == "fanuc":
        return
    for block, text in zip(blocks, texts, strict=True):
        if len(text) > LINUXCNC and _longest(text) > LINUXCNC >= _longest(block.text):
            raise block.refuse(
                f"its corrected line has {_longest(text)} characters, and LinuxCNC reads {LINUXCNC}: make it shorter, "
                'or write family = "fanuc" in the machine file'
            )


def _longest(text: str) -> int:
    return max(map(len, text.splitlines(keepends=True)), default=0)
