"""Evidence of smooth functions of some variables in residuals, against noise alone.

A Gaussian process whose kernel is the product of one squared exponential per variable, each with its own length. It
therefore covers joint effects of the variables too. Low rank: some of the rows, the centres, represent the process
(the subset of regressors). The d components share the lengths. They are rotated so that their smooth parts are
uncorrelated, since most causes act in one direction. Each then has its own amplitude, the most likely one of a few,
and its own noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from scipy import linalg

from kinematics.transforms import Array, read_only

AMPLITUDES = read_only(np.concatenate([[0.0], np.geomspace(0.02, 200.0, 9)]))
"""Variances of the function that are tried, in units of the noise variance."""
TURNING = 0.2
"""Variance of the function, in units of the noise variance, for the rotation of the components."""
RANK = 1e-5
"""Least variance that a row adds to the kernel, and least variance of a mode as a share of the largest."""


class Modes(NamedTuple):
    """Uncorrelated modes of a smooth function, orthonormal over the rows and without mean."""

    spanning: Array
    """Kernels `(m, n)` of some centres; a mode is a sum of these less its mean."""
    vectors: Array
    """Shares `(m, r)` of the kernels in the modes."""
    variances: Array
    """Variances `(r,)` of the modes."""

    def along(self, values: Array) -> Array:
        """Parts `(r, k)` along the modes of values `(n, k)` with zero mean."""
        return np.asarray(self.vectors.T @ (self.spanning @ values))

    def sums(self, parts: Array) -> Array:
        """Sums `(n, k)` of the modes with coefficients `(r, k)`."""
        shares = self.vectors @ parts
        return np.asarray(self.spanning.T @ shares - self.spanning.mean(axis=1) @ shares)


class Kernels:
    """Kernels of single variables between rows and centres, stored by length."""

    def __init__(self, variables: Sequence[Array], centres: np.ndarray) -> None:
        self._scaled = [(values - values.min()) / np.ptp(values) for values in variables]
        self._centres = centres
        self._known: dict[tuple[int, float], Array] = {}

    def of(self, variable: int, length: float) -> Array:
        """Kernel `(m, n)` of a variable; length: as a fraction of its range."""
        key = variable, length
        if key not in self._known:
            values = self._scaled[variable]
            self._known[key] = np.exp(-0.5 * ((values[self._centres, None] - values) / length) ** 2)
        return self._known[key]

    def modes(self, lengths: Mapping[int, float]) -> Modes:
        """Modes of a function of these variables; its kernel is the product of theirs."""
        product = reduce(np.multiply, (self.of(variable, length) for variable, length in lengths.items()))
        root, order, rank, _ = linalg.lapack.dpstrf(product[:, self._centres], tol=RANK, lower=1)
        spanning = product[order[:rank] - 1]
        means, root = spanning.mean(axis=1), np.asfortranarray(root[:rank, :rank])
        covariance = spanning @ spanning.T - len(product[0]) * np.outer(means, means)
        # only the lower triangle, which eigh reads
        whole, _ = linalg.lapack.dsygst(covariance.T, root, lower=1)
        variances, vectors = np.linalg.eigh(whole)
        kept = variances > RANK * variances[-1]
        shares = linalg.blas.dtrsm(1.0, root, vectors[:, kept], lower=1, trans_a=1)
        return Modes(spanning, shares / np.sqrt(variances[kept]), variances[kept])


def log_evidence(modes: Modes, residual: Array) -> Array:
    """Log odds `(k,)` of the function against noise alone, for residuals `(n, k, d)`: the same rows in k orders.

    The residuals have zero mean.
    """
    parts, sizes, _ = _apart(modes, residual)
    return np.asarray(_odds(modes.variances, parts, sizes, len(residual)).max(axis=0).sum(axis=-1))


def smooth_part(modes: Modes, residual: Array) -> Array:
    """Expected values `(n, d)` of the function at the rows, given residuals `(n, d)` with zero mean."""
    parts, sizes, vectors = _apart(modes, residual[:, None])
    amplitudes = AMPLITUDES[_odds(modes.variances, parts, sizes, len(residual)).argmax(axis=0)][0]
    scaled = modes.variances[:, None] * amplitudes
    return modes.sums(scaled / (1.0 + scaled) * parts[0] @ vectors[0].T)


def _apart(modes: Modes, residual: Array) -> tuple[Array, Array, Array]:
    """Residuals rotated so that their smooth parts are uncorrelated.

    Parts along the modes `(k, r, d)`, sums of squares `(k, d)`, and rotations `(k, d, d)`.
    """
    n, k, d = residual.shape
    parts = np.moveaxis(modes.along(residual.reshape(n, -1)).reshape(-1, k, d), 0, 1)
    weights = TURNING * modes.variances / (1.0 + TURNING * modes.variances)
    _, vectors = np.linalg.eigh(np.swapaxes(parts, 1, 2) @ (weights[:, None] * parts))
    sizes = np.sum(vectors * (residual[:, 0].T @ residual[:, 0] @ vectors), axis=1)
    return parts @ vectors, sizes, vectors


def _odds(variances: Array, parts: Array, sizes: Array, n: int) -> Array:
    """Log odds `(amplitudes, k, d)` of each component for each amplitude."""
    scaled = AMPLITUDES[:, None] * variances
    unfitted = 1.0 - np.tensordot(scaled / (1.0 + scaled), parts**2, axes=(1, 1)) / sizes
    return np.asarray(
        -0.5 * n * np.log(np.maximum(unfitted, 1e-12)) - 0.5 * np.log1p(scaled).sum(axis=1)[:, None, None]
    )
