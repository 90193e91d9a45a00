"""Blocks of ISO / Fanuc / LinuxCNC programs: a quick reader of plain blocks; the grammar reads all others.

Nearly all blocks of a CAM program are words and perhaps one comment; a regular expression reads those, equal to what
the grammar gives (a property test holds them together).
"""

from __future__ import annotations

import re

from postproc.iso.reading.calls import CALLS, program_name
from postproc.text.block import Block
from postproc.text.plain_lines import read_plain
from postproc.text.statements import Begin

# Written so that a text matches in one manner only: trying several takes exponential time on a long block.
_WORD = r"[A-Za-z$][ \t]*(?:[+-][ \t]*)?(?:\d+(?:\.\d*)?|\.\d+)"
WORDS = re.compile(rf"(?:[ \t]*{_WORD})+[ \t]*")
"""A text that holds words and nothing else."""
_PLAIN = re.compile(rf"((?:[ \t]*{_WORD})*)[ \t]*(?:\([^()\r\n]*\)[ \t]*|;[^\r\n]*)?[\r\n]*")
PARTS = re.compile(r"([A-Za-z$])[ \t]*(([+-]?)[ \t]*(\d+\.?\d*|\.\d+))")
_TAPE_MARK = re.compile(r"[ \t\x00]*(%[^\r\n]*)[\r\n]*")

NO_NUMBER = -1.0
"""Number of a program that has a name."""
FLOW = re.compile(
    CALLS.pattern + r"|GOTO|WHILE|(DO|END)[ \t]*\d|O[ \t]*(\d+|<[^<>]*>|\[.*\])[ \t]*[A-Z]",
    re.IGNORECASE,
)
"""Statements after which the next block does not always run."""


def plain_block(line: int, text: str) -> Block | None:
    """The block of words and a comment, or of a tape mark; None for every other text."""
    block = read_plain(line, text, _PLAIN, PARTS)
    if block is None and (mark := _TAPE_MARK.fullmatch(text)):
        return Block(line, text, "tape_mark", detail=mark[1])
    return block


def labels(block: Block) -> list[str]:
    """The names under which jumps and calls find a block."""
    prefixes = {"N": "", "O": "O"}
    found = [
        f"{prefixes[w.address]}{w.value:.10g}"
        for w in block.words
        if w.address in prefixes and w.value not in (None, NO_NUMBER)
    ]
    found += [program_name(block.text[w.at : w.end]) for w in block.words if w.address == "O" and w.value == NO_NUMBER]
    if block.code is not None:
        found += [step.key for step in block.code.before if isinstance(step, Begin) and step.kind == "SUB"]
    return found
