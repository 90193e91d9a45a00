"""Writes the measurement file that `calibration/measurement/file.py` reads."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from calibration.instruments.exact_numbers import converted, in_units, joined, texts
from calibration.measurement.measurement import Measurement
from calibration.measurement.measuring_date import MEASURED
from calibration.measurement.states import (
    CARRIERS,
    MADE_BY,
    PLAIN_NAME,
)
from kinematics.effects.base import UM
from kinematics.state import REFERENCE_DEGC
from kinematics.user_error import UserError
from kinematics.version import VERSION

WRITTEN_ROWS = 50_000
"""Number of rows converted to text at a time."""


def write_measurement(measurement: Measurement, file: BinaryIO, origin: str = "") -> None:
    """Write the measurement; reading it gives the same measurement, with last moves from the order of rows.

    origin: of the data, for the header line `made_by`.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    for line in (*header_lines(measurement), f"{MADE_BY}: ncomp {VERSION}{origin}"):
        text.write(f"# {line}\n")
    columns = measurement.instrument.file_columns(measurement) or columns_of(measurement)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for start in range(0, len(next(iter(columns.values()))), WRITTEN_ROWS):
        part = [column[start : start + WRITTEN_ROWS] for column in columns.values()]
        writer.writerows(zip(*map(texts, part), strict=True))
    text.flush()
    text.detach()


def header_lines(measurement: Measurement) -> Iterator[str]:
    """Header lines, without `# `."""
    instrument = measurement.instrument
    yield f"machine: {measurement.machine.name}"
    yield f"instrument: {instrument.kind()}"
    if measurement.measured is not None:
        yield f"{MEASURED}: {measurement.measured}"
    for name in instrument.uncertainty_keys():
        yield f"{name}: {getattr(instrument, name)!r}"
    yield from instrument.header_lines(measurement)
    if instrument.OWN_TIP:
        return
    keys = {carrier: key for key, carrier in CARRIERS.items()}
    for name, target in measurement.targets.items():
        if not PLAIN_NAME.fullmatch(name):
            raise UserError(f"target {name!r}: its name must not contain blanks, commas or colons")
        if not target.free:
            yield f"{keys[target.carrier]}.{name}: {joined(target.position)}"


def columns_of(measurement: Measurement) -> dict[str, np.ndarray]:
    """The columns of the file, in its units."""
    machine, state, instrument = measurement.machine, measurement.state, measurement.instrument
    columns: dict[str, np.ndarray | None] = {"time_s": state.time}
    for i, name in enumerate(machine.names):
        columns[name] = in_units(state.positions[:, i], machine.scale[i])
    columns |= _directions(measurement)
    if not instrument.OWN_TIP:
        columns["target"] = state.target
    columns |= {instrument.SET_UP: state.station, "run": measurement.run}
    columns |= instrument.observed_columns(measurement)
    if measurement.scatter is not None:
        columns["scatter_um"] = in_units(measurement.scatter, UM)
    columns |= {"feed": measurement.feed, "spindle_rpm": state.spindle_speed}
    if measurement.actual is not None:
        for i in np.flatnonzero(~np.isnan(measurement.actual).any(axis=0)).tolist():
            columns[f"actual_{machine.names[i]}"] = in_units(measurement.actual[:, i], machine.scale[i])
    for sensor, kelvin in state.temperatures.items():
        columns[f"temp_{sensor}"] = converted(
            kelvin, lambda k: k + REFERENCE_DEGC, lambda degrees: degrees - REFERENCE_DEGC
        )
    return {name: column for name, column in columns.items() if column is not None}


def _directions(measurement: Measurement) -> dict[str, np.ndarray]:
    """Columns dir_X ..., unless the order of the rows gives the same (for a part it gives no direction)."""
    state = measurement.state
    if state.approach is None:
        return {}
    from_order = measurement.instrument.in_order(state).approach
    assert from_order is not None
    if measurement.instrument.IN_ORDER_OF_MOVES and np.array_equal(state.approach, from_order):
        return {}
    signs = state.approach.astype(int)
    return {f"dir_{name}": signs[:, i] for i, name in enumerate(measurement.machine.names)}
