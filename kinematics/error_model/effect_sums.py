"""Errors of effects, and their derivatives by the parameters."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from kinematics.effects import Effect
from kinematics.effects.records import Columns
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, blocks


def total_errors(effects: Sequence[Effect], machine: Machine, state: State) -> Array:
    """Errors `(n, axes + 2, 6)`, mm and rad, of effects at the axes, the tool, and the observed point."""
    total = np.moveaxis(np.zeros((len(machine.axes) + 2, 6, len(state))), 2, 0)
    for rows in blocks(len(state)):
        part = state.rows(rows)
        for effect in effects:
            if not effect.HAS_MEMORY:
                _add(total[rows], effect, machine, part)
    for effect in effects:
        if effect.HAS_MEMORY:
            _add(total, effect, machine, state)
    return total


def _add(total: Array, effect: Effect, machine: Machine, state: State) -> None:
    for column, component, values in effect.contributions(machine, state):
        total[:, column, component] += values


class Design:
    """Derivatives by the parameters of effects, a block of rows at a time.

    Columns of effects with memory, which depend on the rows before a block, are made from all rows, once. Those of the
    instrument's parameters are zero without the instrument.
    """

    def __init__(self, effects: Sequence[Effect], machine: Machine, state: State, *, with_instrument: bool) -> None:
        lasts = list(itertools.accumulate((len(effect.parameters) for effect in effects), initial=0))
        self._machine, self._state, self._parameters = machine, state, lasts[-1]
        self._width = 6 * (len(machine.axes) + 1) + 3 * with_instrument
        chosen = [
            (effect, slice(*ends))
            for effect, ends in zip(effects, itertools.pairwise(lasts), strict=True)
            if with_instrument or effect.ACTS_ON != "instrument"
        ]
        self._now = [(effect, part) for effect, part in chosen if not effect.HAS_MEMORY]
        self._remembered = [(list(e.columns(machine, state)), part) for e, part in chosen if e.HAS_MEMORY]

    def of(self, rows: slice | np.ndarray, transform: Array) -> Array:
        """`(n, k, parameters)` at some rows; `transform` `(n, k, width)` as `ErrorModel.design` takes it there."""
        if transform.shape[2] != self._width:
            raise ValueError(f"transform has {transform.shape[2]} columns, {self._machine.name} takes {self._width}")
        state, columns_of_errors = self._state.rows(rows), len(self._machine.axes) + 2
        arms: dict[int, Array] = {}
        design = np.zeros((self._parameters, *transform.T.shape[1:]))
        for effect, part in self._now:
            _fill(effect.columns(self._machine, state), transform, arms, columns_of_errors, design[part])
        for columns, part in self._remembered:
            there = (each._replace(values=each.values[rows]) for each in columns)
            _fill(there, transform, arms, columns_of_errors, design[part])
        return np.ascontiguousarray(design.T)


def _fill(
    columns: Iterable[Columns], transform: Array, arms: dict[int, Array], columns_of_errors: int, design: Array
) -> None:
    """Write the transformed columns of one effect into its part of a design `(parameters, k, n)`.

    arms `(k, n)`: those columns of the transform that effects have needed, with their rows next to each other in
    memory, as in `design`.
    """
    for i, (column, component, values) in enumerate(columns):
        number = 6 * (column % columns_of_errors) + component
        if number not in arms:
            arms[number] = np.ascontiguousarray(transform[:, :, number].T)
        arm = arms[number]
        for derivative, value in zip(design, np.ascontiguousarray(values.T), strict=True):
            np.add(derivative, arm * value, out=derivative) if i else np.multiply(arm, value, out=derivative)
