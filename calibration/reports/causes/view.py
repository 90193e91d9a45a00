"""Panels of a cause: readings over a variable, and the fitted cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from calibration.diagnosis.conclusion.fitted_rows import FittedRows
from kinematics.effects import (
    COMPONENTS,
    Effect,
    unit_of,
)
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from rendering.figures import clock

BLUNT = 10.0
"""Multiple of the median standard uncertainty above which rows are not shown."""
IN_ORDER = "row, in the order of acquisition"


class Curve(NamedTuple):
    """The fitted cause as a line."""

    x: Array
    y: Array
    group: int = 0


@dataclass(frozen=True)
class View:
    """One panel: readings `(n,)` over a variable, and the fitted cause."""

    title: str
    x: Array
    y: Array
    u: Array
    """Standard uncertainties; infinite for rows without information."""
    fitted: Array
    x_label: str
    y_label: str
    groups: tuple[tuple[str, np.ndarray], ...] = ()
    """Names and masks `(n,)` of rows in separate colours; empty: one colour for all."""
    curves: tuple[Curve, ...] = ()
    """Curves of the fitted cause; empty: it is drawn row by row."""
    over: Array | None = None
    """Second variable `(n,)` of a map."""
    over_label: str = ""
    moment: float | None = None
    """Moment of a jump, on the x axis."""
    ticks: tuple[str, ...] = ()
    """Names of x = 0, 1, ...; empty: x is a number."""
    means: bool = True
    """False where rows are drawn without their means."""


@dataclass(frozen=True)
class CauseInFit:
    """One cause, beside the residuals that it and all others leave."""

    data: FittedRows
    effect: Any

    @property
    def state(self) -> State:
        """State of the rows."""
        return self.data.measurement.state

    def position(self, axis: str) -> Array:
        """Positions `(n,)` of an axis, mm or degrees."""
        return self.state.position(self.data.measurement.machine, axis)

    def label(self, axis: str) -> str:
        """Name and unit of an axis."""
        machine = self.data.measurement.machine
        return f"{axis}, {machine.axes[machine.index(axis)].unit}"

    def of_axis(self, column: str) -> Array:
        """Column `(n,)` of the state for the axis of the cause."""
        table = self.state.need(column, self.effect.name)
        return np.asarray(table[:, self.data.measurement.machine.index(self.effect.axis)])

    def time(self) -> tuple[Array, str]:
        """Time `(n,)` in the unit of its label, and the label."""
        seconds = self.state.need("time", self.effect.name)
        unit, label = clock(seconds)
        return np.asarray(seconds / unit), label

    def over(self, x: Array, label: str) -> Iterator[View]:
        """A panel for each component that the cause acts on."""
        for (acts_at, component), values in motions_of(self.effect, self.state, self.data.measurement.machine).items():
            arm = self.data.transform[:, :, 6 * acts_at + component]
            unit, size = unit_of(COMPONENTS[component])
            title = self._title(acts_at, component)
            yield self.along(arm, values, size, (title, f"{title}, {unit}"), (x, label))

    def along(self, arm: Array, values: Array, size: float, title: tuple[str, str], over: tuple[Array, str]) -> View:
        """Readings along whitened directions `(n, d)` per mm or rad; `values` `(n,)` are those of the cause.

        size: mm or rad of the unit shown; title: of the panel, of its y axis; over: x and its label.
        """
        squares = np.sum(arm**2, axis=1)
        sharp = self.data.good & (squares > 0)
        sharp &= squares >= (np.median(squares[sharp]) if sharp.any() else 0.0) / BLUNT**2
        safe = np.where(sharp, squares, 1.0)
        left = np.sum(arm * self.data.residual, axis=1) / safe
        u = np.where(sharp, safe**-0.5 / size, np.inf)
        fitted = values / size
        return View(title[0], over[0], fitted + left / size, u, fitted, over[1], title[1])

    def _title(self, acts_at: int, component: int) -> str:
        axes, letter = self.data.measurement.machine.names, COMPONENTS[component]
        if acts_at < len(axes):
            return f"E_{letter}{axes[acts_at]}"
        return f"tool {letter}" if acts_at == len(axes) else f"observed {letter.lower()}"


def motions_of(effect: Effect, state: State, machine: Machine) -> dict[tuple[int, int], Array]:
    """Values `(n,)` of the effect in these states, mm or rad, by error frame and component."""
    sums: dict[tuple[int, int], Array] = {}
    for acts_at, component, values in effect.contributions(machine, state):
        key = acts_at % (len(machine.axes) + 2), component
        sums[key] = sums.get(key, 0.0) + values
    return sums


def lined(view: View) -> View:
    """The view with the fitted cause as one line from left to right."""
    order = np.argsort(view.x, kind="stable")
    return replace(view, curves=(Curve(view.x[order], view.fitted[order]),))
