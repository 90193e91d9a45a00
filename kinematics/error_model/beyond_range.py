"""Sentences on effects that are used beyond the ranges for which they are known."""

from __future__ import annotations

from collections.abc import Mapping


def beyond_range(outside: Mapping[tuple[str, str], float]) -> list[str]:
    """One sentence for all effects that are used equally far beyond their ranges, by `ErrorModel.outside`."""
    names: dict[str, list[str]] = {}
    for (name, unit), excess in outside.items():
        names.setdefault(f"{excess:.4g} {unit}", []).append(name)
    return [
        f"{', '.join(each)}{':' if each[1:] else ''} {'each ' if each[1:] else ''}is used up to {distance} beyond its "
        "calibrated range; its end value is held there"
        for distance, each in names.items()
    ]
