"""Durations in words."""

from __future__ import annotations

UNITS = (("year", 365.25), ("month", 30.44), ("week", 7.0), ("day", 1.0))
"""Units, days; a unit is used from two of it on."""


def age_in_words(days: float) -> str:
    """`made today`, `3 days old`, `5 weeks old`, `14 months old`, from days; of a time ahead: `dated in the future`."""
    if days < 0.0:
        return "dated in the future"
    for name, size in UNITS:
        if days >= 2.0 * size:
            return f"{days / size:.0f} {name}s old"
    return "1 day old" if days >= 1.0 else "made today"
