"""Faults of a calibration file: keys that are given twice, and the messages of the decoder in the words of people."""

from __future__ import annotations

import codecs
import re
from typing import Any

from kinematics.files.toml_entries import NOUNS
from kinematics.user_error import UserError

CURE = "take an unchanged copy of the file, or make the calibration anew (ncomp fit)"
REASONS = {
    "Input data was truncated": "the file is incomplete",
    "Object contains unknown field": "there is no entry",
    "Object missing required field": "the entry is missing:",
    "`": "",
}
"""Words of the decoder, each with those for people."""


def utf8_content(data: bytes, source: str) -> bytes:
    """The content without the mark of its encoding; UserError for UTF-16."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise UserError(f"calibration {source} is UTF-16 text: save it as UTF-8")
    return data.removeprefix(codecs.BOM_UTF8)


def given_twice(content: dict[str, Any], data: bytes) -> str:
    """A key that one object has twice, of which JSON readers take the last; empty for none."""
    if data.count(b'":') == _keys(content):
        return ""
    found: list[str] = []

    def once(pairs: list[tuple[str, Any]]) -> None:
        names = [name for name, _ in pairs]
        found.extend(name for name in names if names.count(name) > 1)

    import json

    json.loads(data, object_pairs_hook=once)
    return found[0] if found else ""


def _keys(value: object) -> int:
    """Number of keys in a content, without those in lists of numbers."""
    if isinstance(value, dict):
        return len(value) + sum(map(_keys, value.values()))
    return sum(map(_keys, value)) if isinstance(value, list) and value and isinstance(value[0], dict) else 0


def reason_of_fault(fault: str) -> str:
    """The reason of msgspec in the words of people."""
    reason, _, where = fault.partition(" - at ")
    types = re.match(r"Expected `(\w+)`, got `(\w+)`$", reason)
    if types:
        reason = f"expected {NOUNS.get(types[1], types[1])}, not {NOUNS.get(types[2], types[2])}"
    for theirs, ours in REASONS.items():
        reason = reason.replace(theirs, ours)
    place = where.strip("`").removeprefix("$").removeprefix(".").replace("[...]", "")
    return f"{place}: {reason}" if place else reason


def hint(fault: str, data: bytes) -> str:
    """The expected form, for frequent typing errors."""
    if "made_at" in fault:
        return "; expected e.g. 2026-01-31T12:00:00Z"
    if "malformed" in fault and any(word in data for word in (b"NaN", b"Infinity")):
        return "; NaN and Infinity are no numbers in JSON"
    return ""
