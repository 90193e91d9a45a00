"""What a design can show and separate, by family of causes: for the head of a report, and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calibration.diagnosis.separability import Separability
from rendering.report import Section, Table

LISTED = 4
"""Most causes of a family that one cell lists."""
TEXT = (
    "By the positions, their order and the set-up alone, without the readings. Only together with: these data cannot "
    "separate the two (in brackets: cosine). Not visible: model and registration imitate at least 95 % of the signal."
)


def separability_section(design: Sequence[Separability]) -> Section:
    """Table of the families of causes that a design shows."""
    families: dict[str, list[Separability]] = {}
    for each in design:
        families.setdefault(each.kind, []).append(each)
    rows = [
        (
            kind,
            _listed([_place(each) for each in family if each.verdict == "visible"], len(family)),
            _listed([_tie(each) for each in family if each.verdict == "tied"], 0, "\n"),
            _listed([_place(each) for each in family if each.verdict == "not visible"], len(family)),
        )
        for kind, family in families.items()
    ]
    head = ("cause", "visible", "visible only together with", "not visible")
    return Section("What this design can show", TEXT, Table(head, rows))


def separability_json(design: Sequence[Separability]) -> list[dict[str, Any]]:
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


def _place(each: Separability) -> str:
    """Axis, component or circle of a cause; `yes` where it is the only one of its family."""
    return each.name.removeprefix(each.kind).strip() or "yes"


def _tie(each: Separability) -> str:
    (other, cosine), *more = each.tied_with
    return f"{_place(each)}: {other} ({cosine:.2f})" + (f" and {len(more)} more" if more else "")


def _listed(texts: Sequence[str], whole: int, between: str = ", ") -> str:
    """The causes of a cell; `all 12` for a whole family, and the number of those that are not listed."""
    if whole and len(texts) == whole > LISTED:
        return f"all {whole}"
    if len(texts) > LISTED:
        texts = [*texts[: LISTED - 1], f"{len(texts) - LISTED + 1} more"]
    return between.join(texts)
