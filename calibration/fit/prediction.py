"""Deviations of the tool point, or of a target, that an error model predicts at a table of states.

Actual minus nominal, tool relative to workpiece, in the workpiece frame, by the exact matrix product; standard
uncertainties to first order from the covariance of the parameters. Effects of the instrument are excluded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calibration.instruments import KINDS
from calibration.measurement.measurement import Measurement
from calibration.measurement.measuring_date import MEASURED
from calibration.measurement.states import (
    MeasurementStates,
    allow_columns,
    check_machine,
    note_unknown_keys,
    read_states,
    refuse_unstated,
    state_columns,
)
from calibration.measurement.text_table import Table, read_table
from kinematics.columns import point_deviations
from kinematics.deviation import UM_PER_MM, exact_deviation
from kinematics.error_model.beyond_range import beyond_range
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.files.mistaken import kind_of_program
from kinematics.files.number_text import uncertainty
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, blocks
from kinematics.user_error import UserError
from rendering.shown import Shown

ADDED = ("dx_um", "dy_um", "dz_um", "u_dx_um", "u_dy_um", "u_dz_um")
"""Columns of a prediction."""
MOST_STATES_COMPARED = 1000
"""Largest number of states that are compared with each other."""
LEVER_ARM_MM = 100.0
"""Lever arm, mm, at which errors count that an interferometer measures as angles of a rotary axis."""


@dataclass(frozen=True)
class Points:
    """The states of a file, and its table with all columns."""

    machine: Machine
    table: Table
    states: MeasurementStates
    notes: tuple[str, ...]


class Predicted(NamedTuple):
    """Predictions of a block of rows."""

    rows: slice
    deviation: Array
    """Deviations `(n, 3)`, um."""
    u: Array
    """Standard uncertainties `(n, 3)`, um, k = 1."""


@dataclass(frozen=True, repr=False)
class Prediction(Shown):
    """The deviations that a calibration predicts at a table of states, computed a block at a time."""

    machine: Machine
    """The machine."""
    model: ErrorModel
    """The calibration."""
    state: State
    """The states of the machine."""
    tool: Array
    """Tool vectors `(n, 3)`, mm."""
    given_notes: tuple[str, ...] = ()
    """Notes on the states."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{len(self.state)} states of {self.machine.name}, calibration {self.model.id}"

    @property
    def columns(self) -> dict[str, Array]:
        """Axis positions, mm and degrees, deviations and their standard uncertainties (k = 1), um, by name `(n,)`."""
        axes = zip(self.machine.names, (self.state.positions / self.machine.scale).T, strict=True)
        return dict(axes) | dict(zip(ADDED, np.hstack([self.deviation_um, self.u_um]).T, strict=True))

    def blocks(self) -> Iterator[Predicted]:
        """The predictions, a block of rows at a time."""
        return predictions(self.model, self.machine, self.state, self.tool)

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        deviations, uncertainties = zip(*((block.deviation, block.u) for block in self.blocks()), strict=True)
        return np.concatenate(deviations), np.concatenate(uncertainties)

    @property
    def deviation_um(self) -> Array:
        """Deviations `(n, 3)`, um, actual minus nominal, tool relative to workpiece, in the workpiece frame."""
        return self._whole[0]

    @property
    def u_um(self) -> Array:
        """Standard uncertainties `(n, 3)` of the deviations, um, k = 1."""
        return self._whole[1]

    def relative(self) -> RelativeDeviation:
        """Deviations relative to their mean, with their uncertainties, at `MOST_STATES_COMPARED` states or fewer."""
        return relative_at_most(self.model, self.machine, self.state, self.tool)

    @property
    def notes(self) -> list[str]:
        """Notes on positions beyond the calibrated range, and on a calibration without uncertainties."""
        notes = [*self.given_notes, *beyond_range(self.model.outside(self.machine, self.state))]
        effects = self.model.effects
        if effects and self.model.covariance is None and not any(any(effect.uncertainties) for effect in effects):
            notes.append("the calibration has no uncertainties: every deviation counts as significant")
        return notes


class RelativeDeviation(NamedTuple):
    """Deviations at several states relative to their mean, and the shift that all have in common; um."""

    deviation: Array
    """Deviations `(n, 3)` less their mean."""
    u: Array
    """Standard uncertainties `(n, 3)` of these differences, k = 1."""
    u_shift: Array
    """Standard uncertainties `(3,)` of the mean, the shift common to all states. A work offset that is touched off on
    the machine includes this shift, and data of one tool vector do not show it."""

    @property
    def u_between(self) -> Array:
        """RMS over the states `(3,)` of the uncertainties of the differences, um."""
        mean: Array = (self.u**2).mean(axis=0)
        return mean**0.5

    def __str__(self) -> str:
        known = (self.u_between > 0.0) | (self.u_shift > 0.0)
        known = known if known.any() else ~known  # a calibration without uncertainties
        between, shift = (
            ", ".join(uncertainty(u, 2) for u in values[known].tolist()) for values in (self.u_between, self.u_shift)
        )
        inside, outside = (
            ", ".join(name for name, shown in zip("xyz", mask, strict=True) if shown) for mask in (known, ~known)
        )
        return (
            f"Deviations relative to their mean have standard uncertainties (k=1) of {between} um in {inside}. "
            f"The shift common to all has {shift} um; it disappears if the zero is touched off on the machine."
        ) + (f" Deviations in {outside} are unknown: the model has no error there." if outside else "")

    def json(self) -> dict[str, list[float]]:
        """Standard uncertainties in x, y and z, um, for programs."""
        return {"between_positions": self.u_between.tolist(), "common_shift": self.u_shift.tolist()}


def relative(model: ErrorModel, machine: Machine, state: State, tool: Array) -> RelativeDeviation:
    """Deviations at states relative to their mean, tool `(n, 3)`, mm; all states at once."""
    deviation = exact_deviation(machine, state.positions, model.errors(machine, state), tool).position
    design = deviation_design(model, machine, state, tool)
    mean = design.mean(axis=0, keepdims=True)
    return RelativeDeviation(
        (deviation - deviation.mean(axis=0)) * UM_PER_MM,
        model.propagated(design - mean) * UM_PER_MM,
        model.propagated(mean)[0] * UM_PER_MM,
    )


def deviation_design(model: ErrorModel, machine: Machine, state: State, tool: Array) -> Array:
    """Derivatives `(n, 3, p)`, mm, of the deviations at states by the parameters; tool `(n, 3)`, mm."""
    return model.design(machine, state, error_transform_with_tool(machine, state.positions, tool)[:, :3])


def relative_at_most(
    model: ErrorModel, machine: Machine, state: State, tool: Array, most: int = MOST_STATES_COMPARED
) -> RelativeDeviation:
    """As `relative`, at `most` states or fewer, evenly spread."""
    return relative(model, machine, *evenly_spread(state, tool, most))


def evenly_spread(state: State, tool: Array, most: int = MOST_STATES_COMPARED) -> tuple[State, Array]:
    """At most so many of the states, evenly spread, with their tool vectors."""
    rows = np.unique(np.linspace(0, len(state) - 1, min(len(state), most)).astype(int))
    return state.rows(rows), tool[rows]


def relative_deviations(model: ErrorModel, measurement: Measurement) -> RelativeDeviation:
    """Predicted deviations of the tool target with the most rows, at evenly spread measured states."""
    return relative_at_most(model, measurement.machine, *usual_states(measurement))


def usual_states(measurement: Measurement) -> tuple[State, Array]:
    """Measured states, and the vector `(n, 3)`, mm, of the tool target with the most rows, or an arm."""
    if measures_angles(measurement):
        return measurement.state, np.full((len(measurement), 3), LEVER_ARM_MM)
    on_tool = np.array([target.carrier == "tool" for target in measurement.targets.values()])[measurement.target_number]
    rows = np.flatnonzero(on_tool) if on_tool.any() else np.arange(len(measurement))
    return measurement.state.rows(rows), np.tile(usual_target(measurement), (len(rows), 1))


def measures_angles(measurement: Measurement) -> bool:
    """True for data of an interferometer along rotary axes alone, whose target may lie on the axis."""
    machine, own = measurement.machine, measurement.axis_rows
    return bool(own) and all(machine.rotary[machine.index(name)] for name in own)


def usual_target(measurement: Measurement) -> tuple[float, ...]:
    """Position, mm, of the target on the tool with the most rows; zero if there is none."""
    targets = list(measurement.targets.values())
    on_tool = np.array([target.carrier == "tool" for target in targets])[measurement.target_number]
    if not on_tool.any():
        return (0.0, 0.0, 0.0)
    return tuple(targets[int(np.bincount(measurement.target_number[on_tool]).argmax())].position)


def read_points(path: Path, machine: Machine) -> Points:
    """The states in a file with columns of the measurement file, of any instrument or of none."""
    if kind := kind_of_program(path):
        raise UserError(f"file of points {path}: this is {kind}: give a table of axis positions (X,Y,Z, ...)")
    table = read_table(path, "file of points")
    notes: list[str] = []
    check_machine(table, machine, notes)
    keys, kinds = ["machine", "instrument", MEASURED], KINDS.values()
    note_unknown_keys(table, lambda key: key in keys or any(kind.is_header_key(key) for kind in kinds), notes)
    again = [name for name in ADDED if name in table.names]
    if again:
        raise UserError(f"{table.head} column {again[0]}: these points already have a prediction")
    columns = [*(kind.OBSERVED for kind in kinds), *(kind.OPTIONAL for kind in kinds)]
    observed = dict.fromkeys(name for names in columns for name in names)
    allow_columns(table, [*state_columns(machine), *observed])
    states = read_states(table, machine, notes)
    refuse_unstated(table, states.targets, "a prediction")
    for name, target in states.targets.items():
        if target.carrier != "tool":
            raise UserError(
                f"{table.source}: target {name} is on the {target.carrier}: only a target on the tool can be predicted"
            )
    return Points(machine, table, states, tuple(notes))


def predictions(model: ErrorModel, machine: Machine, state: State, tool: Array) -> Iterator[Predicted]:
    """Predictions for all rows, a block at a time; tool `(n, 3)`, mm.

    Only the error motions, and the columns of effects with memory, are in memory for all rows at once.
    """
    errors = model.errors(machine, state)
    design = Design(model.effects, machine, state, with_instrument=False)
    for rows in blocks(len(state)):
        q = state.positions[rows]
        deviation = point_deviations(machine, q, errors[rows], tool[rows])
        transform = error_transform_with_tool(machine, q, tool[rows])[:, :3]
        unmeasured = model.unmeasured_variance(machine, state.rows(rows), transform)
        yield Predicted(
            rows, deviation * UM_PER_MM, model.propagated(design.of(rows, transform), unmeasured) * UM_PER_MM
        )
