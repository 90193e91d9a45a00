"""The log of `ncomp watch`: what has become of the last programs."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from kinematics.files import reason_of

LINE = re.compile(r"(?P<time>\d{4}-\d\d-\d\d \d\d:\d\d:\d\d) (?:(?P<state>[a-z][a-z ]*): )?(?P<text>.*)")
END = 1 << 17
"""Bytes of the end of a log that are read."""
MOST_SHOWN_LINES = 200
"""Lines that are shown."""


class Line(NamedTuple):
    """A line of the log."""

    time: str
    state: str
    """What has become of a program; empty for another line."""
    text: str


class Watched(NamedTuple):
    """The end of a log."""

    lines: list[Line]
    """The last one first."""
    counts: Counter[str]
    """Number of lines by state."""
    fault: str = ""
    """Why the log cannot be read."""


def watched(log: Path) -> Watched:
    """The last lines of the log."""
    try:
        with log.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - END, 0))
            texts = file.read().decode(errors="replace").splitlines()[1 if size > END else 0 :]
    except OSError as fault:
        return Watched([], Counter(), f"{log.name}: {reason_of(fault)}: start ncomp watch, and write its log there")
    lines: list[Line] = []
    for text in texts:
        found = LINE.fullmatch(text)
        if found:
            lines.append(Line(found["time"], found["state"] or "", found["text"]))
        elif lines:
            lines[-1] = lines[-1]._replace(text=f"{lines[-1].text}\n{text}")
    lines = lines[: -MOST_SHOWN_LINES - 1 : -1]
    return Watched(lines, Counter(each.state for each in lines if each.state))
