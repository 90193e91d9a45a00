"""Patterns of points in a box of any dimension: lines to walk along, grids, scattered points. Units are the box's."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError

LARGEST = 5_000_000
"""Points; more are a slip of the pen."""


class Box(NamedTuple):
    """From low `(d,)` to high `(d,)`; patterns of planes lie at `share` of the way from the one to the other."""

    low: Array
    high: Array
    share: float = 1.0


class Points(NamedTuple):
    """Points `(n, d)` in the order of the way, and the number of the line that each is on `(n,)`, from 1."""

    positions: Array
    line: np.ndarray


def hexahedron(box: Box, spacing: float) -> Points:
    """The edges of the box, all lines of one direction one after the other, in turn forward and backward."""
    d = len(box.low)
    return _walk(box, _parallel(d, [(axis,) for axis in range(d)]), spacing)


def space_diagonals(box: Box, spacing: float) -> Points:
    """The diagonals through the middle (four of three axes; ISO 230-6)."""
    d = len(box.low)
    return _walk(box, _parallel(d, [tuple(range(d))]), spacing)


def face_diagonals(box: Box, spacing: float) -> Points:
    """Both diagonals of each face (twelve of three axes; ISO 230-6)."""
    d = len(box.low)
    return _walk(box, _parallel(d, list(itertools.combinations(range(d), 2))), spacing)


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
    """A plane for each two axes, all others at the box's share: lines along the second axis, a grid all over."""
    positions, lines = [], []
    count = 0
    for pair in itertools.combinations(range(len(box.low)), 2):
        chosen = list(pair)
        flat = grid(Box(box.low[chosen], box.high[chosen]), spacing)
        place = np.tile(box.low + box.share * (box.high - box.low), (len(flat.positions), 1))
        place[:, chosen] = flat.positions
        positions.append(place)
        lines.append(flat.line + count)
        count = int(lines[-1][-1])
    return _once(np.concatenate(positions), np.concatenate(lines))


def grid(box: Box, spacing: float) -> Points:
    """A grid all over the box, the last axis to and fro in each line."""
    counts = np.ceil((box.high - box.low) / spacing - 1e-9).astype(int) + 1
    _check(float(np.prod(counts.astype(float))))
    index = np.zeros((1, 0), int)
    for count in counts[::-1]:
        # one more axis in front: the way so far, there for its even and back for its odd positions
        ways = [index[::-1] if k % 2 else index for k in range(count)]
        index = np.concatenate([np.insert(way, 0, k, axis=1) for k, way in enumerate(ways)])
    share = index / np.maximum(counts - 1, 1)
    return Points(box.low + share * (box.high - box.low), np.arange(len(index)) // counts[-1] + 1)


def random(d: int, n: int, rng: np.random.Generator) -> Array:
    """Independent points `(n, d)` in 0..1."""
    return rng.uniform(size=(n, d))


def space_filling(d: int, n: int, rng: np.random.Generator) -> Array:
    """Points `(n, d)` in 0..1 of a scrambled Halton sequence: even also in its first few."""
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
    """The pattern with the spacing that brings it nearest to so many points."""
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
    """Lines in the unit cube on which the axes of a bundle run together, from every corner, every second backward."""
    for bundle in bundles:
        backward = False
        for corner in itertools.product((0.0, 1.0), repeat=d):
            if corner[bundle[0]] == 0.0:
                start, end = np.array(corner), np.array(corner)
                end[list(bundle)] = 1.0 - end[list(bundle)]
                yield (end, start) if backward else (start, end)
                backward = not backward


def _walk(box: Box, lines: Iterator[tuple[Array, Array]], spacing: float) -> Points:
    """Points along lines of the unit cube laid into the box, `spacing` apart or a little closer."""
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
    """Each point where the way comes to it first: corners and crossings are not measured again."""
    _, first = np.unique(np.round(positions, 6), axis=0, return_index=True)
    first.sort()
    return Points(positions[first], line[first])


def _check(points: float) -> None:
    if points > LARGEST:
        raise UserError(f"a spacing that makes {points:.3g} points, more than {LARGEST}")
