"""Axis positions of the rows of a measurement file: from axis columns, target positions or nominal features."""

from __future__ import annotations

import numpy as np

from calibration.instruments.axis_columns import axis_columns, by_kind
from calibration.measurement.text_table import Table
from calibration.registration.registration import rigid
from kinematics.forward import tool_point
from kinematics.machine import Machine, Vector
from kinematics.transforms import Array

SAME_COLUMN_POSITION = 1e-6
"""Difference, mm or rad, up to which two columns for one axis agree."""
NOMINAL_AGREES = 1e-3
"""Difference, mm, up to which axis positions and nominal features, both rounded, agree."""


def of_axes(table: Table, machine: Machine, notes: list[str]) -> Array:
    """Commanded positions `(n, axes)`, mm and rad; home for an axis without a column."""
    positions = np.tile([axis.home for axis in machine.axes], (len(table), 1))
    given = table.numbers([name for name in machine.names if name in table.names])
    for name, column in given.items():
        positions[:, machine.index(name)] = column
    _note_home(machine, [name for name in machine.names if name not in given], notes)
    return np.asarray(positions * machine.scale)


def of_targets(table: Table, machine: Machine, notes: list[str]) -> Array:
    """Positions `(n, axes)` in a table with one measured axis per row: its target; other axes as in `of_axes`."""
    columns = axis_columns(table, machine)
    measured = [name for i, name in enumerate(machine.names) if np.any(columns == i)]
    aside: list[str] = []
    positions = of_axes(table, machine, aside)
    rows = np.arange(len(table))
    target = by_kind(table, machine, "target_mm", "target_deg") * machine.scale[columns]
    for name in [name for name in measured if name in table.names]:
        i = machine.index(name)
        differ = np.flatnonzero((columns == i) & (np.abs(positions[:, i] - target) > SAME_COLUMN_POSITION))
        if len(differ):
            table.fault(int(differ[0]), name, "differs from the target of this axis")
    positions[rows, columns] = target
    missing = [name for name in machine.names if name not in table.names and measured != [name]]
    _note_home(machine, missing, notes, "in runs of other axes" if len(measured) > 1 else "")
    return positions


def of_part(table: Table, machine: Machine, tool: Array, notes: list[str]) -> tuple[Array, Vector]:
    """Positions `(n, axes)`, mm and rad, with the tool point on the nominal features, and the part's zero, mm.

    Rotary axes, and linear ones that are not needed, are at home; the tool point is affine in the others.
    """
    zero = _given_zero(table)
    if zero is None:
        zero = (0.0, 0.0, 0.0)
        notes.append("part_offset is missing: the zero of the part is assumed at that of the workpiece frame")
    if "nominal_z" not in table.names:
        notes.append("column nominal_z is missing: the features are assumed at z = 0 of the part")
    points = _nominal(table) + zero
    home = np.array([axis.home for axis in machine.axes]) * machine.scale
    movers = list(machine.translators)
    home[movers] = 0.0
    start = tool_point(machine, home, tool)
    steps = np.repeat(home[None], 3, axis=0)
    steps[np.arange(3), movers] = 1.0
    along = (tool_point(machine, steps) - tool_point(machine, home)).T
    positions = np.tile(home, (len(table), 1))
    positions[:, movers] = np.linalg.solve(along, (points - start).T).T
    standing = ", ".join(machine.names[i] for i in movers)
    notes.append(f"columns of axis positions are missing: the positions of {standing} follow from the nominal features")
    _note_home(machine, [name for i, name in enumerate(machine.names) if i not in movers], notes)
    return positions, zero


def _nominal(table: Table) -> Array:
    """Nominal features `(n, 3)`, mm, in the part's frame; z is 0 without a column."""
    table.need_columns(["nominal_x", "nominal_y"], "a part")
    names = [name for name in ("nominal_x", "nominal_y", "nominal_z") if name in table.names]
    columns = list(table.numbers(names).values())
    return np.stack([*columns, *[np.zeros(len(table))] * (3 - len(names))], axis=1)


def _given_zero(table: Table) -> Vector | None:
    if "part_offset" not in table.entries:
        return None
    x, y, z = table.header_numbers("part_offset", 3)
    return x, y, z


def observed_zero(table: Table, points: Array, notes: list[str]) -> Vector:
    """The part's zero, mm, for tool points `(n, 3)`; a note if they do not fit the nominal features."""
    nominal = _nominal(table)
    planar = "nominal_z" not in table.names
    left = points - rigid(nominal, points, planar=planar).apply(nominal)
    worst = float(np.linalg.norm(left[:, :2] if planar else left, axis=1).max())
    if worst > NOMINAL_AGREES:
        notes.append(
            f"nominal features and the tool points at the positions of the axes differ by up to {worst:.4g} mm, "
            "after a shift and a turn: the positions of the axes are used"
        )
    x, y, z = (points - nominal).mean(axis=0).tolist()
    return _given_zero(table) or (x, y, z)


def _note_home(machine: Machine, names: list[str], notes: list[str], when: str = "") -> None:
    if names:
        homes = ", ".join(f"{name} {machine.axes[machine.index(name)].home:g}" for name in names)
        units = "mm, deg" if machine.rotary.any() else "mm"
        notes.append(
            f"no column of {', '.join(names)}: the home position is used ({homes} {units}){when and f' {when}'}"
        )
