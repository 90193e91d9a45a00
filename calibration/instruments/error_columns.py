"""Error motions of linear axes as columns (E_XX_um ... E_CX_urad), as from six-degree lasers: converted to single rows.

A column is named by the error motion and its unit: EYX_um or E_YX_um is the straightness of X in y, EBX_urad the
rotation of X about y. Signs are those of ISO 230-1: tool relative to workpiece, along the positive directions of the
machine's x, y and z and right-handed about them (for an inclined axis: of its error frame).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from kinematics.machine import Machine
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.text_table import Table

NAME = re.compile(r"E_?([XYZABC])([A-Za-z]\w*?)_(um|urad)")
"""Component, axis and unit."""


def spread(table: Table, machine: Machine) -> Table:
    """The table with one row for each error motion; unchanged without such columns.

    UserError for an unknown axis, a rotary axis, and a unit that does not belong to the component.
    """
    found = {name: match for name in table.names if (match := NAME.fullmatch(name))}
    if not found:
        return table
    for name, match in found.items():
        _check(table, machine, name, match)
    clash = [name for name in ("component", "deviation_um", "deviation_urad") if name in table.names]
    if clash:
        raise UserError(
            f"{table.head} column {clash[0]}: is not allowed together with columns of error motions "
            f"({', '.join(found)}): keep one kind of column"
        )
    kept = [name for name in table.names if name not in found and name != "axis"]
    cells, beside = table.cells(list(found)), table.cells(kept)
    filled = np.stack([column != "" for column in cells.values()], axis=1)
    if not filled.any():
        raise UserError(f"{table.head}: no row has an error motion")
    row, which = np.nonzero(filled)
    names = list(found)
    texts = {name: column[row].tolist() for name, column in beside.items()}
    texts["axis"] = [found[names[i]][2] for i in which.tolist()]
    _check_axis(table, row, texts["axis"])
    texts["component"] = [found[names[i]][1] for i in which.tolist()]
    if "target_mm" not in texts:
        _take_targets(table, texts)
    values = [cells[names[i]][r] for r, i in zip(row.tolist(), which.tolist(), strict=True)]
    for unit in ("um", "urad"):
        own = [value if found[names[i]][3] == unit else "" for value, i in zip(values, which.tolist(), strict=True)]
        if any(own):
            texts[f"deviation_{unit}"] = own
    return table.with_rows(texts, table.lines[row].tolist())


def _check(table: Table, machine: Machine, name: str, match: re.Match[str]) -> None:
    component, axis, unit = match.groups()
    where = f"{table.head} column {name}"
    if axis not in machine.names:
        raise UserError(f"{where}: machine {machine.name} ({machine.chain}) has no axis {axis!r}")
    if machine.axes[machine.index(axis)].rotary:
        raise UserError(
            f"{where}: columns of error motions belong to linear axes; a rotary axis needs the column target_deg"
        )
    expected = "um" if component in "XYZ" else "urad"
    if unit != expected:
        raise UserError(f"{where}: E_{component}{axis} is in {expected}")


def _check_axis(table: Table, row: np.ndarray, axes: list[str]) -> None:
    """UserError if a column `axis` names another axis than the columns of error motions."""
    if "axis" not in table.names:
        return
    stated = table.texts(["axis"])["axis"][row]
    wrong = np.flatnonzero(stated != np.array(axes))
    if len(wrong):
        first = int(wrong[0])
        table.fault(int(row[first]), "axis", f"{stated[first]}, but the row has an error motion of {axes[first]}")


def _take_targets(table: Table, texts: dict[str, list[str]]) -> None:
    """The target of each row from the column of its axis."""
    missing = sorted({axis for axis in texts["axis"] if axis not in texts})
    if missing:
        raise UserError(
            f"{table.head}: the position of {', '.join(missing)} is missing: column target_mm or {missing[0]}"
        )
    texts["target_mm"] = [texts[axis][i] for i, axis in enumerate(texts["axis"])]
