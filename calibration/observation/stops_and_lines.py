"""Units of information of a measurement, from the order of its rows: stops, lines of stops, cycles.

- Stop: rows in sequence at one position of all axes, in one set-up and run. They share the machine's error there.
- Line: successive stops on one straight line, along an axis or across several; out and back, and a later pass over the
  same positions, are the same line.
- Cycle: a pass over the targets of one axis and its return (ISO 230-2).

Rows of one unit predict each other, so that only whole units can be held out of a fit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.registration.derived import derived
from kinematics.transforms import Array

ON_LINE_SHARE = 1e-3
"""Distance from a line, as a share of the range of each axis, within which positions lie on it."""
LEAST_OF_LINE = 4
"""Smallest number of positions of a line; one fewer where such lines hold half of the positions (small grids)."""
REGIONS, MOST_LINE_BLOCKS = 8, 16
"""Number of regions of positions off the lines, and most blocks of lines beside them."""
LEAST_OF_REGION = 4
"""Smallest number of positions of a region beside lines; fewer positions are never held out."""
LEAST_BLOCKS, MOST_BLOCKS = 3, 24
"""Fewer lines do not predict each other; more lines, or cycles, are grouped."""
LEAST_CYCLES = 2
"""Each cycle visits all targets, so that two predict each other."""
STRETCHES = 64
"""Stretches into which the positions of a continuous record along one axis are divided."""


@derived
def lines(measurement: Measurement) -> np.ndarray:
    """Numbers `(n,)` of the lines, from 0 in the order of their first rows; -1 for rows on no line."""
    visit = np.cumsum(measurement.moved) - 1
    first = np.unique(visit, return_index=True)[1]
    return np.asarray(_lines_of(_in_tolerances(measurement)[first])[visit])


def cycles(measurement: Measurement) -> np.ndarray:
    """Numbers `(n,)` of the cycles, from 0 for each axis that is observed by itself, else for all rows.

    These are its runs; where an axis has one run, a cycle ends before a position recurs in the same direction.
    """
    found = np.zeros(len(measurement), int)
    for rows in measurement.axis_rows.values() or [np.arange(len(measurement))]:
        run = np.zeros(len(rows), int) if measurement.run is None else _numbered(measurement.run[rows])
        found[rows] = run if run.max() else _recurring(measurement.rows(rows))
    return found


@derived
def held_out_blocks(measurement: Measurement) -> tuple[np.ndarray, str]:
    """Labels `(n,)` of the blocks of rows to be held out of a fit, -1 for rows of none; and their name, plural.

    Where axes are observed by themselves, cycles, if each axis has two or more, else sets of positions. Elsewhere
    lines, where the others cover their axes, and regions of the other positions, each with all visits. Lines are
    grouped where there are more than MOST_BLOCKS.
    """
    if of_axes := measurement.axis_rows.values():
        cycle = cycles(measurement)
        fewest = min(cycle[rows].max() + 1 for rows in of_axes)
        if fewest >= LEAST_CYCLES:
            return cycle % MOST_BLOCKS, "cycles"
        return _sets_of_positions(measurement), "sets of positions"
    line, positions = lines(measurement), _in_tolerances(measurement)
    line = np.where(np.isin(line, _predictable(line, positions)), line, -1)
    known = np.unique(line[line >= 0])
    loose = np.flatnonzero(line < 0)
    if len(known) < LEAST_BLOCKS:
        return _regions(positions, REGIONS), "regions of stops"
    regions = min(REGIONS, len(np.unique(positions[loose], axis=0)) // LEAST_OF_REGION)
    labels = np.full(len(line), -1)
    labels[line >= 0] = np.searchsorted(known, line[line >= 0]) % (MOST_LINE_BLOCKS if regions else MOST_BLOCKS)
    if not regions:
        return labels, "lines"
    labels[loose] = _regions(positions[loose], regions) + labels.max() + 1
    return labels, "lines and regions of stops"


@derived
def _in_tolerances(measurement: Measurement) -> Array:
    """Positions `(n, moving)` of the axes that move, in tolerances of a line, rounded to equal ones where the same."""
    positions = np.round(measurement.positions_in_tolerances)
    ranges = np.ptp(positions, axis=0) if len(positions) else np.zeros(positions.shape[1])
    return np.asarray(positions[:, ranges > 1.0] / (ON_LINE_SHARE * ranges[ranges > 1.0]))


def _numbered(names: np.ndarray) -> np.ndarray:
    """Numbers `(n,)` of names, from 0 in the order of their first rows."""
    _, first, number = np.unique(names, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[number.reshape(-1)])


class _Lines(NamedTuple):
    """Straight lines through positions, in tolerances."""

    centre: Array
    """`(k, d)`"""
    direction: Array
    """`(k, d)`"""

    @classmethod
    def through(cls, points: Array) -> _Lines:
        """One line, through points `(m, d)`."""
        centre = points.mean(axis=0)
        return cls(centre[None], np.linalg.svd(points - centre, full_matrices=False)[2][:1])

    def along(self, points: Array) -> Array:
        """Distances `(k, m)` of points from the centres along the lines."""
        return np.asarray(self.direction @ points.T - np.sum(self.direction * self.centre, axis=1)[:, None])

    def distances(self, points: Array) -> Array:
        """Distances `(k, m)` of points from the lines."""
        squares = np.sum((points[None] - self.centre[:, None]) ** 2, axis=2) - self.along(points) ** 2
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    def joined(self, other: _Lines) -> _Lines:
        """These lines and other ones."""
        return _Lines(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def _lines_of(points: Array) -> np.ndarray:
    """Numbers `(v,)` of the lines through successive points `(v, d)`; -1 for points on none."""
    found = np.full(len(points), -1)
    segments = _segments(points)
    most = sum(len(part) for part in segments)
    least = LEAST_OF_LINE - 1 if 2 * most >= len(points) else LEAST_OF_LINE
    known = _Lines(*np.zeros((2, 0, points.shape[1])))
    for part in segments:
        line = _Lines.through(points[part])
        along = line.along(points[part])[0]
        if len(np.unique(np.round(along))) < least or line.distances(points[part]).max() > 1.0:
            continue
        ends = points[part][[int(np.argmin(along)), int(np.argmax(along))]]
        same = np.flatnonzero(known.distances(ends).max(axis=1) <= 2.0)
        if not len(same):
            known = known.joined(line)
        found[part] = same[0] if len(same) else len(known.centre) - 1
    loose = np.flatnonzero(found < 0)  # single visits of a position of a line
    if len(loose) and len(known.centre):
        along, own = known.along(points[loose]), known.along(points)
        ends = np.array([[own[k, found == k].min(), own[k, found == k].max()] for k in range(len(own))])
        on_it = (known.distances(points[loose]) <= 1.0) & (along >= ends[:, :1] - 1.0) & (along <= ends[:, 1:] + 1.0)
        found[loose] = np.where(on_it.any(axis=0), np.argmax(on_it, axis=0), -1)
    return found


def _segments(points: Array) -> list[np.ndarray]:
    """Indices of runs of three or more successive points `(v, d)`, each in line with its neighbours."""
    steps = np.diff(points, axis=0)
    first, second = steps[:-1], steps[1:]
    squares = np.sum(first**2, axis=1), np.sum(second**2, axis=1)
    area = np.maximum(squares[0] * squares[1] - np.sum(first * second, axis=1) ** 2, 0.0)
    straight = np.append(False, np.append(np.sqrt(area) <= np.sqrt(np.maximum(*squares)), False))[: len(points)]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], straight.astype(int), [0]])))
    return [np.arange(start - 1, end + 1) for start, end in edges.reshape(-1, 2).tolist()]


def _predictable(line: np.ndarray, positions: Array) -> list[int]:
    """Numbers of the lines along which the rows off the line have positions of every axis that moves in it.

    That is at least half as many positions as the line has, within its ends.
    """
    covered = np.ones(line.max(initial=-1) + 1, bool)
    order = np.argsort(line, kind="stable")
    parts = np.split(order, np.searchsorted(line[order], np.arange(len(covered) + 1)))[1:-1]
    for values in np.round(positions).T:
        levels, level = np.unique(values, return_inverse=True)
        rows = np.bincount(level)
        for number, part in enumerate(parts):
            own = np.bincount(level[part], minlength=len(levels))
            inside = slice(level[part].min(), level[part].max() + 1)
            if levels[inside][-1] - levels[inside][0] > 2.0:
                others = np.count_nonzero(rows[inside] > own[inside])
                covered[number] &= 2 * others >= np.count_nonzero(own)
    return np.flatnonzero(covered).tolist()


def _regions(positions: Array, most: int) -> np.ndarray:
    """Labels `(n,)` of at most so many regions of the positions `(n, d)`, halved again and again."""
    labels = np.zeros(len(positions), int)
    shares = positions / np.maximum(np.ptp(positions, axis=0), 1e-9) if positions.size else positions
    while shares.size and 2 * (before := labels.max() + 1) <= most:
        for label in range(before):
            rows = np.flatnonzero(labels == label)
            widest = shares[rows, int(np.argmax(np.ptp(shares[rows], axis=0)))]
            # a value that most rows have is their median
            middle = next((m for m in map(np.median, (widest, np.unique(widest))) if (widest > m).any()), np.inf)
            upper = rows[widest > middle]
            if len(upper):
                labels[upper] = labels.max() + 1
        if labels.max() + 1 == before:  # fewer positions than regions
            break
    return labels


def _recurring(measurement: Measurement) -> np.ndarray:
    """Cycle `(n,)` of rows along one axis: a new one begins where a position recurs in the same direction."""
    along = _in_tolerances(measurement)
    found, number = np.zeros(len(along), int), 0
    if not along.size:
        return found
    seen: set[tuple[float, float]] = set()
    before: tuple[float, float] | None = None
    keys = zip(along[:, 0].tolist(), _directions(measurement).tolist(), strict=True)
    for row, key in enumerate(keys):
        if key != before and key in seen:
            number, seen = number + 1, set()
        seen.add(key)
        before = key
        found[row] = number
    return found


def _directions(measurement: Measurement) -> Array:
    """Direction `(n,)` of the pass of each row: of the move to its stop, or from it for the later rows of a stop."""
    along, stop = _in_tolerances(measurement)[:, 0], measurement.stops
    _, first, count = np.unique(stop, return_index=True, return_counts=True)
    moves = np.sign(np.diff(along[first]))
    came, goes = np.append(0.0, moves), np.append(moves, 0.0)
    came = np.where(came == 0.0, goes, came)
    if measurement.state.approach is not None:
        axis = int(np.argmax(np.ptp(measurement.state.positions, axis=0)))
        stated = measurement.state.approach[first, axis]
        came = np.where(stated == 0.0, came, stated)
    goes = np.where(goes == 0.0, came, goes)
    later = np.arange(len(along)) - first[stop] >= count[stop] / 2.0 - 0.5 * (count[stop] == 1)
    return np.asarray(np.where(later, goes[stop], came[stop]))


def _sets_of_positions(measurement: Measurement) -> np.ndarray:
    """Labels `(n,)` along each measured axis: every eighth position, or every eighth stretch of many positions."""
    labels = np.zeros(len(measurement), int)
    for name, rows in measurement.axis_rows.items():
        position = np.round(measurement.positions_in_tolerances[rows, measurement.machine.index(name)])
        number = np.unique(position, return_inverse=True)[1].reshape(-1)
        distinct = number.max() + 1
        labels[rows] = (number * STRETCHES // distinct if distinct > 2 * STRETCHES else number) % REGIONS
    return labels
