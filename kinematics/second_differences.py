"""Upper bounds of the second difference of the tool point error along straight paths.

A straight path deviates from its corrected path as far as the tool point error h does from a straight line: its second
difference is h(0) - 2 h(1/2) + h(1), at the start, the middle and the end. A quantity x along a path has three bounds:

    size        |x| at each of the three points
    change      2 |x(0) - x(1/2)| and 2 |x(1) - x(1/2)|
    bend        |x(0) - 2 x(1/2) + x(1)|, the second difference itself

They follow the chain from the tool to the workpiece. For a product, with x y at three points written as
x(1/2) y(1/2) plus differences,

    bend(x y) <= bend(x) size(y) + size(x) bend(y) + change(x) change(y) / 2,

and likewise for the change. A turn by an angle that changes evenly by d has size 1, change d and bend d^2 / 4. The
error motion f of an axis whose position changes by d, and deviates by b/2 from even in the middle, has

    change <= slope (d + b) + 2 steps,   bend <= second d^2 / 4 + kinks d / 2 + slope b + 3 steps

with the largest slope and second derivative of its pieces, and the sums of the kinks (changes of slope) and steps
(changes of value) at the breaks between the positions. A rotation by a small vector w differs from none by at most
|w|, and its second derivatives by w are at most 2, so that bend <= bend(w) + change(w)^2 / 2.

Under TCP the rotary axes and the tool point move evenly, and the linear axes follow: Q = inverse(L) R^T (P - b), with
the directions L of the linear axes, the rotation R in front of them and the tool point b for linear axes at zero.

Shifts d of the axes displace the nominal tool point by J d, with its derivatives J somewhere between the two positions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.columns import ChainColumns, length, minus, vector
from kinematics.machine import Machine, NDArrayBool
from kinematics.pieces import ErrorMotions
from kinematics.transforms import Array

PATHS_OF_A_BLOCK = 32
"""Number of neighbouring paths that are bounded together at first."""


class Along(NamedTuple):
    """Bounds of a quantity along n paths, each `(n,)` or a number."""

    size: Array | float
    change: Array | float = 0.0
    bend: Array | float = 0.0

    def plus(self, other: Along) -> Along:
        """Bounds of a sum."""
        return Along(self.size + other.size, self.change + other.change, self.bend + other.bend)

    def times(self, other: Along) -> Along:
        """Bounds of a product."""
        return Along(
            self.size * other.size,
            self.change * other.size + self.size * other.change,
            self.bend * other.size + self.size * other.bend + self.change * other.change / 2.0,
        )


NOTHING = Along(0.0)


def turning(angle: Array | float) -> Along:
    """Bounds of a turn by an angle, rad, that changes evenly by so much."""
    return Along(1.0, angle, angle**2 / 4.0)


class _Stretches(NamedTuple):
    """Paths of the axes, or of several paths together; axis positions in mm and rad."""

    low: Array
    """Smallest positions `(axes, n)`."""
    high: Array
    way: Array
    """Largest changes of position along one path `(axes, n)`."""
    bend: Array
    """Bounds `(n,)`, mm, of the second differences of the linear axes."""
    reach: Array
    """Lengths of the tools `(n,)`, mm."""
    datum: Array
    """Sizes of the datum shifts `(n,)`, mm."""

    def joined(self) -> _Stretches:
        """TOGETHER neighbours as one."""
        first = np.arange(0, self.low.shape[1], PATHS_OF_A_BLOCK)
        most = (np.maximum.reduceat(column, first, axis=-1) for column in self[1:])
        return _Stretches(np.minimum.reduceat(self.low, first, axis=-1), *most)

    def rows(self, rows: np.ndarray) -> _Stretches:
        """Some of the paths."""
        return _Stretches(*(column[..., rows] for column in self))


def nominal_bends(
    machine: Machine, start: Array, end: Array, tool: Array, tcp: NDArrayBool, first: Array, last: Array
) -> tuple[Array, Array]:
    """Bounds `(n,)`, mm, of second differences of the nominal tool point, and of its displacement by shifts of axes.

    The shifts change evenly from `first` to `last` along paths from `start` to `end`, all `(n, axes)`, mm and rad. tool
    `(n, 3)`, mm. tcp `(n,)`: the tool point moves evenly with and without the shifts.
    """
    starts, ends, sizes, changes = (
        np.ascontiguousarray(each.T) for each in (start, end, np.maximum(np.abs(first), np.abs(last)), last - first)
    )
    point, moved = Along(length(vector(tool))), NOTHING
    for i in range(len(machine.axes) - 1, -1, -1):
        axis, shift = machine.axes[i], Along(sizes[i], np.abs(changes[i]))
        way = np.abs(ends[i] - starts[i]) + shift.change
        if not axis.rotary:
            farthest = np.maximum(np.abs(starts[i]), np.abs(ends[i])) + shift.size
            point, moved = point.plus(Along(farthest, way)), moved.plus(shift)
            continue
        turn, centre = turning(way), Along(float(np.linalg.norm(axis.point)))
        point, moved = turn.times(point.plus(centre)), turn.times(moved)
        if sizes[i].any():
            moved = moved.plus(shift.times(point))
        point = point.plus(centre)
    return np.where(tcp, 0.0, point.bend), np.where(tcp, 0.0, moved.bend)


class SecondDifferences:
    """Bounds for a machine with these error motions."""

    def __init__(self, motions: ErrorMotions) -> None:
        self.machine, self._motions = motions.machine, motions
        before = [{i for i in range(k) if self.machine.axes[i].rotary} for k in self.machine.translators]
        self._in_front = before[0] if all(these == before[0] for these in before) else None
        lines = np.array([self.machine.axes[k].unit_direction for k in self.machine.translators]).T
        self._lines, self._inverse = np.linalg.norm(lines, 2), np.linalg.norm(np.linalg.inv(lines), 2)

    def bounds(
        self,
        start: Array,
        end: Array,
        tool: Array,
        tcp: NDArrayBool,
        turned: NDArrayBool,
        datum: Array,
        least: float = 0.0,
    ) -> Array:
        """Bounds `(n,)`, mm, for paths between axis positions `(n, axes)`, mm and rad; infinite where none is known.

        tool `(n, 3)`, mm. tcp `(n,)`: the tool point moves evenly, otherwise all axes do. turned `(n,)`: the
        bound also holds for the error minus the datum shift `(n, 3)`, mm, along the linear axes. least: smallest
        bound, mm, that is returned: paths that keep it together with their neighbours are not looked at singly.
        """
        found = self._inside(start, end, tool, tcp, turned, datum, least)
        rows = np.flatnonzero(np.isinf(found))
        far = self._motions.far if len(rows) and self._in_front is not None else None
        if far is not None:
            moves = start[rows], end[rows], tool[rows], tcp[rows], turned[rows], datum[rows]
            found[rows] = SecondDifferences(far)._inside(*moves, least)
        return found

    def _inside(
        self,
        start: Array,
        end: Array,
        tool: Array,
        tcp: NDArrayBool,
        turned: NDArrayBool,
        datum: Array,
        least: float,
    ) -> Array:
        """As `bounds`; infinite also beyond the reach of the tables."""
        n = len(start)
        if not n or not self._motions.complete or self._in_front is None:
            return np.full(n, np.inf)
        low, high = (np.ascontiguousarray(ends.T) for ends in (np.minimum(start, end), np.maximum(start, end)))
        way, reach, size = high - low, np.broadcast_to(length(vector(tool)), n), np.linalg.norm(datum, axis=1)
        if tcp.any():
            front = turning(sum((way[i] for i in self._in_front), np.zeros(n)))
            bend = np.where(tcp, self._bend_under_tcp(start, end, tool, front), 0.0)
            return np.maximum(self._of(_Stretches(low, high, way, bend, reach, size), turned), least)
        stretches, found = _Stretches(low, high, way, np.zeros(n), reach, size), np.full(n, least)
        together = self._of(stretches.joined(), np.ones(-(-n // PATHS_OF_A_BLOCK), bool))
        rows = np.flatnonzero(np.repeat(together > least, PATHS_OF_A_BLOCK)[:n])
        if len(rows):
            found[rows] = np.maximum(self._of(stretches.rows(rows), turned[rows]), least)
        return found

    def _of(self, stretches: _Stretches, turned: NDArrayBool) -> Array:
        """Bounds `(n,)`, mm; turned `(n,)` as for `bounds`."""
        machine = self.machine
        low, high, way, bend, reach, datum = stretches
        n, held = len(bend), np.ones(len(bend), bool)
        front = turning(sum((way[i] for i in self._in_front or ()), np.zeros(n)))
        bends = [np.zeros(n) if axis.rotary else bend for axis in machine.axes]
        point, error = Along(reach), NOTHING
        own = self._motions.tool
        size = float(np.linalg.norm(own[:3])) + float(np.linalg.norm(own[3:])) * point.size
        point, error = point.plus(Along(size)), Along(size)
        for i in range(len(machine.axes) - 1, -1, -1):
            axis = machine.axes[i]
            centre, head = Along(float(np.linalg.norm(axis.point))), axis.side == "tool"
            turn = turning(way[i])
            farthest = np.maximum(np.abs(low[i]), np.abs(high[i])) + bends[i]
            moved = NOTHING if axis.rotary else Along(farthest, way[i] + bends[i], bends[i])
            point = point.plus(centre)
            if axis.rotary and head:
                point, error = turn.times(point), turn.times(error)
            if not head:
                point = point.plus(moved)
            if i in self._motions.tables:
                translation, w = self._along(i, (low[i], high[i]), way[i], bends[i], held)
                rotation = Along(w.size, w.change, w.bend + w.change**2 / 2.0)
                here = translation.plus(rotation.times(point))
                point, error = point.plus(here), error.plus(here)
            if axis.rotary and not head:
                point, error = turn.times(point), turn.times(error)
            if head:
                point = point.plus(moved)
            point = point.plus(centre)
        along_axes = front.times(error.plus(Along(datum))).bend * self._inverse
        return np.where(held, np.where(turned, np.maximum(along_axes, error.bend), error.bend), np.inf)

    def _along(
        self, i: int, ends: tuple[Array, Array], way: Array, bend: Array, held: NDArrayBool
    ) -> tuple[Along, Along]:
        """Bounds of the translations and the rotations of an axis along paths between its positions `ends`.

        held `(n,)` becomes false where the paths leave the reach of the tables.
        """
        away = self._motions.turns_away(i, *ends)
        low, high, curvatures = ends[0] - away, ends[1] - away, self._motions.curvatures[i]
        breaks = curvatures[0].breaks
        held &= (low - bend >= breaks[0]) & (high + bend <= breaks[-1])
        found = NOTHING, NOTHING
        for curvature in curvatures:
            translation, rotation = (Along(*bounds) for bounds in curvature.along(low, high, way, bend))
            found = found[0].plus(translation), found[1].plus(rotation)
        return found

    def _bend_under_tcp(self, start: Array, end: Array, tool: Array, front: Along) -> Array:
        """Bounds `(n,)`, mm, of the second difference of the linear axes."""
        machine, tip = self.machine, vector(tool)
        point = Along(length(tip) + np.zeros(len(start)))
        for i in range(len(machine.axes) - 1, -1, -1):
            axis, way = machine.axes[i], np.abs(end[:, i] - start[:, i])
            if axis.rotary:
                centre = Along(float(np.linalg.norm(axis.point)))
                point = turning(way).times(point.plus(centre)).plus(centre)
            elif i not in machine.translators:
                reach = np.maximum(np.abs(start[:, i]), np.abs(end[:, i]))
                point = point.plus(Along(reach, way))
        way = length(minus(ChainColumns(machine, end).point(tip), ChainColumns(machine, start).point(tip)))
        linear = np.linalg.norm(np.maximum(np.abs(start), np.abs(end))[:, list(machine.translators)], axis=1)
        change = way + point.change
        seen = Along(self._lines * linear + change / 2.0, change, point.bend)
        return np.asarray(self._inverse * front.times(seen).bend)
