"""Dependence of residuals on each variable alone, by distance correlation, which is zero only for independence.

Szekely, Rizzo and Bakirov 2007; without bias: Szekely and Rizzo 2013. p-values are by permutation of the residuals in
blocks; those of several variables are adjusted by Benjamini and Hochberg. Variables that act only jointly may show no
dependence alone: `dependence` finds such sets.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.residual.permuted_blocks import blocks_in_time, permuted
from kinematics.transforms import Array

ROWS = 300
"""Most rows that are used, evenly spread."""
PERMUTATIONS = 499


class Dependence(NamedTuple):
    """Dependence of the residuals on one variable."""

    variable: str
    correlation: float
    """Squared distance correlation without bias; about 0, also negative, where independent."""
    p_value: float
    adjusted: float
    """p-value by Benjamini and Hochberg: of the variables below a level q, a share of at most q is there by chance."""


def distance_correlation(x: Array, y: Array) -> float:
    """Squared distance correlation without bias of `x` and `y`, each `(n,)` or `(n, k)`; on at most `ROWS` rows.

    0 where one of them does not vary.
    """
    rows = _evenly(len(x), ROWS)
    return float(np.vdot(_distances(x[rows]), _distances(y[rows])))


def dependences(
    white: Array, variables: Mapping[str, Array], rng: np.random.Generator, blocks: np.ndarray | None = None
) -> list[Dependence]:
    """Dependence of residuals `(n, d)` on each variable `(n,)`, the clearest first.

    blocks: labels `(n,)` of rows that are permuted together; by `blocks_in_time` when None.
    """
    if not variables:
        return []
    rows = _evenly(len(white), ROWS)
    labels = (blocks_in_time(white) if blocks is None else blocks)[rows]
    ours, theirs = _distances(white[rows]), [_distances(values[rows]) for values in variables.values()]
    flat = np.stack([one.ravel() for one in theirs])
    found = flat @ ours.ravel()
    reached = np.ones(len(found))
    for order in permuted(labels, PERMUTATIONS, rng):
        reached += flat @ ours[np.ix_(order, order)].ravel() >= found
    p_values = reached / (PERMUTATIONS + 1)
    rated = map(Dependence, variables, found.tolist(), p_values.tolist(), _adjusted(p_values).tolist())
    return sorted(rated, key=lambda one: (one.p_value, -one.correlation))


def _adjusted(p_values: Array) -> Array:
    """p-values adjusted by Benjamini and Hochberg; the import of scipy.stats, which has this, takes a second."""
    order = np.argsort(p_values)[::-1]
    shares = p_values[order] * len(order) / np.arange(len(order), 0, -1)
    return np.asarray(np.minimum.accumulate(shares)[np.argsort(order)])


def _evenly(n: int, most: int) -> np.ndarray:
    return np.linspace(0, n - 1, min(n, most)).astype(int)


def _distances(values: Array) -> Array:
    """U-centred distances `(n, n)`, of Euclidean norm 1; zeros where nothing varies."""
    n = len(values)
    table = (values - values.mean(axis=0)).reshape(n, -1)
    if table.shape[1] == 1:
        distances = np.abs(table - table.T)
    else:
        squares = np.sum(table**2, axis=1)
        distances = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * table @ table.T, 0.0))
    np.fill_diagonal(distances, 0.0)
    rows = distances.sum(axis=1) / (n - 2)
    centred = distances - rows[:, None] - rows + distances.sum() / ((n - 1) * (n - 2))
    np.fill_diagonal(centred, 0.0)
    size = np.linalg.norm(centred)
    return np.asarray(centred / size) if size > 0.0 else centred
