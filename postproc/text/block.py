"""NC text without loss: blocks with their words and the position of each number; edits that change nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from kinematics.user_error import UserError
from postproc.text.expressions import Expression, Formula
from postproc.text.line_numbers import place
from postproc.text.statements import Code

_DIALECT = re.compile("is not (understood|known|complete)|controls differ")
"""Reasons that a wrong dialect can have."""


class Refusal(UserError):
    """A block that cannot be used: file, line, text and reason."""

    def __init__(self, line: int, text: str, reason: str) -> None:
        super().__init__(reason)
        self.line = line
        self.text = text.strip()
        self.reason = reason

    def located(self, file: str, read_as: str = "") -> UserError:
        """The message a user sees; `file`: that of the main program; `read_as`: the dialect, and why."""
        called, line = place(self.line)
        text = readable(self.text)
        shown = text if len(text) <= 80 else text[:77] + "..."
        guessed = "because no line" in read_as  # of interest where the dialect can be the cause
        behind = f" ({read_as})" if read_as and (not guessed or _DIALECT.search(self.reason)) else ""
        return UserError(f"{called or file}:{line}: {shown!r}: {self.reason}{behind}")


def readable(text: str) -> str:
    """Text of a program, whose characters are its bytes, as its author sees it: decoded where it is UTF-8."""
    try:
        return text.encode("latin-1").decode()
    except UnicodeError:
        return text


class Word(NamedTuple):
    """An address and its number, with the positions of both in the text of the block."""

    address: str
    """Upper case; Klartext increments as IX, IY, ..."""
    value: float | None
    """None for an address without a number (`FMAX` is the address FMAX; Klartext also has a bare `M`)."""
    at: int
    start: int
    end: int
    """The word is text[at:end], its number text[start:end]."""
    formula: Formula | None = None
    """The expression instead of the number; the value is then that of the present iteration, if known."""
    mode: str = ""
    """AC, IC, DC, ... of a Siemens word with its own meaning of the value."""
    tail: int = 0
    """Characters behind the number that belong to the word."""
    arguments: tuple[Expression, ...] | None = None
    """Words of a call."""


class Block(NamedTuple):
    """One NC block, a line or several joined by continuation marks."""

    line: int
    """Number of its first line in the file, from 1; in a called file as of `line_numbers`."""
    text: str
    """With its end of line; joining the texts of all blocks gives the file."""
    kind: str
    """Its content, in the terms of its dialect's module."""
    words: tuple[Word, ...] = ()
    detail: str = ""
    """The construct behind `kind`, for messages and rare statements."""
    skippable: bool = False
    """True when the operator's block-skip switch decides whether it runs."""
    code: Code | None = None
    """Its statements; a block whose words hold formulas has one too, be it empty."""
    no_insertion: bool = False
    """True if a jump leads to it or away from it: a block added before or behind it may not run."""

    def refuse(self, reason: str) -> Refusal:
        """The exception that stops the run at this block."""
        return Refusal(self.line, self.text, reason)

    def refuse_skip(self) -> Refusal:
        """The exception for a block whose run depends on the operator and matters to other blocks."""
        return self.refuse(
            "the block-skip switch decides whether this block runs: state it by --block-skip on (it is skipped) or off "
            "(it runs), or by block_skip under [control] of the machine file"
        )


class Edit(NamedTuple):
    """Replace text[start:end] of a block."""

    start: int
    end: int
    text: str


def edited(text: str, edits: Iterable[Edit]) -> str:
    """The text with all edits made; edits do not overlap, those at one position keep their order."""
    pieces: list[str] = []
    done = 0
    for start, end, replacement in sorted(edits, key=lambda edit: edit[:2]):
        pieces += text[done:start], replacement
        done = end
    pieces.append(text[done:])
    return "".join(pieces)


TYPING = (
    (r"[Oo]", r"[A-Za-z][-+]?\d*$", "write the digit 0 in place of the letter O"),
    (r"[lI]", r"[A-Z][-+]?\d*$", "write the digit 1 in place of the letter"),
    (r",\d", r"(?:^|[^.\d])\d+$", "write the decimal point as '.'"),
    ("\xe2\x88\x92|\xe2\x80\x93|\x96", r"[A-Z]$", "write the plain minus sign - in place of the typographic one"),
    ("\xc2\xa0", "", "write a plain blank in place of the no-break space"),
    ("\xef\xbc[\x90-\x99]", "", "write plain digits in place of the wide ones"),
)
"""Likely typing mistakes: beginning of the rest and end of the text before it, Latin-1, and the cure."""


NO_BREAK = ": write a plain blank in place of the no-break space"


def not_understood(text: str, at: int, *, bare: bool = False) -> str:
    """Reason for a block that is not understood from the position `at` on, with the likely typing mistake.

    bare: the dialect has addresses without a number.
    """
    rest = text[at:].strip()
    skipped = text[at : len(text) - len(text[at:].lstrip())]
    likely = NO_BREAK if "\xa0" in skipped else _likely(text[:at], rest, bare)
    return f"{readable(rest)[:20]!r} is not understood{likely}"


def _likely(before: str, rest: str, bare: bool) -> str:
    """The likely mistake, behind a separator; a general advice where none is likely."""
    for begins, behind, cure in TYPING:
        if re.match(begins, rest) and re.search(behind, before):
            return f": {cure}"
    if before.count("[") > before.count("]"):
        return ": close the bracket with ]"
    empty = re.search(r"(?:^|[\s\d.])([A-Z])\s*$", before)
    if empty and not bare and re.match(r"[A-Z;(]|$", rest):
        return f": {empty[1]} has no value"
    return ": correct the block"
