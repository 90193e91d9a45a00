"""What the data of a diagnosis do not show, and the measurements that would show it."""

from __future__ import annotations

from collections.abc import Iterator

from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.reports.causes import text as words
from kinematics.files.number_text import rounded
from rendering.report import Section, Table

OF_MOTIONS = "positions of its axis over the travel, seen in this direction"
"""Measurement that shows an error motion."""

ENCODER = (
    "positions in steps of a few um along {}, over some signal periods of its encoder: waves below {:.3g} mm are not "
    "sought in these positions"
)
"""Measurement that shows errors of an encoder."""


def unseen_sections(answer: Diagnosis) -> Iterator[Section]:
    """Causes that are not visible, not tested, and the smallest sizes of the others."""
    by_remedy: dict[str, list[str]] = {}
    if answer.unseen_motions:
        by_remedy[OF_MOTIONS] = answer.unseen_motions
    for each in answer.expected:
        if not each.visible:
            names = by_remedy.setdefault(each.effect.shown_by(answer.measurement.state), [])
            names += [name for name in [words.in_full(each.effect.name)] if name not in names]
    for axis, period in answer.shortest_periods.items():
        by_remedy[ENCODER.format(axis, period)] = [f"sub-divisional error of the encoder of {axis}"]
    if by_remedy:
        text = "Of typical size, the following causes would not be clear in these data (NOT VISIBLE)."
        hidden = [(", ".join(names), remedy) for remedy, names in by_remedy.items()]
        yield Section("Unidentifiable causes", text, Table(("cause", "measurement that would show it"), hidden))
    lacking: dict[str, list[str]] = {}
    for name, lacks in answer.untested:
        lacking.setdefault(lacks, []).append(words.in_full(name))
    if lacking:
        untested = [(", ".join(names), lacks) for lacks, names in lacking.items()]
        yield Section("Not tested", table=Table(("cause", "columns that the data lack"), untested), detail=True)
    yield from _smallest(answer)


def _smallest(answer: Diagnosis) -> Iterator[Section]:
    """The smallest sizes that the data would show, by kind and unit."""
    found: dict[tuple[str, str], list[str]] = {}
    for each in answer.expected:
        if each.visible and each.smallest is not None:
            name, size, unit = each.smallest
            kind, _, place = name.partition(" ")
            found.setdefault((kind, unit), []).append(f"{place} {rounded(size)}".strip())
    if found:
        rows = [(kind, ", ".join(dict.fromkeys(sizes)), unit) for (kind, unit), sizes in found.items()]
        table = Table(("cause", "smallest size that these data show", "unit"), rows)
        yield Section("Detection limits", table=table, detail=True)
