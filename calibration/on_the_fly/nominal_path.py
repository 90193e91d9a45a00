"""The programmed path: as columns of axis positions, and as the path of one target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.registration.observed_points import derivatives_by_positions
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

PATH_SEGMENT_DEG = 0.25
"""Largest rotation between two points by which the path length of a target is measured, degrees."""
STORED_STEPS, SHORTEST_STORED_STEP_MM = 40_000, 0.2
"""Number of equal steps in which the path of a target is stored; shortest step, mm."""
CORNER_DEG = 1.0
"""Change of direction, degrees, above which a path has a corner."""
STANDSTILL_TARGET_MM = 1e-6
"""Distance, mm, below which a target does not move."""


@dataclass(frozen=True)
class NominalPath:
    """Vertices `m` in the order of the path; axis positions are linear between two of them."""

    machine: Machine
    """The machine."""
    positions: Array
    """Axis positions `(m, axes)`, mm and rad."""
    feed_distance: Array
    """Distance that the feed refers to `(m,)`, from 0: mm of the linear axes together, degrees of rotary axes alone."""
    feed_move: np.ndarray
    """True `(m,)` where the move to the vertex is a feed move; the path of a rapid move is unknown."""
    source: str = ""
    """Name of the program."""
    fingerprint: str = ""
    """Fingerprint of the program."""
    notes: tuple[str, ...] = ()
    """Notes on the program."""

    @property
    def ends(self) -> Array:
        """Smallest and largest positions `(2, axes)`, mm and rad."""
        return np.stack([self.positions.min(axis=0), self.positions.max(axis=0)])


class Located(NamedTuple):
    """Positions on the path of a target."""

    points: Array
    """Points `(n, 3)`, mm, in the frame to which the instrument is fixed."""
    tangents: Array
    """Unit vectors `(n, 3)`."""


@dataclass(frozen=True)
class TargetPath:
    """The path of one target, at `k` equal steps of its length."""

    step: float
    """Length of a step, mm."""
    positions: Array
    """Axis positions `(k, axes)`, mm and rad."""
    slopes: Array
    """Derivatives of the positions `(k, axes)`, mm and rad per mm of the path, of the segment after each step."""
    points: Array
    """Points `(k, 3)`, mm, in the frame to which the instrument is fixed."""
    tangents: Array
    """Unit vectors `(k, 3)`."""
    feed_distance: Array
    """Distance that the feed refers to `(k,)`, mm, or degrees where only rotary axes move."""
    corners: Array
    """Distances along the path `(c,)`, mm, at which it turns, stops or continues in rapid, with its two ends."""
    usable: np.ndarray
    """Mask `(c - 1,)` of the segments between corners that are feed moves."""

    @cached_property
    def length(self) -> float:
        """Length of the path, mm."""
        return self.step * (len(self.points) - 1)

    def at(self, s: Array) -> Located:
        """Points and tangents at `(n,)` mm along the path; points are cubic between two steps."""
        i, u = self._step_and_share(s)
        u = u[:, None]
        p, q, a, b = self.points[i], self.points[i + 1], self.tangents[i], self.tangents[i + 1]
        rest = 1.0 - u
        chord = q - p
        points = p + u * chord + u * rest * self.step * (rest * a - u * b) + u * rest * (u - rest) * chord
        tangents = rest * a + u * b
        return Located(points, tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12))

    def positions_at(self, s: Array) -> Array:
        """Axis positions `(n, axes)`, mm and rad, at `(n,)` mm along the path."""
        i, u = self._step_and_share(s)
        return np.asarray(self.positions[i] + u[:, None] * (self.positions[i + 1] - self.positions[i]))

    def slopes_at(self, s: Array) -> Array:
        """Derivatives of the axis positions `(n, axes)`, mm and rad per mm of the path."""
        return np.asarray(self.slopes[self._step_and_share(s)[0]])

    def feed_distance_at(self, s: Array) -> Array:
        """Distance that the feed refers to `(n,)`, mm, or degrees where only rotary axes move."""
        i, u = self._step_and_share(s)
        return np.asarray(self.feed_distance[i] + u * (self.feed_distance[i + 1] - self.feed_distance[i]))

    def segment_at(self, s: Array) -> np.ndarray:
        """Index `(n,)` of the segment between two corners."""
        return np.clip(np.searchsorted(self.corners, s, side="right") - 1, 0, len(self.usable) - 1)

    def _step_and_share(self, s: Array) -> tuple[np.ndarray, Array]:
        along = np.clip(s / self.step, 0.0, len(self.points) - 1.0)
        i = np.minimum(along.astype(int), len(self.points) - 2)
        return i, along - i


def target_path(path: NominalPath, target: Target, stands_on: Literal["workpiece", "bed"] = "workpiece") -> TargetPath:
    """The path of a target, by exact kinematics; UserError for a target that hardly moves."""
    vertices, move = _segments(path)

    def at(positions: Array) -> Measurement:
        state = State(positions, target=np.full(len(positions), "1"))
        return Measurement(path.machine, LaserTracker(), state, np.zeros((len(positions), 3)), {"1": target}, stands_on)

    corner = at(vertices)
    chords = np.diff(corner.nominal_points, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    lengths[lengths < STANDSTILL_TARGET_MM] = 0.0
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    length = float(arc[-1])
    if length < 10.0 * SHORTEST_STORED_STEP_MM:
        raise UserError(f"{path.source}: the target moves by {length:.3g} mm only, which is too short for a path")
    count = max(int(np.ceil(length / max(length / STORED_STEPS, SHORTEST_STORED_STEP_MM))), 2)
    s = np.linspace(0.0, length, count + 1)
    moving = np.flatnonzero(lengths)
    segment = moving[np.clip(np.searchsorted(arc[moving], s, side="right") - 1, 0, len(moving) - 1)]
    slopes = (np.diff(vertices, axis=0)[segment]) / lengths[segment][:, None]
    positions = vertices[segment] + (s - arc[segment])[:, None] * slopes
    there = at(positions)
    tangents = np.einsum("nca,na->nc", derivatives_by_positions(there, there.tool), slopes)
    corners, usable = _corners(chords, lengths, arc, path.feed_move[1:][move])
    feed_distance = np.interp(
        _vertex_index(segment, arc, s, lengths), np.arange(len(vertices)), _feed_distance(path, move)
    )
    return TargetPath(
        length / count, positions, slopes, there.nominal_points,
        tangents / np.linalg.norm(tangents, axis=1, keepdims=True), feed_distance, corners, usable,
    )  # fmt: skip


def _vertex_index(segment: np.ndarray, arc: Array, s: Array, lengths: Array) -> Array:
    """Fractional index `(n,)` of the vertices at `s` mm along the path; whole numbers at the vertices."""
    return np.asarray(segment + np.clip((s - arc[segment]) / lengths[segment], 0.0, 1.0))


def _segments(path: NominalPath) -> tuple[Array, np.ndarray]:
    """Vertices `(v, axes)` between which rotary axes turn by PIECE_DEG at most; move `(v - 1,)` of each segment."""
    moves = np.diff(path.positions, axis=0)
    turned = np.degrees(np.abs(moves[:, path.machine.rotary]).max(axis=1, initial=0.0))
    counts = np.maximum(np.ceil(turned / PATH_SEGMENT_DEG), 1).astype(int)
    move = np.repeat(np.arange(len(moves)), counts)
    first = np.cumsum(counts) - counts
    share = (np.arange(len(move)) - first[move] + 1) / counts[move]
    between = path.positions[move] + share[:, None] * moves[move]
    return np.concatenate([path.positions[:1], between]), move


def _feed_distance(path: NominalPath, move: np.ndarray) -> Array:
    """Distance that the feed refers to `(v,)`, at the vertices of the segments."""
    counts = np.bincount(move, minlength=len(path.feed_distance) - 1)
    first = np.cumsum(counts) - counts
    share = (np.arange(len(move)) - first[move] + 1) / counts[move]
    return np.concatenate(
        [path.feed_distance[:1], path.feed_distance[move] + share * np.diff(path.feed_distance)[move]]
    )


def _corners(chords: Array, lengths: Array, arc: Array, feed_move: np.ndarray) -> tuple[Array, np.ndarray]:
    """Corners `(c,)`, mm along the path, and the mask `(c - 1,)` of the segments between them that are feed moves.

    A corner lies where the path turns, the target stops, or feed and rapid change.
    """
    moving = np.flatnonzero(lengths)
    directions = chords[moving] / lengths[moving][:, None]
    turns = np.sum(directions[1:] * directions[:-1], axis=1) < np.cos(np.radians(CORNER_DEG))
    stops = np.diff(moving) > 1
    changes = feed_move[moving][1:] != feed_move[moving][:-1]
    at = np.flatnonzero(turns | stops | changes)
    corners = np.concatenate([[0.0], arc[moving[at + 1]], arc[-1:]])
    return corners, feed_move[moving][np.append(0, at + 1)]
