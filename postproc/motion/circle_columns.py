"""The circles of the arcs of a chunk as columns, and positions along them."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from kinematics.transforms import Array
from postproc.motion.moves import Arc

TURN = 2.0 * np.pi


class CircleColumns(msgspec.Struct, frozen=True):
    """Arcs in their planes; columns `(k,)`, lengths in mm, programmed coordinates."""

    rows: np.ndarray
    """Rows of the arcs, in increasing order."""
    first: np.ndarray
    second: np.ndarray
    """Columns of the first and second axis of the plane."""
    from_centre: tuple[Array, Array]
    """Start, seen from the centre."""
    centre: tuple[Array, Array]
    turned: Array
    """Sweep, rad, positive counter-clockwise."""
    grown: Array
    """Radius at the end by that at the start."""
    turns: np.ndarray
    """Whole turns of helices."""

    @classmethod
    def of(cls, arcs: Mapping[int, Arc], start: Array, target: Array) -> CircleColumns:
        """The circles of arcs, by row; start, target `(n, axes)`."""
        rows = np.array(sorted(arcs), int)
        found = [arcs[row] for row in rows.tolist()]
        first, second = np.array([arc.plane[:2] for arc in found], int).reshape(-1, 2).T
        centre = np.array([arc.centre for arc in found], float).reshape(-1, 2).T
        sense, full, turns = np.array([(arc.sense, arc.full, arc.turns) for arc in found], int).reshape(-1, 3).T
        x, y = (start[rows, axis] - at for axis, at in zip((first, second), centre, strict=True))
        u, v = (target[rows, axis] - at for axis, at in zip((first, second), centre, strict=True))
        once = np.where(full > 0, TURN, (sense * (np.arctan2(v, u) - np.arctan2(y, x))) % TURN)
        begun = np.hypot(x, y)
        grown = np.divide(np.hypot(u, v), begun, out=np.ones(len(rows)), where=begun > 0.0)
        turned = sense * (once + turns * TURN)
        for column in (rows, first, second, x, y, centre, turned, grown, turns):
            column.flags.writeable = False
        return cls(rows, first, second, (x, y), (centre[0], centre[1]), turned, grown, turns)

    @property
    def lengths(self) -> Array:
        """Lengths of the arcs in their planes."""
        return np.asarray(np.hypot(*self.from_centre) * np.abs(self.turned))

    @property
    def out_of_round(self) -> Array:
        """Differences of the radii at both ends, mm."""
        return np.asarray(np.hypot(*self.from_centre) * np.abs(self.grown - 1.0))

    @property
    def nearly_full(self) -> np.ndarray:
        """Arcs of more than half a turn whose ends are closer together than a radius, as for `between`."""
        return np.asarray(np.cos(self.turned) > 0.5) & (np.abs(self.turned) > np.pi)

    def put(self, program: Array, shares: Array | float) -> None:
        """Put positions at shares `(k,)` of the arcs into their rows of `program` `(n, axes)`."""
        self._put(program, self.rows, np.arange(len(self.rows)), shares)

    def put_some(self, program: Array, rows: np.ndarray, shares: Array) -> None:
        """The same for positions `(m, axes)` at shares `(m,)` of moves `rows` `(m,)`, some of which are arcs."""
        arcs = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        some = np.flatnonzero(self.rows[arcs] == rows)
        self._put(program, some, arcs[some], shares[some])

    def _put(self, program: Array, cells: np.ndarray, arcs: np.ndarray, shares: Array | float) -> None:
        """If the radii at the two ends of an arc differ, the radius changes linearly between them."""
        angle = shares * self.turned[arcs]
        grown = 1.0 + shares * (self.grown[arcs] - 1.0)
        (x, y), (c, s) = (of[arcs] for of in self.from_centre), (np.cos(angle), np.sin(angle))
        program[cells, self.first[arcs]] = self.centre[0][arcs] + grown * (c * x - s * y)
        program[cells, self.second[arcs]] = self.centre[1][arcs] + grown * (s * x + c * y)
