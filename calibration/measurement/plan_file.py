"""Plans as files: measurement files without observations (contract 4.2), with the names of points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from calibration.measurement.measurement import with_moves
from calibration.measurement.plan import Plan
from calibration.measurement.states import (
    CARRIERS,
    PLAIN_NAME,
    allow_columns,
    check_machine,
    read_states,
    refuse_unstated,
    state_columns,
)
from calibration.measurement.text_table import read_table
from kinematics.machine import Machine
from kinematics.user_error import UserError

POINT = "point"
"""Column with the names of points."""


def write_plan(plan: Plan, file: BinaryIO) -> None:
    """Write the plan: mm, degrees, s; with directions of approach unless the order of the rows gives the same."""
    state, axes = plan.state, plan.machine.names
    keys = {carrier: key for key, carrier in CARRIERS.items()}
    head = [f"machine: {plan.machine.name}", f"strategy: {plan.strategy}", f"minutes: {plan.minutes:.1f}"]
    for name, target in plan.targets.items():
        if not PLAIN_NAME.fullmatch(name):
            raise UserError(f"target {name!r}: its name must not contain blanks, commas or colons")
        head.append(f"{keys[target.carrier]}.{name}: {' '.join(f'{v!r}' for v in target.position)}")
    columns: dict[str, list[str]] = {}
    if state.time is not None:
        columns["time_s"] = [f"{t:.1f}" for t in state.time.tolist()]
    for name, column in zip(axes, (state.positions / plan.machine.scale).T, strict=True):
        columns[name] = [f"{value:.4f}" for value in (np.round(column, 4) + 0.0).tolist()]
    if state.approach is not None and not np.array_equal(state.approach, with_moves(state).approach):  # type: ignore[arg-type]
        for name, approach in zip(axes, state.approach.T, strict=True):
            columns[f"dir_{name}"] = [str(sign) for sign in approach.astype(int).tolist()]
    if state.target is not None:
        columns["target"] = state.target.tolist()
    columns |= {"run": plan.run.tolist(), POINT: plan.names.tolist()}
    if plan.axis is not None:
        columns |= _measured(plan, plan.axis, columns)
    lines = [*(f"# {line}" for line in head), ",".join(columns)]
    lines += [",".join(cells) for cells in zip(*columns.values(), strict=True)]
    file.write(("\n".join(lines) + "\n").encode())


def read_plan(path: Path, machine: Machine) -> Plan:
    """The plan in a file with the state columns of a measurement file; UserError for a value that cannot be used."""
    table, notes = read_table(path, "plan"), list[str]()
    check_machine(table, machine, notes)
    allow_columns(table, [*state_columns(machine), "axis", "target_mm", "target_deg"])
    states = read_states(table, machine, notes)
    refuse_unstated(table, states.targets, "a plan")
    names = table.texts([name for name in (POINT,) if name in table.names])
    count = np.arange(1, len(table) + 1).astype(str)
    strategy = table.entries["strategy"].value if "strategy" in table.entries else path.name
    return Plan(
        machine, strategy, states.state, names.get(POINT, count), count if states.run is None else states.run,
        states.targets, states.axis, minutes=_minutes(states.state.time), position_count=len(table), notes=tuple(notes),
    )  # fmt: skip


def _measured(plan: Plan, axis: np.ndarray, columns: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """The axis of each row and its position, as in a measurement with an interferometer."""
    rotary = [each.name for each in plan.machine.axes if each.rotary]
    found = {"axis": axis.tolist()}
    for header, rows in (("target_mm", ~np.isin(axis, rotary)), ("target_deg", np.isin(axis, rotary))):
        if rows.any():
            cells = zip(axis.tolist(), rows.tolist(), range(len(axis)), strict=True)
            found[header] = [columns[name][row] if filled else "" for name, filled, row in cells]
    return found


def _minutes(time: np.ndarray | None) -> float:
    return 0.0 if time is None else float(time[-1] - time[0]) / 60.0
