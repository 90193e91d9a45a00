"""The table of recorded answers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from short_measurements.answers import Record
from short_measurements.case import KINDS
from short_measurements.designs import DESIGNS

VISIBLE = 0.5
"""Power below which an effect that is not found counts as invisible."""


def table(records: list[Record]) -> Iterator[str]:
    """Lines of the table: all, by design and by effect."""
    head = ("asked", "named", "tied", "unexplained", "missed", "invisible", "false", "worse", "refused", "covered")
    yield f"{'':32}{''.join(f'{word:>12}' for word in head)}"
    groups: dict[str, list[Record]] = {"all": records}
    for key in ("design", "effect"):
        for name in DESIGNS if key == "design" else KINDS:
            groups[f"{key} {name}"] = [record for record in records if record[key] == name]
    for name, some in groups.items():
        if some:
            yield f"{name:32}{''.join(f'{figure:>12}' for figure in summary(some))}"


def summary(some: list[Record]) -> list[str]:
    """Figures of some answers."""
    answers = [each for each in some if "failure" not in each]
    count = dict.fromkeys(("named", "tied", "unexplained", "missed", "invisible"), 0)
    for each in answers:
        hidden = each["verdict"] == "missed" and each.get("power", 1.0) < VISIBLE
        count["invisible" if hidden else each["verdict"]] += each["effect"] != "none"
    written = [each for each in answers if "after_um" in each]
    worse = sum(each["accepted"] and each["after_um"] > each["none_um"] for each in written)
    refused = sum(not each["accepted"] and each["after_um"] < each["none_um"] for each in written)
    inside = [each["covered"] for each in written if "covered" in each and each["accepted"]]
    covered = f"{100 * np.mean(inside):.1f} %" if inside else ""
    false = sum(bool(each["false"]) for each in answers)
    return [*map(str, (len(some), *count.values(), false, worse, refused)), covered]


def read(path: Path) -> list[Record]:
    """The recorded answers."""
    return [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
