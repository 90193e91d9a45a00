"""Error motions at constant conditions as piecewise polynomials of the position of each axis.

A table holds the six error motions of an axis, in its error frame, on the union of the nodes of all its
effects; pieces are halved until they agree with `ErrorModel.errors` to EXACT. With play, an axis has a table for each
direction of approach. Effects that no table holds (of several axes, with jumps, with a memory of the moves) are
evaluated as they are and added.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.machine import TURN, Axis, Machine, NDArrayBool
from kinematics.state import State
from kinematics.transforms import Array, read_only
from kinematics.turn import knots_of

DEGREE = 6
EXACT = 1e-12
"""mm and rad."""
MARGIN = 5.0
"""mm or degrees beyond the travel to which tables reach; further outside the model itself is evaluated."""
ENDLESS_TURNS, ENDLESS_MM = 2.0, 5000.0
"""Reach of the tables of axes without end on either side of zero."""
MOST_FEATURES = 500.0
"""Features of an effect along the travel, above which it is not put into a table."""
ARM = 1000.0
"""Distance, mm, of the tool point from the axes whose error motions turn it, about."""
ROUNDING = EXACT / 1000.0
"""Coefficients of the highest powers, mm and rad, that are rounding of the fit and left out."""
STEP = 4.0 * EXACT
"""Difference between the ends of two pieces that meet in a smooth error, mm and rad, at most."""
HALVINGS = 12
FEW = 24
"""Pieces, and changes of the piece from row to row, up to which they are evaluated one after the other."""
NODES = read_only(np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1)))
TESTS = read_only(np.linspace(-1.0, 1.0, 16) * (1.0 - 1e-9))
"""Where a piece is fitted and where it is tested, in its own coordinate -1 ... 1."""
FIT = read_only(np.linalg.inv(np.vander(NODES, DEGREE + 1, increasing=True)))
AT_TESTS = read_only(np.vander(TESTS, DEGREE + 1, increasing=True))

ConstantConditions = Callable[[Array, Array | None], State]
"""The state at positions `(n, axes)`, mm and rad, approached in directions `(n, axes)`."""


class Table(NamedTuple):
    """Pieces of the error motions of an axis; in the directions backward, 0 and forward one after the other if there is
    play."""

    breaks: Array
    """Ends of the pieces `(pieces + 1,)`, mm or rad."""
    coefficients: Array
    """`(degree + 1, 6, directions * pieces)`, mm and rad, by powers of the coordinate of a piece, at least 1."""
    directed: bool

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
        pieces = len(self.breaks) - 1
        piece = np.searchsorted(self.breaks[1:-1], x, side="right")
        if self.directed and approach is not None:
            piece += pieces * (approach.astype(int) + 1)
        ends = np.append(np.flatnonzero(piece[1:] != piece[:-1]) + 1, len(piece)).tolist()
        if len(ends) <= FEW:  # a smooth path: no row is copied
            for first, end in pairwise([0, *ends]):
                self._put(piece[first : first + 1], x[first:end], values[:, first:end])
            return
        low = int(piece.min())
        present = low + np.flatnonzero(np.bincount(piece - low))
        if len(present) > FEW:
            self._put(piece, x, values)
            return
        for one in present:
            rows = np.flatnonzero(piece == one)
            part = np.empty((6, len(rows)))
            self._put(np.array([one]), x[rows], part)
            values[:, rows] = part

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

    def _put(self, piece: np.ndarray, x: Array, values: Array) -> None:
        """As `put`, at positions in pieces `(n,)`, or in one piece `(1,)` (Horner)."""
        first = piece % (len(self.breaks) - 1)
        low, high = self.breaks[first], self.breaks[first + 1]
        u = (x - (low + high) / 2.0) / ((high - low) / 2.0)
        constant, *coefficients, last = self.coefficients
        np.multiply(last[:, piece], u, out=values)
        for coefficient in reversed(coefficients):
            values += coefficient[:, piece]
            values *= u
        values += constant[:, piece]


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


class ErrorMotions:
    """Error motions of a machine by a model at constant conditions."""

    def __init__(self, machine: Machine, model: ErrorModel, state: ConstantConditions) -> None:
        self.machine, self.model, self._state = machine, model, state
        self._last: dict[int, tuple[Array, Array | None, Array]] = {}
        """By axis: positions, directions and error motions of the last evaluation."""
        self._without_table: set[int] = set()
        """Columns of axes for which no table becomes exact."""
        bare = msgspec.structs.replace(model, covariance=None)
        while True:
            held = bare.part(self._in_table)
            tables, failed = _tables(machine, held, state)
            if not failed:
                break
            self._without_table |= failed
        self._rest = bare.part(lambda effect: effect.ACTS_ON != "instrument" and not self._in_table(effect))
        self.tables = tables
        """By column of the axis."""
        directions = np.zeros((1, len(machine.axes)))
        self.tool = held.errors(machine, state(np.zeros_like(directions), directions))[:, len(machine.axes)].T
        """Displacement of the tool `(6, 1)`, mm and rad."""

    @cached_property
    def curvatures(self) -> dict[int, Curvature]:
        """By column of the axis."""
        return {i: Curvature(table) for i, table in self.tables.items()}

    @cached_property
    def slope(self) -> float:
        """Largest change of tool point errors per distance of the linear axes, mm/mm; infinite if errors jump.

        Over the travel, for a tool point that is ARM away from the axes.
        """
        jumps = (bounds.steps.max() > STEP * len(bounds.breaks) for bounds in self.curvatures.values())
        if not self.complete or any(jumps):
            return np.inf
        total = 0.0
        for i, table in self.tables.items():
            sizes, slopes = table.largest(*self.machine.travel[:, i])
            total += sizes[1] + (slopes[0] + ARM * slopes[1] if i in self.machine.translators else 0.0)
        return float(total)

    def _in_table(self, effect: Effect) -> bool:
        """True for the effects in tables and for constants of the tool."""
        axis = _axis_of(effect, self.machine)
        return axis is not None and axis not in self._without_table

    @property
    def complete(self) -> bool:
        """True if tables hold all errors."""
        return not self._rest.effects

    def at(self, q: Array, approach: Array | None = None) -> Array:
        """Error motions `(n, axes + 1, 6)` at positions `(n, axes)`, mm and rad, approached in directions `(n, axes)`.

        As `ErrorModel.errors` at the constant conditions, to EXACT; a row by the same steps, whichever rows there are
        beside it. UserError if the model needs directions and there
        are none.
        """
        held = self._held(q, approach)
        if not held.any():
            return self.model.errors(self.machine, self._state(q, approach))
        if held.all():
            result = self._by_tables(q, approach)
        else:
            result = self.model.errors(self.machine, self._state(q, approach))
            result[held] = self._by_tables(q[held], None if approach is None else approach[held])
        if self._rest.effects:
            rest = self._rest.errors(self.machine, self._state(q, approach))
            result = result + np.where(held[:, None, None], rest, 0.0)
        return result

    def _by_tables(self, q: Array, approach: Array | None) -> Array:
        """Error motions `(n, axes + 1, 6)` of the effects in tables and of the tool."""
        axes = len(self.machine.axes)
        errors = np.empty((axes + 1, 6, len(q)))
        for i in range(axes):
            if i in self.tables:
                self._put(i, q, approach, errors[i])
            else:
                errors[i] = 0.0
        errors[axes] = self.tool
        return read_only(np.moveaxis(errors, 2, 0))  # those of the last evaluation are kept

    def _put(self, i: int, q: Array, approach: Array | None, values: Array) -> None:
        """Error motions of one axis into `values` `(6, n)`; those of the last evaluation if it has not moved since."""
        table, x = self.tables[i], np.ascontiguousarray(q[:, i])
        came = approach[:, i] if table.directed and approach is not None else None
        known = self._last.get(i)
        if known is not None and all(map(_equal, known[:2], (x, came))):
            values[:] = known[2]
            return
        table.put(x, came, values)
        self._last[i] = x.copy(), None if came is None else came.copy(), values

    def _held(self, q: Array, approach: Array | None) -> NDArrayBool:
        """True `(n,)` for the positions to which the tables reach; for none if they need directions and have none."""
        if approach is None and any(table.directed for table in self.tables.values()):
            return np.zeros(len(q), bool)
        held = np.ones(len(q), bool)
        for i, table in self.tables.items():
            held &= (q[:, i] >= table.breaks[0]) & (q[:, i] <= table.breaks[-1])
        return held


def _equal(column: Array | None, other: Array | None) -> bool:
    return column is other or (column is not None and other is not None and np.array_equal(column, other))


def _axis_of(effect: Effect, machine: Machine) -> int | None:
    """Column of the axis in whose table an effect belongs, -1 for a constant of the tool; None if no table holds it."""
    bases = effect.position_bases
    if effect.ACTS_ON == "instrument" or bases is None or len(bases) > 1:
        return None
    for name in bases:
        low, high = _reach(machine.axes[machine.index(name)])
        if effect.feature_lengths.get(name, np.inf) * MOST_FEATURES < high - low:
            return None
        return machine.index(name)
    return -1


def _reach(axis: Axis) -> tuple[float, float]:
    """Lower and upper end of the table of an axis, mm or degrees."""
    endless = ENDLESS_TURNS * TURN if axis.rotary else ENDLESS_MM
    low, high = axis.travel
    return (low - MARGIN if np.isfinite(low) else -endless), (high + MARGIN if np.isfinite(high) else endless)


def _tables(machine: Machine, model: ErrorModel, state: ConstantConditions) -> tuple[dict[int, Table], set[int]]:
    """Tables by column of the axis, and the axes for which no table becomes exact."""
    breaks: dict[int, Array] = {}
    directed = set()
    for effect in model.effects:
        for name, basis in (effect.position_bases or {}).items():
            i = machine.index(name)
            axis = machine.axes[i]
            low, high = _reach(axis)
            knots = [] if basis is None else knots_of(axis, basis, low, high)
            nodes = np.array([low, *axis.travel, high, *knots]) * machine.scale[i]
            breaks[i] = np.concatenate([breaks.get(i, np.empty(0)), nodes[np.isfinite(nodes)]])
            if "approach" in effect.needs:
                directed.add(i)
    open_pieces = {i: _distinct(found) for i, found in breaks.items()}
    done: dict[int, list[tuple[Array, Array, Array]]] = {i: [] for i in breaks}
    for _ in range(HALVINGS):
        found = _fitted(machine, model, state, open_pieces, directed)
        open_pieces = {}
        for i, (first, last, coefficients, exact) in found.items():
            done[i].append((first[exact], last[exact], coefficients[..., exact]))
            if not exact.all():
                low, high = first[~exact], last[~exact]
                middle = (low + high) / 2.0
                open_pieces[i] = np.stack([np.concatenate([low, middle]), np.concatenate([middle, high])])
        if not open_pieces:
            break
    tables = {}
    for i, parts in done.items():
        first, last, coefficients = (np.concatenate(column, axis=-1) for column in zip(*parts, strict=True))
        order = np.argsort(first)
        ordered = coefficients[..., order].swapaxes(0, 2).swapaxes(0, 1)  # degree, components, directions, pieces
        flat = ordered.reshape(DEGREE + 1, 6, -1)
        sizes = np.abs(flat).max(axis=(1, 2), initial=0.0)
        degree = int(np.flatnonzero(sizes >= ROUNDING).max(initial=1))
        nodes = np.append(first[order], last[order][-1:])
        tables[i] = Table(nodes, np.ascontiguousarray(flat[: degree + 1]), i in directed)
    return tables, set(open_pieces)


def _distinct(nodes: Array) -> Array:
    """First and last ends of pieces `(2, pieces)` between nodes."""
    ordered = np.sort(nodes)  # np.unique would load numpy.ma
    kept = ordered[np.append(True, np.diff(ordered) > 1e-9)]
    return np.stack([kept[:-1], kept[1:]])


def _fitted(
    machine: Machine,
    model: ErrorModel,
    state: ConstantConditions,
    pieces: dict[int, Array],
    directed: set[int],
) -> dict[int, tuple[Array, Array, Array, np.ndarray]]:
    """By axis: ends of its pieces, coefficients `(directions, degree, 6, pieces)`, and true for exact pieces.

    All axes are sampled together, because their errors do not depend on each other.
    """
    samples = np.concatenate([NODES, TESTS])
    points = {
        i: ((first + last) / 2.0 + samples[:, None] * ((last - first) / 2.0)).ravel()
        for i, (first, last) in pieces.items()
    }
    q = np.zeros((max(map(len, points.values()), default=0), len(machine.axes)))
    for i, x in points.items():
        q[: len(x), i], q[len(x) :, i] = x, x[0]
    errors = {
        way: model.errors(machine, state(q, np.full_like(q, way))) for way in ((-1.0, 0.0, 1.0) if directed else (0.0,))
    }
    found = {}
    for i, (first, last) in pieces.items():
        ways = (-1.0, 0.0, 1.0) if i in directed else (0.0,)
        values = np.array([errors[way][: len(points[i]), i] for way in ways])
        values = values.reshape(len(ways), len(samples), len(first), 6).swapaxes(2, 3)
        coefficients = np.einsum("ds,wscp->wdcp", FIT, values[:, : DEGREE + 1])
        tested = np.einsum("sd,wdcp->wscp", AT_TESTS, coefficients)
        exact = np.abs(tested - values[:, DEGREE + 1 :]).max(axis=(0, 1, 2)) < EXACT
        found[i] = first, last, coefficients, exact
    return found
