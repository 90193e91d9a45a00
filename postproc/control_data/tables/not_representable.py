"""Errors that tables cannot represent: the part of each error motion that is no function of their variables.

Each error motion is converted into its correction on a grid of the volume. The residual of the tables' functions, means
over the grid, is the part that they cannot represent, however fine they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.effects import COMPONENTS
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_names_with_tool, error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.state import State
from kinematics.transforms import Array
from postproc.control_data.exported import WORTH_UM, Unrepresented
from postproc.control_data.tables.target import Target, positional, too_fine
from postproc.control_data.tables.terms import Surface, Term

GRID = {3: 9}
"""Positions along each axis, by the number of axes; `COARSE_NODES` for more."""
COARSE_NODES = 5
POINTS_A_WAVE = 6
"""Nodes of a table for each wave: with fewer the residual exceeds a tenth of the wave."""


def not_representable(target: Target, whole: ErrorModel, terms: Sequence[Term] | None) -> list[Unrepresented]:
    """The remaining errors, the largest first; those that depend on more than positions and directions at the end.

    Without `terms`, of tables of error motions: dependences on other axes than their own.
    """
    machine = target.machine
    n = GRID.get(len(machine.axes), COARSE_NODES)
    axes = [low + (high - low) * (np.arange(n) + 0.5) / n for low, high in target.bounds]
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)) * machine.scale
    errors = target.model.errors(machine, State(q, np.zeros_like(q))).reshape(len(q), -1)
    transform = error_transform_with_tool(machine, q, target.tool)[:, :3]
    if terms is None:
        return [*_not_of_their_own_axis(target, errors, transform, n), *_beyond(whole)]
    nominal = tool_point(machine, q, target.tool)
    found = []
    for k, name in enumerate(error_names_with_tool(machine)):
        if not errors[:, k].any() or _by_a_rotary_table(target, k, terms):
            continue
        aim = nominal - transform[:, :, k] * errors[:, [k]]
        required = (linear_positions(machine, q, aim, target.tool) - q).reshape(*(n,) * len(axes), -1)
        residual = float(np.sqrt(np.mean(np.sum(_beside_tables(target, required, terms) ** 2, axis=-1)))) * 1e3
        if residual > WORTH_UM:
            found.append(Unrepresented(name, round(residual, 4), _reason(name)))
    return [*sorted(found, key=lambda residual: -residual.rms_um), *_reversals(target, terms), *_beyond(whole)]


def short_waves(target: Target, points: int) -> list[Unrepresented]:
    """Effects that repeat faster than so many points along their axis can follow."""
    machine, found = target.machine, []
    for effect in target.model.effects:
        wave = effect.shortest_wave
        if wave is None:
            continue
        i = machine.index(wave[0])
        if wave[1] * points < POINTS_A_WAVE * np.ptp(target.bounds[i]) or too_fine(effect, machine):
            found.append(
                Unrepresented(effect.name, float("nan"), f"waves of {wave[1]:g} {machine.axes[i].unit} are too short")
            )
    return found


def _not_of_their_own_axis(target: Target, errors: Array, transform: Array, n: int) -> list[Unrepresented]:
    count, found = len(target.machine.axes), []
    for k, name in enumerate(error_names_with_tool(target.machine)):
        grid = errors[:, k].reshape((n,) * count)
        others = tuple(j for j in range(count) if j != k // 6)
        beside = (grid - grid.mean(axis=others, keepdims=True) if k // 6 < count else grid).reshape(-1, 1)
        residual = float(np.sqrt(np.mean(np.sum((transform[:, :, k] * beside) ** 2, axis=1)))) * 1e3
        if residual > WORTH_UM:
            found.append(Unrepresented(name, round(residual, 4), "depends on other axes as well"))
    return sorted(found, key=lambda residual: -residual.rms_um)


def _by_a_rotary_table(target: Target, column: int, terms: Sequence[Term]) -> bool:
    """True of the positioning error of a rotary axis that has a table of its own."""
    column_of_axis, component = divmod(column, 6)
    if column_of_axis >= len(target.machine.axes):
        return False
    axis = target.machine.axes[column_of_axis]
    own = axis.rotary and own_component(axis.name) == COMPONENTS[component]
    return own and any(term.output == axis.name and term.inputs == (axis.name,) for term in terms)


def _beside_tables(target: Target, required: Array, terms: Sequence[Term]) -> Array:
    """Residual of a correction after the means that the tables can hold, on the grid `(n, ..., axes)`."""
    axes, residual = target.machine.axes, required.copy()
    every = tuple(range(len(axes)))
    for i, axis in enumerate(axes):
        sources: set[tuple[int, ...]] = set()
        for term in (term for term in terms if term.output == axis.name):
            columns = tuple(sorted(target.machine.index(name) for name in term.inputs))
            sources |= {(), columns}
            if isinstance(term.factors[0], Surface):
                sources |= {(column,) for column in columns}
        for source in sorted(sources, key=len):
            rest = tuple(j for j in every if j not in source)
            residual[..., i] = residual[..., i] - residual[..., i].mean(axis=rest, keepdims=True)
    return residual


def _reason(name: str) -> str:
    component = name[2] if name.startswith("E_") else ""
    if component in tuple("ABC"):
        return "angular error: it acts away from the line that the tables correct"
    return "the tables have no function for its direction or its axis" if component else "at the tool"


def _reversals(target: Target, terms: Sequence[Term]) -> list[Unrepresented]:
    """Backlash of axes whose table is the same in both directions."""
    bidirectional = {term.output for term in terms if term.direction}
    machine, found = target.machine, []
    low, high = target.bounds.T
    middle = (low + high) / 2 * machine.scale
    for i, axis in enumerate(machine.axes):
        if axis.name in bidirectional or not target.depends_on_direction(i):
            continue
        directions = np.zeros((2, len(machine.axes)))
        directions[:, i] = 1.0, -1.0
        q = np.tile(middle, (2, 1))
        corrections = target.correction(q, directions)[:, i] / machine.scale[i]
        half = abs(float(corrections[0] - corrections[1])) / 2 * (1e3 if not axis.rotary else np.radians(1.0) * 1e6)
        found.append(
            Unrepresented(f"reversal of {axis.name}", round(half, 4), "the table is the same in both directions")
        )
    return found


def _beyond(whole: ErrorModel) -> list[Unrepresented]:
    """Effects that depend on variables that tables do not have: their size is not known."""
    beyond = [e for e in whole.effects if e.ACTS_ON != "instrument" and not positional(e)]
    reasons = {e.name: ", ".join(e.needs).replace("_", " ") or "variables that no table has" for e in beyond}
    return [Unrepresented(name, float("nan"), f"depends on {why}") for name, why in reasons.items()]
