"""Plans as files: measurement files without observations (contract 4.2), with the names of points."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from calibration.measurement import with_moves
from calibration.places import CARRIERS, PLAIN_NAME, check_machine, read_places, state_columns
from calibration.plan import Plan
from calibration.table import read_table
from kinematics.errors import UserError
from kinematics.machine import Machine

POINT, MEASURED = "point", "measured"
"""Columns that only a plan has: the name of the point, and the axis that is measured on its own."""


def write_plan(plan: Plan, file: BinaryIO) -> None:
    """Write the plan: mm, degrees, s. Directions of approach stand in it unless the order of the rows says the same."""
    state, axes = plan.state, plan.machine.names
    keys = {carrier: key for key, carrier in CARRIERS.items()}
    head = [f"machine: {plan.machine.name}", f"strategy: {plan.strategy}", f"minutes: {plan.minutes:.1f}"]
    for name, target in plan.targets.items():
        if not PLAIN_NAME.fullmatch(name):
            raise UserError(f"target {name!r}: a name has no blanks, commas and colons")
        head.append(f"{keys[target.carrier]}.{name}: {' '.join(f'{v!r}' for v in target.position)}")
    columns: dict[str, list[str]] = {}
    if state.time is not None:
        columns["time_s"] = [f"{t:.1f}" for t in state.time.tolist()]
    for name, column in zip(axes, (state.positions / plan.machine.scale).T, strict=True):
        columns[name] = [f"{value:.4f}" for value in (np.round(column, 4) + 0.0).tolist()]
    if state.approach is not None and not np.array_equal(state.approach, with_moves(state).approach):  # type: ignore[arg-type]
        for name, approach in zip(axes, state.approach.T, strict=True):
            columns[f"dir_{name}"] = [str(sign) for sign in approach.astype(int).tolist()]
    for header, names in (("target", state.target), ("run", plan.run), (POINT, plan.names), (MEASURED, plan.axis)):
        if names is not None:
            columns[header] = names.tolist()
    lines = [*(f"# {line}" for line in head), ",".join(columns)]
    lines += [",".join(cells) for cells in zip(*columns.values(), strict=True)]
    file.write(("\n".join(lines) + "\n").encode())


def read_plan(path: Path, machine: Machine) -> Plan:
    """The plan in a file with the state columns of a measurement file; UserError for what can't be used."""
    table, notes = read_table(path, "plan"), list[str]()
    check_machine(table, machine, notes)
    known = [*state_columns(machine), POINT, MEASURED]
    table.allow_columns(lambda name: name in known or name.startswith("temp_"), known)
    places = read_places(table, machine, notes)
    texts = table.texts([name for name in (POINT, MEASURED) if name in table.names])
    count = np.arange(1, len(table) + 1).astype(str)
    strategy = table.entries["strategy"].value if "strategy" in table.entries else path.name
    for row, name in enumerate(texts.get(MEASURED, ())):
        if name not in machine.names:
            table.fault(row, MEASURED, f"machine {machine.name} has no axis {name!r}")
    return Plan(
        machine, strategy, places.state, texts.get(POINT, count), count if places.run is None else places.run,
        places.targets, texts.get(MEASURED), minutes=_minutes(places.state.time), places=len(table), notes=tuple(notes),
    )  # fmt: skip


def _minutes(time: np.ndarray | None) -> float:
    return 0.0 if time is None else float(time[-1] - time[0]) / 60.0
