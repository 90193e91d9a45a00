"""The columns of a file of lengths and dial readings: a row for each length, and for each reading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.instruments.exact_numbers import in_units
from calibration.instruments.lengths import reading
from calibration.instruments.lengths.geometry import moved_axes, pairs_of
from kinematics.effects.base import UM

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

AGAINST = {"gauge": "", "square": "1", "reversed": "reversed"}
"""The cell of the column `square`, by what the dial touches."""
LENGTH_DECIMALS = 9
SIGNS = {1: "+", -1: "-", 0: ""}


def file_columns(measurement: Measurement) -> dict[str, np.ndarray]:
    """The columns as texts, lengths first; columns that no row fills are left out."""
    rows = [*_lengths(measurement), *_readings(measurement)]
    names = [name for name in reading.columns_known(measurement.machine) if any(row.get(name) for row in rows)]
    return {name: np.array([row.get(name, "") for row in rows]) for name in names}


def _lengths(measurement: Measurement) -> list[dict[str, str]]:
    """The cells of each length whose two ends are there."""
    machine, found = measurement.machine, []
    columns = zip(measurement.state.positions.T, machine.scale, strict=True)
    scaled = [in_units(column, scale) for column, scale in columns]
    for one, two in zip(*(rows.tolist() for rows in pairs_of(measurement)), strict=True):
        cells = {reading.NAME: str(measurement.groups[one]).partition(" (line")[0]}
        for axis, column in zip(machine.names, scaled, strict=True):
            cells |= {f"{axis}1": repr(float(column[one])), f"{axis}2": repr(float(column[two]))}
        length = float(measurement.observed[two, 0] - measurement.observed[one, 0])
        cells[reading.LENGTH_MM] = repr(round(length, LENGTH_DECIMALS))
        if measurement.scatter is not None:
            cells[reading.OWN_U] = repr(round(float(measurement.scatter[one] / UM * 2.0**0.5), LENGTH_DECIMALS))
        found.append(cells)
    return found


def _readings(measurement: Measurement) -> list[dict[str, str]]:
    """The cells of each reading of a dial gauge."""
    machine, axes, found = measurement.machine, moved_axes(measurement), []
    sides = measurement.state.need("approach", "a dial gauge")
    assert measurement.run is not None
    for row in np.flatnonzero(axes >= 0).tolist():
        kind, along = reading.role_of(str(measurement.run[row]))
        group = str(measurement.groups[row]).partition(" ")[2].rpartition(" ")[0]
        own = axes[row]
        cells = {
            reading.AXIS: machine.names[own],
            reading.ALONG: along,
            reading.POSITION: repr(float(measurement.state.positions[row, own])),
            reading.DIRECTION: SIGNS[int(sides[row, own])],
            reading.READING: repr(round(float(measurement.observed[row, 0] / UM), LENGTH_DECIMALS)),
            reading.SQUARE: AGAINST[kind],
            reading.RUN: group.removesuffix(" reversed"),
        }
        if measurement.scatter is not None:
            cells[reading.OWN_U] = repr(round(float(measurement.scatter[row] / UM), LENGTH_DECIMALS))
        found.append(cells)
    return found
