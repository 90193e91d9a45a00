"""Delta debugging: the smallest program that still shows a difference of the same class."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

SECONDS = 120.0
"""Time for one program."""


def shrink(text: str, differs: Callable[[str], bool], seconds: float = SECONDS) -> str:
    """Leave out lines, then words, as long as the program differs."""
    end = time.monotonic() + seconds
    for parts in (_lines, _words, _lines):
        text = "".join(_fewest(parts(text), lambda kept: differs("".join(kept)), end))
    return text


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def _words(text: str) -> list[str]:
    """Words of NC text: a letter with what follows up to the next letter, blank or line end; brackets stay whole."""
    return re.findall(r"\s+|[A-Za-z_]?[^\sA-Za-z\[<(]*(?:\[[^\n]*\]|<[^>\n]*>|\([^)\n]*\))?|.", text)


def _fewest(parts: list[str], differs: Callable[[list[str]], bool], end: float) -> list[str]:
    size = max(1, len(parts) // 2)
    while True:
        start, gone = 0, False
        while start < len(parts) and time.monotonic() < end:
            kept = parts[:start] + parts[start + size :]
            if differs(kept):
                parts, gone = kept, True
            else:
                start += size
        if time.monotonic() > end or (size == 1 and not gone):
            return parts
        size = max(1, size // 2) if not gone or size > 1 else 1
