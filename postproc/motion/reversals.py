"""Direction of the last motion of each axis, for effects such as backlash."""

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
"""Shares of the path of a move at which it is evaluated between its ends."""


def needs_direction(effect: Effect) -> bool:
    """True for correctable effects that depend on the approach direction of an axis."""
    return effect.ACTS_ON != "instrument" and effect.REMEDY != "none" and "approach" in effect.needs


def axes_with_backlash(model: ErrorModel, machine: Machine) -> tuple[int, ...]:
    """Columns of the axes whose direction the model depends on."""
    return tuple(sorted({machine.index(name) for e in model.effects if needs_direction(e) for name in e.axes}))


def dead_band(machine: Machine, tolerance_um: float) -> Array:
    """Travel `(axes,)`, mm and rad, that an axis must go back before it counts as a reversal: half the tolerance.

    The other half is for the path between the evaluated positions. A tolerance in um is taken in urad for rotary axes.
    The dead band is never smaller than the resolution of the axis.
    """
    resolution = np.array([axis.resolution for axis in machine.axes]) * machine.scale
    return np.maximum(0.5e-3 * tolerance_um * np.where(machine.rotary, 1e-3, 1.0), resolution)


class Directions:
    """Direction of the last motion of each axis with backlash, row after row.

    An axis that has gone back by no more than the dead band keeps its direction, so that an axis at rest does not
    chatter. The direction is 0 if the position before is unknown.
    """

    def __init__(self, axes: Iterable[int], band: Array) -> None:
        self._band: list[float] = band.tolist()
        self.last = np.zeros(len(band))
        """Directions `(axes,)` after the last row: -1, 0, 1."""
        self._farthest: dict[int, float | None] = dict.fromkeys(axes)
        self._behind_cycle = False
        self.returned = np.empty((0, len(band)))
        """Directions `(n, axes)` in which canned cycles returned to the starts of the last moves; nan otherwise."""

    def follow_moves(self, motions: Motions, positions: Array, starts: Array, certain: NDArrayBool) -> Array:
        """Directions `(n, shares, axes)` at positions `(n, shares, axes)` along moves that start at `(n, axes)`.

        The row of a canned cycle ends at the bottom of its hole; the axis then returns to the start of the next move.
        """
        behind = np.append(self._behind_cycle, motions.kind == Kind.CYCLE)
        self._behind_cycle = bool(behind[-1])
        self.returned = np.full_like(starts, np.nan)
        if not behind[:-1].any():
            return _follow_paths(self, positions, certain)
        returned = np.where(behind[:-1, None], starts, np.nan)
        found = _follow_paths(self, np.concatenate([returned[:, None], positions], axis=1), certain)
        self.returned[behind[:-1]] = found[behind[:-1], 0]
        return found[:, 1:]

    def follow(self, q: Array, certain: NDArrayBool) -> Array:
        """Directions `(n, axes)`, -1, 0, 1, in which the axes approach positions q `(n, axes)`, mm and rad.

        certain `(n, axes)`: true where the position before is also known. A position nan means no move.
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
    """True `(n, axes)` where the position of an axis before a move is known; with TCP a linear axis needs all axes."""
    known = motions.known_start != Known.ASSUMED
    tcp = np.array([frame.tcp for frame in motions.frames], bool)[motions.frame]
    linear = ~motions.machine.rotary
    known[np.ix_(tcp, linear)] &= known[tcp].all(axis=1, keepdims=True)
    return np.asarray(known)


def axis_positions_along(motions: Motions, shares: Iterable[float]) -> Array:
    """Axis positions `(n, shares, axes)`, mm and rad, at shares of the paths of all moves."""
    return np.stack([motions.in_machine(motions.along(share)) for share in shares], axis=1)


def _follow_paths(directions: Directions, positions: Array, certain: NDArrayBool) -> Array:
    """Directions `(n, shares, axes)` at positions of this shape along moves; `certain` `(n, axes)`: as in `follow`."""
    n, shares, axes = positions.shape
    return directions.follow(positions.reshape(-1, axes), np.repeat(certain, shares, axis=0)).reshape(n, shares, axes)


def turns_inside(motions: Motions, axes: Iterable[int], band: Array) -> NDArrayBool:
    """True `(n,)` for moves within which an axis may reverse: arcs, and under TCP lines and rapids too."""
    inside = np.array([frame.tcp for frame in motions.frames], bool)[motions.frame]
    for row in motions.arcs:
        inside[row] |= any(axis in axes and way > band[axis] for _, axis, way in turning_points(motions, row))
    return np.asarray(inside & np.isin(motions.kind, (Kind.RAPID, Kind.LINE, Kind.ARC)))


def feeds(motions: Motions) -> NDArrayBool:
    """True `(n,)` for feed moves, whose path matters and not only their end."""
    return np.isin(motions.kind, (Kind.LINE, Kind.ARC))
