"""Seven designs of short measurements: positions as shares of the travels, in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from short_measurements.machines import Array

LUNCH_S, WARMING_S = 3000.0, 600.0


def line(axis: int, at: Array, low: float, high: float, count: int, *, back: bool = True) -> Array:
    """Shares of the travels along an axis, out and, unless not wanted, back."""
    u = np.linspace(low, high, count)
    u = np.concatenate([u, u[::-1]]) if back else u
    rows = np.tile(at, (len(u), 1))
    rows[:, axis] = u
    return rows


def box(rng: np.random.Generator, least: float, most: float) -> Array:
    """Part of the travels, `(3, 2)`, that a measurement covers."""
    width = rng.uniform(least, most, 3)
    low = rng.uniform(0.0, 1.0 - width)
    return np.stack([low, low + width], axis=1)


def part_lines(rng: np.random.Generator) -> Array:
    """Three lines along each axis, out and back, in a part of the volume."""
    part = box(rng, 0.5, 0.8)
    at = (rng.uniform(*part.T) for _ in range(9))
    return np.concatenate([line(a, next(at), *part[a], 5 if a == 2 else 7) for a in rng.permutation(3) for _ in "123"])


def diagonals(_: np.random.Generator) -> Array:
    """Two body diagonals out and back, then two lines along each axis."""
    u = np.linspace(0.03, 0.97, 13)
    rows = [np.stack([w, w if s else 1 - w, w], axis=1) for s in (True, False) for w in (u, u[::-1])]
    rows += [line(a, np.full(3, at), 0.03, 0.97, 7, back=at < 0.5) for a in range(3) for at in (0.15, 0.8)]
    return np.concatenate(rows)


def pairs(rng: np.random.Generator) -> Array:
    """65 random stops with two targets each; a lunch break."""
    return np.repeat(rng.uniform(0.05, 0.95, (65, 3)), 2, axis=0)


def three_rounds(rng: np.random.Generator) -> Array:
    """A line along each axis, the corners and 16 random positions: three times, while the machine warms up."""
    rows = [line(a, np.full(3, 0.5), 0.05, 0.95, 7, back=False) for a in range(3)]
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 0, 1)]
    rows += [0.08 + 0.84 * np.array(corners, float), rng.uniform(0.1, 0.9, (16, 3))]
    return np.tile(np.concatenate(rows), (3, 1))


def layers(_: np.random.Generator) -> Array:
    """Three layers, each a grid in turning lines, then three lines up."""
    rows = []
    for z in (0.1, 0.5, 0.85):
        for j, y in enumerate(np.linspace(0.05, 0.95, 5)):
            x = np.linspace(0.05, 0.95, 7)[:: 1 - 2 * (j % 2)]
            rows.append(np.stack([x, np.full(7, y), np.full(7, z)], axis=1))
    rows += [line(2, np.array([x, y, 0.0]), 0.1, 0.85, 6, back=False) for x, y in ((0.1, 0.1), (0.9, 0.2), (0.2, 0.9))]
    return np.concatenate(rows)


def sorted_stops(rng: np.random.Generator) -> Array:
    """150 random positions, sorted by slices of X and then by Z."""
    u = rng.uniform(0.02, 0.98, (150, 3))
    return u[np.lexsort((u[:, 2], np.round(u[:, 0] * 5)))]


def sparse(rng: np.random.Generator) -> Array:
    """62 rows: three edges out and back, then 26 random positions."""
    part = box(rng, 0.6, 0.9)
    rows = [line(a, part[:, 0], *part[a], 6) for a in range(3)]
    return np.concatenate([*rows, part[:, 0] + rng.uniform(size=(26, 3)) * np.ptp(part, axis=1)])


@dataclass(frozen=True)
class Design:
    """Positions as shares of the travels, in order, the number of targets, and pauses, s."""

    shares: Callable[[np.random.Generator], Array]
    targets: int
    pause_s: float = 0.0
    rounds: int = 1


DESIGNS = {
    "part-lines": Design(part_lines, 1),
    "diagonals": Design(diagonals, 2),
    "pairs": Design(pairs, 2, LUNCH_S),
    "three-rounds": Design(three_rounds, 2, WARMING_S, 3),
    "layers": Design(layers, 1),
    "sorted": Design(sorted_stops, 3),
    "sparse": Design(sparse, 1),
}
