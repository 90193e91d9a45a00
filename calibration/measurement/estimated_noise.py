"""Noise estimated from data: a factor on the instrument's variances, and the non-repeatability of each axis.

Non-repeatability is an error of an axis that all rows of a stop share, drawn anew at every stop: noise of the machine,
which no table compensates. The covariance of the rows of one stop is that of the instrument plus a a', with an arm a
for each axis. Rows are whitened by their own covariance; then the rows of each stop with several of them are made
independent of each other (`Decorrelation`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from kinematics.transforms import Array

NEGLIGIBLE_NOISE_FACTOR = 0.1
"""Factor on the specified noise below which its value is not shown."""
ZERO_UNCERTAINTY_SHARE = 1e-6
"""Share of the largest standard uncertainty of a row below which another counts as zero."""
LEAST_SHARE_OF_ROW = 1e-6
"""Least share of a row's variance that is its own, and not its stop's."""


@dataclass(frozen=True)
class EstimatedNoise:
    """Variances estimated from the data, and the observations' response to them."""

    instrument_factor: float
    """Factor on the variances of the instrument's specification."""
    non_repeatability: Mapping[str, float]
    """Standard deviation of each axis from stop to stop, mm or rad; of the axes that show it clearly."""
    stop: np.ndarray
    """Number of the stop of each row `(n,)`; the rows of a stop follow one another."""
    arms: Array
    """Change of the observations `(n, d, axes)`, mm, by one standard deviation of each axis that adds to the noise."""

    def rows(self, index: slice | np.ndarray) -> EstimatedNoise:
        """The same for some of the rows."""
        return replace(self, stop=self.stop[index], arms=self.arms[index])

    def covariance(self, specified: Array) -> Array:
        """Covariances `(n, d, d)` of single rows, mm2, from those of the specification."""
        return np.asarray(self.instrument_factor * specified + self.arms @ np.swapaxes(self.arms, 1, 2))

    @property
    def text(self) -> str:
        """The estimate in sentences for the report."""
        parts = []
        if self.instrument_factor != 1.0:
            root = self.instrument_factor**0.5
            times = f"{root:.2g}" if root > NEGLIGIBLE_NOISE_FACTOR else f"less than {NEGLIGIBLE_NOISE_FACTOR:g}"
            parts.append(f"The instrument scatters {times} times as much as specified.")
        if self.non_repeatability:
            sizes = [f"{axis} repeats to {_with_unit(axis, size)}" for axis, size in self.non_repeatability.items()]
            parts.append(f"{', '.join(sizes)} (standard deviation from stop to stop). No table cures that.")
        return " ".join(parts)

    def json(self) -> dict[str, Any]:
        """The estimate for programs: factor on the uncertainties of the instrument; um or urad by axis."""

        def micro(sizes: Mapping[str, float]) -> dict[str, float]:
            return {axis: size * (1e6 if axis[0] in "ABC" else 1e3) for axis, size in sizes.items()}

        return {
            "instrument_factor": self.instrument_factor**0.5,
            "non_repeatability": micro(self.non_repeatability),
        }


def _with_unit(axis: str, size: float) -> str:
    return f"{size * 1e6:.2g} urad" if axis[0] in "ABC" else f"{size * 1e3:.2g} um"


class _Stops(NamedTuple):
    """Stops of the same number of rows."""

    rows: np.ndarray
    """`(stops, rows of a stop)`"""
    matrices: Array
    """Inverse roots `(stops, m d, m d)` of the correlation of their whitened rows."""


@dataclass(frozen=True)
class Decorrelation:
    """Transform of whitened rows that makes the rows of one stop independent of each other."""

    stops: tuple[_Stops, ...] = ()

    @classmethod
    def of(cls, noise: EstimatedNoise | None, white: Array, weights: Array | None = None) -> Decorrelation:
        """The transform for rows that `white` `(n, d, d)` whitens, each by its own covariance.

        weights `(n,)` of the rows, which are multiplied by their roots: a row of no weight shares nothing.
        """
        if noise is None or not noise.arms.shape[2]:
            return cls()
        arms = white @ noise.arms
        if weights is not None:
            arms = arms * np.sqrt(weights)[:, None, None]
        n, d, k = arms.shape
        starts = np.flatnonzero(np.append(True, np.diff(noise.stop) != 0))
        counts = np.diff(np.append(starts, n))
        found = []
        for m in np.unique(counts[counts > 1]).tolist():
            rows = starts[counts == m][:, None] + np.arange(m)
            own = arms[rows].reshape(len(rows), m * d, k)
            same_row = np.kron(np.eye(m), np.ones((d, d))) > 0.0
            values, vectors = np.linalg.eigh(np.where(same_row, np.eye(m * d), own @ np.swapaxes(own, 1, 2)))
            roots = vectors / np.sqrt(np.maximum(values, LEAST_SHARE_OF_ROW))[:, None, :]
            found.append(_Stops(rows, roots @ np.swapaxes(vectors, 1, 2)))
        return cls(tuple(found))

    @property
    def log_determinant(self) -> float:
        """Log determinant of the transform."""
        return float(sum(np.linalg.slogdet(each.matrices)[1].sum() for each in self.stops))

    def apply(self, table: Array) -> Array:
        """The transformed rows of a whitened table `(n, d, ...)`; the same table where no stop has several rows."""
        return self._times(table, [each.matrices for each in self.stops])

    def _times(self, table: Array, matrices: Sequence[Array]) -> Array:
        if not self.stops:
            return table
        result = table.copy()
        for each, own in zip(self.stops, matrices, strict=True):
            some = table[each.rows]
            result[each.rows] = (own @ some.reshape(*own.shape[:2], -1)).reshape(some.shape)
        return result


def inverse_roots(covariances: Array) -> Array | None:
    """Matrices W `(n, d, d)` with W C W' = 1 of covariances C; Montavon et al., weights by Cholesky.

    None where the uncertainty of a row is zero in some direction.
    """
    try:
        root = np.linalg.cholesky(covariances)
    except np.linalg.LinAlgError:
        return None
    sizes = np.diagonal(root, axis1=1, axis2=2)
    if (sizes.min(axis=1) < ZERO_UNCERTAINTY_SHARE * sizes.max(axis=1)).any():
        return None
    return np.asarray(np.linalg.inv(root))
