"""Observations and columns of terms, made white by a noise and free of the registration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.gaussian_terms.noise import Noise, Stops, whiteners
from calibration.gaussian_terms.observations import Observations
from kinematics.transforms import Array

RANK = 1e-9
"""Singular value of the registration, as a share of the largest one, below which a combination is not observed."""
TOGETHER = 64
"""Columns that are whitened together: several copies of them are made."""


@dataclass(frozen=True)
class Whitener:
    """Makes rows white but for the common factor of the noise, and removes what any registration explains.

    A whitened table has n d rows, and one for each stated value of the registration. Rows that are left out are 0.
    """

    observations: Observations
    stops: Sequence[Stops]
    matrices: Sequence[Array]
    """Of the stops, as `whiteners`."""
    left_out: np.ndarray
    spanned: Array
    """Orthonormal columns `(n d + k, r)` that the registration spans."""
    log_volume: float
    """Log determinant of the whitening, less that of the registration."""

    @classmethod
    def of(cls, observations: Observations, stops: Sequence[Stops], noise: Noise) -> Whitener:
        """The whitener of a noise."""
        matrices = whiteners(stops, noise)
        bare = cls(observations, stops, matrices, noise.left_out, np.zeros((0, 0)), 0.0)
        rows = np.concatenate([bare.rows(observations.registration), observations.stated])
        spanned, values, _ = np.linalg.svd(rows, full_matrices=False)
        kept = values > RANK * values.max(initial=0.0)
        volume = -float(np.log(values[kept]).sum())
        for each, own in zip(stops, matrices, strict=True):
            inside = ~noise.left_out[each.rows].any(axis=1)
            volume += float(np.log(np.diagonal(own[inside], axis1=1, axis2=2)).sum())
        return cls(observations, stops, matrices, noise.left_out, spanned[:, kept], volume)

    @property
    def scalars(self) -> int:
        """Number of scalars that count, less the directions of the registration."""
        inside = int(np.count_nonzero(~self.left_out)) * self.observations.components
        return inside + len(self.observations.stated) - int(self.spanned.shape[1])

    @property
    def observed(self) -> int:
        """Number of scalars in the file that count, also those whose mean is one row."""
        rows = self.observations.averaged[~self.left_out]
        return int(rows.sum()) * self.observations.components + len(self.observations.stated)

    def rows(self, table: Array) -> Array:
        """Whitened rows `(n d, k)` of a table `(n, d, k)`, whatever the registration; in the precision of the table."""
        table = np.where(self.left_out[:, None, None], 0.0, table) if self.left_out.any() else table
        found = np.empty_like(table)
        for stops, own in zip(self.stops, self.matrices, strict=True):
            turned = stops.times(own.astype(table.dtype, copy=False), table)
            found[stops.rows] = turned.reshape(*stops.rows.shape, *table.shape[1:])
        return found.reshape(self.observations.residual.size, table.shape[2])

    def blocks(self, table: Array) -> list[Array]:
        """Products T T' `(stops, m d, m d)` of the whitened rows of each stop of a table T `(n d + k, c)`."""
        rows = table[: self.observations.residual.size].reshape(*self.observations.residual.shape, -1)
        own = (rows[each.rows].reshape(*each.specified.shape[:2], -1) for each in self.stops)
        return [np.asarray(each @ np.swapaxes(each, 1, 2), float) for each in own]

    @cached_property
    def registered(self) -> list[Array]:
        """Share `(stops, m d, m d)` that the registration takes of the whitened rows of each stop."""
        return self.blocks(self.spanned)

    def columns(self, table: Array) -> Array:
        """Whitened columns `(n d + k, c)` of terms `(n, d, c)`, free of the registration."""
        found = np.empty((len(self.spanned), table.shape[2]), table.dtype)
        for first in range(0, table.shape[2], TOGETHER):
            some = slice(first, first + TOGETHER)
            found[:, some] = self._free(self.with_stated(table[:, :, some]))
        return found

    def with_stated(self, table: Array) -> Array:
        """Whitened rows `(n d + k, c)` of terms, whatever the registration: those of stated values are 0."""
        stated = np.zeros((len(self.observations.stated), table.shape[2]), table.dtype)
        return np.concatenate([self.rows(table), stated])

    def residual(self) -> Array:
        """The whitened observations `(n d + k,)`, free of the registration."""
        own = self.rows(self.observations.residual[:, :, None])
        return self._free(np.concatenate([own, self.observations.stated_residual[:, None]]))[:, 0]

    def _free(self, table: Array) -> Array:
        return table - self.spanned @ (self.spanned.T @ table)
