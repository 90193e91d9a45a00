"""What changes from day to day or from version to version, and is therefore not compared."""

from __future__ import annotations

import re

from kinematics.version import VERSION

MASKS = (
    (re.compile(rf"ncomp {re.escape(VERSION)}"), "ncomp VERSION"),
    (re.compile(r"\b20\d\d-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?Z?(?: UTC)?)?"), "DATE"),
    (re.compile(r"(?<![\w.])[0-9a-f]{12}(?![\w.])"), "HASH"),
    (re.compile(r"\b(?:in|took|after) \d+(?:\.\d+)? s(?:econds)?\b"), "in SECONDS"),
)
"""Patterns, and the word in their place: version, dates and times, hashes of inputs and models, durations of a run."""


def masked(text: str) -> str:
    """The text with a word in place of each volatile part, and without blanks at the ends of lines."""
    for pattern, word in MASKS:
        text = pattern.sub(word, text)
    return "\n".join(line.rstrip() for line in text.splitlines())
