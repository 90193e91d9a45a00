"""Compares an answer with the stored one, line by line; numbers within their precision."""

from __future__ import annotations

import difflib
import re
from typing import NamedTuple


class Rounding(NamedTuple):
    """Differences of a number that are rounding errors."""

    relative: float
    smallest: float
    """In the unit of the number."""


EXACT = Rounding(1e-6, 1e-9)
"""Of results in double precision."""
SEARCHED = Rounding(1e-3, 1e-3)
"""Of a diagnosis, um, urad and powers of ten: candidates in single precision, sizes by iterations."""
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)|(?<=[A-Z])-?\d+\.\d+")
"""Also behind the letter of an axis, as in a program."""
SECTION = "== "
"""A line that begins with this names the file, or the stream, that follows."""


def differences(stored: str, present: str, rounding: Rounding = EXACT) -> str:
    """The lines in which an answer differs from the stored one, as a diff; empty where there are none.

    A line agrees whose words are the same and whose numbers differ by so much at most, in texts by one of the last
    digit too.
    """
    before, after = stored.splitlines(), present.splitlines()
    matcher = difflib.SequenceMatcher(None, _skeletons(before), _skeletons(after), autojunk=False)
    of_json = _are_of_json(before)
    for first, second, length in matcher.get_matching_blocks():
        for number in range(length):
            if _agree(before[first + number], after[second + number], of_json[first + number], rounding):
                after[second + number] = before[first + number]
    return "\n".join(difflib.unified_diff(before, after, "stored", "present", n=1, lineterm=""))


def _are_of_json(lines: list[str]) -> list[bool]:
    """Whether each line is in a section of JSON."""
    here, found = False, []
    for line in lines:
        here = line.endswith(".json") if line.startswith(SECTION) else here
        found.append(here)
    return found


def _skeletons(lines: list[str]) -> list[str]:
    """The words of each line, behind the section in which it stands."""
    section, found = "", []
    for line in lines:
        section = line if line.startswith(SECTION) else section
        found.append(section + _words(line))
    return found


def _words(line: str) -> str:
    """A line without its numbers; columns move, and rules of tables grow, with the width of a number."""
    return " ".join(re.sub("─+", "─", NUMBER.sub("#", line)).split())


def _agree(one: str, other: str, of_json: bool, rounding: Rounding) -> bool:
    first, second = NUMBER.findall(one), NUMBER.findall(other)
    return all(_near(*pair, of_json, rounding) for pair in zip(first, second, strict=True))


def _near(one: str, other: str, of_json: bool, rounding: Rounding) -> bool:
    if one == other:
        return True
    if _is_whole(one) and _is_whole(other):
        return False
    apart, largest = abs(float(one) - float(other)), max(abs(float(one)), abs(float(other)))
    last = 0.0 if of_json else (1 + rounding.relative) * max(_last_digit(one), _last_digit(other))
    return apart <= max(rounding.relative * largest, last, rounding.smallest)


def _is_whole(number: str) -> bool:
    return not {".", "e"} & set(number)


def _last_digit(number: str) -> float:
    """One of the last printed digit."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
