"""The measurement file (contract 4.2), written from the columns of a session."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

import numpy as np

from virtual_machine.chain import Array
from virtual_machine.observe import Laser, Tracker
from virtual_machine.session import Session


def tracker_sheet(session: Session, tracker: Tracker, points: Array) -> str:
    """The file of a tracker's readings `(n, 3)`, mm."""
    header = ["instrument: laser-tracker", *(f"{key}: {value:g}" for key, value in asdict(tracker).items())]
    header += [f"table.{name}: {_vector(place)}" for name, place in session.references.items()]
    columns = _columns(session) | {"target": session.target}
    columns |= {letter: _decimals(points[:, i], 6) for i, letter in enumerate("xyz")}
    return _text(session, header, columns)


def laser_sheet(session: Session, axis: str, laser: Laser, readings: Array) -> str:
    """The file of an interferometer's readings `(n,)`, mm, along one linear axis."""
    header = ["instrument: interferometer", *(f"{key}: {value:g}" for key, value in asdict(laser).items())]
    forward = np.where(session.approach(axis) < 0, "-", "+")
    columns = _columns(session) | {"axis": np.full(len(session), axis), "direction": forward}
    columns |= {"target_mm": _decimals(session.place(axis), 4), "deviation_um": _decimals(readings * 1e3, 4)}
    return _text(session, header, columns)


def _columns(session: Session) -> dict[str, Iterable[object]]:
    """Those of the state, by name, in the order of the contract."""
    columns: dict[str, Iterable[object]] = {}
    if session.time is not None:
        columns["time_s"] = _decimals(session.time, 1)
    columns |= {name: _decimals(session.place(name), 4) for name in session.chain.names}
    if session.feed is not None:
        columns["feed"] = _decimals(session.feed, 0)
    columns |= {
        name: column for name, column in (("station", session.station), ("run", session.run)) if column is not None
    }
    return columns | {f"temp_{name}": _decimals(column, 3) for name, column in session.temperatures.items()}


def _text(session: Session, header: list[str], columns: dict[str, Iterable[object]]) -> str:
    targets = [f"target.{name}: {_vector(place)}" for name, place in session.targets.items()]
    lines = [f"# {line}" for line in (f"machine: {session.chain.name}", *header, *targets)]
    lines += [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    return "\n".join(lines) + "\n"


def _decimals(column: Array, places: int) -> list[str]:
    return [f"{value:.{places}f}" for value in column.tolist()]


def _vector(place: Array) -> str:
    return " ".join(f"{value:.4f}" for value in place.tolist())
