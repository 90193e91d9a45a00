"""Plain lists of targets and readings of one axis, as of calipers, a digital scale or a dial gauge.

    # axis: X
    # u_um: 30
    target_mm,reading_mm
    0,0.02
    100,100.05

A reading is the position that the axis has reached, mm or degrees, from any zero. Rows are in the order of acquisition:
up and down again is one run. The separator is `,` `;` or a tab; with the latter two a decimal comma is also read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibration.measurement.logged import with_columns
from calibration.measurement.readers import delimited
from calibration.measurement.readers.text import axis_of
from calibration.measurement.text_table import Entry, Table
from kinematics.machine import Machine

PAIRS = {
    ("target_mm", "reading_mm"): ("deviation_um", 1e3),
    ("target_deg", "reading_deg"): ("deviation_urad", math.pi / 180.0 * 1e6),
}
"""Columns of targets and readings: the column of their deviations, and its units in one of the reading's."""
DIRECTION, RUN, AXIS = "direction", "run", "axis"


def recognises(head: str) -> bool:
    """True for names of columns with a target and a reading, and nothing else."""
    names = delimited.names_in(head)
    return any(sorted(map(_plain, names)) == sorted(pair) for pair in PAIRS)


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, and notes."""
    table, notes = delimited.plain_table(data, source, machine, header, _plain)
    return with_deviations(table, machine), notes


def _plain(name: str) -> str:
    """The name of a column with its unit behind an underscore: `target_mm` for `Target [mm]`."""
    return re.sub(r"\s*[\[(]\s*(\w+)\s*[\])]$", r"_\1", name.strip().lower())


def with_deviations(table: Table, machine: Machine) -> Table:
    """The table with deviations in place of readings, and with axis, run and direction by the order of its rows."""
    columns = {name: column.tolist() for name, column in table.cells(table.names).items()}
    for (target, reading), (deviation, size) in PAIRS.items():
        if reading in columns:
            table.need_columns([target], "a list of readings")
            numbers = table.numbers([target, reading])
            columns[deviation] = list(map(repr, (size * (numbers[reading] - numbers[target])).round(4).tolist()))
            sides = _sides(numbers[target])
            del columns[reading]
    stated = table.entries.get(AXIS, Entry(""))
    if AXIS not in columns:
        columns[AXIS] = [axis_of(stated.value, machine, table.source)] * len(table)
    columns.setdefault(DIRECTION, ["+" if side > 0 else "-" for side in sides])
    columns.setdefault(RUN, list(map(str, 1 + np.cumsum(np.diff(sides, prepend=1.0) > 0))))
    other = with_columns(table, columns, {"instrument": "interferometer"})
    return replace(other, entries={key: value for key, value in other.entries.items() if key != AXIS})


def _sides(targets: np.ndarray) -> np.ndarray:
    """Direction, -1.0 or 1.0, in which each target `(n,)` was reached; the first one as the second."""
    steps = np.sign(np.diff(targets, prepend=targets[:1]))
    moved = np.flatnonzero(steps)
    if not len(moved):
        return np.ones(len(targets))
    last = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(steps)), moved[0]))
    return np.asarray(steps[last])
