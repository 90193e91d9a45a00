"""Delta debugging: the smallest program that still shows a difference of the same class."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

SECONDS = 40.0
"""Time for one program."""


def shrink(text: str, differs: Callable[[str], bool], seconds: float = SECONDS) -> str:
    """Leave out lines, then words, as long as the program differs."""
    end = time.monotonic() + seconds
    lines = _fewest(text.splitlines(keepends=True), lambda kept: differs("".join(kept)), end)
    for i, line in enumerate(lines):

        def differs_in_line(words: list[str], i: int = i) -> bool:
            return differs("".join([*lines[:i], *words, *lines[i + 1 :]]))

        *words, line_end = _words(line)
        lines[i] = "".join(_fewest(words, lambda words: differs_in_line([*words, line_end]), end)) + line_end  # noqa: B023
    return "".join(_fewest(lines, lambda kept: differs("".join(kept)), end))


def _words(line: str) -> list[str]:
    """Words of a line: a letter with the text up to the next letter or blank, brackets whole; last the line end."""
    body = line.rstrip("\r\n")
    words = re.findall(r"\s+|[A-Za-z_]?[^\sA-Za-z\[<(]*(?:\[[^\n]*\]|<[^>\n]*>|\([^)\n]*\))?", body)
    return [*filter(None, words), line[len(body) :]]


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
