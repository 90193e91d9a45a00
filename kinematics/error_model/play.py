"""Axes with play: where an axis lies in its play, after every position of its drive.

The axis stays where it is while its drive moves within the play, and then is pushed by it: the play operator. Its error
is proportional to the side on which it lies: 1 if the drive has pushed it forward, -1 backward, 0 in the middle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from kinematics.effects.base import own_motion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.state import State
from kinematics.transforms import Array

FLOAT_STEPS = 4.0
"""Steps between floating-point numbers by which a difference of positions may be wrong: of two sums, up and down."""


def half_play(machine: Machine, directed: ErrorModel, forward: State) -> Array:
    """Half of the play `(n, axes)`, mm and rad: how far an axis is behind its drive after a move forward.

    directed: the effects that depend on the direction of approach. forward: a state with the direction 1 of all axes.
    It is 0 for an axis without play, and negative if the axis runs ahead.
    """
    errors = directed.errors(machine, forward)
    half = np.zeros_like(forward.positions)
    for name in {name for effect in directed.effects for name in effect.axes}:
        i, component, sign = own_motion(machine, name)
        half[:, i] = -sign * errors[:, i, component]
    return half


def directed_otherwise(machine: Machine, directed: ErrorModel, forward: State, axes: Iterable[int]) -> bool:
    """True if other errors than the play of these axes depend on the direction; arguments as of `half_play`."""
    errors = directed.errors(machine, forward).copy()
    for i in axes:
        errors[:, i, own_motion(machine, machine.names[i])[1]] = 0.0
    return bool(errors.any())


class InPlay(NamedTuple):
    """Drives and axes at n instants; columns `(n, axes)`, mm and rad."""

    drive: Array
    """Position of the drive: the command. nan before the first one."""
    behind: Array
    """How far the axis is behind its drive."""
    side: Array
    """Side of the play on which the axis lies, -1 ... 1."""

    def rows(self, rows: np.ndarray) -> InPlay:
        """Some of the instants, by their numbers."""
        return InPlay(*(column[rows] for column in self))


class PlayLimits(NamedTuple):
    """What counts as play, and as a reversal of an axis without play; each `(axes,)`, mm and rad."""

    least: Array
    """Half of the smallest play. An axis with a smaller one changes its side as a whole when it reverses."""
    band: Array
    """Way that such an axis must go back before this is a reversal."""

    def moved(self, before: InPlay, drive: Array, half: Array) -> InPlay:
        """The instants after one monotonic move each to `drive` `(n, axes)`; half: `half_play` there."""
        real = half > self.least
        reach = np.where(real, half, self.band / 2.0)
        pushed = before.behind + drive - before.drive
        behind = np.clip(pushed, -reach, reach)
        turned = np.where(np.abs(pushed) > reach, np.sign(pushed), before.side)
        return InPlay(drive, behind, np.where(real, behind / np.where(real, half, 1.0), turned))


class PlayOperator:
    """Follows the drives of some axes from position to position."""

    def __init__(self, axes: Iterable[int], limits: PlayLimits) -> None:
        self.limits, count = limits, len(limits.band)
        self._axes = tuple(axes)
        self.last = InPlay(np.full((1, count), np.nan), np.zeros((1, count)), np.zeros((1, count)))
        """After the last position."""
        self._axis = np.full(count, np.nan)
        """Positions of the axes then."""

    def follow(self, drive: Array, half: Array, known: NDArrayBool) -> InPlay:
        """The instants after monotonic moves to positions `(n, axes)`, in their order; half: `half_play` there.

        known `(n, axes)`: false where the position before is unknown; the axis is then taken in the middle of its play.
        """
        behind, side = np.zeros_like(drive), np.zeros_like(drive)
        if len(drive):
            for i in self._axes:
                behind[:, i], side[:, i] = self._follow(i, drive[:, i], half[:, i], known[:, i])
        found = InPlay(drive, behind, side)
        if len(drive):
            self.last = found.rows(np.array([-1]))
        return found

    def _follow(self, i: int, drive: Array, half: Array, known: NDArrayBool) -> tuple[Array, Array]:
        """`behind` and `side` `(n,)` of one axis, as by `PlayLimits.moved`."""
        known = known.copy()
        known[0] &= not math.isnan(self._axis[i])
        start = self._axis[i] if known[0] else drive[0]
        real = half > self.limits.least[i]
        reach = np.where(known, np.where(real, half, self.limits.band[i] / 2.0), 0.0)
        positions, pushed = followed(start, drive, reach)
        behind, self._axis[i] = drive - positions, positions[-1]
        turned = np.abs(pushed) > reach
        sides = np.where(real, side_of(drive, positions, np.where(real, half, 1.0)), np.sign(pushed))
        return behind, held(np.where(known, sides, 0.0), ~known | real | turned, self.last.side[0, i])


def followed(axis: float, drive: Array, reach: Array) -> tuple[Array, Array]:
    """Positions `(n,)` of an axis after monotonic moves to `drive` `(n,)`, and how far it is behind without a push.

    axis: where it lies before them; reach `(n,)`: how far it can be behind.
    """
    positions = clipped_in_turn(axis, drive - reach, drive + reach)
    return positions, drive - np.concatenate([[axis], positions[:-1]])


def clipped_in_turn(value: float, low: Array, high: Array) -> Array:
    """Values `(n,)`, each of which is the one before it, clipped to `low` and `high` `(n,)`; value: before the first.

    Clips that follow each other are one clip: those of 2, 4, 8, ... are joined for all places at once.
    """
    low, high, step = low.copy(), high.copy(), 1
    while step < len(low):
        limits = low[step:], high[step:]
        low[step:], high[step:] = np.clip(low[:-step], *limits), np.clip(high[:-step], *limits)
        step *= 2
    return np.asarray(np.clip(value, low, high))


def side_of(drive: Array | float, axis: Array | float, half: Array | float) -> Array:
    """Side of the play of an axis and its drive; 1 or -1 where they are half of the play apart but for rounding."""
    behind, rounding = drive - np.asarray(axis), FLOAT_STEPS * np.spacing(np.abs(drive) + half)
    return np.asarray(np.where(np.abs(behind) >= half - rounding, np.sign(behind), behind / half))


def held(values: Array, given: NDArrayBool, first: float) -> Array:
    """Values `(n,)` where they are given, and elsewhere the last one given before; first: before all of them."""
    last = np.maximum.accumulate(np.where(given, np.arange(len(values)), -1))
    return np.asarray(np.where(last >= 0, values[last], first))
