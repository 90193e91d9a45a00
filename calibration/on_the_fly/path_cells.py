"""Reduction: the readings of one pass along the path, as one mean per cell of the path.

A cell is a segment of a straight move, a few mm long, so short that error motions are linear in it. The mean of the
deviations across the path then holds at the middle of the cell; with the number of readings it is all the information
for a fit. Readings far from the median of their cell are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.on_the_fly.nominal_path import TargetPath
from kinematics.transforms import Array

FAR_FROM_MEDIAN = 7.0
"""Robust standard deviations from the median of its cell beyond which a reading is left out."""
READINGS_OF_A_MEDIAN = 5
"""Least number of readings of a cell for a meaningful median."""
RANDOM_VARIANCE_RATIO = 1.1
"""Ratio of variances below which an excess is random."""
READINGS_OF_QUARTER = 3
"""Least number of readings in each quarter of a cell from which the correlation of noise in time is estimated."""


@dataclass(frozen=True)
class Cells:
    """Means over cells `c`, in the order of the path."""

    distances: Array
    """Distance along the path `(c,)`, mm."""
    deviation: Array
    """Deviation from the position on the path `(c, 3)`, mm."""
    count: Array
    """Number of readings `(c,)`."""
    first: np.ndarray
    """Index `(c,)` of the first reading."""
    columns: Array
    """Means `(c, k)` of the other columns of the readings."""
    astray: int
    """Number of readings left out because they lie far from the median of their cell."""
    correlation: float
    """Ratio, 1 or more, of the variance of means over a quarter of a cell to that of independent readings."""


def cell_numbers(path: TargetPath, distances: Array, cell_mm: float) -> np.ndarray:
    """Number `(n,)` of the cell at each distance along the path, mm; corners start cells, nearly `cell_mm` long."""
    lengths = np.diff(path.corners)
    parts = np.maximum(np.round(lengths / cell_mm), 1).astype(int)
    first = np.cumsum(parts) - parts
    segment = path.segment_at(distances)
    share = (distances - path.corners[segment]) / np.maximum(lengths[segment], 1e-12)
    inside = np.minimum((share * parts[segment]).astype(int), parts[segment] - 1)
    return np.asarray(first[segment] + inside)


def reduced(cell: np.ndarray, distances: Array, deviation: Array, columns: Array) -> Cells:
    """Means over the cells; `cell` `(n,)` numbers the cell of each reading, in the order of time."""
    order = np.argsort(cell, kind="stable")
    cell, distances, deviation, columns = cell[order], distances[order], deviation[order], columns[order]
    near = _near(cell, deviation)
    kept = np.flatnonzero(near)
    cell, distances, deviation, columns = cell[kept], distances[kept], deviation[kept], columns[kept]
    start = np.flatnonzero(np.append(True, cell[1:] != cell[:-1])) if len(cell) else np.zeros(0, int)
    count = np.diff(np.append(start, len(cell))).astype(float)

    def mean(values: Array) -> Array:
        return np.asarray(np.add.reduceat(values, start, axis=0) / count.reshape(-1, *[1] * (values.ndim - 1)))

    if not len(start):
        return Cells(distances, deviation, count, start, columns, len(order), 1.0)
    return Cells(
        mean(distances), mean(deviation), count, order[kept[start]], mean(columns), len(order) - len(kept),
        correlation(deviation, start, count),
    )  # fmt: skip


def correlation(deviation: Array, start: np.ndarray, count: Array) -> float:
    """Ratio, 1 or more, of the variance of means of readings to that of independent readings.

    `deviation` `(n, 3)`, mm, sorted by cells: a cell begins at row `start` `(c,)` and has `count` `(c,)` rows in the
    order of time. With the means m1 ... m4 over the quarters of a cell, m1 - m2 - m3 + m4 is free of a linear trend
    along it. Its square is compared with the value that the scatter inside the quarters gives for independent readings.
    """
    mine = np.repeat(np.arange(len(start)), count.astype(int))
    rank = np.arange(len(deviation)) - start[mine]
    quarter = mine * 4 + np.minimum(rank * 4 // np.maximum(count[mine], 1), 3).astype(int)
    size = np.bincount(quarter, minlength=4 * len(start)).astype(float)
    full = size.reshape(-1, 4).min(axis=1) >= READINGS_OF_QUARTER
    if np.count_nonzero(full) < 30:
        return 1.0
    sums = np.stack([np.bincount(quarter, column, 4 * len(start)) for column in deviation.T], axis=1)
    means = np.asarray(sums / np.maximum(size, 1.0)[:, None])
    inner = np.sum((deviation - means[quarter]) ** 2, axis=0) / max(float(np.sum(np.maximum(size - 1.0, 0.0))), 1.0)
    curved = np.einsum("cqk,q->ck", means.reshape(-1, 4, 3), [1.0, -1.0, -1.0, 1.0])[full]
    expected = np.sum(1.0 / size.reshape(-1, 4)[full], axis=1).sum() * float(inner.sum())
    ratio = float(np.sum(curved**2)) / expected if expected > 0.0 else 1.0
    return ratio if ratio > RANDOM_VARIANCE_RATIO else 1.0


def _near(cell: np.ndarray, deviation: Array) -> np.ndarray:
    """Mask `(n,)` of the readings, sorted by cells, that lie near the median of their cell."""
    start = np.flatnonzero(np.append(True, cell[1:] != cell[:-1])) if len(cell) else np.zeros(0, int)
    count = np.diff(np.append(start, len(cell)))
    if not len(count) or count.max() < READINGS_OF_A_MEDIAN:
        return np.ones(len(cell), bool)
    mine = np.repeat(np.arange(len(start)), count)
    away = np.empty_like(deviation)
    for k in range(deviation.shape[1]):
        column = deviation[np.lexsort((deviation[:, k], cell)), k]
        away[:, k] = deviation[:, k] - (column[start + (count - 1) // 2] + column[start + count // 2])[mine] / 2.0
    distance = np.linalg.norm(away, axis=1)
    several = count[mine] >= READINGS_OF_A_MEDIAN
    typical = float(np.median(distance[several]))
    return np.asarray(~several | (distance <= FAR_FROM_MEDIAN * max(typical, 1e-9)))
