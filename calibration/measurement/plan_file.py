"""Plans as files: measurement files without observations (contract 4.2), with the names of points."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from calibration.instruments import TouchProbe, instrument_in
from calibration.instruments.exact_numbers import joined
from calibration.instruments.ranging.ranging import STATION
from calibration.instruments.touch_probe import (
    PLAN_ID,
    SPHERE,
    TIP,
    header_lines,
    read_spheres,
)
from calibration.measurement.file import read_instrument
from calibration.measurement.measurement import with_moves
from calibration.measurement.plan import Plan
from calibration.measurement.states import (
    CARRIERS,
    MADE_BY,
    PLAIN_NAME,
    allow_columns,
    check_machine,
    read_states,
    refuse_unstated,
    state_columns,
)
from calibration.measurement.text_table import Table, read_table
from kinematics.machine import Machine, Vector
from kinematics.user_error import UserError
from kinematics.version import VERSION

MINUTES = "minutes"
"""Header key of the duration, min."""
POINT = "point"
"""Column with the names of points."""


def write_plan(plan: Plan, file: BinaryIO) -> None:
    """Write the plan: mm, degrees, s; with directions of approach unless the order of the rows gives the same."""
    columns = _columns(plan)
    head = [f"machine: {plan.machine.name}", f"strategy: {plan.strategy}", f"{MINUTES}: {plan.minutes:.1f}"]
    head.append(f"{MADE_BY}: ncomp {VERSION}")
    head += [f"{PLAN_ID}: {plan_id(plan)}", *_sphere_lines(plan)] if plan.spheres else _target_lines(plan)
    head += _station_lines(plan)
    lines = [*(f"# {line}" for line in head), ",".join(columns)]
    lines += [",".join(cells) for cells in zip(*columns.values(), strict=True)]
    file.write(("\n".join(lines) + "\n").encode())


def plan_id(plan: Plan) -> int:
    """Number of five digits of the rows and spheres of a plan: the log of its program has the same."""
    rows = [",".join(cells) for cells in zip(*_columns(plan).values(), strict=True)]
    return 10_000 + zlib.crc32("\n".join([*_sphere_lines(plan), *rows]).encode()) % 90_000


def _sphere_lines(plan: Plan) -> list[str]:
    return [f"instrument: {TouchProbe.kind()}", *header_lines(plan.targets[TIP], plan.spheres, ())]


def _target_lines(plan: Plan) -> list[str]:
    keys, found = {carrier: key for key, carrier in CARRIERS.items()}, []
    for name, target in plan.targets.items():
        if not PLAIN_NAME.fullmatch(name):
            raise UserError(f"target {name!r}: its name must not contain blanks, commas or colons")
        found.append(f"{keys[target.carrier]}.{name}: {' '.join(f'{v!r}' for v in target.position)}")
    return found


def _station_lines(plan: Plan) -> list[str]:
    """The instrument and its stations: with the column of its observations the plan is a measurement file."""
    instrument = plan.instrument
    lines = [f"{STATION}.{name}: {joined(position)}" for name, position in plan.stations.items()]
    if instrument is None:
        return lines
    uncertainties = (f"{key}: {getattr(instrument, key)!r}" for key in instrument.uncertainty_keys())
    return [f"instrument: {instrument.kind()}", *uncertainties, *lines]


def _columns(plan: Plan) -> dict[str, list[str]]:
    """The columns of the file."""
    state, axes = plan.state, plan.machine.names
    columns: dict[str, list[str]] = {}
    if state.time is not None:
        columns["time_s"] = [f"{t:.1f}" for t in state.time.tolist()]
    for name, column in zip(axes, (state.positions / plan.machine.scale).T, strict=True):
        columns[name] = [f"{value:.4f}" for value in (np.round(column, 4) + 0.0).tolist()]
    if state.approach is not None and not np.array_equal(state.approach, with_moves(state).approach):  # type: ignore[arg-type]
        for name, approach in zip(axes, state.approach.T, strict=True):
            columns[f"dir_{name}"] = [str(sign) for sign in approach.astype(int).tolist()]
    if plan.spheres:
        assert state.station is not None
        columns[SPHERE] = state.station.tolist()
    elif state.target is not None:
        columns["target"] = state.target.tolist()
    if plan.stations:
        assert state.station is not None
        columns[STATION] = state.station.tolist()
    columns |= {"run": plan.run.tolist(), POINT: plan.names.tolist()}
    if plan.axis is not None:
        columns |= _measured(plan, plan.axis, columns)
    return columns


def read_plan(path: Path, machine: Machine) -> Plan:
    """The plan in a file with the state columns of a measurement file; UserError for a value that cannot be used."""
    table, notes = read_table(path, "plan"), list[str]()
    check_machine(table, machine, notes)
    allow_columns(table, [*state_columns(machine), "axis", "target_mm", "target_deg", SPHERE])
    states = read_states(table, machine, notes)
    refuse_unstated(table, states.targets, "a plan")
    names = table.texts([name for name in (POINT,) if name in table.names])
    count = np.arange(1, len(table) + 1).astype(str)
    strategy = table.entries["strategy"].value if "strategy" in table.entries else path.name
    kind = instrument_in(table)
    instrument = read_instrument(table) if kind.STATIONED and {*kind.uncertainty_keys()} & {*table.entries} else None
    return Plan(
        machine, strategy, states.state, names.get(POINT, count), count if states.run is None else states.run,
        states.targets, states.axis, minutes=_minutes(table, states.state.time),
        position_count=len(np.unique(np.round(states.state.positions, 9), axis=0)), notes=tuple(notes),
        spheres=read_spheres(table) if kind.SET_UP == SPHERE else {}, stations=_stations(table, states.state.station),
        instrument=instrument,
    )  # fmt: skip


def _stations(table: Table, station: np.ndarray | None) -> dict[str, Vector]:
    """Positions of the stations, mm; empty without header lines of them. UserError for a row of another station."""
    stations: dict[str, Vector] = {}
    for key in table.entries:
        first, _, name = key.partition(".")
        if first == STATION:
            x, y, z = table.header_numbers(key, 3)
            stations[name] = (x, y, z)
    if not stations:
        return {}
    if station is None:
        raise UserError(f"{table.head}: the header has stations, but the column {STATION} is missing")
    unknown = np.flatnonzero(~np.isin(station, list(stations)))
    if len(unknown):
        row = int(unknown[0])
        name = str(station[row])
        table.fault(row, STATION, f"{name!r} is not in the header: state its position (# {STATION}.{name}: x y z)")
    return stations


def stated_plan_id(path: Path) -> int | None:
    """The number in the header of a plan of spheres; None without one."""
    table = read_table(path, "plan")
    return round(table.header_numbers(PLAN_ID, 1)[0]) if PLAN_ID in table.entries else None


def _measured(plan: Plan, axis: np.ndarray, columns: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """The axis of each row and its position, as in a measurement with an interferometer."""
    rotary = [each.name for each in plan.machine.axes if each.rotary]
    found = {"axis": axis.tolist()}
    for header, rows in (("target_mm", ~np.isin(axis, rotary)), ("target_deg", np.isin(axis, rotary))):
        if rows.any():
            cells = zip(axis.tolist(), rows.tolist(), range(len(axis)), strict=True)
            found[header] = [columns[name][row] if filled else "" for name, filled, row in cells]
    return found


def _minutes(table: Table, time: np.ndarray | None) -> float:
    """Duration as the header states it, with the set-up; otherwise that of the rows."""
    if MINUTES in table.entries:
        return table.header_numbers(MINUTES, 1)[0]
    return 0.0 if time is None else float(time[-1] - time[0]) / 60.0
