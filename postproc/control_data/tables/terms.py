"""Terms of a control's tables: functions of axis positions that it adds to commands.

Positions and values are in mm and degrees, and in the unit of a control when they are written; values are
*corrections*, added to the command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from kinematics.machine import TURN_DEG, Axis, Machine
from kinematics.transforms import Array

Positions = Callable[[str], Array]
"""Positions `(n,)` of an axis by its name, mm or degrees."""


@dataclass(frozen=True)
class Curve:
    """A function of one axis' position, linear between its nodes, that keeps its end values outside."""

    axis: str
    nodes: Array
    """`(k,)`, ascending."""
    values: Array
    """`(k,)`."""

    @property
    def axes(self) -> tuple[str, ...]:
        """The variables of the function."""
        return (self.axis,)

    def at(self, position: Positions) -> Array:
        """Values `(n,)`."""
        return np.interp(position(self.axis), self.nodes, self.values)

    def scaled(self, of: Callable[[str], float], value: float) -> Curve:
        """The function with positions times `of` their axis, and values times `value`."""
        return Curve(self.axis, self.nodes * of(self.axis), self.values * value)


@dataclass(frozen=True)
class Surface:
    """A function of two axes' positions, bilinear between its nodes, that keeps its values at the edge outside."""

    axes: tuple[str, ...]
    """Two."""
    nodes: tuple[Array, Array]
    values: Array
    """`(k, m)`."""

    def at(self, position: Positions) -> Array:
        """Values `(n,)`."""
        (i, s), (j, t) = (_share(nodes, position(axis)) for axis, nodes in zip(self.axes, self.nodes, strict=True))
        low = (1 - t) * self.values[i, j] + t * self.values[i, j + 1]
        high = (1 - t) * self.values[i + 1, j] + t * self.values[i + 1, j + 1]
        return np.asarray((1 - s) * low + s * high)

    def scaled(self, of: Callable[[str], float], value: float) -> Surface:
        """The function with positions times `of` their axis, and values times `value`."""
        first, second = (nodes * of(axis) for axis, nodes in zip(self.axes, self.nodes, strict=True))
        return Surface(self.axes, (first, second), self.values * value)


@dataclass(frozen=True)
class Term:
    """The product of its factors is added to the command of the axis `output`."""

    output: str
    factors: tuple[Curve | Surface, ...]
    direction: int = 0
    """1 or -1: only while the first factor's axis moves in this direction; 0: always."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The axes that it is a function of."""
        return tuple(axis for factor in self.factors for axis in factor.axes)

    @property
    def name(self) -> str:
        """X(X), Z(Y), Y(X*Z), X(C) forward, ..."""
        joined = "*".join(self.inputs)
        return f"{self.output}({joined})" + {1: " forward", -1: " backward"}.get(self.direction, "")

    def scaled(self, of: Callable[[str], float]) -> Term:
        """The term in other units: lengths and angles times `of` their axis; a second factor has no unit."""
        values = (of(self.output), *[1.0] * (len(self.factors) - 1))
        pairs = zip(self.factors, values, strict=True)
        return replace(self, factors=tuple(factor.scaled(of, value) for factor, value in pairs))


def added(terms: Iterable[Term], machine: Machine, q: Array, approach: Array | None = None) -> Array:
    """Corrections that the tables add to commands `(n, axes)`, all mm and rad.

    approach `(n, axes)`: the direction of approach of each axis; one that has not moved yet, 0, counts half of either.
    """
    total = np.zeros_like(q)

    def position(axis: str) -> Array:
        i = machine.index(axis)
        x = np.asarray(q[:, i] / machine.scale[i])
        return into_the_turn(machine.axes[i], x)

    for term in terms:
        value = np.ones(len(q))
        for factor in term.factors:
            value = value * factor.at(position)
        if term.direction:
            moving = 0.0 if approach is None else approach[:, machine.index(term.inputs[0])]
            value = value * (1.0 + term.direction * moving) / 2.0
        i = machine.index(term.output)
        total[:, i] += value * machine.scale[i]
    return total


def to_steps(values: Array, step: float, decimals: int = 12) -> Array:
    """The values of any shape, rounded to whole steps, without the digits that binary numbers add."""
    return np.asarray(np.round(np.round(values / step) * step, decimals))


def into_the_turn(axis: Axis, x: Array) -> Array:
    """Positions `(n,)`, mm or degrees; of an axis that turns fully, those in the turn that its tables are over."""
    if not axis.turns_fully:
        return x
    low = turn_of(axis)[0]
    return np.where((x >= low) & (x <= low + TURN_DEG), x, low + np.mod(x - low, TURN_DEG))


def turn_of(axis: Axis) -> tuple[float, float]:
    """The turn that tables of an axis are over, degrees: its travel where that is one turn."""
    low, high = axis.travel
    return (low, high) if high - low == TURN_DEG else (0.0, TURN_DEG)


def _share(nodes: Array, x: Array) -> tuple[np.ndarray, Array]:
    """The interval each position lies in, and its fraction of the interval."""
    i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
    return i, np.clip((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0, 1.0)
