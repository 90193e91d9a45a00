"""Error motions of ISO 230-1 as tables, for controls that make corrections of them by their own kinematics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from kinematics.basis import BSpline
from kinematics.effects import COMPONENTS, UM, URAD, Component, ControlTable, Effect, ErrorMotion
from kinematics.effects.base import own_component, own_motion
from kinematics.machine import Axis, Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.nodes import choose_nodes, fitted
from postproc.control_data.tables.target import Target
from postproc.control_data.tables.terms import to_steps

FINE_NODES, OTHER_AXES_NODES = 401, 16
NODE_RMS = (5e-6, 2e-8)
"""mm and rad RMS that are not worth further nodes."""


@dataclass(frozen=True)
class MotionTable:
    """One error motion of an axis, actual minus nominal, counted as in ncomp (docs/conventions.md)."""

    component: str
    axis: str
    nodes: Array
    """Positions `(k,)`, mm or degrees."""
    forward: Array
    """`(k,)`, mm or rad."""
    backward: Array

    @property
    def name(self) -> str:
        """E_XX ... E_CC."""
        return f"E_{self.component}{self.axis}"

    @property
    def angular(self) -> bool:
        """True of a rotation, in rad."""
        return self.component in "ABC"

    @property
    def mean(self) -> Array:
        """Mean of both directions."""
        return np.asarray((self.forward + self.backward) / 2)


def build_motions(
    target: Target, limits: Limits, angular_resolution: float, *, bidirectional: bool
) -> list[MotionTable]:
    """Tables of all error motions of a machine, with means over all variables other than their own axis.

    Location errors are in them, as slopes and constants. Resolution of translations in mm by the limits, of rotations
    in rad. Positioning by direction only with `bidirectional`.
    """
    machine, found = target.machine, []
    others = target.volume(OTHER_AXES_NODES)
    for j, axis in enumerate(machine.axes):
        x = target.positions_along(j, FINE_NODES)
        errors = {direction: _mean_errors(target, j, x, direction, others) for direction in (1, -1)}
        curves = {c: _curves(errors, k, c, axis, bidirectional=bidirectional) for k, c in enumerate(COMPONENTS)}
        steps = {c: angular_resolution if c in "ABC" else limits.resolution for c in COMPONENTS}
        significant = {c: curve for c, curve in curves.items() if np.abs(curve).max() >= steps[c] / 2}
        for group in [list(significant)] if limits.shared and significant else [[c] for c in significant]:
            nodes = _nodes(x, {c: significant[c] for c in group}, steps, limits, axis)
            for component in group:
                values = fitted(x, significant[component], nodes)
                if axis.turns_fully:
                    values[[0, -1]] = values[[0, -1]].mean(axis=0)
                values = to_steps(values, steps[component], 15)
                found.append(MotionTable(component, axis.name, nodes, values[:, 0], values[:, -1]))
    return found


def _curves(errors: dict[int, Array], k: int, component: str, axis: Axis, *, bidirectional: bool) -> Array:
    """Values of one component `(m, directions)`: in both directions only for positioning."""
    curves = np.stack([errors[1][:, k], errors[-1][:, k]], axis=1)
    own = bidirectional and component == own_component(axis.name)
    return curves if own else np.asarray(curves.mean(axis=1, keepdims=True))


def _nodes(x: Array, curves: dict[str, Array], steps: dict[str, float], limits: Limits, axis: Axis) -> Array:
    """Nodes for some components together, each in units of the RMS below which no nodes are added."""
    sizes = {c: max(0.25 * steps[c], NODE_RMS["ABC".find(c) >= 0]) for c in curves}
    scaled = np.concatenate([curve / sizes[c] for c, curve in curves.items()], axis=1)
    return choose_nodes(x, scaled, replace(limits, resolution=1.0, finest=1.0), axis.home, closing=axis.turns_fully)


def _mean_errors(target: Target, column: int, x: Array, direction: int, others: Array) -> Array:
    """Error motions of an axis `(m, 6)`, mm and rad, over positions of the others `(s, axes)`, mm and degrees."""
    machine = target.machine
    q = np.tile(others, (len(x), 1))
    q[:, column] = np.repeat(x, len(others))
    approach = np.zeros_like(q)
    approach[:, column] = direction
    errors = target.model.errors(machine, State(q * machine.scale, approach))[:, column]
    return np.asarray(errors.reshape(len(x), len(others), 6).mean(axis=1))


def effects_of_motions(machine: Machine, tables: Iterable[MotionTable]) -> list[Effect]:
    """The errors that the tables represent."""
    found: list[Effect] = []
    for table in tables:
        size = URAD if table.angular else UM
        nodes = tuple(table.nodes.tolist())
        if (table.forward == table.backward).all():
            values = tuple((table.forward / size).tolist())
            u = (0.0,) * len(values)
            found.append(ErrorMotion(cast(Component, table.component), table.axis, BSpline(nodes, 1), values, u=u))
            continue
        forward = own_motion(machine, table.axis)[2]
        for direction, row in ((1, table.forward), (-1, table.backward)):
            counted = tuple((forward / size * row).tolist())
            found.append(ControlTable(table.axis, (table.axis,), (nodes,), counted, cast(Any, direction)))
    return found
