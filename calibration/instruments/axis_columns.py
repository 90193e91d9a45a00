"""Columns of files in which each row measures one axis: the axis, the error motion, and its number."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kinematics.effects.base import COMPONENTS
from kinematics.machine import Machine
from kinematics.transforms import Array

if TYPE_CHECKING:
    from calibration.measurement.text_table import Table


def axis_columns(table: Table, machine: Machine) -> np.ndarray:
    """Index in the machine `(n,)` of the axis named in each row; UserError for an unknown axis."""
    names = table.texts(["axis"])["axis"]
    unknown = np.flatnonzero(~np.isin(names, machine.names))
    if len(unknown):
        row = int(unknown[0])
        table.fault(row, "axis", f"machine {machine.name} ({machine.chain}) has no axis {str(names[row])!r}")
    return np.array([machine.index(name) for name in names.tolist()])


def read_component(table: Table, machine: Machine) -> np.ndarray | None:
    """Observed error motion of each row `(n,)`, empty for the positioning deviation; None without the column."""
    if "component" not in table.names:
        return None
    letters = table.cells(["component"])["component"]
    unknown = np.flatnonzero(~np.isin(letters, ["", *COMPONENTS]))
    if len(unknown):
        row = int(unknown[0])
        table.fault(row, "component", f"{str(letters[row])!r} is none of {', '.join(COMPONENTS)}")
    turning = np.flatnonzero(machine.rotary[axis_columns(table, machine)] & (letters != ""))
    if len(turning):
        table.fault(
            int(turning[0]), "component", "only linear axes have components here; leave it empty for a rotary axis"
        )
    return letters


def by_kind(table: Table, machine: Machine, linear: str, rotary: str, angular: np.ndarray | None = None) -> Array:
    """Numbers `(n,)` from one column in rows of linear axes and from another in rows of rotary axes.

    `angular`: mask `(n,)` of the rows of the second column, if these are not the rows of rotary axes. In each row the
    other column is empty or missing.
    """
    turns = machine.rotary[axis_columns(table, machine)] if angular is None else angular
    values = np.empty(len(table))
    for name, rows in ((linear, ~turns), (rotary, turns)):
        if not rows.any():
            continue
        if name not in table.names:
            kind = "rotary" if name == rotary else "linear"
            subject = f"a {kind} axis" if angular is None else "a row of this kind"
            table.fault(int(np.flatnonzero(rows)[0]), "axis", f"{subject} needs the column {name}")
        if rows.all():
            return table.numbers([name])[name]
        filled = table.cells([name])[name] != ""
        wrong = np.flatnonzero(filled != rows)
        if len(wrong):
            table.fault(
                int(wrong[0]), name, "must be empty for an axis of the other kind" if filled[wrong[0]] else "empty"
            )
        part = replace(table, rows=[table.rows[i] for i in np.flatnonzero(rows).tolist()], lines=table.lines[rows])
        values[rows] = part.numbers([name])[name]
    return values
