"""Permutation of rows in blocks: it keeps the autocorrelation of noise and destroys all other dependence.

Rows are in the order of acquisition.
"""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array

MEMORIES = 4
"""Length of a block, as a multiple of the lag over which residuals are correlated."""


def blocks_in_time(white: Array) -> np.ndarray:
    """Labels `(n,)` of blocks of successive rows, `MEMORIES` times the lag over which residuals `(n, d)` correlate.

    Single rows where they do not correlate; at least twelve blocks.
    """
    n = len(white)
    residual = white - white.mean(axis=0)
    limit = 2.0 * np.sum(residual**2) / np.sqrt(residual.size)
    longest = max(n // 12, 1)
    lag = 1
    while MEMORIES * lag < longest and np.sum(residual[lag:] * residual[:-lag]) > limit:
        lag += 1
    return np.arange(n) // (1 if lag == 1 else min(MEMORIES * lag, longest))


def permuted(labels: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Orders `(count, n)` of rows: a cyclic shift of all rows by a random number, then the blocks permuted."""
    names, number = np.unique(labels, return_inverse=True)
    n = len(labels)
    ranks = rng.permuted(np.broadcast_to(np.arange(len(names)), (count, len(names))), axis=1)[:, number]
    orders = np.argsort(ranks, axis=1, kind="stable")
    return np.asarray((orders + rng.integers(n, size=(count, 1))) % n)
