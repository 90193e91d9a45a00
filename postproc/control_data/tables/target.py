"""The required correction of every command, and its means over the working volume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from kinematics.correction import correct_position
from kinematics.effects import Effect
from kinematics.effects.base import own_motion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import TURN_DEG, Axis, Machine
from kinematics.pieces import ErrorMotions
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.tables.terms import turn_of

PER_WAVE, MOST_TABLE_POSITIONS = 8, 1601
"""Positions on the shortest wave of the errors of an axis; and positions in all."""
SAMPLES = {1: 96, 2: 32}
"""Positions of the other axes that a mean is taken over, by the number of axes it is a function of."""


def positional(effect: Effect) -> bool:
    """True for an effect of positions and directions alone, like a table."""
    return effect.ACTS_ON != "instrument" and effect.REMEDY != "none" and set(effect.needs) <= {"approach"}


def too_fine(effect: Effect, machine: Machine) -> bool:
    """True for waves too short for any table: the positions along the axis would alias them."""
    wave = effect.shortest_wave
    if wave is None:
        return False
    low, high = bounds(machine.axes[machine.index(wave[0])])
    return wave[1] * MOST_TABLE_POSITIONS < PER_WAVE * (high - low)


def bounds(axis: Axis) -> tuple[float, float]:
    """Its travel, or one turn of an axis that turns fully."""
    if axis.turns_fully:
        return turn_of(axis)
    low, high = axis.travel
    if np.isinf(low) or np.isinf(high):
        raise UserError(f"axis {axis.name} has no ends in its machine file: tables need its travel")
    return low, high


@dataclass(frozen=True)
class Target:
    """One machine with its errors, and the tool for which it is corrected."""

    machine: Machine
    model: ErrorModel
    """Effects of positions and directions only."""
    tool: Array
    """`(3,)`, mm, from the tool reference point."""
    rotary: bool = True
    """False if rotary axes cannot be corrected."""

    def correction(self, q: Array, approach: Array | None = None) -> Array:
        """Corrections of commands q `(n, axes)`, mm and rad, that bring the tool point to its nominal position.

        Rotary axes are turned by their own positioning error, and the linear axes that
        position the tool correct the remaining tool point error.
        """
        came = np.zeros_like(q) if approach is None else approach

        def errors(positions: Array) -> Array:
            return self._motions.at(positions, came)

        start = q.copy()
        for i in np.flatnonzero(self.machine.rotary).tolist() if self.rotary else ():
            _, component, forward = own_motion(self.machine, self.machine.names[i])
            for _ in range(3):  # each reduces the error to 1e-4 of the one before
                start[:, i] = q[:, i] - forward * errors(start)[:, i, component]
        tool = np.broadcast_to(self.tool, (len(q), 3))
        movable = np.ones(q.shape, bool)
        return np.asarray(correct_position(self.machine, errors, q, tool, movable, start) - q)

    @cached_property
    def _motions(self) -> ErrorMotions:
        return ErrorMotions(self.machine, self.model, State)

    @cached_property
    def bounds(self) -> Array:
        """Bounds `(axes, 2)` of the working volume, mm and degrees; UserError for an axis without ends."""
        return np.array([bounds(axis) for axis in self.machine.axes])

    def evenly(self, column: int, n: int) -> Array:
        """n positions `(n,)` from one bound of an axis to the other, mm or degrees."""
        return np.linspace(float(self.bounds[column, 0]), float(self.bounds[column, 1]), n)

    def volume(self, n: int) -> Array:
        """Positions `(n, axes)`, mm and degrees, spread over the working volume."""
        low, high = self.bounds.T
        return np.asarray(low + (high - low) * spread_out(n, len(low)))

    def mean(self, axes: Sequence[int], positions: Sequence[Array], direction: int = 0) -> Array:
        """Mean corrections over all other axes, on the grid of these: `(k, ..., axes)`, mm and degrees.

        axes: columns, with positions of each, mm and degrees; direction: of approach of the first of them.
        """
        others = [i for i in range(len(self.machine.axes)) if i not in axes]
        low, high = self.bounds[others].T
        if len(others) <= 2 and not any(self.machine.axes[i].rotary for i in others):
            shares, weights = gauss(len(others))
        else:
            shares = spread_out(SAMPLES[len(axes)], len(others))
            weights = np.full(len(shares), 1.0 / len(shares))
        samples = low + (high - low) * shares
        grid = np.stack(np.meshgrid(*positions, indexing="ij"), axis=-1).reshape(-1, len(axes))
        q = np.empty((len(grid), len(samples), len(self.machine.axes)))
        q[:, :, list(axes)], q[:, :, others] = grid[:, None, :], samples[None]
        approach = np.zeros(len(self.machine.axes))
        approach[axes[0]] = direction
        flat = q.reshape(-1, q.shape[2]) * self.machine.scale
        found = self.correction(flat, np.broadcast_to(approach, flat.shape)) / self.machine.scale
        mean = np.einsum("s,nsa->na", weights, found.reshape(q.shape))
        return np.asarray(mean.reshape(*(len(p) for p in positions), -1))

    def positions_along(self, column: int, n: int) -> Array:
        """Commands along an axis, mm or degrees: n evenly spread, and those that bring it to a kink of its errors.

        More than n where its errors have short waves.
        """
        machine = self.machine
        waves = [wave for effect in self.model.effects if (wave := effect.shortest_wave) is not None]
        shortest = min((length for axis, length in waves if axis == machine.names[column]), default=np.inf)
        n = min(max(n, int(np.ceil(PER_WAVE * np.ptp(self.bounds[column]) / shortest)) + 1), MOST_TABLE_POSITIONS)
        kinks: set[float] = set()
        for effect in self.model.effects:
            if effect.axes[:1] == (machine.names[column],):
                kinks.update(effect.kinks)
        actual = np.array(sorted(kinks))
        if machine.axes[column].turns_fully:
            actual = self.bounds[column, 0] + np.mod(actual - self.bounds[column, 0], TURN_DEG)
        q = np.tile(self.bounds.mean(axis=1), (len(actual), 1))
        q[:, column] = actual
        commands = actual - self.correction(q * machine.scale)[:, column] / machine.scale[column]
        low, high = self.bounds[column]
        inside = commands[(commands > low) & (commands < high)]
        return np.unique(np.concatenate([self.evenly(column, n), inside]).round(9))

    def depends_on_direction(self, column: int) -> bool:
        """True when errors depend on the direction of approach of this axis."""
        name = self.machine.names[column]
        return any("approach" in effect.needs and name in effect.axes for effect in self.model.effects)


def gauss(dimensions: int) -> tuple[Array, Array]:
    """Positions `(n, dimensions)` in 0 ... 1 and their weights: Gauss and Legendre's rule on each axis."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    positions = np.array(list(product((nodes + 1) / 2, repeat=dimensions))).reshape(-1, dimensions)
    return positions, np.array([float(np.prod(w)) for w in product(weights / 2, repeat=dimensions)])


def spread_out(n: int, dimensions: int) -> Array:
    """`(n, dimensions)` in 0 ... 1, evenly spread: a lattice of irrational slopes, and its mirror image.

    Means of linear functions are exact. Source: Roberts, The unreasonable effectiveness of quasirandom sequences,
    2018; the tent that makes a lattice serve functions that do not close, Hickernell 2002.
    """
    if not dimensions:
        return np.empty((1, 0))
    ratio = 2.0
    for _ in range(40):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    u = (0.5 + np.outer(np.arange(n // 2), ratio ** -np.arange(1.0, dimensions + 1))) % 1.0
    tent = 1.0 - np.abs(2.0 * u - 1.0)
    return np.concatenate([tent, 1.0 - tent])
