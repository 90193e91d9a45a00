"""Notes on readings that a test by ISO 230-2 lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.single_axis.cells import BACKWARD, DIRECTIONS, FORWARD
from kinematics.transforms import Array

RUNS, TARGETS = 5, 5
"""Least numbers by ISO 230-2 for axes up to 2 m: runs in each direction, target positions."""


def remarks(name: str, unit: str, positions: Array, count: np.ndarray) -> list[str]:
    """Notes on deviations of the test from ISO 230-2."""
    directions = [direction for direction in (FORWARD, BACKWARD) if count[direction].any()]
    found = []
    if len(directions) == 1:
        found.append(
            f"{name}: {DIRECTIONS[directions[0]]} runs only: the reversal value and all bidirectional values are "
            "missing"
        )
    for direction in directions:
        runs = count[direction]
        without = positions[runs == 0]
        if len(without):
            found.append(f"{name}: no {DIRECTIONS[direction]} reading at {_listed(without)} {unit}")
        if len(set(runs[runs > 0].tolist())) > 1:
            fewer = positions[(runs > 0) & (runs < runs.max())]
            found.append(f"{name}: fewer than {runs.max()} {DIRECTIONS[direction]} readings at {_listed(fewer)} {unit}")
    if count.max() == 1:
        found.append(f"{name}: one run only: the repeatability is unknown (no s, R and A)")
    elif count[directions].min() < RUNS or len(positions) < TARGETS:
        least, most = int(count[directions].min()), int(count.max())
        readings = f"{least} to {most}" if least < most else str(most)
        found.append(
            f"{name}: {len(positions)} targets, {readings} readings each: "
            f"ISO 230-2 requires at least {TARGETS} targets and {RUNS} runs in each direction"
        )
    return found


def one_way_remarks(name: str, unit: str, values: Mapping[str, float]) -> list[str]:
    """A note where a value of one direction exceeds that of both, which counts targets with both directions alone."""
    larger = [
        f"{symbol} {direction} {one:.3g} {unit} is above {symbol} {values[symbol]:.3g} {unit}"
        for symbol in ("E", "A")
        for direction in DIRECTIONS
        if (one := values.get(f"{symbol} {direction}", 0.0)) > values.get(symbol, np.inf)
    ]
    if not larger:
        return []
    return [
        f"{name}: {', '.join(larger)}: values of both directions leave out the targets with one direction only, and "
        "may be too small. Measure every target in both directions"
    ]


def _listed(positions: Sequence[float] | Array) -> str:
    shown = ", ".join(f"{position:g}" for position in positions[:5])
    return f"{shown}, ... ({len(positions)} targets)" if len(positions) > 5 else shown
