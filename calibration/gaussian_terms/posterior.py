"""The posterior of all columns that are present, for given sizes and a given noise, and the evidence of these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from kinematics.transforms import Array

ROUNDING = 1e-9
"""Share of the variance of the observations below which all that some columns may add to it is rounding."""


@dataclass(frozen=True)
class Equations:
    """Products of the whitened columns that are present: what their posterior needs of them."""

    residual: Array
    """Whitened observations `(N,)`."""
    gram: Array
    """`(p, p)`"""
    along: Array
    """Products with the observations `(p,)`."""

    @classmethod
    def of(cls, design: Array, residual: Array) -> Equations:
        """The equations of whitened columns `(N, p)` and observations."""
        return cls(residual, design.T @ design, design.T @ residual)

    def beside(self, across: Array, columns: Array) -> Equations:
        """The equations with further whitened columns `(N, c)`, whose products with these are across `(p, c)`."""
        gram = np.block([[self.gram, across], [across.T, columns.T @ columns]])
        return Equations(self.residual, gram, np.concatenate([self.along, columns.T @ self.residual]))


@dataclass(frozen=True)
class Posterior:
    """Mean and covariance of the coefficients, in units of the columns."""

    mean: Array
    """`(p,)`"""
    sizes: Array
    """Prior sizes `(p,)` of the columns."""
    kept: np.ndarray
    """Numbers `(k,)` of the columns that the data change."""
    root_of_kept: Array
    """Triangular root R `(k, k)`: the covariance of their coefficients in their prior sizes is R' R."""
    misfit: float
    """Sum of squares of the whitened observations by the prior predictive covariance, factor included."""
    log_determinant: float
    """Log determinant of the prior predictive covariance, as a multiple of the noise."""

    @classmethod
    def of(cls, equations: Equations, sizes: Array, factor: float) -> Posterior:
        """The posterior for prior sizes `(p,)` of the columns, and a variance factor of the noise."""
        kept = changed(equations.gram, sizes, factor)
        squares = float(equations.residual @ equations.residual)
        if not len(kept):
            return cls(np.zeros(len(sizes)), sizes, kept, np.zeros((0, 0)), squares / factor, 0.0)
        upper = scaled_root(equations.gram, sizes, factor, kept)
        determinant = 2.0 * float(np.log(np.diag(upper)).sum()) - len(kept) * float(np.log(factor))
        root = lapack.dtrtri(upper, lower=False, overwrite_c=True)[0].T
        along = root @ (sizes * equations.along)[kept]
        mean = np.zeros(len(sizes))
        mean[kept] = sizes[kept] * (along @ root)
        misfit = (squares - float(along @ along)) / factor
        root *= np.sqrt(factor)
        return cls(mean, sizes, kept, root, misfit, determinant)

    @cached_property
    def root(self) -> Array:
        """Triangular root R `(p, p)`: the covariance of all coefficients in their prior sizes is R' R."""
        if len(self.kept) == len(self.sizes):
            return self.root_of_kept
        root = np.eye(len(self.sizes))
        root[np.ix_(self.kept, self.kept)] = self.root_of_kept
        return root

    @cached_property
    def covariance(self) -> Array:
        """`(p, p)`"""
        found = np.diag(self.sizes**2)
        own, sizes = self.root_of_kept, self.sizes[self.kept]
        found[np.ix_(self.kept, self.kept)] = own.T @ own * sizes[:, None] * sizes
        return found

    @cached_property
    def determined(self) -> Array:
        """Share `(p,)` of each coefficient that the data determine: 0 where it stays at its prior."""
        found = np.zeros(len(self.sizes))
        found[self.kept] = 1.0 - np.einsum("ij,ij->j", self.root_of_kept, self.root_of_kept)
        return found


def changed(gram: Array, sizes: Array, factor: float) -> np.ndarray:
    """Numbers `(k,)` of the columns that data change, by their products `(p, p)` and prior sizes `(p,)`.

    Together, the others change the prior predictive covariance of the observations by less than the share `ROUNDING`.
    """
    shares = np.diagonal(gram) * sizes**2 / factor
    order = np.argsort(shares)
    return np.sort(order[np.cumsum(shares[order]) >= ROUNDING])


def scaled_root(gram: Array, sizes: Array, factor: float, kept: np.ndarray) -> Array:
    """Upper root `(k, k)` of products `(p, p)` of some columns in their prior sizes, and of the noise."""
    own = sizes[kept]
    matrix = (gram if len(kept) == len(gram) else gram[np.ix_(kept, kept)]) * own[:, None] * own
    matrix.flat[:: len(matrix) + 1] += factor
    upper, failed = lapack.dpotrf(matrix.T, lower=False, overwrite_a=True)
    if failed:
        raise np.linalg.LinAlgError("the columns have no finite products")
    return np.asarray(upper)
