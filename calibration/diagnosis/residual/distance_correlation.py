"""How residuals depend on each variable alone, by distance correlation, which vanishes only for independent ones.

Szekely, Rizzo and Bakirov 2007; without bias: Szekely and Rizzo 2013. Chances are those among residuals permuted in
blocks; of several variables they are adjusted by Benjamini and Hochberg. Variables that act only jointly may show
nothing alone: the sets of `dependence` find these.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.residual.permuted_blocks import blocks_in_time, permuted
from kinematics.transforms import Array

ROWS = 300
"""That decide, evenly taken."""
PERMUTATIONS = 499


class Dependence(NamedTuple):
    """How the residuals depend on one variable."""

    variable: str
    correlation: float
    """Squared distance correlation without bias; about 0 where independent, negative too."""
    p_value: float
    adjusted: float
    """p-value by Benjamini and Hochberg: of all variables below a level q, a share q at most is there by chance."""


def distance_correlation(x: Array, y: Array) -> float:
    """Squared distance correlation without bias of `x` and `y`, each `(n,)` or `(n, k)`; of `ROWS` rows if more.

    0 where one of them does not vary.
    """
    rows = _evenly(len(x), ROWS)
    return float(np.vdot(_distances(x[rows]), _distances(y[rows])))


def dependences(
    white: Array, variables: Mapping[str, Array], rng: np.random.Generator, blocks: np.ndarray | None = None
) -> list[Dependence]:
    """How residuals `(n, d)` depend on each variable `(n,)`, the clearest first.

    blocks: labels `(n,)` of rows to be permuted as one; by `blocks_in_time` when None.
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
    """By Benjamini and Hochberg; scipy.stats, which has it, takes a second to import."""
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
