"""Points of the paths of moves between which no linear axis reverses.

An axis reverses inside arcs, and inside moves of the tool point (TCP) during which rotary axes turn. Its turning points
are the roots of the derivative of its path. The derivative is sampled in steps of at most `LARGEST_SAMPLE_RAD`; in each
step with equal signs at both ends its extremum is found first, because two roots may lie on either side of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motion.along import positions_along
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind

LARGEST_SAMPLE_RAD = np.pi / 12.0
"""Largest rotation of rotary axes, or sweep of an arc, between two samples of a derivative, rad."""
DIFFERENCE = 1e-3
"""Share of a path over which it is differentiated: far above the rounding of positions."""
ROOT_ROUNDS = 8
"""Rounds of the search for a root: to less than 1e-5 of the path. A position differs from its extremum by the
square."""


class PathPoints(NamedTuple):
    """Points of the paths of a chunk of n moves, in the order of the motion; the end of every move is one of them."""

    row: np.ndarray
    """Row of the move `(k,)`."""
    share: Array
    """Share of its path `(k,)`; 0 for the return of a canned cycle to the start of the next move."""
    ends: np.ndarray
    """Numbers of the points at the ends of the moves `(n,)`."""

    @property
    def returning(self) -> NDArrayBool:
        """True `(k,)` for the points to which a canned cycle has returned."""
        return np.asarray(self.share == 0.0)

    def before(self, rows: np.ndarray, shares: Array) -> np.ndarray:
        """Number of the last point at or before these shares `(m,)` of the paths of rows `(m,)`; -1 for none."""
        found = np.searchsorted(self.row + self.share, rows + shares, side="right") - 1
        return np.where(shares == 1.0, self.ends[rows], found)


def path_points(
    motions: Motions, axes: Sequence[int], behind_cycle: NDArrayBool, also: Sequence[float] = ()
) -> PathPoints:
    """The turning points of these linear axes, the returns of canned cycles, and the ends of all moves.

    behind_cycle `(n,)`: moves before which a canned cycle returns. also: further shares of moves with turning points.
    """
    rows, shares = turning_points_inside(motions, axes)
    some, n = np.unique(rows), len(motions)
    row = np.concatenate([np.flatnonzero(behind_cycle), rows, np.repeat(some, len(also)), np.arange(n)])
    starts, further = np.zeros(int(behind_cycle.sum())), np.tile(np.asarray(also, float), len(some))
    share = np.concatenate([starts, shares, further, np.ones(n)])
    order = np.lexsort((share, row))
    return PathPoints(row[order], share[order], np.searchsorted(row[order], np.arange(n), side="right") - 1)


def axis_positions(motions: Motions, rows: np.ndarray, shares: Array) -> Array:
    """Axis positions `(k, axes)`, mm and rad, at shares `(k,)` of the paths of rows `(k,)`."""
    return motions.bare.take(rows).in_machine(positions_along(motions, rows, shares))


def turning_points_inside(motions: Motions, axes: Sequence[int]) -> tuple[np.ndarray, Array]:
    """Rows and shares `(k,)` at which one of these linear axes reverses inside a move; in no order."""
    sweep = _sweeps(motions)
    curved = np.flatnonzero(sweep > 0.0)
    if not len(curved) or not axes:
        return np.empty(0, int), np.empty(0)
    steps = np.maximum(np.ceil(sweep[curved] / LARGEST_SAMPLE_RAD), 1.0).astype(int)
    sampled = [_sampled(motions, curved[steps == count], count, axes) for count in np.unique(steps)]
    crossing, dipping = (Brackets.joined(found) for found in zip(*sampled, strict=True))
    paths = Paths(motions)
    middle = dipping.roots(paths.bends)
    passed = (paths.slopes(dipping, middle) > 0.0) != (paths.slopes(dipping, dipping.low) > 0.0)
    pairs = (dipping._replace(high=middle).some(passed), dipping._replace(low=middle).some(passed))
    found = Brackets.joined((crossing, *pairs))
    shares = found.roots(paths.slopes)
    inside = (shares > 0.0) & (shares < 1.0)  # an arc that was cut at its turning point begins or ends there
    return found.row[inside], shares[inside]


def _sweeps(motions: Motions) -> Array:
    """Rotation along each move `(n,)`, rad, by which the paths of linear axes are curved; 0 for straight ones."""
    sweep = np.zeros(len(motions))
    rotary = motions.machine.rotary
    if rotary.any() and motions.tcp.any():
        turned = np.abs(motions.target - motions.start)[:, rotary].sum(axis=1)
        sweep = np.where(motions.tcp, np.deg2rad(turned), 0.0)
    if motions.arcs:
        circles = motions.circles
        sweep[circles.rows] += np.abs(circles.turned)
    return np.where(np.isin(motions.kind, (Kind.RAPID, Kind.LINE, Kind.ARC)), sweep, 0.0)


def _sampled(motions: Motions, rows: np.ndarray, steps: int, axes: Sequence[int]) -> tuple[Brackets, Brackets]:
    """Steps of the paths of rows in which the derivative changes its sign, and in which it is nearer to 0 inside."""
    shares, columns = np.linspace(0.0, 1.0, steps + 1), list(axes)
    row, share, shape = np.repeat(rows, steps + 1), np.tile(shares, len(rows)), (len(rows), steps + 1, len(columns))
    below, here, above = (
        axis_positions(motions, row, share + by)[:, columns].reshape(shape) for by in (-DIFFERENCE, 0.0, DIFFERENCE)
    )
    slope, bend = above - below, above - 2.0 * here + below
    low, high = slope[:, :-1], slope[:, 1:]
    crossing = (low > 0.0) != (high > 0.0)
    dipping = ~crossing & (low * bend[:, :-1] < 0.0) & (high * bend[:, 1:] > 0.0)
    return Brackets.of(crossing, rows, shares, columns), Brackets.of(dipping, rows, shares, columns)


class Brackets(NamedTuple):
    """Intervals `(k,)` of the paths of rows in which a function of an axis changes its sign."""

    row: np.ndarray
    """Row of the move."""
    axis: np.ndarray
    """Column of the axis."""
    low: Array
    """Share of the path at which the interval begins."""
    high: Array
    """Share of the path at which it ends."""

    @classmethod
    def of(cls, where: NDArrayBool, rows: np.ndarray, shares: Array, axes: list[int]) -> Brackets:
        """The intervals between shares, by `where` `(rows, steps, axes)`."""
        row, step, axis = np.nonzero(where)
        return cls(rows[row], np.array(axes)[axis], shares[step], shares[step + 1])

    @classmethod
    def joined(cls, parts: Sequence[Brackets]) -> Brackets:
        """The intervals of several objects."""
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def some(self, where: NDArrayBool) -> Brackets:
        """Some of the intervals."""
        return Brackets(*(column[where] for column in self))

    def roots(self, function: Callable[[Brackets, Array], Array]) -> Array:
        """Shares `(k,)` at which the function is 0, by false position (Illinois)."""
        low, high = self.low, self.high
        at_low, at_high = function(self, low), function(self, high)
        root = (low + high) / 2.0
        for _ in range(ROOT_ROUNDS if len(self.row) else 0):
            between = np.divide(at_low, at_low - at_high, out=np.full(len(low), 0.5), where=at_low != at_high)
            root = low + np.clip(between, 0.0, 1.0) * (high - low)
            there = function(self, root)
            like_low = (there > 0.0) == (at_low > 0.0)
            # an end that stays counts half, so that it moves as well
            at_low, at_high = np.where(like_low, there, at_low / 2.0), np.where(like_low, at_high / 2.0, there)
            low, high = np.where(like_low, root, low), np.where(like_low, high, root)
        return np.asarray(root)


class Paths(NamedTuple):
    """First and second derivatives of the paths of axes."""

    motions: Motions

    def slopes(self, at: Brackets, share: Array) -> Array:
        """Derivatives `(k,)`, mm per 2 DIFFERENCE, at shares `(k,)` of the paths of rows and axes."""
        count = len(share)
        if not count:
            return np.empty(0)
        rows, shares = np.tile(at.row, 2), np.concatenate([share + DIFFERENCE, share - DIFFERENCE])
        found = axis_positions(self.motions, rows, shares)
        both = np.arange(count)
        return np.asarray(found[both, at.axis] - found[both + count, at.axis])

    def bends(self, at: Brackets, share: Array) -> Array:
        """Changes of the derivatives `(k,)` over 2 DIFFERENCE, at shares `(k,)` of the paths of rows and axes."""
        return self.slopes(at, share + DIFFERENCE) - self.slopes(at, share - DIFFERENCE)
