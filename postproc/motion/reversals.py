"""Directions: which way each axis has moved last, for effects such as backlash."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.motion.segments import turning_points

INNER = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
"""Shares of the way of a move at which it is looked at between its ends."""


def needs_direction(effect: Effect) -> bool:
    """True for effects that depend on the direction an axis has come from."""
    return effect.ACTS_ON != "instrument" and "approach" in effect.needs


def axes_with_play(model: ErrorModel, machine: Machine) -> tuple[int, ...]:
    """Columns of the axes whose direction the model depends on."""
    return tuple(sorted({machine.index(name) for e in model.effects if needs_direction(e) for name in e.axes}))


def dead_band(machine: Machine, tolerance_um: float) -> Array:
    """How far `(axes,)`, mm and rad, an axis goes back before that counts as a reversal: half the tolerance.

    The other half is left for the ways between the places that are looked at. A tolerance in um is one in urad for
    rotary axes; no axis counts steps smaller than its resolution.
    """
    resolution = np.array([axis.resolution for axis in machine.axes]) * machine.scale
    return np.maximum(0.5e-3 * tolerance_um * np.where(machine.rotary, 1e-3, 1.0), resolution)


class Directions:
    """The direction of the last move of each axis with play, row after row.

    An axis that has gone back by no more than the dead band keeps its direction: so an axis that stands, or nearly so,
    does not chatter. The direction is 0 where nobody knows where the axis came from.
    """

    def __init__(self, axes: Iterable[int], band: Array) -> None:
        self._band: list[float] = band.tolist()
        self.last = np.zeros(len(band))
        """After the last row `(axes,)`: -1, 0, 1."""
        self._farthest: dict[int, float | None] = dict.fromkeys(axes)
        self._behind_cycle = False
        self.returned = np.empty((0, len(band)))
        """Directions in which canned cycles returned to the starts of the last moves `(n, axes)`, nan behind others."""

    def follow_moves(self, motions: Motions, positions: Array, starts: Array, certain: NDArrayBool) -> Array:
        """Directions `(n, shares, axes)` at positions `(n, shares, axes)` along moves that start at `(n, axes)`.

        A canned cycle ends at the bottom of its hole and returns: the axis then comes from where the next move starts.
        """
        behind = np.append(self._behind_cycle, motions.kind == Kind.CYCLE)
        self._behind_cycle = bool(behind[-1])
        self.returned = np.full_like(starts, np.nan)
        if not behind[:-1].any():
            return follow_ways(self, positions, certain)
        returned = np.where(behind[:-1, None], starts, np.nan)
        found = follow_ways(self, np.concatenate([returned[:, None], positions], axis=1), certain)
        self.returned[behind[:-1]] = found[behind[:-1], 0]
        return found[:, 1:]

    def follow(self, q: Array, certain: NDArrayBool) -> Array:
        """Directions `(n, axes)`, -1, 0, 1, in which the axes come to positions q `(n, axes)`, mm and rad.

        certain `(n, axes)`: true where the position before is known too. A position that is nan is no move.
        """
        approach = np.zeros_like(q)
        for axis in self._farthest:
            approach[:, axis] = self._follow(axis, q[:, axis].tolist(), certain[:, axis].tolist())
        if len(q):
            self.last = approach[-1].copy()
        return approach

    def _follow(self, axis: int, positions: list[float], certain: list[bool]) -> list[float]:
        band, direction, farthest = self._band[axis], float(self.last[axis]), self._farthest[axis]
        found = []
        for position, sure in zip(positions, certain, strict=True):
            if math.isnan(position):
                pass
            elif not sure or farthest is None:
                direction, farthest = 0.0, position
            elif (position - farthest) * direction > 0.0:
                farthest = position
            elif abs(position - farthest) > band:
                direction, farthest = (1.0 if position > farthest else -1.0), position
            found.append(direction)
        self._farthest[axis] = farthest
        return found


def known_before(motions: Motions) -> NDArrayBool:
    """Where `(n, axes)` the position of an axis before a move is known; with TCP, it takes all axes to know one."""
    known = motions.known_start != Known.ASSUMED
    tcp = np.array([frame.tcp for frame in motions.frames], bool)[motions.frame]
    linear = ~motions.machine.rotary
    known[np.ix_(tcp, linear)] &= known[tcp].all(axis=1, keepdims=True)
    return np.asarray(known)


def ways(motions: Motions, shares: Iterable[float]) -> Array:
    """Axis positions `(n, shares, axes)`, mm and rad, at shares of the ways of all moves."""
    return np.stack([motions.in_machine(motions.along(share)) for share in shares], axis=1)


def follow_ways(directions: Directions, positions: Array, certain: NDArrayBool) -> Array:
    """Directions `(n, shares, axes)` at positions `(n, shares, axes)` along moves that start `certain` `(n, axes)`."""
    n, shares, axes = positions.shape
    return directions.follow(positions.reshape(-1, axes), np.repeat(certain, shares, axis=0)).reshape(n, shares, axes)


def turns_inside(motions: Motions, axes: Iterable[int], band: Array) -> NDArrayBool:
    """Moves `(n,)` within which an axis may turn back: arcs, of these axes, and all under TCP, rapids too."""
    inside = np.array([frame.tcp for frame in motions.frames], bool)[motions.frame]
    for row in motions.arcs:
        inside[row] |= any(axis in axes and way > band[axis] for _, axis, way in turning_points(motions, row))
    return np.asarray(inside & np.isin(motions.kind, (Kind.RAPID, Kind.LINE, Kind.ARC)))


def feeds(motions: Motions) -> NDArrayBool:
    """Rows `(n,)` whose way matters, and not their end alone."""
    return np.isin(motions.kind, (Kind.LINE, Kind.ARC))
