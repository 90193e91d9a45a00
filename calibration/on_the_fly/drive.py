"""Motion of a control along a path: at constant feed, stopping at corners, with limited acceleration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.nominal_path import CORNER_DEG, NominalPath
from kinematics.transforms import Array


class Manner(NamedTuple):
    """Dynamics of the motion, and the rate of the readings."""

    feed: float
    """Feed, mm/min; deg/min where only rotary axes move."""
    acceleration: float = 1000.0
    """Acceleration along the path, mm/s2 (deg/s2)."""
    rate: float = 500.0
    """Rate of the readings, 1/s."""
    pause_s: float = 1.0
    """Standstill at the start and at the end, s."""
    rapid: float = 15_000.0
    """Feed of rapid moves, mm/min."""


class Driven(NamedTuple):
    """Motion of the axes, one row per instant `n`."""

    time: Array
    """Time `(n,)`, s."""
    positions: Array
    """Axis positions `(n, axes)`, mm and rad."""
    velocity: Array
    """Velocity `(n, axes)`, mm/s and rad/s."""
    acceleration: Array
    """Acceleration `(n, axes)`, mm/s2 and rad/s2."""


class _Stretches(NamedTuple):
    """Segments `k` of the path, each between two stops."""

    stops: Array
    """Distance along the path `(k + 1,)` of the stops, mm or deg."""
    peak: Array
    """Largest speed `(k,)`, mm/s or deg/s."""
    ramp: Array
    """Time `(k,)` to reach it, s."""
    lasting: Array
    """Duration `(k,)`, s."""


def duration(path: NominalPath, manner: Manner) -> float:
    """Duration of a pass, s."""
    return float(_stretches(path, manner).lasting.sum()) + 2.0 * manner.pause_s


def driven(path: NominalPath, manner: Manner) -> Driven:
    """Motion of the axes along the path, from standstill at its start to standstill at its end."""
    stops, peak, ramp, lasting = _stretches(path, manner)
    lengths = np.diff(stops)
    begins = manner.pause_s + np.concatenate([[0.0], np.cumsum(lasting)])
    time = np.arange(0.0, begins[-1] + manner.pause_s, 1.0 / manner.rate)
    stretch = np.clip(np.searchsorted(begins, time, side="right") - 1, 0, len(lengths) - 1)
    since = np.clip(time - begins[stretch], 0.0, lasting[stretch])
    left, up, a = lasting[stretch] - since, ramp[stretch], manner.acceleration
    speeding, slowing = since < up, left < up
    along = np.where(
        speeding,
        0.5 * a * since**2,
        np.where(slowing, lengths[stretch] - 0.5 * a * left**2, peak[stretch] * (since - 0.5 * up)),
    )
    stands = (since <= 0.0) | (left <= 0.0)
    speed = np.where(speeding, a * since, np.where(slowing, a * left, peak[stretch]))
    change = np.where(stands, 0.0, np.where(speeding, a, np.where(slowing, -a, 0.0)))
    way = stops[stretch] + along
    piece = np.clip(np.searchsorted(path.way, way, side="right") - 1, 0, len(path.way) - 2)
    slopes = np.diff(path.positions, axis=0) / np.maximum(np.diff(path.way), 1e-12)[:, None]
    positions = path.positions[piece] + (way - path.way[piece])[:, None] * slopes[piece]
    return Driven(time, positions, slopes[piece] * speed[:, None], slopes[piece] * change[:, None])


def _stretches(path: NominalPath, manner: Manner) -> _Stretches:
    at = _stops(path)
    lengths = np.diff(path.way[at])
    feeds = np.where(path.counts[at[1:]], manner.feed, manner.rapid) / 60.0
    peak = np.minimum(feeds, np.sqrt(manner.acceleration * lengths))
    ramp = peak / manner.acceleration
    return _Stretches(path.way[at], peak, ramp, lengths / peak + ramp)


def _stops(path: NominalPath) -> np.ndarray:
    """Vertices where the machine stops: ends, corners in axis positions, and changes between feed and rapid."""
    moves = np.diff(path.positions, axis=0) / np.where(path.machine.rotary, path.machine.scale, 1.0)
    directions = moves / np.maximum(np.linalg.norm(moves, axis=1, keepdims=True), 1e-12)
    turns = np.sum(directions[1:] * directions[:-1], axis=1) < np.cos(np.radians(CORNER_DEG))
    changes = path.counts[2:] != path.counts[1:-1]
    return np.concatenate([[0], np.flatnonzero(turns | changes) + 1, [len(path.way) - 1]])
