"""The posterior of all columns that are present, for given sizes and a given noise, and the evidence of these."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import blas, lapack

from kinematics.transforms import Array

ROUNDING = 1e-9
"""Share of a whole below which a part of it is rounding: sums of some ten thousand products in double precision have
errors of 1e-12 of their largest one, and a solution of their equations some hundred times as much."""

FEW_OBSERVATIONS = 0.7
"""Observations for each column below which the covariance of the observations is the quicker matrix to decompose."""


@dataclass(frozen=True)
class Equations:
    """Products of the whitened columns that are present: what their posterior needs of them."""

    residual: Array
    """Whitened observations `(N,)`."""
    gram: Array
    """`(p, p)`"""
    along: Array
    """Products with the observations `(p,)`."""
    columns: Array | None = None
    """The columns themselves, each a row `(p, N)`, where they are more than the observations."""

    @classmethod
    def of(cls, design: Array, residual: Array) -> Equations:
        """The equations of whitened columns `(N, p)` and observations."""
        few = len(design) < design.shape[1]
        columns = np.ascontiguousarray(design.T) if few else None
        return cls(residual, design.T @ design, design.T @ residual, columns)

    def gram_of(self, some: np.ndarray) -> Array:
        """Products `(k, k)` of some columns; those of the same ones are kept for the next sizes."""
        if len(some) == len(self.gram):
            return self.gram
        known, found = self.__dict__.get("of_some", (np.zeros(0, int), self.gram))
        if not np.array_equal(known, some):
            found = self.gram[np.ix_(some, some)]
            self.__dict__["of_some"] = some, found
        return np.asarray(found)

    def beside(self, across: Array, columns: Array) -> Equations:
        """The equations with further whitened columns `(N, c)`, whose products with these are across `(p, c)`."""
        gram = np.block([[self.gram, across], [across.T, columns.T @ columns]])
        along = np.concatenate([self.along, columns.T @ self.residual])
        whole = None if self.columns is None else np.concatenate([self.columns, columns.T])
        return Equations(self.residual, gram, along, whole)


@dataclass(frozen=True)
class Posterior:
    """Mean and covariance of the coefficients, in units of the columns."""

    equations: Equations
    sizes: Array
    """Prior sizes `(p,)` of the columns."""
    factor: float
    """Variance factor of the noise."""
    kept: np.ndarray
    """Numbers `(k,)` of the columns that the data change."""
    mean: Array
    """`(p,)`"""
    determined: Array
    """Share `(p,)` of each coefficient that the data determine: 0 where it stays at its prior."""
    misfit: float
    """Sum of squares of the whitened observations by the prior predictive covariance, factor included."""
    log_determinant: float
    """Log determinant of the prior predictive covariance, as a multiple of the noise."""

    @classmethod
    def of(cls, equations: Equations, sizes: Array, factor: float) -> Posterior:
        """The posterior for prior sizes `(p,)` of the columns, and a variance factor of the noise."""
        kept = changed(equations.gram, sizes, factor)
        bare = cls(equations, sizes, factor, kept, np.zeros(len(sizes)), np.zeros(len(sizes)), 0.0, 0.0)
        few = equations.columns is not None and len(equations.residual) < FEW_OBSERVATIONS * len(kept)
        return bare._of_observations() if few else bare._of_coefficients()

    def _of_coefficients(self) -> Posterior:
        """The posterior by the matrix of the coefficients."""
        squares = float(self.equations.residual @ self.equations.residual)
        if not len(self.kept):
            return replace(self, misfit=squares / self.factor)
        upper = self._upper()
        determinant = _log_determinant(upper, self.factor)
        root = lapack.dtrtri(upper, lower=False, overwrite_c=True)[0].T
        along = root @ (self.sizes * self.equations.along)[self.kept]
        mean, misfit = self.sizes[self.kept] * (along @ root), (squares - float(along @ along)) / self.factor
        root *= np.sqrt(self.factor)
        found = self._with(mean, 1.0 - np.einsum("ij,ij->j", root, root), misfit, determinant)
        found.__dict__["root_of_kept"] = root
        return found

    def _of_observations(self) -> Posterior:
        """The posterior by the covariance of the observations, where these are few."""
        assert self.equations.columns is not None
        sizes = self.sizes[self.kept]
        columns = self.equations.columns[self.kept] * sizes[:, None]
        upper = _root(columns.T @ columns, self.factor)
        white = blas.dtrsm(1.0, upper, columns.T, trans_a=1, overwrite_b=1).T
        residual = blas.dtrsv(upper, self.equations.residual, trans=1)
        determined, misfit = np.einsum("ij,ij->i", white, white), float(residual @ residual)
        return self._with(sizes * (white @ residual), determined, misfit, _log_determinant(upper, self.factor))

    def _with(self, mean: Array, determined: Array, misfit: float, log_determinant: float) -> Posterior:
        """The posterior with what is known of the coefficients `(k,)` that the data change."""
        own = np.zeros((2, len(self.sizes)))
        own[:, self.kept] = mean, determined
        return replace(self, mean=own[0], determined=own[1], misfit=misfit, log_determinant=log_determinant)

    def _upper(self) -> Array:
        """Upper root `(k, k)` of the products of the columns that the data change, and of the noise, in their sizes."""
        sizes = self.sizes[self.kept]
        return _root(self.equations.gram_of(self.kept) * sizes[:, None] * sizes, self.factor)

    @cached_property
    def root_of_kept(self) -> Array:
        """Triangular root R `(k, k)`: the covariance of their coefficients in their prior sizes is R' R."""
        if not len(self.kept):
            return np.zeros((0, 0))
        upper = self._upper()
        return np.asarray(lapack.dtrtri(upper, lower=False, overwrite_c=True)[0].T * np.sqrt(self.factor))

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


def changed(gram: Array, sizes: Array, factor: float) -> np.ndarray:
    """Numbers `(k,)` of the columns that data change, by their products `(p, p)` and prior sizes `(p,)`.

    Together, the others change the prior predictive covariance of the observations by less than the share `ROUNDING`.
    Columns without finite products are among them.
    """
    shares = np.diagonal(gram) * sizes**2 / factor
    order = np.argsort(shares)
    return np.sort(order[~(np.cumsum(shares[order]) < ROUNDING)])


def _root(matrix: Array, factor: float) -> Array:
    """Upper root of a matrix, which is lost, and a multiple of the unit matrix.

    Where the noise of exact data is less than the rounding of their products, that is added.
    """
    rounding = float(np.finfo(float).eps * len(matrix) * np.diagonal(matrix).max())
    matrix.flat[:: len(matrix) + 1] += factor
    upper, failed = lapack.dpotrf(matrix.T, lower=False)
    if failed:
        matrix.flat[:: len(matrix) + 1] += rounding
        upper, failed = lapack.dpotrf(matrix.T, lower=False, overwrite_a=True)
    if failed:
        raise np.linalg.LinAlgError("the columns have no finite products")
    return np.asarray(upper)


def _log_determinant(upper: Array, factor: float) -> float:
    """Log determinant of a matrix by its root, as a multiple of a factor of the unit matrix."""
    return 2.0 * float(np.log(np.diag(upper)).sum()) - len(upper) * float(np.log(factor))
