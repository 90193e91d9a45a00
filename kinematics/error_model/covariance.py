"""Covariances that stay symmetric and positive through the arithmetic: as products of a root with its transpose."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from kinematics.transforms import Array

COVERAGE_FACTOR = 2.0
"""k of expanded uncertainties U = k u: 95 % of a normal distribution (GUM, 6.3.3). A size above U is significant."""


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
