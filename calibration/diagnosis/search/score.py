"""Scores of candidates on a linearised fit, and the part of their signals that nothing else can imitate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from kinematics.transforms import Array

RIDGE = 1e-9
"""Ridge on the Schur complement of columns of unit length."""
GENEROUS = 5.0
"""Least prior standard deviation of a candidate's parameters, in typical sizes."""
BEYOND = 3.0
"""Least prior standard deviation of a candidate's parameters, as a multiple of the largest estimate of them."""


class Score(NamedTuple):
    """Score of a candidate on the linearised fit that it is added to."""

    squares: float
    """Reduction of the sum of squares."""
    gain: float
    """Reduction of the sum of squares, in units of the noise variance and of the rows that count as one."""
    effective_parameters: float
    """Degrees of freedom that it uses, shapes included."""
    delta_bic: float
    """Change of the BIC: negative where the gain exceeds the cost of the parameters."""
    p_value: float
    """Chance of so large a gain from noise, over all shapes that were tried."""
    size: Array
    """Linear parameters `(k,)`, in units of their typical sizes."""


class Complement(NamedTuple):
    """The Schur complement of columns, and its eigenvalues."""

    matrix: Array
    """`(k, k)`"""
    values: Array
    """`(k,)`, none below 0."""
    vectors: Array
    """`(k, k)`"""

    @classmethod
    def of(cls, schur: Array) -> Complement:
        """The eigenvalues of a Schur complement `(k, k)`."""
        values, vectors = (schur[0], np.eye(1)) if len(schur) == 1 else np.linalg.eigh((schur + schur.T) / 2)
        return cls(schur, np.maximum(values, 0.0), vectors)


class Projected(NamedTuple):
    """Columns of a candidate, in units of typical sizes, and their part that model and registration cannot imitate."""

    columns: Array
    """`(N, k)`, whitened."""
    through: Array
    """L^-1 J'G `(q, k)`, with L L' = H."""
    schur: Array
    """Schur complement S `(k, k)`."""

    @property
    def visible(self) -> float:
        """Share of the signal that the model and the registration cannot imitate."""
        whole = float(np.sum(self.columns**2))
        return float(np.sqrt(max(np.trace(self.schur), 0.0) / whole)) if whole > 0 else 0.0

    @property
    def summary(self) -> Projected:
        """Only the sizes of the columns, without their rows: the same visibility and Schur complement."""
        return Projected(np.diag(np.linalg.norm(self.columns, axis=0)), np.zeros((0, len(self.schur))), self.schur)


class Rating(NamedTuple):
    """The quantities of a linearised fit that the scores of all candidates have in common."""

    squares: float
    """Sum of squares of the residual r."""
    scalars: int
    """Number N of scalar residuals."""
    degrees_of_freedom: float
    absorbed: Array
    """S'r `(q,)`: the residual along the spanned columns S, which their priors hold."""
    gram: Array
    """S'S `(q, q)`"""

    def of(self, complement: Complement, along: Array, through: Array, shapes: int = 0, trials: float = 1.0) -> Score:
        """Score of columns by their Schur complement and the residual `along` them `(k,)`.

        through: as `Projected.through` `(q, k)`.
        """
        schur, values, vectors = complement
        turned = vectors.T @ along
        softened = values + GENEROUS**-2
        largest = float(np.abs(vectors @ (turned / softened)).max(initial=0.0))
        softened = values + max(GENEROUS, BEYOND * largest) ** -2
        effective_parameters = float(np.sum(values / softened)) + shapes
        squares, size = float(np.sum(turned**2 / softened)), vectors @ (turned / softened)
        # reduction of the data's squares by the column c = G size, of which the model takes the part S S'c
        spanned = through @ size
        own = float(size @ schur @ size + spanned @ spanned)
        taken = float(spanned @ (self.gram @ spanned))
        by_data = 2.0 * float(along @ size - self.absorbed @ spanned) - (own - 2.0 * float(spanned @ spanned) + taken)
        return self.scored(max(min(squares, by_data), 0.0), effective_parameters, trials, size)

    def scored(
        self, squares: float, effective_parameters: float, trials: float, size: Array, correlated: float = 1.0
    ) -> Score:
        """Score of a candidate that reduces the sum of squares by `squares`; so many rows in sequence count as one."""
        remaining = self.degrees_of_freedom - effective_parameters
        gain = squares / max((self.squares - squares) / max(remaining, 1.0), 1.0) / correlated
        p_value = float(special.chdtrc(max(effective_parameters, 1.0), gain)) * trials
        delta_bic = -gain + effective_parameters * float(np.log(self.scalars))
        return Score(squares, gain, effective_parameters, delta_bic, min(p_value, 1.0), size)


def squares_of_all(candidates: Sequence[Projected], residual: Array) -> float:
    """Reduction of the sum of squares of a residual `(N,)` by all of these candidates together, of any size."""
    if not candidates:
        return 0.0
    columns = np.concatenate([each.columns for each in candidates], axis=1)
    through = np.concatenate([each.through for each in candidates], axis=1)
    schur, along = columns.T @ columns - through.T @ through, columns.T @ residual
    scale = 1.0 / np.sqrt(np.maximum(np.diag(schur), RIDGE))
    values, vectors = np.linalg.eigh(schur * np.outer(scale, scale))
    values = np.maximum(values, 0.0) + RIDGE * len(values)
    return float(np.sum((vectors.T @ (scale * along)) ** 2 / values))
