"""The posterior of all columns that are present, for given sizes and a given noise, and the evidence of these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from kinematics.transforms import Array


@dataclass(frozen=True)
class Equations:
    """Whitened columns that are present, and their products."""

    parts: tuple[Array, ...]
    """Columns `(N, ...)`, p together."""
    residual: Array
    """`(N,)`"""
    gram: Array
    """`(p, p)`"""
    along: Array
    """`(p,)`"""

    @classmethod
    def of(cls, design: Array, residual: Array) -> Equations:
        """The equations of whitened columns `(N, p)` and observations."""
        return cls((design,), residual, design.T @ design, design.T @ residual)

    @cached_property
    def design(self) -> Array:
        """All columns `(N, p)`."""
        return self.parts[0] if len(self.parts) == 1 else np.concatenate(self.parts, axis=1)

    def beside(self, columns: Array) -> Equations:
        """The equations with further whitened columns `(N, c)` behind these; products of these are not made again."""
        across = np.concatenate([part.T @ columns for part in self.parts])
        gram = np.block([[self.gram, across], [across.T, columns.T @ columns]])
        along = np.concatenate([self.along, columns.T @ self.residual])
        return Equations((*self.parts, columns), self.residual, gram, along)

    def times(self, coefficients: Array) -> Array:
        """All columns times coefficients `(p,)` or `(p, k)`: `(N,)` or `(N, k)`; in the precision of these."""
        ends = np.cumsum([part.shape[1] for part in self.parts])[:-1]
        own = zip(self.parts, np.split(coefficients, ends), strict=True)
        return np.asarray(sum(part.astype(each.dtype, copy=False) @ each for part, each in own))


@dataclass(frozen=True)
class Posterior:
    """Mean and covariance of the coefficients, in units of the columns."""

    mean: Array
    """`(p,)`"""
    covariance: Array
    """`(p, p)`"""
    misfit: float
    """Sum of squares of the whitened observations by the prior predictive covariance, factor included."""
    log_determinant: float
    """Log determinant of the prior predictive covariance, as a multiple of the noise."""

    @classmethod
    def of(cls, equations: Equations, sizes: Array, factor: float) -> Posterior:
        """The posterior for prior sizes `(p,)` of the columns, and a variance factor of the noise."""
        if not len(sizes):
            squares = float(equations.residual @ equations.residual)
            return cls(np.zeros(0), np.zeros((0, 0)), squares / factor, 0.0)
        matrix = equations.gram * sizes[:, None] * sizes
        matrix[np.diag_indices_from(matrix)] += factor
        low, failed = lapack.dpotrf(matrix, lower=True, overwrite_a=True)
        if failed:
            raise np.linalg.LinAlgError("the columns have no finite products")
        inverse, _ = lapack.dpotri(low, lower=True)
        covariance = np.tril(inverse) + np.tril(inverse, -1).T
        covariance *= factor * sizes[:, None] * sizes
        mean = covariance @ equations.along / factor
        misfit = float(equations.residual @ equations.residual - equations.along @ mean) / factor
        determinant = 2.0 * float(np.log(np.diag(low)).sum()) - len(sizes) * float(np.log(factor))
        return cls(mean, covariance, misfit, determinant)

    def determined(self, sizes: Array) -> Array:
        """Share `(p,)` of each coefficient that the data determine: 0 where it stays at its prior."""
        return np.asarray(1.0 - np.diag(self.covariance) / sizes**2)
