"""Motion of a control along a path: at constant feed, stopping at corners, with limited acceleration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.nominal_path import CORNER_DEG, NominalPath
from kinematics.transforms import Array


class PathDynamics(NamedTuple):
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


class _Segments(NamedTuple):
    """Segments `k` of the path, each between two stops."""

    stops: Array
    """Distance along the path `(k + 1,)` of the stops, mm or deg."""
    peak: Array
    """Largest speed `(k,)`, mm/s or deg/s."""
    ramp: Array
    """Time `(k,)` to reach it, s."""
    lasting: Array
    """Duration `(k,)`, s."""


def duration(path: NominalPath, dynamics: PathDynamics) -> float:
    """Duration of a pass, s."""
    return float(_segments(path, dynamics).lasting.sum()) + 2.0 * dynamics.pause_s


def driven(path: NominalPath, dynamics: PathDynamics) -> Driven:
    """Motion of the axes along the path, from standstill at its start to standstill at its end."""
    stops, peak, ramp, lasting = _segments(path, dynamics)
    lengths = np.diff(stops)
    starts = dynamics.pause_s + np.concatenate([[0.0], np.cumsum(lasting)])
    time = np.arange(0.0, starts[-1] + dynamics.pause_s, 1.0 / dynamics.rate)
    segment = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(lengths) - 1)
    since = np.clip(time - starts[segment], 0.0, lasting[segment])
    left, up, a = lasting[segment] - since, ramp[segment], dynamics.acceleration
    speeding, slowing = since < up, left < up
    along = np.where(
        speeding,
        0.5 * a * since**2,
        np.where(slowing, lengths[segment] - 0.5 * a * left**2, peak[segment] * (since - 0.5 * up)),
    )
    at_rest = (since <= 0.0) | (left <= 0.0)
    speed = np.where(speeding, a * since, np.where(slowing, a * left, peak[segment]))
    change = np.where(at_rest, 0.0, np.where(speeding, a, np.where(slowing, -a, 0.0)))
    travelled = stops[segment] + along
    move = np.clip(np.searchsorted(path.feed_distance, travelled, side="right") - 1, 0, len(path.feed_distance) - 2)
    slopes = np.diff(path.positions, axis=0) / np.maximum(np.diff(path.feed_distance), 1e-12)[:, None]
    positions = path.positions[move] + (travelled - path.feed_distance[move])[:, None] * slopes[move]
    return Driven(time, positions, slopes[move] * speed[:, None], slopes[move] * change[:, None])


def _segments(path: NominalPath, dynamics: PathDynamics) -> _Segments:
    at = _stops(path)
    lengths = np.diff(path.feed_distance[at])
    feeds = np.where(path.feed_move[at[1:]], dynamics.feed, dynamics.rapid) / 60.0
    peak = np.minimum(feeds, np.sqrt(dynamics.acceleration * lengths))
    ramp = peak / dynamics.acceleration
    return _Segments(path.feed_distance[at], peak, ramp, lengths / peak + ramp)


def _stops(path: NominalPath) -> np.ndarray:
    """Vertices where the machine stops: ends, corners in axis positions, and changes between feed and rapid."""
    moves = np.diff(path.positions, axis=0) / np.where(path.machine.rotary, path.machine.scale, 1.0)
    directions = moves / np.maximum(np.linalg.norm(moves, axis=1, keepdims=True), 1e-12)
    turns = np.sum(directions[1:] * directions[:-1], axis=1) < np.cos(np.radians(CORNER_DEG))
    changes = path.feed_move[2:] != path.feed_move[1:-1]
    stops = np.concatenate([[0], np.flatnonzero(turns | changes) + 1, [len(path.feed_distance) - 1]])
    moved = np.diff(path.feed_distance[stops]) > 0.0  # a repeated position is no segment
    return np.compress(np.concatenate([[True], moved]), stops)
