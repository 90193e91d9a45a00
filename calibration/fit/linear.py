"""Linear least squares with priors: the algebra of fit, basis selection, diagnosis, predicted information and study.

J is a whitened design `(N, p)` with parameters in units of their priors, P the diagonal information of the priors, and
H = J'J + P the information of data and priors together. Parameters without a prior, those of the registration, are
eliminated by the pseudo-inverse of their part of J'J, or by an orthonormal basis of their columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from kinematics.transforms import Array, read_only

Part = tuple[str, str]
"""Axis, and the basis of its error motions; the first is empty for parts of the model that belong to no axis."""


class Posterior:
    """Cholesky factor L of H = J'J + P."""

    def __init__(self, information: Array, prior: Array | float) -> None:
        """information: J'J `(p, p)`; prior: P `(p,)`. LinAlgError where H is not positive definite."""
        whole = np.array(information, order="F")
        self.prior = np.broadcast_to(prior, len(whole))
        np.fill_diagonal(whole, np.diag(whole) + self.prior)
        self.factor = linalg.cho_factor(whole, lower=True, overwrite_a=True)
        """The pair that `scipy.linalg.cho_solve` expects."""

    def solve(self, right: Array) -> Array:
        """H^-1 right."""
        return np.asarray(linalg.cho_solve(self.factor, right, check_finite=False))

    def whitened(self, cross: Array) -> Array:
        """L^-1 cross."""
        return np.asarray(linalg.solve_triangular(self.factor[0], cross, lower=True, check_finite=False))

    def complement(self, own: Array, cross: Array) -> Array:
        """Schur complement G'G - G'J H^-1 J'G `(k, k)`: the information on columns G with the parameters of J unknown.

        own: G'G `(k, k)`; cross: J'G `(p, k)`.
        """
        through = self.whitened(cross)
        return np.asarray(own - through.T @ through)

    @cached_property
    def root(self) -> Array:
        """R = L'^-1 `(p, p)`, upper triangular: R R' is the covariance H^-1."""
        return np.asarray(np.tril(linalg.lapack.dtrtri(self.factor[0], lower=1)[0]).T)

    def spanned(self, design: Array, *, in_place: bool = False) -> Array:
        """J R `(N, p)` of a design J `(N, p)`, R as `root`: columns along which the parameters absorb signals.

        in_place: the design may be overwritten.
        """
        return np.asarray(linalg.blas.dtrmm(1.0, self.root, design.T, trans_a=1, overwrite_b=in_place).T)

    @property
    def effective_parameters(self) -> float:
        """Degrees of freedom that the data determine: each direction counts as far as the data outweigh the prior."""
        return len(self.prior) - float(np.sum(np.sum(self.root**2, axis=1) * self.prior))

    @property
    def log_determinant(self) -> float:
        """log det H."""
        return float(2.0 * np.sum(np.log(np.diag(self.factor[0]))))


def effective_parameters(information: Array) -> float:
    """Degrees of freedom that data determine, p - tr (J'J + 1)^-1, where all parameters have a prior.

    information: J'J `(p, p)`, parameters in units of their priors. `Posterior` has the same for any P.
    """
    size = len(information)
    if not size:
        return 0.0
    try:
        inverse, _ = linalg.lapack.dtrtri(np.linalg.cholesky(information + np.eye(size)), lower=1)
    except np.linalg.LinAlgError:
        # beside very large information rounding makes small eigenvalues negative
        values = np.maximum(np.linalg.eigvalsh(information), 0.0)
        return float(np.sum(values / (1.0 + values)))
    return size - float(np.sum(inverse**2))


class PseudoInverse(NamedTuple):
    """Pseudo-inverse of an information matrix `(p, p)` without priors."""

    root: Array
    """R `(p, rank)`: R R' is the pseudo-inverse."""
    null: Array
    """Orthonormal directions `(p, p - rank)` on which there is no information."""
    log_determinant: float
    """Log determinant of the matrix on the directions that are determined."""

    @property
    def rank(self) -> int:
        """Number of directions that are determined."""
        return int(self.root.shape[1])

    def explained(self, along: Array) -> float:
        """Reduction of the sum of squares by a fit of parameters with the right-hand side `along` `(p,)`."""
        return float(np.sum((self.root.T @ along) ** 2))


def pseudo_inverse(matrix: Array, share: float, least: float = 0.0) -> PseudoInverse:
    """Pseudo-inverse of a symmetric matrix; eigenvalues up to `share` of the largest, or of `least`, count as zero."""
    values, vectors = np.linalg.eigh(matrix)
    determined = values > share * max(float(values.max(initial=0.0)), least)
    root = vectors[:, determined] / np.sqrt(values[determined])
    return PseudoInverse(root, vectors[:, ~determined], float(np.sum(np.log(values[determined]))))


class ColumnSpace(NamedTuple):
    """Column space of a design A `(N, r)`."""

    basis: Array
    """Orthonormal columns Q `(N, rank)`."""
    back: Array
    """Matrix `(r, rank)`: A times this is Q."""

    def removed(self, columns: Array) -> Array:
        """The part of columns `(N, k)` that is orthogonal to the space."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """Thin singular value decomposition U, s, V' of a matrix.

    By QR iteration: divide and conquer, as in `numpy.linalg.svd`, fails to converge for some of deficient rank.
    LAPACK is called directly: for few columns the way through `scipy.linalg.svd` takes longer than the decomposition.
    """
    if not matrix.size:
        return np.linalg.svd(matrix, full_matrices=False)
    finite, memory = np.asarray_chkfinite(matrix), _memory(*matrix.shape)
    u, values, v, status = lapack.dgesvd(finite, compute_uv=True, full_matrices=False, lwork=memory)
    if status:
        raise linalg.LinAlgError("the singular values of a matrix do not converge")
    return u, values, v


@cache
def _memory(rows: int, columns: int) -> int:
    """Working memory of `dgesvd` for a matrix of this shape, in numbers."""
    best, _ = lapack.dgesvd_lwork(rows, columns, compute_uv=True, full_matrices=False)
    return int(best.real)


def column_space(columns: Array, share: float) -> ColumnSpace:
    """Column space by singular values; those up to `share` of the largest count as zero."""
    u, values, v = singular_values(columns)
    determined = values > share * values.max(initial=0.0)
    return ColumnSpace(u[:, determined], v[determined].T / values[determined])


def of_columns(columns: Callable[[Part], Array]) -> Callable[[Part, Part], Array]:
    """Products Ja'Jb `(k, l)` of the whitened designs `(N, k)` of parts."""
    return lambda a, b: np.asarray(columns(a).T @ columns(b))


@dataclass(frozen=True)
class NormalBlocks:
    """Blocks Ja'Jb of normal matrices by the parts of a model; each is computed once, however many models share it."""

    block: Callable[[Part, Part], Array]
    """Ja'Jb `(k, l)` of two parts with whitened designs J."""
    _blocks: dict[tuple[Part, Part], Array] = field(default_factory=dict)

    def matrix(self, parts: Sequence[Part]) -> Array:
        """J'J of a model of these parts, in their order."""
        ends = np.cumsum([0, *(len(self._between(part, part)) for part in parts)]).tolist()
        own = [slice(low, high) for low, high in pairwise(ends)]
        matrix = np.empty((ends[-1], ends[-1]))
        for (i, a), (j, b) in combinations_with_replacement(enumerate(parts), 2):
            matrix[own[i], own[j]] = block = self._between(a, b)
            matrix[own[j], own[i]] = block.T
        return matrix

    def _between(self, a: Part, b: Part) -> Array:
        """The block of two parts, computed in one order of the two: its bits do not depend on the order of threads."""
        first, second = min(a, b), max(a, b)
        if (first, second) not in self._blocks:
            self._blocks[first, second] = read_only(self.block(first, second))
        block = self._blocks[first, second]
        return block if first == a else block.T
