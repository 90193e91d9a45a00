"""The circles of the arcs of a chunk as columns, positions along them, and their centres with new ends."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from kinematics.transforms import TURN_RAD, Array
from postproc.motion.circles import RADIUS_DIFFERENCE_MM, RADIUS_TOLERANCE_MM, SAME_POINT_MM, SHORT_ARC
from postproc.motion.moves import Arc


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
        once = np.where(full > 0, TURN_RAD, (sense * (np.arctan2(v, u) - np.arctan2(y, x))) % TURN_RAD)
        begun = np.hypot(x, y)
        grown = np.divide(np.hypot(u, v), begun, out=np.ones(len(rows)), where=begun > 0.0)
        turned = sense * (once + turns * TURN_RAD)
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


def sweeps(start: np.ndarray, end: np.ndarray, centre: np.ndarray, sense: Array) -> Array:
    """Sweeps `(k,)`, rad, of arcs that are no full circles, as `sweep`; points `(k,)` are complex numbers."""
    return np.asarray(sense * ((sense * (np.angle(end - centre) - np.angle(start - centre))) % TURN_RAD))


def centres_by_radius(start: np.ndarray, end: np.ndarray, radius: Array, sense: Array) -> np.ndarray:
    """Centres `(k,)` of arcs with these radii, as `centre_from_radius`: complex numbers, nan where there is none."""
    chord = np.abs(end - start)
    none = (
        (radius == 0.0)
        | (chord < SAME_POINT_MM)
        | (chord / 2 > np.abs(radius) + RADIUS_TOLERANCE_MM)
        | np.isnan(radius)
    )
    height = np.sqrt(np.maximum(0.0, radius * radius - chord * chord / 4)) * sense * np.copysign(1.0, radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(none, np.nan, (start + end) / 2 + 1j * height * (end - start) / chord))


Shifts = tuple[np.ndarray, np.ndarray, np.ndarray]


def moved_centres(ends: tuple[np.ndarray, np.ndarray], centre: np.ndarray, turned: Array, shifts: Shifts) -> np.ndarray:
    """Centres `(k,)` of arcs after the shifts of their starts, middles and ends, as `moved_centre`; complex numbers."""
    start, end = ends
    first, last = np.abs(start - centre), np.abs(end - centre)
    turned = np.clip(turned, -TURN_RAD, TURN_RAD)
    mean = (shifts[0] + shifts[2]) / 4 + shifts[1] / 2
    pointed = (first > 0.0) & (last > 0.0)
    u, v = (start - centre) / np.where(pointed, first, 1.0), (end - centre) / np.where(pointed, last, 1.0)
    w = u * np.exp(0.5j * turned)
    out = [_dot(d, shift - mean) for d, shift in zip((u, w, v), shifts, strict=True)]
    across = (out[1] - (out[0] + out[2]) / 2) / np.maximum(1.0 - np.cos(turned / 2), SHORT_ARC)
    n = u - v
    excess = across * _dot(n, w) - out[0] + out[2]
    square = n.real**2 + n.imag**2
    square = np.where(np.abs(turned) > np.pi, np.maximum(square, 1.0), square)
    root, divisor = np.sqrt(square), np.where(square > 0.0, square, 1.0)
    far = (np.abs(excess) > RADIUS_DIFFERENCE_MM) & (np.abs(excess) < root * np.minimum(first, last))
    moved = centre + mean + across * w - np.where(far, excess / divisor, 0.0) * n
    largest = np.max(np.abs(np.stack(shifts)), axis=0)
    left = np.abs(start + shifts[0] - moved) - np.abs(end + shifts[2] - moved) - (first - last)
    far = (np.abs(left) > RADIUS_DIFFERENCE_MM) & (np.abs(left) < root * largest)
    return np.where(pointed, moved + np.where(far, left / divisor, 0.0) * n, centre + mean)


def _dot(a: np.ndarray, b: np.ndarray) -> Array:
    """Scalar products `(k,)` of vectors that are complex numbers."""
    return np.asarray(a.real * b.real + a.imag * b.imag)
