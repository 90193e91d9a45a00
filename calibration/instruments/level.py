"""The electronic level: pitch and roll of a moving component against gravity, along a horizontal axis.

It lies on the table where the axis carries the workpiece, otherwise on the side of the tool. A reading is a rotation of
this component, right-handed about a machine axis; observations are error motions, tool relative to workpiece, so that
readings on the table count with the opposite sign. Its zero is unknown in each run. It sees no yaw and no positions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np

from calibration.instruments.along_axes import AlongAxes
from calibration.instruments.axis_columns import axis_columns
from calibration.instruments.exact_numbers import in_units, only
from calibration.registration.registration import Registration
from kinematics.effects.base import URAD, own_component
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from kinematics.transforms import Pose

PITCH, ROLL = "pitch", "roll"
READINGS = {
    f"{name}_{unit}": (name, size) for unit, size in (("urad", 1.0), ("mm_per_m", 1e3)) for name in (PITCH, ROLL)
}
"""Columns of readings: what they are, and their unit in urad."""
VERTICAL = "vertical"
"""Header key of the machine's direction along gravity."""
Vertical = Literal["x", "y", "z"]
ZERO_RAD = 5e-4
"""Half-width of the zero of a virtual level: it lies on a surface that is not quite level."""


class Level(AlongAxes, frozen=True, tag="level"):
    """Pitch and roll of the component that a horizontal linear axis moves, against gravity."""

    OBSERVED = ("axis", "component", "direction", "target_mm", "deviation_urad", *READINGS)
    HEADER_KEYS = (VERTICAL,)
    NEVER_SEEN = (
        "a level sees pitch and roll of horizontal axes only: yaw, straightness, positions and squareness need another "
        "instrument"
    )
    NEEDED = (("u_angle_urad",),)

    u_angle_urad: float = 0.0
    """Standard uncertainty of a reading, urad."""
    vertical: Vertical = "z"
    """Direction of the machine along gravity."""
    components: Literal[1] = 1
    """Number of observed values in a row."""

    @classmethod
    def typical(cls) -> Level:
        """See `InstrumentBase.typical`."""
        return cls(u_angle_urad=2.0)

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """The direction along gravity."""
        return {VERTICAL: _vertical(table)}

    @classmethod
    def converted(cls, table: Table, machine: Machine) -> Table:
        """The table with one row for each reading; UserError for axes that a level cannot measure."""
        table.need_columns(cls.REQUIRED, cls.a_kind())
        found = _columns(table)
        letters, cells = _letters(table, machine), table.cells(found)
        row, which = np.nonzero(np.stack([column != "" for column in cells.values()], axis=1))
        if not len(row):
            raise UserError(f"{table.head} columns {', '.join(found)}: no row has a reading")
        values, component = np.empty(len(row)), np.empty(len(row), "U1")
        for k, name in enumerate(found):
            own = row[which == k]
            kind, size = READINGS[name]
            if len(own):
                part = table.with_rows({name: cells[name][own].tolist()}, table.lines[own].tolist())
                values[which == k], component[which == k] = part.numbers([name])[name] * size, letters[kind][own]
        beside = table.cells([name for name in table.names if name not in READINGS])
        texts = {name: column[row].tolist() for name, column in beside.items()}
        texts |= {"component": component.tolist(), "deviation_urad": [repr(value) for value in values.tolist()]}
        return table.with_rows(texts, table.lines[row].tolist())

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Error motions `(n, 1)`, rad, of the readings."""
        side = _side(machine, axis_columns(table, machine))
        return np.asarray((table.numbers(["deviation_urad"])["deviation_urad"] * side * URAD)[:, None])

    def row_covariances(self, measurement: Measurement) -> Array:
        """The same for each reading."""
        return np.full((len(measurement), 1, 1), (self.u_angle_urad * URAD) ** 2)

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The direction along gravity."""
        yield f"{VERTICAL}: {self.vertical}"

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """Axis, target, pitch and roll; a row has one reading."""
        machine, state = measurement.machine, measurement.state
        own = np.arange(len(measurement)), measurement.axis_column
        axis, approach = np.array(machine.names)[own[1]], state.need("approach", "a level")[own]
        columns = {"axis": axis, "direction": approach.astype(int)}
        columns["target_mm"] = in_units(state.positions[own], 1.0)
        readings = in_units(measurement.observed[:, 0] * _side(machine, own[1]), URAD)
        letters = {name: pitch_and_roll(name, self.vertical) for name in np.unique(axis).tolist()}
        for k, name in enumerate((PITCH, ROLL)):
            rows = measurement.motions == np.array([letters[each][k] for each in axis.tolist()])
            if rows.any():
                columns[f"{name}_urad"] = only(rows, readings)
        return columns

    def motions_in(
        self, machine: Machine, axis: np.ndarray, wanted: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows of horizontal axes, once for pitch and once for roll; UserError without any."""
        flat = [_is_horizontal(machine, name, self.vertical) for name in axis.tolist()]
        rows = np.repeat(np.flatnonzero(flat), 2)
        if not len(rows):
            raise UserError("a level measures horizontal linear axes, and the plan moves none")
        return rows, np.concatenate([pitch_and_roll(name, self.vertical) for name in axis[rows[::2]].tolist()])

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """Random zeros: a level is not set to zero where a run begins."""
        groups = np.unique(blank.groups).tolist()
        return Registration(
            zeros=dict(zip(groups, rng.uniform(-ZERO_RAD, ZERO_RAD, len(groups)).tolist(), strict=True))
        )

    def zeroed(self, blank: Measurement, exact: Array) -> Array:
        """The readings with the zeros of their runs."""
        return exact


def pitch_and_roll(axis: str, vertical: Vertical) -> tuple[str, str]:
    """Components of the error motions that are pitch and roll of a horizontal axis: B and A of X, A and B of Y."""
    along, up = "XYZ".index(own_component(axis)), "xyz".index(vertical)
    (across,) = {0, 1, 2} - {along, up}
    return "ABC"[across], "ABC"[along]


def _is_horizontal(machine: Machine, axis: str, vertical: Vertical) -> bool:
    return not machine.axes[machine.index(axis)].rotary and own_component(axis) != vertical.upper()


def _side(machine: Machine, column: np.ndarray) -> Array:
    """-1 `(n,)` for a level on the table, where the axis of this column carries the workpiece; else 1."""
    return np.where(np.array([axis.side for axis in machine.axes])[column] == "tool", 1.0, -1.0)


def _vertical(table: Table) -> Vertical:
    """The direction along gravity in the header, z without one; UserError for another text."""
    value = table.entries[VERTICAL].value if VERTICAL in table.entries else "z"
    if value not in get_args(Vertical):
        table.header_fault(VERTICAL, f"{value!r} is none of x, y and z: the direction of the machine along gravity")
    return cast(Vertical, value)


def _columns(table: Table) -> list[str]:
    """The columns of readings; UserError without any, for two units of one reading, and for other observations."""
    found = [name for name in READINGS if name in table.names]
    if not found:
        raise UserError(f"{table.head} columns of readings are missing: expected some of {', '.join(READINGS)}")
    if len({READINGS[name][0] for name in found}) < len(found):
        raise UserError(f"{table.head} columns {', '.join(found)}: a reading has one unit, remove the other columns")
    for name in ("component", "deviation_urad"):
        if name in table.names:
            raise UserError(f"{table.head} column {name}: a level has {', '.join(READINGS)} instead")
    return found


def _letters(table: Table, machine: Machine) -> dict[str, np.ndarray]:
    """Components `(n,)` that are the pitch and the roll of each row; UserError for an axis that is not horizontal."""
    vertical, names = _vertical(table), [machine.names[i] for i in axis_columns(table, machine).tolist()]
    for row, name in enumerate(names):
        if not _is_horizontal(machine, name, vertical):
            why = f"a level measures horizontal linear axes, and {name} is none ({VERTICAL}: {vertical})"
            table.fault(row, "axis", why)
    both = np.array([pitch_and_roll(name, vertical) for name in names])
    return {PITCH: both[:, 0], ROLL: both[:, 1]}
