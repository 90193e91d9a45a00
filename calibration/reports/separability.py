"""Causes that a design shows and separates, by family: for a report, and for programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from calibration.diagnosis.conclusion.design import Designed
from rendering.report import Section, Table

LISTED_CAUSES = 4
"""Most causes of a family that one cell lists."""
TEXT = (
    "The table follows from the positions, their order and the set-up alone, without the readings. A cause is visible "
    "if odds of 150 to 1 or more are expected where it is there, of typical size; it is visible only together with "
    "another one if this explains its signal about as well (cosine in brackets)."
)
"""How the table follows from expected odds."""


def separability_section(design: Sequence[Designed]) -> Section:
    """Table of the families of causes that a design shows."""
    families: dict[str, list[Designed]] = {}
    for each in design:
        families.setdefault(each.kind, []).append(each)
    kinds = {each.name: each.kind for each in design}
    rows = [
        (
            kind,
            _listed([_place(each) for each in family if each.verdict == "visible"], len(family)),
            "\n".join(_ties(family, kinds)),
            _listed([_place(each) for each in family if each.verdict == "not visible"], len(family)),
        )
        for kind, family in families.items()
    ]
    head = ("cause", "visible", "visible only together with", "not visible")
    return Section("Causes that this design can show", TEXT, Table(head, rows), detail=True)


def separability_json(design: Sequence[Designed]) -> list[dict[str, Any]]:
    """The design's causes for programs."""
    return [
        {
            "kind": each.kind,
            "name": each.name,
            "verdict": each.verdict,
            "share": each.share,
            "tied_with": [{"name": name, "cosine": cosine} for name, cosine in each.tied_with],
            "remedy": each.remedy,
        }
        for each in design
    ]


def _place(each: Designed) -> str:
    """Axis, component or circle of a cause; `yes` where it is the only one of its family."""
    return each.name.removeprefix(each.kind).lstrip("- ") or "yes"


def _ties(family: Sequence[Designed], kinds: Mapping[str, str]) -> Iterator[str]:
    """Causes of a family with the family of the most similar other cause, and the largest cosine."""
    tied: dict[str, list[Designed]] = {}
    for each in family:
        if each.verdict == "tied":
            tied.setdefault(kinds[each.tied_with[0][0]], []).append(each)
    for other, some in tied.items():
        cosine = max(each.tied_with[0][1] for each in some)
        yield f"{_listed([_place(each) for each in some], len(family))}: {other} ({cosine:.2f})"


def _listed(texts: Sequence[str], whole: int) -> str:
    """The causes of a cell; `all 12` for a whole family, and the number of those that are not listed."""
    if len(texts) == whole > LISTED_CAUSES:
        return f"all {whole}"
    if len(texts) > LISTED_CAUSES:
        texts = [*texts[: LISTED_CAUSES - 1], f"{len(texts) - LISTED_CAUSES + 1} more"]
    return ", ".join(texts)
