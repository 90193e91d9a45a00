"""The posterior of all columns that are present, for given sizes and a given noise, and the evidence of these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from kinematics.transforms import Array


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
    root: Array
    """Triangular root R `(p, p)`: the covariance of the coefficients in their prior sizes is R' R."""
    misfit: float
    """Sum of squares of the whitened observations by the prior predictive covariance, factor included."""
    log_determinant: float
    """Log determinant of the prior predictive covariance, as a multiple of the noise."""

    @classmethod
    def of(cls, equations: Equations, sizes: Array, factor: float) -> Posterior:
        """The posterior for prior sizes `(p,)` of the columns, and a variance factor of the noise."""
        if not len(sizes):
            squares = float(equations.residual @ equations.residual)
            return cls(np.zeros(0), sizes, np.zeros((0, 0)), squares / factor, 0.0)
        matrix = equations.gram * sizes[:, None] * sizes
        matrix.flat[:: len(matrix) + 1] += factor
        upper, failed = lapack.dpotrf(matrix.T, lower=False, overwrite_a=True)
        if failed:
            raise np.linalg.LinAlgError("the columns have no finite products")
        determinant = 2.0 * float(np.log(np.diag(upper)).sum()) - len(sizes) * float(np.log(factor))
        root = lapack.dtrtri(upper, lower=False, overwrite_c=True)[0].T
        along = root @ (sizes * equations.along)
        mean = sizes * (along @ root)
        misfit = float(equations.residual @ equations.residual - along @ along) / factor
        root *= np.sqrt(factor)
        return cls(mean, sizes, root, misfit, determinant)

    @cached_property
    def covariance(self) -> Array:
        """`(p, p)`"""
        return np.asarray(self.root.T @ self.root * self.sizes[:, None] * self.sizes)

    @cached_property
    def determined(self) -> Array:
        """Share `(p,)` of each coefficient that the data determine: 0 where it stays at its prior."""
        return np.asarray(1.0 - np.einsum("ij,ij->j", self.root, self.root))
