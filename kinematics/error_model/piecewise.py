"""Piecewise polynomials of the position of an axis, and bounds of their changes."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array, read_only

PIECE_DEGREE = 6
FEW_STRETCHES = 24
"""Stretches of rows in one piece up to which they are evaluated one after the other."""
TESTS = read_only(np.linspace(-1.0, 1.0, 16) * (1.0 - 1e-9))
"""Where a piece is tested, in its own coordinate -1 ... 1."""
AT_TESTS = read_only(np.vander(TESTS, PIECE_DEGREE + 1, increasing=True))


class Pieces(NamedTuple):
    """Some error motions of an axis, on pieces that are as long as these motions allow."""

    components: tuple[slice, ...]
    """Numbers of the error motions, each slice of neighbours."""
    number: np.ndarray | None
    """Number of the piece that contains each piece of the table, of all directions; None if they are the same."""
    middle: Array
    """Middle of the pieces of all directions `(directions * pieces,)`, mm or rad."""
    half: Array
    """Half of their lengths."""
    coefficients: Array
    """As of Table."""

    @classmethod
    def of(cls, components: tuple[slice, ...], breaks: Array, coefficients: Array, within: Array) -> Pieces:
        """Pieces between breaks, for a table whose pieces lie between the breaks `within`."""
        directions = coefficients.shape[2] // (len(breaks) - 1)
        low, high = (np.tile(ends, directions) for ends in (breaks[:-1], breaks[1:]))
        number = None
        if len(breaks) < len(within):
            first = np.searchsorted(breaks[1:-1], within[:-1], side="right")
            number = np.concatenate([first + k * (len(breaks) - 1) for k in range(directions)])
        return cls(components, number, (low + high) / 2.0, (high - low) / 2.0, coefficients)

    def put(self, x: Array, piece: np.ndarray, values: Array) -> None:
        """Error motions at positions `(n,)` into `values` `(6, n)`; piece `(n,)`: of the table, of all directions."""
        if self.number is not None:
            piece = self.number.take(piece)
        ends = np.append(np.flatnonzero(piece[1:] != piece[:-1]) + 1, len(piece)).tolist()
        if len(ends) > FEW_STRETCHES:
            self._put(piece, x, values)
            return
        for first, end in pairwise([0, *ends]):  # a smooth path: no row is copied
            self._put(piece[first : first + 1], x[first:end], values[:, first:end])

    def _put(self, piece: np.ndarray, x: Array, values: Array) -> None:
        """As `put`, at positions in pieces `(n,)`, or in one piece `(1,)` (Horner)."""
        u = (x - self.middle.take(piece)) / self.half.take(piece)
        for some in self.components:
            constant, *coefficients, last = self.coefficients[:, some]
            there, found = np.empty((len(constant), len(piece))), values[some]

            def of_pieces(coefficient: Array, out: Array = there) -> Array:
                return coefficient.take(piece, axis=1, out=out, mode="clip")  # faster than with a check of the indices

            np.multiply(of_pieces(last), u, out=found)
            for coefficient in reversed(coefficients):
                found += of_pieces(coefficient)
                found *= u
            found += of_pieces(constant)


class Table(NamedTuple):
    """Pieces of the error motions of an axis; in the directions backward, 0 and forward one after the other if they
    depend on them."""

    breaks: Array
    """Ends of the pieces `(pieces + 1,)`, mm or rad."""
    coefficients: Array
    """`(degree + 1, 6, directions * pieces)`, mm and rad, by powers of the coordinate of a piece, at least 1."""
    directed: bool
    parts: tuple[Pieces, ...]
    """The error motions that are not zero everywhere."""

    def put(self, x: Array, approach: Array | None, values: Array) -> None:
        """Error motions at positions `(n,)` inside the breaks, approached in directions `(n,)`, into `values` `(6, n)`.

        Between two directions, within the play, they are interpolated. A row is evaluated in the same steps, whichever
        other rows there are.
        """
        if self.directed and approach is not None:
            inside = np.flatnonzero(approach != np.rint(approach))
            if len(inside):
                self._put_between(inside, x, approach, values)
                return
        if sum(some.stop - some.start for part in self.parts for some in part.components) < len(values):
            values[:] = 0.0
        piece = np.searchsorted(self.breaks[1:-1], x, side="right")
        if self.directed and approach is not None:
            piece += (len(self.breaks) - 1) * (approach.astype(int) + 1)
        for part in self.parts:
            part.put(x, piece, values)

    def _put_between(self, inside: np.ndarray, x: Array, approach: Array, values: Array) -> None:
        """As `put`; `inside`: the rows between two directions."""
        low = np.floor(approach)
        self.put(x, low, values)
        upper = np.empty((6, len(inside)))
        self.put(np.ascontiguousarray(x[inside]), low[inside] + 1.0, upper)
        share = (approach - low)[inside]
        values[:, inside] = (1.0 - share) * values[:, inside] + share * upper

    def largest(self, low: float, high: float) -> Array:
        """Largest sizes and slopes `(2, 2)` of the translations and of the rotations, from the pieces between."""
        pieces = len(self.breaks) - 1
        inside = np.tile((self.breaks[1:] > low) & (self.breaks[:-1] < high), self.coefficients.shape[2] // pieces)
        half = np.tile(np.diff(self.breaks) / 2.0, self.coefficients.shape[2] // pieces)[inside]
        coefficients, powers = self.coefficients[:, :, inside], np.arange(float(len(self.coefficients)))[:, None, None]
        values = np.einsum("sd,dcp->csp", AT_TESTS[:, : len(coefficients)], coefficients)
        slopes = np.einsum("sd,dcp->csp", AT_TESTS[:, : len(powers) - 1], powers[1:] * coefficients[1:]) / half
        return np.stack([_lengths(each.reshape(6, -1)).max(axis=1) for each in (values, slopes)])


class Curvature:
    """Bounds of the pieces of an axis: of its translations, mm, and of its rotations, rad."""

    def __init__(self, table: Table) -> None:
        self.breaks = table.breaks
        pieces = len(table.breaks) - 1
        powers = np.arange(float(len(table.coefficients)))[:, None, None]
        half = np.tile(np.diff(table.breaks) / 2.0, table.coefficients.shape[2] // pieces)
        sizes = np.abs(table.coefficients)
        self.size, self.slope, self.second = (
            _lengths(part).max(axis=1)
            for part in (
                sizes.sum(axis=0),
                (powers * sizes).sum(axis=0) / half,
                (powers * (powers - 1.0) * sizes).sum(axis=0) / half**2,
            )
        )
        signs = np.where(powers % 2.0 == 0.0, 1.0, -1.0)
        ends = [(sign * table.coefficients).sum(axis=0) for sign in (1.0, signs)]
        slopes = [(sign * powers * table.coefficients).sum(axis=0) / half for sign in (1.0, -signs)]
        self.steps, self.kinks = (_sums(upper, lower, pieces) for upper, lower in (ends, slopes))

    def along(self, low: Array, high: Array, way: Array, bend: Array) -> list[tuple[Array, Array, Array]]:
        """Bounds of the size, the change and the bend `(n,)` of the translations, and of the rotations.

        Along paths of these lengths between positions `(n,)` from which the position in the middle deviates by
        `bend` / 2; terms as in `kinematics.second_differences`.
        """
        inner = self.breaks[1:-1]
        first = np.searchsorted(inner, low - bend / 2.0, side="left")
        last = np.searchsorted(inner, high + bend / 2.0, side="right")
        found = []
        for k in (0, 1):
            kinks, steps = (sums[k, last] - sums[k, first] for sums in (self.kinks, self.steps))
            change = self.slope[k] * (way + bend) + 2.0 * steps
            bent = self.second[k] * way**2 / 4.0 + kinks * way / 2.0 + self.slope[k] * bend + 3.0 * steps
            found.append((np.full(len(way), self.size[k]), change, bent))
        return found


def _lengths(components: Array) -> Array:
    """Lengths `(2, k)` of translations and rotations of components `(6, k)`."""
    return np.stack([np.linalg.norm(components[:3], axis=0), np.linalg.norm(components[3:], axis=0)])


def _sums(upper: Array, lower: Array, pieces: int) -> Array:
    """Sums `(2, pieces)` up to each piece of the differences between the ends of pieces that meet."""
    directions = upper.shape[1] // pieces
    last, first = (ends.reshape(6, directions, pieces) for ends in (upper, lower))
    differences = np.stack([_lengths(first[:, way, 1:] - last[:, way, :-1]) for way in range(directions)]).max(axis=0)
    return np.concatenate([np.zeros((2, 1)), np.cumsum(differences, axis=1)], axis=1)
