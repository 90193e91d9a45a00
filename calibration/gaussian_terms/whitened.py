"""Observations and columns of terms, made white by a noise and free of the registration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np

from calibration.gaussian_terms.noise import Noise, Stops, whiteners
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import ROUNDING, Equations
from kinematics.transforms import Array

SCALARS_OF_A_BLOCK = 1000
"""Scalars that are whitened together."""


class Piece(NamedTuple):
    """Some stops of equally many rows."""

    rows: np.ndarray | slice
    """Their rows."""
    scalars: np.ndarray | slice
    """Their scalars."""
    matrices: Array
    """Matrices `(stops, m d, m d)` that make them white; 0 for rows that are left out."""

    @classmethod
    def of(cls, rows: np.ndarray, d: int, matrices: Array) -> Piece:
        """Some rows, of d scalars each."""
        first, last = int(rows[0]), int(rows[-1]) + 1
        if last - first == len(rows):
            return cls(slice(first, last), slice(first * d, last * d), matrices)
        return cls(rows, (rows[:, None] * d + np.arange(d)).ravel(), matrices)

    @property
    def precision(self) -> Array:
        """Precisions `(stops, m d, m d)` of their scalars, in that of the noise."""
        return np.asarray(np.swapaxes(self.matrices, 1, 2) @ self.matrices)

    def white(self, rows: Array) -> Array:
        """Whitened scalars `(k, c)` of these rows of a table `(k / d, d, c)`, in its precision."""
        stops, size = self.matrices.shape[:2]
        own = rows.reshape(stops, size, rows.shape[2])
        return np.asarray(self.matrices.astype(rows.dtype, copy=False) @ own).reshape(stops * size, rows.shape[2])

    def back(self, rows: Array) -> Array:
        """Scalars `(k, c)` whose products with others are those of these rows `(k, c)` with the whitened others."""
        own = rows.reshape(*self.matrices.shape[:2], -1)
        return np.asarray(np.swapaxes(self.matrices, 1, 2) @ own).reshape(rows.shape)


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
        kept = values > ROUNDING * values.max(initial=0.0)
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

    @cached_property
    def by_stops(self) -> list[list[Piece]]:
        """The stops of each number of rows, in pieces that stay in the cache of the processor."""
        d, found = self.observations.components, []
        for stops, matrices in zip(self.stops, self.matrices, strict=True):
            step = max(SCALARS_OF_A_BLOCK // matrices.shape[1], 1)
            kept = np.repeat(~self.left_out[stops.rows], d, axis=1)[:, None, :]
            parts = (slice(first, first + step) for first in range(0, len(matrices), step))
            found.append([Piece.of(stops.rows[some].ravel(), d, matrices[some] * kept[some]) for some in parts])
        return found

    @property
    def pieces(self) -> Iterator[Piece]:
        """All stops."""
        return chain.from_iterable(self.by_stops)

    def rows(self, table: Array) -> Array:
        """Whitened rows `(n d, k)` of a table `(n, d, k)`, whatever the registration; in the precision of the table."""
        return self.with_stated(table)[: self.observations.residual.size]

    def back(self, table: Array) -> Array:
        """Rows `(n d, c)` whose products with others are those of rows `(N, c)` with the whitened others."""
        found = np.empty((self.observations.residual.size, table.shape[1]))
        for piece in self.pieces:
            found[piece.scalars] = piece.back(table[piece.scalars])
        return found

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
        found = self.with_stated(table)
        through = self.spanned.T @ found
        for first in range(0, len(found), SCALARS_OF_A_BLOCK):
            some = slice(first, first + SCALARS_OF_A_BLOCK)
            found[some] -= self.spanned[some] @ through
        return found

    def with_stated(self, table: Array) -> Array:
        """Whitened rows `(n d + k, c)` of terms, whatever the registration: those of stated values are 0."""
        count = self.observations.residual.size + len(self.observations.stated)
        found = np.zeros((count, table.shape[2]), table.dtype)
        for piece in self.pieces:
            found[piece.scalars] = piece.white(table[piece.rows])
        return found

    def registers(self, table: Array) -> Array:
        """Products `(r, c)` of the directions of the registration with columns `(n, d, c)`, once they are white."""
        return self.through(table, self.spanned).T

    def through(self, table: Array, columns: Array) -> Array:
        """Products `(p, c)` of columns `(n, d, p)` with whitened ones `(N, c)` that are free of the registration."""
        return np.asarray(table.reshape(self.observations.residual.size, -1).T @ self.back(columns))

    def equations(self, table: Array, registers: Array) -> Equations:
        """Products of columns `(n, d, p)`, white and free of the registration; registers: their `registers`."""
        if len(self.spanned) < table.shape[2]:
            return Equations.of(self.columns(table), self.residual)
        gram = -(registers.T @ registers)
        for piece in self.pieces:
            rows = piece.white(table[piece.rows])
            gram += rows.T @ rows
        return Equations(self.residual, gram, self.through(table, self.residual[:, None])[:, 0])

    @cached_property
    def residual(self) -> Array:
        """The whitened observations `(n d + k,)`, free of the registration."""
        own = self.rows(self.observations.residual[:, :, None])
        return self._free(np.concatenate([own, self.observations.stated_residual[:, None]]))[:, 0]

    def _free(self, table: Array) -> Array:
        return table - self.spanned @ (self.spanned.T @ table)
