"""Error motions at constant conditions as piecewise polynomials of the position of each axis.

A table holds the six error motions of an axis, in its error frame, on the union of the nodes of all its effects; pieces
are halved until they agree with `ErrorModel.errors` to `EXACT_MM`. Effects that depend on the direction of approach
have a table of their own, with pieces for each direction. Effects that no table holds (of several axes, with jumps,
with a memory of the moves) are evaluated as they are and added. Beyond the reach of its tables, an axis whose errors
repeat with the turn is looked up a whole number of turns back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.piecewise import AT_TESTS, PIECE_DEGREE, TESTS, Curvature, Pieces, Table
from kinematics.machine import TURN_DEG, Axis, Machine, NDArrayBool
from kinematics.state import State
from kinematics.transforms import TURN_RAD, Array, read_only
from kinematics.turn import knots_of

EXACT_MM = 1e-12
"""mm and rad."""
TABLE_MARGIN = 5.0
"""mm or degrees beyond the travel to which tables reach; further outside the model itself is evaluated."""
FAR = 1.0
"""Lengths of the travel beyond it to which the tables reach that serve positions beyond the others."""
ENDLESS_TURNS, ENDLESS_MM = 2.0, 5000.0
"""Reach of the tables of axes without end on either side of zero."""
MOST_FEATURES = 500.0
"""Features of an effect along the travel, above which it is not put into a table."""
TOOL_ARM_MM = 1000.0
"""Distance, mm, of the tool point from the axes whose error motions turn it, about."""
NEGLIGIBLE_COEFFICIENT = EXACT_MM / 1000.0
"""Coefficients of the highest powers, mm and rad, that are rounding of the fit and left out."""
SMOOTH_JOINT = 4.0 * EXACT_MM
"""Difference between the ends of two pieces that meet in a smooth error, mm and rad, at most."""
MOST_PIECE_HALVINGS = 12
TURNS_AWAY, REPEATS = (-1, 7), 499
"""Turns after which it is tested that errors repeat, and number of positions: a prime, so that no wave hides."""
NODES = read_only(np.cos(np.pi * (np.arange(PIECE_DEGREE + 1) + 0.5) / (PIECE_DEGREE + 1)))
"""Where a piece is fitted, in its own coordinate -1 ... 1."""
FIT = read_only(np.linalg.inv(np.vander(NODES, PIECE_DEGREE + 1, increasing=True)))

ConstantConditions = Callable[[Array, Array | None], State]
"""The state at positions `(n, axes)`, mm and rad, approached in directions `(n, axes)`."""


class ErrorMotions:
    """Error motions of a machine by a model at constant conditions."""

    def __init__(self, machine: Machine, model: ErrorModel, state: ConstantConditions, beyond: float = 0.0) -> None:
        """beyond: lengths of the travel by which the tables reach further beyond it."""
        self.machine, self.model, self._state, self._beyond = machine, model, state, beyond
        self._last: dict[tuple[int, int], tuple[Array, Array | None, Array]] = {}
        """By axis and number of its table: positions, directions and error motions of the last evaluation."""
        self._without_table: set[int] = set()
        """Columns of axes for which no table becomes exact."""
        bare = msgspec.structs.replace(model, covariance=None)
        while True:
            held = bare.part(self._in_table)
            found = [
                _tables(machine, held.part(_is_directed if directed else _is_not_directed), state, directed, beyond)
                for directed in (False, True)
            ]
            failed = found[0][1] | found[1][1]
            if not failed:
                break
            self._without_table |= failed
        self._in_tables = held
        self._rest = bare.part(lambda effect: effect.ACTS_ON != "instrument" and not self._in_table(effect))
        self.tables = {
            i: tuple(tables[i] for tables, _ in found if i in tables)
            for i in range(len(machine.axes))
            if any(i in tables for tables, _ in found)
        }
        """By column of the axis: of the effects that do not depend on directions, and of those that do."""
        directions = np.zeros((1, len(machine.axes)))
        self.tool = held.errors(machine, state(np.zeros_like(directions), directions))[:, len(machine.axes)].T
        """Displacement of the tool `(6, 1)`, mm and rad."""

    @cached_property
    def curvatures(self) -> dict[int, tuple[Curvature, ...]]:
        """By column of the axis, of its tables."""
        return {i: tuple(map(Curvature, tables)) for i, tables in self.tables.items()}

    @cached_property
    def slope(self) -> float:
        """Largest change of tool point errors per distance of the linear axes, mm/mm; infinite if errors jump.

        Over the travel, for a tool point that is `TOOL_ARM_MM` away from the axes.
        """
        jumps = (
            bounds.steps.max() > SMOOTH_JOINT * len(bounds.breaks)
            for each in self.curvatures.values()
            for bounds in each
        )
        if not self.complete or any(jumps):
            return np.inf
        total = 0.0
        for i, table in ((i, table) for i, tables in self.tables.items() for table in tables):
            sizes, slopes = table.largest(*self.machine.travel[:, i])
            total += sizes[1] + (slopes[0] + TOOL_ARM_MM * slopes[1] if i in self.machine.translators else 0.0)
        return float(total)

    def _in_table(self, effect: Effect) -> bool:
        """True for the effects in tables and for constants of the tool."""
        axis = _axis_of(effect, self.machine, self._beyond)
        return axis is not None and axis not in self._without_table

    @property
    def complete(self) -> bool:
        """True if tables hold all errors."""
        return not self._rest.effects

    def at(self, q: Array, approach: Array | None = None) -> Array:
        """Error motions `(n, axes + 1, 6)` at positions `(n, axes)`, mm and rad, approached in directions `(n, axes)`.

        As `ErrorModel.errors` at the constant conditions, to `EXACT_MM`; a row by the same steps, whichever rows there
        are beside it. UserError if the model needs directions and there are none.
        """
        near = self._turned_back(q)
        held = self._held(near, approach)
        if held.all():
            result = self._by_tables(near, approach)
        elif self.far is not None:
            errors = np.empty((len(self.machine.axes) + 1, 6, len(q)))
            for motions, rows, there in ((self, held, near), (self.far, ~held, q)):
                if rows.any():
                    some = motions.at(there[rows], None if approach is None else approach[rows])
                    errors[:, :, rows] = np.moveaxis(some, 0, 2)
            result = np.moveaxis(errors, 2, 0)
        else:
            result = self.model.errors(self.machine, self._state(q, approach))
            if held.any():
                result[held] = self._by_tables(near[held], None if approach is None else approach[held])
        if self._rest.effects:
            rest = self._rest.errors(self.machine, self._state(q, approach))
            result = result + np.where(held[:, None, None], rest, 0.0)
        return result

    @cached_property
    def far(self) -> ErrorMotions | None:
        """Those with tables beyond the reach of these; None where tables do not hold all errors, or need directions."""
        if self._beyond or not self.complete:
            return None
        far = ErrorMotions(self.machine, self.model, self._state, FAR)
        return far if far.complete else None

    def turns_away(self, i: int, low: Array, high: Array) -> Array:
        """Whole turns `(n,)`, rad, after which an axis has the errors that tables hold, at positions from low to high.

        low, high `(n,)`, rad. 0 where the tables reach, and for axes whose errors do not repeat with the turn.
        """
        first, last = self.tables[i][0].breaks[[0, -1]]
        beyond = (low < first) | (high > last)
        if not beyond.any() or i not in self._repeating:
            return np.zeros(len(low))
        return np.where(beyond, np.floor((low - first) / TURN_RAD) * TURN_RAD, 0.0)

    @cached_property
    def _repeating(self) -> frozenset[int]:
        """Columns of the axes whose errors in tables repeat with the turn, as samples show it."""
        turning = [i for i in self.tables if self.machine.axes[i].turns_fully]
        q, turn = np.zeros((REPEATS, len(self.machine.axes))), np.zeros(len(self.machine.axes))
        for i in turning:
            first, last = self.tables[i][0].breaks[[0, -1]].tolist()
            q[:, i], turn[i] = np.linspace(first, last, REPEATS), TURN_RAD
        differences = np.zeros(len(self.machine.axes) + 1)
        directed = any(tables[-1].directed for tables in self.tables.values())
        for way in (-1.0, 0.0, 1.0) if directed else (0.0,):
            there, *others = (
                self._in_tables.errors(self.machine, self._state(q + k * turn, np.full_like(q, way)))
                for k in (0, *TURNS_AWAY)
            )
            for each in others:
                differences = np.maximum(differences, np.abs(each - there).max(axis=(0, 2)))
        return frozenset(i for i in turning if differences[i] < EXACT_MM)

    def _turned_back(self, q: Array) -> Array:
        """The positions `(n, axes)`, mm and rad, with those beyond the reach of the tables whole turns back."""
        near = q
        for i in self.tables:
            if self.machine.axes[i].turns_fully:
                away = self.turns_away(i, q[:, i], q[:, i])
                if away.any():
                    near = q.copy() if near is q else near
                    near[:, i] -= away
        return near

    def _by_tables(self, q: Array, approach: Array | None) -> Array:
        """Error motions `(n, axes + 1, 6)` of the effects in tables and of the tool."""
        axes = len(self.machine.axes)
        errors = np.empty((axes + 1, 6, len(q)))
        for i in range(axes):
            self._put(i, q, approach, errors[i])
        errors[axes] = self.tool
        return read_only(np.moveaxis(errors, 2, 0))  # those of the last evaluation are kept

    def _put(self, i: int, q: Array, approach: Array | None, values: Array) -> None:
        """Error motions of one axis into `values` `(6, n)`."""
        tables = self.tables.get(i, ())
        if not tables:
            values[:] = 0.0
            return
        x = np.ascontiguousarray(q[:, i])
        for number, table in enumerate(tables):
            came = approach[:, i] if table.directed and approach is not None else None
            found = self._of_table((i, number), table, x, came)
            if number:
                values += found
            else:
                values[:] = found

    def _of_table(self, key: tuple[int, int], table: Table, x: Array, came: Array | None) -> Array:
        """Error motions `(6, n)` of a table; those of the last evaluation if the axis has not moved since."""
        known = self._last.get(key)
        if known is not None and all(map(_equal, known[:2], (x, came))):
            return known[2]
        values = np.empty((6, len(x)))
        table.put(x, came, values)
        self._last[key] = x.copy(), None if came is None else came.copy(), values
        return values

    def _held(self, q: Array, approach: Array | None) -> NDArrayBool:
        """True `(n,)` for the positions to which the tables reach; for none if they need directions and have none."""
        if approach is None and any(tables[-1].directed for tables in self.tables.values()):
            return np.zeros(len(q), bool)
        held = np.ones(len(q), bool)
        for i, (table, *_) in self.tables.items():
            held &= (q[:, i] >= table.breaks[0]) & (q[:, i] <= table.breaks[-1])
        return held


def _equal(column: Array | None, other: Array | None) -> bool:
    return column is other or (column is not None and other is not None and np.array_equal(column, other))


def _axis_of(effect: Effect, machine: Machine, beyond: float) -> int | None:
    """Column of the axis in whose table an effect belongs, -1 for a constant of the tool; None if no table holds it."""
    bases = effect.position_bases
    if effect.ACTS_ON == "instrument" or bases is None or len(bases) > 1:
        return None
    for name in bases:
        low, high = _reach(machine.axes[machine.index(name)], beyond)
        if effect.feature_lengths.get(name, np.inf) * MOST_FEATURES < high - low:
            return None
        return machine.index(name)
    return -1


def _is_directed(effect: Effect) -> bool:
    """True for an effect that depends on the direction of approach."""
    return "approach" in effect.needs


def _is_not_directed(effect: Effect) -> bool:
    return not _is_directed(effect)


def _reach(axis: Axis, beyond: float) -> tuple[float, float]:
    """Lower and upper end of the table of an axis, mm or degrees; beyond: as of ErrorMotions."""
    endless = ENDLESS_TURNS * TURN_DEG if axis.rotary else ENDLESS_MM
    low, high = axis.travel
    margin = TABLE_MARGIN + (beyond * (high - low) if np.isfinite(high - low) else 0.0)
    return (low - margin if np.isfinite(low) else -endless), (high + margin if np.isfinite(high) else endless)


def _tables(
    machine: Machine, model: ErrorModel, state: ConstantConditions, directed: bool, beyond: float
) -> tuple[dict[int, Table], set[int]]:
    """Tables by column of the axis, and the axes for which no table becomes exact.

    directed: the effects depend on the direction of approach; beyond: as of ErrorMotions.
    """
    breaks: dict[int, Array] = {}
    for effect in model.effects:
        for name, basis in (effect.position_bases or {}).items():
            i = machine.index(name)
            axis = machine.axes[i]
            low, high = _reach(axis, beyond)
            knots = [] if basis is None else knots_of(axis, basis, low, high)
            nodes = np.array([low, *axis.travel, high, *knots]) * machine.scale[i]
            breaks[i] = np.concatenate([breaks.get(i, np.empty(0)), nodes[np.isfinite(nodes)]])
    open_pieces = {i: _distinct(found) for i, found in breaks.items()}
    coarse = _fitted(machine, model, state, open_pieces, directed)
    done: dict[int, list[_Fitted]] = {i: [] for i in breaks}
    for round_ in range(MOST_PIECE_HALVINGS):
        found = _fitted(machine, model, state, open_pieces, directed) if round_ else coarse
        open_pieces = {}
        for i, fitted in found.items():
            exact = np.asarray(fitted.exact.all(axis=0))
            done[i].append(fitted.some(exact))
            if not exact.all():
                first, last = fitted.first[~exact], fitted.last[~exact]
                middle = (first + last) / 2.0
                open_pieces[i] = np.stack([np.concatenate([first, middle]), np.concatenate([middle, last])])
        if not open_pieces:
            break
    return {i: _table(coarse[i], parts, directed) for i, parts in done.items()}, set(open_pieces)


def _table(coarse: _Fitted, parts: list[_Fitted], directed: bool) -> Table:
    """The table of an axis from all its exact pieces, and from those before any of them was halved."""
    first, last, coefficients, _ = (np.concatenate(column, axis=-1) for column in zip(*parts, strict=True))
    order = np.argsort(first)
    breaks, flat = np.append(first[order], last[order][-1:]), _flat(coefficients[..., order])
    used, whole = np.asarray(flat.any(axis=(0, 2))), np.asarray(coarse.exact.all(axis=1))
    long = breaks, flat
    if not whole.all():
        long = np.append(coarse.first, coarse.last[-1:]), _flat(coarse.coefficients * whole[:, None])
    some = (_slices(used & whole), *long), (_slices(used & ~whole), breaks, flat)
    return Table(breaks, flat, directed, tuple(Pieces.of(*part, breaks) for part in some if part[0]))


def _slices(chosen: NDArrayBool) -> tuple[slice, ...]:
    """Slices of neighbours that are all chosen `(k,)`."""
    ends = np.flatnonzero(np.diff(chosen, prepend=False, append=False)).tolist()
    return tuple(map(slice, ends[::2], ends[1::2]))


def _flat(coefficients: Array) -> Array:
    """Coefficients `(degree + 1, 6, directions * pieces)`, without rounding, of `_Fitted` pieces in order."""
    ordered = coefficients.swapaxes(0, 2).swapaxes(0, 1)  # degree, components, directions, pieces
    flat = ordered.reshape(PIECE_DEGREE + 1, 6, -1)
    sizes = np.abs(flat).max(axis=(1, 2), initial=0.0)
    degree = int(np.flatnonzero(sizes >= NEGLIGIBLE_COEFFICIENT).max(initial=1))
    return np.ascontiguousarray(flat[: degree + 1])


def _distinct(nodes: Array) -> Array:
    """First and last ends of pieces `(2, pieces)` between nodes."""
    ordered = np.sort(nodes)  # np.unique would load numpy.ma
    kept = ordered[np.append(True, np.diff(ordered) > 1e-9)]
    return np.stack([kept[:-1], kept[1:]])


class _Fitted(NamedTuple):
    """Polynomials of the error motions of an axis on p pieces."""

    first: Array
    """Ends of the pieces `(p,)`, mm or rad."""
    last: Array
    coefficients: Array
    """`(directions, degree + 1, 6, p)`."""
    exact: NDArrayBool
    """True `(6, p)` where a polynomial agrees with the error model."""

    def some(self, chosen: NDArrayBool) -> _Fitted:
        """Those of some pieces, by a mask `(p,)`."""
        return _Fitted(self.first[chosen], self.last[chosen], self.coefficients[..., chosen], self.exact[:, chosen])


def _fitted(
    machine: Machine,
    model: ErrorModel,
    state: ConstantConditions,
    pieces: dict[int, Array],
    directed: bool,
) -> dict[int, _Fitted]:
    """By axis: polynomials on these pieces.

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
    ways = (-1.0, 0.0, 1.0) if directed else (0.0,)
    errors = [model.errors(machine, state(q, np.full_like(q, way))) for way in ways]
    found = {}
    for i, (first, last) in pieces.items():
        values = np.array([each[: len(points[i]), i] for each in errors])
        values = values.reshape(len(ways), len(samples), len(first), 6).swapaxes(2, 3)
        coefficients = np.einsum("ds,wscp->wdcp", FIT, values[:, : PIECE_DEGREE + 1])
        tested = np.einsum("sd,wdcp->wscp", AT_TESTS, coefficients)
        exact = np.abs(tested - values[:, PIECE_DEGREE + 1 :]).max(axis=(0, 1)) < EXACT_MM
        found[i] = _Fitted(first, last, coefficients, exact)
    return found
