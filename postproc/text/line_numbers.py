"""Numbers of lines in few words."""

from __future__ import annotations

from collections.abc import Iterable

LONGEST = 120
"""Characters of a list of lines that a person reads."""


def ranges(lines: Iterable[int]) -> str:
    """Lines in few words: `3, 5-9`."""
    found: list[list[int]] = []
    for line in sorted(set(lines)):
        if found and line == found[-1][1] + 1:
            found[-1][1] = line
        else:
            found.append([line, line])
    return ", ".join(f"{first}" if first == last else f"{first}-{last}" for first, last in found)


def shortened(text: str) -> str:
    """Ranges without those that are too many."""
    return text if len(text) <= LONGEST else text[:LONGEST].rpartition(", ")[0] + ", ..."
