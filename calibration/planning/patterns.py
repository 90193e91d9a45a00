"""Patterns of points in a box of any dimension: lines, grids, scattered points. Units are those of the box."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError

MOST_PLANNED_POINTS = 5_000_000
"""Largest number of points; a larger number is regarded as a mistake."""


class Box(NamedTuple):
    """Box from low `(d,)` to high `(d,)`; planes lie at `share` of the distance from low to high."""

    low: Array
    high: Array
    share: float = 1.0


class Points(NamedTuple):
    """Points `(n, d)` in the order of measuring, and the number of the line of each point `(n,)`, from 1."""

    positions: Array
    line: np.ndarray


def hexahedron(box: Box, spacing: float) -> Points:
    """The edges of the box, ordered by direction, alternately forward and backward."""
    d = len(box.low)
    return _along_lines(box, _parallel(d, [(axis,) for axis in range(d)]), spacing)


def space_diagonals(box: Box, spacing: float) -> Points:
    """The diagonals through the middle (four for three axes; ISO 230-6)."""
    d = len(box.low)
    return _along_lines(box, _parallel(d, [tuple(range(d))]), spacing)


def face_diagonals(box: Box, spacing: float) -> Points:
    """Both diagonals of each face (twelve for three axes; ISO 230-6)."""
    d = len(box.low)
    return _along_lines(box, _parallel(d, list(itertools.combinations(range(d), 2))), spacing)


def diagonals(box: Box, spacing: float) -> Points:
    """The diagonals of the faces and of the box."""
    faces = face_diagonals(box, spacing)
    if len(box.low) == 2:
        return faces
    through = space_diagonals(box, spacing)
    return _once(
        np.concatenate([faces.positions, through.positions]), np.append(faces.line, through.line + faces.line[-1])
    )


def planes(box: Box, spacing: float) -> Points:
    """A plane for each pair of axes, with all others at the box's share: a grid of lines along the second axis."""
    positions, lines = [], []
    count = 0
    for pair in itertools.combinations(range(len(box.low)), 2):
        chosen = list(pair)
        flat = grid(Box(box.low[chosen], box.high[chosen]), spacing)
        position = np.tile(box.low + box.share * (box.high - box.low), (len(flat.positions), 1))
        position[:, chosen] = flat.positions
        positions.append(position)
        lines.append(flat.line + count)
        count = int(lines[-1][-1])
    return _once(np.concatenate(positions), np.concatenate(lines))


def grid(box: Box, spacing: float) -> Points:
    """A grid over the whole box, with lines along the last axis, alternately forward and backward."""
    counts = np.ceil((box.high - box.low) / spacing - 1e-9).astype(int) + 1
    _check(float(np.prod(counts.astype(float))))
    index = np.zeros((1, 0), int)
    for count in counts[::-1]:
        # one more axis in front: the path so far, forward at its even and backward at its odd positions
        sequences = [index[::-1] if k % 2 else index for k in range(count)]
        index = np.concatenate([np.insert(sequence, 0, k, axis=1) for k, sequence in enumerate(sequences)])
    share = index / np.maximum(counts - 1, 1)
    return Points(box.low + share * (box.high - box.low), np.arange(len(index)) // counts[-1] + 1)


def random(d: int, n: int, rng: np.random.Generator) -> Array:
    """Independent points `(n, d)` in 0..1."""
    return rng.uniform(size=(n, d))


def space_filling(d: int, n: int, rng: np.random.Generator) -> Array:
    """Points `(n, d)` in 0..1 of a scrambled Halton sequence, of which also the first few are evenly distributed."""
    from scipy.stats import qmc

    return np.asarray(qmc.Halton(d, seed=rng).random(n))


SPACED: Mapping[str, Callable[[Box, float], Points]] = {
    "planes": planes,
    "hexahedron": hexahedron,
    "diagonals": diagonals,
    "face-diagonals": face_diagonals,
    "space-diagonals": space_diagonals,
    "grid": grid,
}
"""Patterns with a spacing."""
SCATTERED: Mapping[str, Callable[[int, int, np.random.Generator], Array]] = {
    "random": random,
    "space-filling": space_filling,
}
"""Patterns with a number of points."""


def spaced(name: str, box: Box, points: int) -> Points:
    """The pattern with the spacing for which its number of points is nearest to `points`."""
    pattern = SPACED[name]
    coarse = fine = float(np.linalg.norm(box.high - box.low))
    found = nearest = pattern(box, fine)

    def far(each: Points) -> int:
        return abs(len(each.positions) - points)

    while len(found.positions) < points:
        coarse, fine = fine, fine / 2
        found = pattern(box, fine)
        nearest = min(nearest, found, key=far)
    while far(nearest) and coarse - fine > 1e-3 * fine:
        spacing = (coarse + fine) / 2
        found = pattern(box, spacing)
        nearest = min(nearest, found, key=far)
        coarse, fine = (spacing, fine) if len(found.positions) < points else (coarse, spacing)
    return nearest


def _parallel(d: int, bundles: list[tuple[int, ...]]) -> Iterator[tuple[Array, Array]]:
    """Lines in the unit cube along which the axes of a bundle move together; every second line is backward."""
    for bundle in bundles:
        backward = False
        for corner in itertools.product((0.0, 1.0), repeat=d):
            if corner[bundle[0]] == 0.0:
                start, end = np.array(corner), np.array(corner)
                end[list(bundle)] = 1.0 - end[list(bundle)]
                yield (end, start) if backward else (start, end)
                backward = not backward


def _along_lines(box: Box, lines: Iterator[tuple[Array, Array]], spacing: float) -> Points:
    """Points along lines of the unit cube, scaled to the box, at a distance of `spacing` or a little less."""
    span = box.high - box.low
    positions, numbers = [], []
    for number, (start, end) in enumerate(lines, start=1):
        steps = max(int(np.ceil(np.linalg.norm((end - start) * span) / spacing - 1e-9)), 1)
        _check(float(steps) * 2 ** len(span))
        share = np.linspace(0.0, 1.0, steps + 1)[:, None]
        positions.append(box.low + (start + share * (end - start)) * span)
        numbers.append(np.full(steps + 1, number))
    return _once(np.concatenate(positions), np.concatenate(numbers))


def _once(positions: Array, line: np.ndarray) -> Points:
    """The points without repetitions: corners and crossings are measured only the first time."""
    _, first = np.unique(np.round(positions, 6), axis=0, return_index=True)
    first.sort()
    return Points(positions[first], line[first])


def _check(points: float) -> None:
    if points > MOST_PLANNED_POINTS:
        raise UserError(
            f"a spacing that makes {points:.3g} points, more than the limit of {MOST_PLANNED_POINTS}: choose "
            "a larger spacing"
        )
