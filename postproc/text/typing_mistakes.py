"""Typing mistakes: the likely one in a block that is not understood, from the text around the place."""

from __future__ import annotations

import re


def not_understood(text: str, at: int, *, bare: bool = False) -> str:
    """Reason for a block that is not understood from the position `at` on, with the likely typing mistake.

    bare: the dialect has addresses without a number.
    """
    rest = text[at:].strip()
    return f"{rest[:20]!r} is not understood{_likely(text[:at], rest, bare)}"


def _likely(before: str, rest: str, bare: bool) -> str:
    """The likely mistake, behind a separator; a general advice where none is likely."""
    if re.match(r"[Oo]", rest) and re.search(r"[A-Za-z][-+]?\d*$", before):
        return ": write the digit 0 in place of the letter O"
    if re.match(r"[lI]", rest) and re.search(r"[A-Z][-+]?\d*$", before):
        return ": write the digit 1 in place of the letter"
    if re.match(r",\d", rest) and re.search(r"\d$", before):
        return ": write the decimal point as '.'"
    if before.count("[") > before.count("]"):
        return ": close the bracket with ]"
    empty = re.search(r"(?:^|[\s\d.])([A-Z])\s*$", before)
    if empty and not bare and re.match(r"[A-Z;(]|$", rest):
        return f": {empty[1]} has no value"
    return ": correct the block"
