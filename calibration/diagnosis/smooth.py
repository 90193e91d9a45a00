"""Smooth functions of some variables: how much more likely they make residuals than noise alone does.

A Gaussian process whose kernel is the product of one squared exponential per variable, each with its own length, so
that it also holds what acts only jointly. Low rank: the rows stand for it through some of them, its centres (the subset
of regressors). The d components share the lengths. They are turned so that their smooth parts are uncorrelated, since
most causes act in one direction; then each has an amplitude of its own, the most likely one of a few, and noise of its
own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from kinematics.transforms import Array

AMPLITUDES = np.concatenate([[0.0], np.geomspace(0.02, 200.0, 9)])
"""Variance of the function, in variances of the noise."""
TURNING = 0.2
"""The amplitude with which the smooth parts are estimated for that."""
RANK = 1e-5
"""Share of the variance below which what a row adds to the kernel is left out, and of the largest one of a mode."""


class Kernels:
    """Kernels of single variables between rows and centres, kept for every length asked for."""

    def __init__(self, variables: Sequence[Array], centres: np.ndarray) -> None:
        self._scaled = [(values - values.min()) / np.ptp(values) for values in variables]
        self._centres = centres
        self._known: dict[tuple[int, float], Array] = {}

    def of(self, variable: int, length: float) -> Array:
        """Kernel `(n, m)` of a variable; length: in parts of its range."""
        key = variable, length
        if key not in self._known:
            values = self._scaled[variable]
            self._known[key] = np.exp(-0.5 * ((values[:, None] - values[self._centres]) / length) ** 2)
        return self._known[key]

    def modes(self, lengths: dict[int, float]) -> tuple[Array, Array]:
        """Orthonormal columns `(n, r)` without mean, and their variances `(r,)`, of a function of these variables."""
        product = np.ones_like(self._scaled[0], shape=(1, 1))
        for variable, length in lengths.items():
            product = product * self.of(variable, length)
        root, order, rank, _ = linalg.lapack.dpstrf(product[self._centres], tol=RANK, lower=1)
        spanning = np.asfortranarray(product[:, order[:rank] - 1])
        features = linalg.blas.dtrsm(1.0, root[:rank, :rank], spanning, side=1, lower=1, trans_a=1)
        features -= features.mean(axis=0)
        variances, ways = np.linalg.eigh(features.T @ features)
        kept = variances > RANK * variances[-1]
        return features @ (ways[:, kept] / np.sqrt(variances[kept])), variances[kept]


def log_evidence(modes: Array, variances: Array, residual: Array) -> Array:
    """Log odds `(k,)` of the function against noise alone, for residuals `(n, k, d)`: the same rows in k orders.

    Their means are 0.
    """
    parts, sizes, _ = _apart(modes, variances, residual)
    return np.asarray(_odds(variances, parts, sizes, len(modes)).max(axis=0).sum(axis=-1))


def smooth_part(modes: Array, variances: Array, residual: Array) -> Array:
    """The function's expectation at the rows `(n, d)`, given residuals `(n, d)`."""
    parts, sizes, ways = _apart(modes, variances, residual[:, None])
    amplitudes = AMPLITUDES[_odds(variances, parts, sizes, len(modes)).argmax(axis=0)][0]
    scaled = variances[:, None] * amplitudes
    return np.asarray(modes @ (scaled / (1.0 + scaled) * parts[0]) @ ways[0].T)


def _apart(modes: Array, variances: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Residuals turned so that their smooth parts are uncorrelated: along modes `(k, r, d)`, sizes `(k, d)`, turns."""
    n, k, d = residual.shape
    parts = np.moveaxis((modes.T @ residual.reshape(n, -1)).reshape(-1, k, d), 0, 1)
    weights = TURNING * variances / (1.0 + TURNING * variances)
    _, ways = np.linalg.eigh(np.swapaxes(parts, 1, 2) @ (weights[:, None] * parts))
    sizes = np.sum(ways * (residual[:, 0].T @ residual[:, 0] @ ways), axis=1)
    return parts @ ways, sizes, ways


def _odds(variances: Array, parts: Array, sizes: Array, n: int) -> Array:
    """Log odds `(amplitudes, k, d)` of each component."""
    scaled = AMPLITUDES[:, None] * variances
    left = 1.0 - np.tensordot(scaled / (1.0 + scaled), parts**2, axes=(1, 1)) / sizes
    return np.asarray(-0.5 * n * np.log(np.maximum(left, 1e-12)) - 0.5 * np.log1p(scaled).sum(axis=1)[:, None, None])
