"""Reads the measurement file: commands to the machine and observations as CSV (contract 4.2)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.instruments import KINDS, Instrument
from calibration.measurement.measurement import Measurement
from calibration.measurement.measuring_date import MEASURED, measuring_date, measuring_start
from calibration.measurement.states import (
    MeasurementStates,
    allow_columns,
    check_machine,
    is_simulated,
    note_unknown_keys,
    read_states,
    refuse_unstated,
    state_columns,
)
from calibration.measurement.text_table import Table, read_table
from kinematics.effects.base import UM
from kinematics.files.mistaken import none_of
from kinematics.files.time_stamps import ZONE
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError


def read_measurement(path: Path, machine: Machine) -> Measurement:
    """The measurement in a file; UserError with line and column for a value that cannot be used."""
    return measurement_of(read_table(path, "measurement file"), machine)


def measurement_of(table: Table, machine: Machine) -> Measurement:
    """The measurement in a table of the contract's columns."""
    notes: list[str] = []
    kind = _kind(table)
    table = kind.converted(table, machine)
    check_machine(table, machine, notes)
    kind.refuse_other_files(table)
    instrument = read_instrument(table)
    _check_names(table, kind, machine, notes)
    spheres, distances = kind.read_set_ups(table)
    states = read_states(table, machine, notes)
    instrument.check_rows(table, states)
    observed = kind.read_observed(table, machine, states)
    if not kind.ANY_TARGETS:
        _refuse_other_targets(table, states, kind.kind())
    measurement = Measurement(
        machine,
        instrument,
        replace(states.state, observed=in_space(observed)),
        observed,
        states.targets,
        states.stands_on,
        states.axis,
        states.run,
        states.actual,
        states.feed,
        states.part_zero,
        table.lines,
        table.source,
        table.fingerprint,
        tuple(notes),
        component=states.component,
        scatter=_scatter(table),
        spheres=spheres,
        distances=distances,
        simulated=is_simulated(table),
        measured=measuring_date(table),
        start=measuring_start(table),
    )
    return instrument.placed(measurement, table)


def _check_names(table: Table, kind: type[Instrument], machine: Machine, notes: list[str]) -> None:
    """UserError for unknown columns, and for missing ones; notes on unknown header keys."""
    keys = ["machine", "instrument", MEASURED, ZONE]
    note_unknown_keys(table, lambda key: key in keys or kind.is_header_key(key), notes)
    allow_columns(table, [*kind.OBSERVED, *state_columns(machine), *kind.OPTIONAL])
    table.need_columns(kind.REQUIRED, kind.a_kind())


def _refuse_other_targets(table: Table, states: MeasurementStates, kind: str) -> None:
    """UserError for targets that are not on the tool, and for those whose position the header does not give."""
    refuse_unstated(table, states.targets, kind)
    if not all(target.known for target in states.targets.values()):
        raise UserError(
            f"{table.source}: only a laser tracker can have targets on the table or on the bed, but the instrument is "
            f"{kind}"
        )


def _kind(table: Table) -> type[Instrument]:
    """The class of the instrument; UserError without a known one."""
    if "instrument" not in table.entries:
        plan = ": this is a plan, not its measurement" if "strategy" in table.entries else ""
        raise UserError(f"{table.source}{plan}: header line '# instrument: {' | '.join(KINDS)}' is missing")
    kind = table.entries["instrument"].value
    if kind not in KINDS:
        table.header_fault("instrument", none_of(kind, KINDS))
    return KINDS[kind]


LARGEST_U = 1e6
"""Largest accepted standard uncertainty of an instrument, um or um/m: a metre."""


def read_instrument(table: Table) -> Instrument:
    """The instrument with its uncertainties; UserError if the file does not give them."""
    kind = _kind(table)
    values: dict[str, Any] = {}
    for key in kind.uncertainty_keys():
        if key in table.entries:
            (values[key],) = table.header_numbers(key, 1)
            if values[key] < 0:
                table.header_fault(key, f"{values[key]:g} is negative: expected 0 or more")
            if values[key] > LARGEST_U:
                table.header_fault(key, f"{values[key]:g} is more than {LARGEST_U:g}: this is not an uncertainty")
    kind.check_stated(table, values)
    return kind(**values, **kind.read_own(table))


def _scatter(table: Table) -> Array | None:
    """Standard uncertainties `(n,)`, mm, of the means in the rows; None without the column."""
    if "scatter_um" not in table.names:
        return None
    column = table.numbers(["scatter_um"])["scatter_um"]
    if np.any(column < 0.0):
        table.fault(int(np.argmax(column < 0.0)), "scatter_um", "below 0")
    if np.any(column > LARGEST_U):
        table.fault(int(np.argmax(column > LARGEST_U)), "scatter_um", f"more than {LARGEST_U:g}, and no uncertainty")
    return column * UM


def in_space(observed: Array) -> Array | None:
    """Observed points `(n, 3)`, mm, of observations `(n, components)`; z = 0 where a part is measured in x and y.

    None for an interferometer, which observes no points.
    """
    if observed.shape[1] == 1:
        return None
    return np.concatenate([observed, np.zeros((len(observed), 3 - observed.shape[1]))], axis=1)
