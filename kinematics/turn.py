"""The turn of a rotary axis: positions a whole turn apart are one pose, and so have one error.

This holds for the axes with `Axis.turns_fully`. An error motion of such an axis is known on an *arc* of the turn,
the interval of its basis. `columns_of` makes its functions repeat with the turn:

- harmonics repeat by themselves;
- a table or spline over a whole turn has at its seam the mean of its two ends; of any other basis the difference of its
  ends is taken off at the upper end, and in proportion from the lower end on, where it stays as it is: the misclosure
  of a full turn is no property of the axis;
- across an arc that was not measured, the errors go in a straight line from one end of the measured arc to the other,
  so that they stay between two measured values. `spread_beyond` states how far they may really be from it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinematics.basis import Basis, BSpline, Harmonics, Interval
from kinematics.machine import TURN_DEG, Axis
from kinematics.transforms import Array, read_only

CLOSED = 10.0
"""Degrees: a part of the turn that is no wider counts as measured with its neighbours."""
SEAM = 1.0
"""Degrees: across a part of the turn that is no wider, ends that differ are misclosure, not a change of the error."""
SPACING = 1.5
"""A gap between positions counts as measured too when it is no wider than so many times the next smaller one."""
SPREAD_HARMONIC = 2.0
"""Highest harmonic that is assumed for errors in an unmeasured range."""


def measured_arc(positions: Array) -> Interval:
    """The arc of the turn that positions `(n,)`, degrees, cover: all but the widest gap between neighbours.

    It counts upward from its lower end, which is one of the positions; a whole turn if no gap is distinct.
    """
    x = np.asarray(positions, float)
    turned, first = np.unique(np.round(np.mod(x, TURN_DEG), 9) % TURN_DEG, return_index=True)
    gaps = np.diff(np.append(turned, turned[0] + TURN_DEG))
    widest = int(np.argmax(gaps))
    others = np.delete(gaps, widest)
    low = round(float(x[first[(widest + 1) % len(turned)]]), 9)
    if len(others) and gaps[widest] <= max(CLOSED, SPACING * others.max()):
        start = round(float(x.min()), 9)
        return start, start + TURN_DEG
    return low, round(low + TURN_DEG - float(gaps[widest]), 9)


def swept_arc(low: float, high: float) -> Interval:
    """The arc of the turn that a motion from one position to another, degrees, sweeps; a whole turn where it counts."""
    return (low, low + TURN_DEG) if high - low >= TURN_DEG - CLOSED else (low, high)


def gap_of(arc: Interval) -> float:
    """Width of the part of the turn, degrees, that was not measured; 0 where the turn counts as measured all round."""
    gap = TURN_DEG - (arc[1] - arc[0])
    return gap if gap > CLOSED else 0.0


def beyond(arc: Interval, x: Array) -> Array:
    """Distance of positions `(n,)` from the measured arc, degrees along the turn to its nearer end."""
    if not gap_of(arc):
        return np.zeros(len(x))
    along, width = np.mod(x - arc[0], TURN_DEG), arc[1] - arc[0]
    return np.asarray(np.maximum(np.minimum(along - width, TURN_DEG - along), 0.0))


def columns_of(axis: Axis, basis: Basis, x: Array) -> Array:
    """Basis functions `(n, size)` at positions `(n,)`, mm or degrees, of an axis; they repeat if it turns fully."""
    if not axis.turns_fully or isinstance(basis, Harmonics):
        return np.asarray(basis.columns(x))
    low, high = basis.interval
    along, gap = np.mod(x - low, TURN_DEG), TURN_DEG - (high - low)
    if gap > SEAM:
        first, last = _at(basis, low, high)
        share = np.clip((along - (high - low)) / gap, 0.0, 1.0)
        return np.asarray(basis.columns(np.minimum(low + along, high)) + share[:, None] * (first - last))
    turns = max(round((high - low) / TURN_DEG), 1)
    every = [basis.columns(low + along + k * TURN_DEG) for k in range(turns)]
    columns = np.asarray(np.mean(every, axis=0))
    if isinstance(basis, BSpline) and abs(gap) <= SEAM:
        columns[:, [0, -1]] = columns[:, [0, -1]].mean(axis=1, keepdims=True)
        return columns
    first, last = _at(basis, low, low + turns * TURN_DEG)
    return np.asarray(columns - (along / TURN_DEG)[:, None] * (last - first) / turns)


@lru_cache(maxsize=1024)
def _at(basis: Basis, low: float, high: float) -> Array:
    """Basis functions `(2, size)` at two positions, degrees: the same in every evaluation of an error."""
    return read_only(np.asarray(basis.columns(np.array([low, high]))))


def spread_beyond(arc: Interval, x: Array) -> Array:
    """Standard deviation `(n,)` of an error from the line across the unmeasured arc, as a share of its typical size.

    The rise of the harmonic BENDING over its chord across the gap, and 1 where the gap holds a quarter of its wave on
    either side.
    """
    half = np.deg2rad(SPREAD_HARMONIC * min(gap_of(arc), TURN_DEG / 2 / SPREAD_HARMONIC) / 2)
    inward = np.minimum(np.deg2rad(SPREAD_HARMONIC * beyond(arc, x)), half)
    return np.asarray(np.cos(half - inward) - np.cos(half))


def knots_of(axis: Axis, basis: Basis, low: float, high: float) -> list[float]:
    """Positions from `low` to `high`, mm or degrees, between which the functions of `columns_of` are smooth."""
    if isinstance(basis, Harmonics):
        return []
    nodes = basis.nodes if isinstance(basis, BSpline) else basis.interval
    if not axis.turns_fully:
        return list(nodes)
    first = basis.interval[0]
    turns = np.arange(np.floor((low - first) / TURN_DEG), np.ceil((high - first) / TURN_DEG) + 1.0)
    within = first + np.mod(np.array([*nodes, first]) - first, TURN_DEG)
    return [float(x) for x in (within[:, None] + TURN_DEG * turns).ravel() if low < x < high]
