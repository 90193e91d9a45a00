"""Numbers of lines, of several files if a program calls others, and lists of them in few words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import PurePath

LIST_CHARACTERS = 120
"""Characters of a list of lines that a person reads."""
FILE = 1 << 40
"""A line of the main program has its own number; those of the n-th called file are counted from n times FILE."""
_FILES: list[str | Sequence[int]] = [""]
"""Names of the called files that this process has met, and the lines that each line of an unrolled text is from."""


def first_line(file: str) -> int:
    """The number to add to the numbers of the lines of a called file; 0 for the main program, which has no name."""
    if file not in _FILES:
        _FILES.append(file)
    return _FILES.index(file) * FILE


def first_line_of_text(origins: Sequence[int]) -> int:
    """The number to add to the numbers of the lines of a text that ncomp makes; origins: the line that each is from."""
    _FILES.append(origins)
    return (len(_FILES) - 1) * FILE


def original(line: int) -> int:
    """The line of a program that a line of a text is from; a line of a program itself as it is."""
    file, number = _FILES[line // FILE], line % FILE
    return line if isinstance(file, str) else file[min(number, len(file)) - 1]


def place(line: int) -> tuple[str, int]:
    """The called file of a line, empty for the main program, and the number of the line in it."""
    line = original(line)
    return str(_FILES[line // FILE]), line % FILE


def shown(line: int) -> str:
    """A line in words: `5`, `O1000.nc:5` in a called file."""
    file, number = place(line)
    return f"{PurePath(file).name}:{number}" if file else f"{number}"


def ranges(lines: Iterable[int]) -> str:
    """Lines in few words: `3, 5-9`, `O1000.nc:4-6` in a called file."""
    found: list[list[int]] = []
    for line in sorted(set(map(original, lines))):
        if found and line == found[-1][1] + 1:
            found[-1][1] = line
        else:
            found.append([line, line])
    return ", ".join(shown(first) if first == last else f"{shown(first)}-{place(last)[1]}" for first, last in found)


def shortened(text: str) -> str:
    """Ranges without those that are too many."""
    return text if len(text) <= LIST_CHARACTERS else text[:LIST_CHARACTERS].rpartition(", ")[0] + ", ..."
