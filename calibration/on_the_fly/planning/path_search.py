"""Search for a path that identifies the errors in the volume best: straight moves from boundary to boundary.

The best of several random paths of the given length is improved step by step: a corner is moved, replaced or added, and
the change is kept if `NoiseGain.score` falls. Corners lie on the boundary of the volume, so that long moves have few
corners, near which readings are left out, and reach the ends of the axes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.planning.noise_gain import NoiseGain, Volume
from kinematics.transforms import Array
from kinematics.user_error import UserError

RANDOM_PATHS, IMPROVEMENT_TRIES = 12, 1500
"""Number of random paths, and number of attempts to improve the best of them."""
FIRST_SHIFT_SHARE, LAST_SHIFT_SHARE = 0.5, 0.05
"""Standard deviation of a corner's shift, as a share of the travel: at the first and at the last attempt."""
CORNER_DECIMALS = 3
"""Decimals of the corners, in mm and degrees."""
PATH_MOVES = 3
"""Least number of moves of a path."""


@dataclass(frozen=True)
class PlannedPath:
    """A path of `m` corners, and its identifiability."""

    corners: Array
    """Axis positions of the corners `(m, axes)`, mm and rad."""
    length_mm: float
    noise_gain: NoiseGain


class _Draft(NamedTuple):
    """A path during the search."""

    corners: list[Array]
    moves: Counter[bytes]
    """Number of times that each move occurs, by its two ends."""
    parts: dict[bytes, Array]
    """Information of each move."""
    total: Array


def best_path(
    volume: Volume, length_mm: float, rng: np.random.Generator, progress: Callable[[int], None] = lambda _: None
) -> PlannedPath:
    """The best path found, no longer than `length_mm`; the same generator gives the same path.

    `progress` is called once per attempt. UserError if no path of `PATH_MOVES` moves has this length.
    """
    generator = _Generator(volume, length_mm, rng)
    best, score = None, np.inf
    for _ in range(RANDOM_PATHS):
        draft = generator.random()
        own = volume.score(draft.total)
        if own < score:
            best, score = draft, own
        progress(1)
    assert best is not None
    for k in range(IMPROVEMENT_TRIES):
        changed = generator.changed(
            best, FIRST_SHIFT_SHARE * (LAST_SHIFT_SHARE / FIRST_SHIFT_SHARE) ** (k / IMPROVEMENT_TRIES)
        )
        own = volume.score(changed.total)
        if own < score:
            best, score = changed, own
        progress(1)
    corners = np.array(best.corners)
    return PlannedPath(corners, generator.length(best.corners), volume.noise_gain(best.total))


class _Generator:
    """Generates random paths and variants of them."""

    def __init__(self, volume: Volume, length_mm: float, rng: np.random.Generator) -> None:
        self._volume, self._length, self._rng = volume, length_mm, rng
        machine = volume.machine
        self._low, self._high = volume.ends / machine.scale
        moves = self._high > self._low
        self._linear = np.flatnonzero(moves & ~machine.rotary)
        if not len(self._linear):
            raise UserError(f"machine {machine.name}: no linear axis is left to move along a path")

    def length(self, corners: list[Array]) -> float:
        """Length of the path, mm."""
        return sum(self._volume.length(a, b) for a, b in pairwise(corners))

    def random(self) -> _Draft:
        """A random path, nearly of the largest length."""
        corners, length, rejected = [self._boundary_position()], 0.0, 0
        while rejected < 20:
            corner = self._boundary_position()
            step = self._volume.length(corners[-1], corner)
            if length + step > self._length:
                rejected += 1
                continue
            corners.append(corner)
            length += step
        if len(corners) <= PATH_MOVES:
            raise UserError(
                f"a path of {self._length * 1e-3:.3g} m is too short: not even {PATH_MOVES} moves across this volume"
            )
        return self._draft(corners, None)

    def changed(self, draft: _Draft, size: float) -> _Draft:
        """The path with one corner shifted by about `size` of the travel, replaced or added.

        If this makes the path too long, random corners are removed.
        """
        rng, corners = self._rng, list(draft.corners)
        k, how = int(rng.integers(len(corners))), rng.random()
        if how < 0.6:
            corners[k] = self._near(corners[k], size)
        elif how < 0.8:
            corners[k] = self._boundary_position()
        else:
            corners.insert(k, self._boundary_position())
        while self.length(corners) > self._length:
            del corners[int(rng.integers(len(corners)))]
        return self._draft(corners, draft)

    def _draft(self, corners: list[Array], like: _Draft | None) -> _Draft:
        """The path through these corners; the moves that it shares with `like` are not computed again."""
        ends = {a.tobytes() + b.tobytes(): (a, b) for a, b in pairwise(corners)}
        moves = Counter(a.tobytes() + b.tobytes() for a, b in pairwise(corners))
        known = {} if like is None else like.parts
        new = [key for key in moves if key not in known]
        found = dict(zip(new, self._volume.informations([ends[key] for key in new]), strict=True)) if new else {}
        parts = {key: known[key] if key in known else found[key] for key in moves}
        if like is None:
            total = sum((count * parts[key] for key, count in moves.items()), np.zeros(()))
        else:
            added, gone = moves - like.moves, like.moves - moves
            total = like.total + sum(count * parts[key] for key, count in added.items())
            total = total - sum(count * known[key] for key, count in gone.items())
        return _Draft(corners, moves, parts, np.asarray(total))

    def _boundary_position(self) -> Array:
        """A random position on the boundary `(axes,)`, mm and rad."""
        share = self._rng.uniform(size=len(self._low))
        share[self._rng.choice(self._linear)] = float(self._rng.integers(2))
        return self._rounded(share)

    def _near(self, corner: Array, size: float) -> Array:
        """A position on the boundary near another `(axes,)`, mm and rad."""
        span = np.where(self._high > self._low, self._high - self._low, 1.0)
        share = (corner / self._volume.machine.scale - self._low) / span
        share = np.clip(share + size * self._rng.standard_normal(len(share)), 0.0, 1.0)
        inner = np.minimum(share, 1.0 - share)[self._linear]
        if inner.min() > 0.0:
            nearest = self._linear[np.argmin(inner)]
            share[nearest] = round(float(share[nearest]))
        return self._rounded(share)

    def _rounded(self, share: Array) -> Array:
        corner = np.round(self._low + share * (self._high - self._low), CORNER_DECIMALS)
        return np.asarray(np.clip(corner, self._low, self._high) * self._volume.machine.scale)
