"""Where a station stands, by its ranges to known points: linear multilateration, then least squares from more starts.

A range is the distance from the station, plus a dead length that is new after each break of the beam. Its square is
linear in the position of the station and, besides, in the dead lengths and one constant for each of them. Points in one
plane do not show on which side of it the station stands, so that mirrored starts are tried as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array

START_DISTANCES = 2.0
"""Distance of starts around the points from their centre, in units of their largest distance from it."""
LARGEST_MM = 1.0
"""RMS residual above which a first position may be a wrong one: no machine in use errs so much."""
EQUAL_RESIDUAL_FACTOR = 1.1
"""Factor of the RMS residuals up to which two positions explain the ranges equally well."""
MACHINE_ERROR_SHARE = 1e-4
"""Errors of machines as a share of their size, below which a direction of the linear equations is not determined."""
MOST_STATION_STEPS = 50
"""Most steps from a start: a good one takes about ten."""
DIFFERENT_STATION_MM = 10.0
"""Distance from which two positions of a station are different ones."""


class Located(NamedTuple):
    """A station."""

    position: Array
    """Position `(3,)`, mm."""
    dead: Array
    """Dead lengths `(k,)`, mm."""
    rms: float
    """RMS residual, mm."""


def located(points: Array, ranges: Array, number: np.ndarray, guess: Array | None = None) -> list[Located]:
    """The positions of a station that explain its ranges best, the one nearest to the guess first; mostly one.

    points `(n, 3)` and ranges `(n,)`, mm; number `(n,)` of the dead length of each, from 0; guess: about where it is.
    """
    middle, count = points.mean(axis=0), int(number.max()) + 1
    own, size = points - middle, float(np.linalg.norm(points - middle, axis=1).max())
    across = np.linalg.svd(own, full_matrices=True)[2][2]

    def refined(starts: Iterable[Array]) -> list[Located]:
        found = [_refined(own, ranges, number, count, start) for start in starts]
        return sorted(found, key=lambda each: each.rms)

    start, determined = _linear(own, ranges, number, count)
    found = refined([start] + ([] if guess is None else [guess - middle]))
    if found[0].rms > LARGEST_MM and not determined:
        found = refined(
            [found[0].position, *(START_DISTANCES * size * np.array(c) for c in product((-1, 1), repeat=3))]
        )
    nearest = found[0].position
    found = sorted(found + refined([nearest - 2.0 * (nearest @ across) * across]), key=lambda each: each.rms)
    best: list[Located] = []
    for each in found:
        new = all(np.linalg.norm(each.position - other.position) > DIFFERENT_STATION_MM for other in best)
        if new and each.rms <= EQUAL_RESIDUAL_FACTOR * found[0].rms + np.finfo(float).eps * size:
            best.append(each)
    if guess is not None:
        best.sort(key=lambda each: float(np.linalg.norm(each.position + middle - guess)))
    return [each._replace(position=each.position + middle) for each in best]


def _linear(own: Array, ranges: Array, number: np.ndarray, count: int) -> tuple[Array, bool]:
    """The position `(3,)` from r^2 - |p|^2 = 2 r d - 2 p s + (|s|^2 - d^2), and True where that determines it."""
    dead = (number[:, None] == np.arange(count)).astype(float)
    columns = np.concatenate([-2.0 * own, 2.0 * ranges[:, None] * dead, dead], axis=1)
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    found, _, rank, _ = np.linalg.lstsq(columns / scale, ranges**2 - np.sum(own**2, axis=1), rcond=MACHINE_ERROR_SHARE)
    return np.asarray((found / scale)[:3]), rank == columns.shape[1]


def _refined(own: Array, ranges: Array, number: np.ndarray, count: int, start: Array) -> Located:
    """Least squares from a start; each dead length is the mean of what the distances leave."""
    from scipy.optimize import least_squares

    rows = np.bincount(number, minlength=count)

    def centred(values: Array) -> Array:
        sums = np.zeros((count, values.shape[1]))
        np.add.at(sums, number, values)
        return np.asarray(values - (sums / rows[:, None])[number])

    def off(station: Array) -> Array:
        return centred((ranges - np.linalg.norm(own - station, axis=1))[:, None])[:, 0]

    def slopes(station: Array) -> Array:
        away = own - station
        return centred(away / np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)[:, None])

    position = least_squares(off, start, slopes, method="lm", max_nfev=MOST_STATION_STEPS).x
    dead = np.bincount(number, ranges - np.linalg.norm(own - position, axis=1), count) / rows
    return Located(position, dead, float(np.sqrt(np.mean(off(position) ** 2))))
