"""Figures of runs of the fuzzers, kept in `figures.csv`: a line for each examiner and seed, the newest run of both."""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.runner import Count

FILE = Path(__file__).with_name("figures.csv")
HEAD = ("examiner", "seed", "programs", "compared", "refused", "differences")


class Figures(NamedTuple):
    """Numbers of programs."""

    programs: int
    compared: int
    refused: int
    differences: int


def record(name: str, seed: int, count: Count) -> None:
    """Enter a run in the place of an earlier one of this examiner with this seed."""
    rows = _rows()
    figures = Figures(count.programs, count.compared, count.refused.total(), count.differences.total())
    rows[name, seed] = figures
    with FILE.open("w", encoding="ascii", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEAD)
        writer.writerows([*key, *rows[key]] for key in sorted(rows))


def sums() -> dict[str, Figures]:
    """All runs of each examiner together."""
    found: dict[str, list[Figures]] = defaultdict(list)
    for (name, _), figures in _rows().items():
        found[name].append(figures)
    return {name: Figures(*map(sum, zip(*each, strict=True))) for name, each in found.items()}


def _rows() -> dict[tuple[str, int], Figures]:
    if not FILE.exists():
        return {}
    with FILE.open(encoding="ascii", newline="") as file:
        _, *rows = csv.reader(file)
    return {(row[0], int(row[1])): Figures(*map(int, row[2:])) for row in rows}
