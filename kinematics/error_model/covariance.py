"""Covariances that stay symmetric and positive through the arithmetic: as products of a root with its transpose."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from kinematics.transforms import Array

COVERAGE_FACTOR = 2.0
"""k of expanded uncertainties U = k u: 95 % of a normal distribution (GUM, 6.3.3). A size above U is significant."""


class Rows(tuple[tuple[float, ...], ...]):
    """Rows of a matrix, as files have them; an array of them is made without a look at each number."""

    _array: Array

    @classmethod
    def of(cls, matrix: Array) -> Rows:
        """The rows of a matrix `(p, p)`."""
        rows = cls(map(tuple, matrix.tolist()))
        rows._array = np.array(matrix, float)
        return rows

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """The matrix, which may be written to."""
        return self._array.astype(dtype or float, copy=copy is not False)


def propagated(matrix: Array, covariance: Array) -> Array:
    """Covariance `(q, q)` of `matrix` `(q, p)` times parameters with this covariance `(p, p)`.

    Exactly symmetric and, to rounding of each standard uncertainty, positive semidefinite, also for small differences
    of large terms.
    """
    half = matrix @ root_of(covariance)
    return np.asarray(half @ half.T)


def root_of(covariance: Array) -> Array:
    """R `(p, p)` with R R' the covariance `(p, p)`, or the positive part of one that rounding has made indefinite."""
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    units = np.where(u > 0, u, 1.0)  # parameters differ in unit and size
    scaled = covariance / np.outer(units, units)
    scaled = (scaled + scaled.T) / 2
    with suppress(np.linalg.LinAlgError):  # it is positive definite, as most are
        return np.asarray(units[:, None] * np.linalg.cholesky(scaled))
    values, vectors = np.linalg.eigh(scaled)
    return np.asarray(units[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
