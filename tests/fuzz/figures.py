"""Figures of runs of the fuzzers: a line for each examiner or reader and seed, the newest run of both.

`figures.csv` has those of `python -m tests.fuzz`, `readers.csv` those of `python -m tests.fuzz.guided`.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

PROGRAMS = Path(__file__).with_name("figures.csv")
READERS = Path(__file__).with_name("readers.csv")


class Figures(NamedTuple):
    """Numbers of programs or files."""

    inputs: int
    compared: int
    """Of a reader: read."""
    refused: int
    differences: int
    """Of a reader: neither read nor refused in words."""


def record(file: Path, name: str, seed: int, figures: Figures) -> None:
    """Enter a run in the place of an earlier one of this name with this seed."""
    rows = _rows(file)
    rows[name, seed] = figures
    with file.open("w", encoding="ascii", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(("name", "seed", *Figures._fields))
        writer.writerows([*key, *rows[key]] for key in sorted(rows))


def sums(file: Path) -> dict[str, Figures]:
    """All runs of each name together."""
    found: dict[str, list[Figures]] = defaultdict(list)
    for (name, _), figures in _rows(file).items():
        found[name].append(figures)
    return {name: Figures(*map(sum, zip(*each, strict=True))) for name, each in found.items()}


def _rows(file: Path) -> dict[tuple[str, int], Figures]:
    if not file.exists():
        return {}
    with file.open(encoding="ascii", newline="") as lines:
        _, *rows = csv.reader(lines)
    return {(row[0], int(row[1])): Figures(*map(int, row[2:])) for row in rows}
