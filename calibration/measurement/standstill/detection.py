"""Standstills in a tracker's stream of points: position, duration and scatter of each standstill of the target.

Readings are combined into medians over 25 ms. A standstill is an interval in which these stay within a radius and do
not creep. Interruptions of the beam and short disturbances do not end it if the target is at the same position after
them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError

BLOCK_S, BLOCK_READINGS = 0.025, 5
"""Duration of a block, s, and its least number of readings."""
SHORTEST_S = 0.2
"""Shortest duration of a standstill, s."""
STANDSTILL_RADIUS_MM = 0.02
"""Largest radius of a standstill, mm, unless the noise of the blocks is larger."""
OF_NOISE = 6.0
"""Radius of a standstill in standard deviations of a block's median."""
CREEP = 0.005
"""Speed, mm/s, up to which a target counts as at standstill."""
CREEPING_MM = 0.003
"""Drift within a standstill, mm, up to which it does not count as creeping."""
EXCURSION_MM = 0.5
"""Excursion between two standstills at one position, mm, below which it is a disturbance, not a move."""
GAP_READINGS = 5.0
"""Gap that interrupts the stream, in median intervals of the readings."""
SLOWEST = 0.1
"""Largest interval of readings, s."""
FROZEN = 20
"""Number of equal successive readings from which the beam counts as interrupted, if readings scatter."""
BATCHES = 10
"""Number of parts of a standstill, whose means give the scatter of the whole mean."""


class Stream(NamedTuple):
    """Readings of a tracker, in the order of time."""

    time: Array
    """Time `(n,)`, s."""
    points: Array
    """Points `(n, 3)`, mm, in the tracker's frame."""


@dataclass(frozen=True)
class Standstills:
    """Standstills, one row for each, in the order of time."""

    start: Array
    """Start of each standstill `(k,)`, s; `end`: its end."""
    end: Array
    points: Array
    """Mean points `(k, 3)`, mm."""
    scatter: Array
    """Standard uncertainty `(k,)`, mm, of each coordinate of the means, from the scatter of the readings and drift."""
    reading: np.ndarray
    """Index `(k,)` of the first reading."""

    def __len__(self) -> int:
        return len(self.start)

    @property
    def time(self) -> Array:
        """Middle of the standstills `(k,)`, s."""
        return (self.start + self.end) / 2.0


class Found(NamedTuple):
    """Standstills in a stream, and statistics of the readings."""

    standstills: Standstills
    creeping: list[str]
    """Descriptions of intervals of slow motion that could be taken for a standstill."""
    noise: float
    """Standard deviation of a coordinate of one reading, mm."""
    breaks: int
    """Number of interruptions of the beam."""
    dropped: int
    """Number of readings without a beam: all zero, or frozen."""


class _Blocks(NamedTuple):
    """Blocks `b` of readings, each replaced by its median."""

    time: Array
    points: Array
    reading: np.ndarray
    """Index of the first reading `(b,)`."""
    duration: float


class _Part(NamedTuple):
    """Range of successive blocks of one standstill; interruptions lie between parts."""

    first: int
    end: int


def find_standstills(stream: Stream, where: str, radius: float = STANDSTILL_RADIUS_MM) -> Found:
    """The standstills of a stream; UserError, naming `where`, if it is not a stream."""
    interval = _interval(stream, where)
    noise = _noise(stream.points)
    kept = np.flatnonzero(_with_beam(stream.points, noise))
    if len(kept) < BLOCK_READINGS:
        raise UserError(f"{where}: no reading has a beam")
    cuts = np.flatnonzero(np.diff(stream.time[kept]) > GAP_READINGS * interval) + 1
    blocks = _blocks(stream, kept, cuts, interval)
    if not len(blocks.time):
        raise UserError(f"{where}: no interval of {blocks.duration * 1e3:.0f} ms without an interruption of the beam")
    size = round(blocks.duration / interval)
    radius = max(radius, OF_NOISE * 1.25 * noise / size**0.5)
    standstills, creeping = [], []
    for parts in _merged(blocks, list(_at_rest(blocks, radius)), radius):
        rows = np.concatenate([np.arange(part.first, part.end) for part in parts])
        steady = _steady(blocks, rows)
        if len(steady):
            standstills.append(steady)
        elif _lasts(blocks, rows):
            start, end = blocks.time[rows[0]], blocks.time[rows[-1]]
            drift_mm = float(np.linalg.norm(_drift(blocks, rows)[0]))
            creeping.append(f"at {start:.2f} s: moves {drift_mm * 1e3:.0f} um in {end - start:.2f} s")
    return Found(_standstills(blocks, standstills), creeping, noise, len(cuts), len(stream.time) - len(kept))


def _interval(stream: Stream, where: str) -> float:
    """Median interval of the readings, s."""
    steps = np.diff(stream.time)
    if len(steps) < BLOCK_READINGS:
        raise UserError(f"{where}: {len(stream.time)} readings are too few for the stream of a tracker")
    if np.any(steps < 0.0):
        raise UserError(f"{where}: the time decreases after {stream.time[int(np.argmax(steps < 0.0))]:.3f} s")
    interval = float(np.median(steps))
    if interval <= 0.0:
        raise UserError(
            f"{where}: the resolution of the time is too coarse: most readings have the time of the reading before"
        )
    if interval > SLOWEST:
        raise UserError(
            f"{where}: one reading every {interval:.3g} s is too slow: the detection of standstills needs "
            f"{1 / SLOWEST:.0f} or more readings per second"
        )
    return interval


def _noise(points: Array) -> float:
    """Standard deviation, mm, of a coordinate of one reading, from second differences, which remove uniform motion."""
    second = points[2:] - 2.0 * points[1:-1] + points[:-2]
    return float(np.sqrt(np.mean(np.median(np.abs(second), axis=0) ** 2) / 6.0) / 0.6745)


def _with_beam(points: Array, noise: float) -> np.ndarray:
    """Mask `(n,)` of the measured readings: neither all zero nor a repeated last value."""
    beam = np.any(points != 0.0, axis=1)
    if noise == 0.0:
        return np.asarray(beam)
    same = np.concatenate([[False], np.all(points[1:] == points[:-1], axis=1)])
    if np.mean(same) > 0.2:
        return np.asarray(beam)
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, len(points)))
    return np.asarray(beam & ~(same & np.repeat(lengths >= FROZEN, lengths)))


def _blocks(stream: Stream, kept: np.ndarray, cuts: np.ndarray, interval: float) -> _Blocks:
    """Medians of readings with a beam, none across an interruption."""
    size = max(BLOCK_READINGS, round(BLOCK_S / interval))
    starts = [
        piece[: len(piece) // size * size].reshape(-1, size) for piece in np.split(kept, cuts) if len(piece) >= size
    ]
    rows = np.concatenate(starts) if starts else np.empty((0, size), int)
    points = np.median(stream.points[rows], axis=1) if len(rows) else np.empty((0, 3))
    return _Blocks(stream.time[rows].mean(axis=1), points, rows[:, 0], size * interval)


def _at_rest(blocks: _Blocks, radius: float) -> Iterator[_Part]:
    """Longest sequences of blocks within a radius and without interruption."""
    points, time = blocks.points.tolist(), blocks.time.tolist()
    first, low, high = 0, points[0], points[0]
    for i, point in enumerate(points):
        least, most = list(map(min, low, point)), list(map(max, high, point))
        broken = i > first and time[i] - time[i - 1] > 2.0 * blocks.duration
        if broken or any(b - a > 2.0 * radius for a, b in zip(least, most, strict=True)):
            yield _Part(first, i)
            first, least, most = i, point, point
        low, high = least, most
    yield _Part(first, len(points))


def _merged(blocks: _Blocks, parts: list[_Part], radius: float) -> Iterator[list[_Part]]:
    """Parts of each standstill: at one position, with only interruptions or disturbances between them."""
    current: list[_Part] = []
    for part in parts:
        if part.end - part.first < 2:
            continue
        if current and not _one_standstill(blocks, current[-1], part, radius):
            yield current
            current = []
        current.append(part)
    if current:
        yield current


def _one_standstill(blocks: _Blocks, before: _Part, after: _Part, radius: float) -> bool:
    centre = np.median(blocks.points[before.first : before.end], axis=0)
    again = np.median(blocks.points[after.first : after.end], axis=0)
    between = blocks.points[before.end : after.first]
    near = float(np.linalg.norm(again - centre)) < radius
    return near and bool(np.all(np.linalg.norm(between - centre, axis=1) < EXCURSION_MM))


def _lasts(blocks: _Blocks, rows: np.ndarray) -> bool:
    return len(rows) * blocks.duration >= SHORTEST_S


def _steady(blocks: _Blocks, rows: np.ndarray) -> np.ndarray:
    """Blocks of a standstill without the ends in which the target settles or moves; none if it creeps."""
    rows = rows[1:-1]
    for share in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5):
        cut = int(share * len(rows))
        for kept in (rows[cut:], rows[: len(rows) - cut]):
            if not _lasts(blocks, kept):
                return np.empty(0, int)
            drift, u = _drift(blocks, kept)
            drift_mm, time = float(np.linalg.norm(drift)), float(blocks.time[kept[-1]] - blocks.time[kept[0]])
            if drift_mm <= max(3.0 * u, CREEPING_MM, CREEP * time):
                return kept
    return np.empty(0, int)


def _drift(blocks: _Blocks, rows: np.ndarray) -> tuple[Array, float]:
    """Displacement `(3,)`, mm, of a linear motion fitted to the blocks, from first to last, and its uncertainty, mm."""
    time = blocks.time[rows]
    from_middle = time - time.mean()
    square = float(from_middle @ from_middle)
    slope = from_middle @ blocks.points[rows] / square
    left = blocks.points[rows] - blocks.points[rows].mean(axis=0) - from_middle[:, None] * slope
    u = float(np.sqrt(np.sum(left**2) / max(len(rows) - 2, 1) / square))
    span = float(time[-1] - time[0])
    return slope * span, u * span


def _standstills(blocks: _Blocks, standstills: list[np.ndarray]) -> Standstills:
    half = blocks.duration / 2.0
    return Standstills(
        np.array([blocks.time[rows[0]] - half for rows in standstills]),
        np.array([blocks.time[rows[-1]] + half for rows in standstills]),
        np.array([blocks.points[rows].mean(axis=0) for rows in standstills]).reshape(-1, 3),
        np.array([_scatter(blocks, rows) for rows in standstills]),
        np.array([blocks.reading[rows[0]] for rows in standstills], int),
    )


def _scatter(blocks: _Blocks, rows: np.ndarray) -> float:
    """Standard uncertainty, mm, of each coordinate of the mean, from the means of parts and the drift."""
    parts = np.array([part.mean(axis=0) for part in np.array_split(blocks.points[rows], min(BATCHES, len(rows)))])
    of_mean = float(np.mean(parts.var(axis=0, ddof=1))) / len(parts)
    drift_mm, u = _drift(blocks, rows)
    drift = max(float(drift_mm @ drift_mm) - u**2, 0.0) / 3.0
    return float(np.sqrt(of_mean + drift / 12.0))
