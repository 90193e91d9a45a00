"""The interferometer: deviations of one axis at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from calibration.instruments.along_axes import AlongAxes
from calibration.instruments.axis_columns import axis_columns, by_kind
from calibration.instruments.error_columns import spread
from calibration.instruments.exact_numbers import in_units, only
from kinematics.effects.base import UM, URAD, own_component
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table

ANGULAR = list("ABC")
"""Error motions that are angles."""


class Interferometer(AlongAxes, frozen=True, tag="interferometer"):
    """Deviations along, or about, one axis at a time; for linear axes also straightness and angles (six degrees)."""

    OBSERVED = (
        *("axis", "component", "direction", "target_mm", "target_deg"),
        *("deviation_um", "deviation_urad"),
    )
    GROWS_ALONG_RUN = True
    CHOOSES_MOTIONS = True

    u_um: float = 0.0
    """Standard uncertainty, um; urad for a rotary axis."""
    u_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of travel from the first position of the run."""
    u_straightness_um: float = 0.0
    """Standard uncertainty of straightness deviations, um."""
    u_straightness_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of travel from the first position of the run."""
    u_angle_urad: float = 0.0
    """Standard uncertainty of angular error motions of a linear axis, urad."""
    components: Literal[1] = 1
    """Number of observed values in a row."""

    @classmethod
    def check_stated(cls, table: Table, values: Mapping[str, float]) -> None:
        """Each kind of error motion in the rows needs its own uncertainty, see `check_rows`."""
        if "component" not in table.names:
            super().check_stated(table, values)

    @classmethod
    def converted(cls, table: Table, machine: Machine) -> Table:
        """The table with one row for each error motion."""
        return spread(table, machine)

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Deviations `(n, 1)`, mm; rad for angles."""
        rotary = machine.rotary[axis_columns(table, machine)]
        angular = None if states.component is None else rotary | np.isin(states.component, ANGULAR)
        sizes = np.where(rotary if angular is None else angular, URAD, UM)
        return np.asarray((by_kind(table, machine, "deviation_um", "deviation_urad", angular) * sizes)[:, None])

    @classmethod
    def typical(cls) -> Interferometer:
        """See `InstrumentBase.typical`."""
        return cls(u_um=0.2, u_um_per_m=0.5, u_straightness_um=0.5, u_angle_urad=1.0)

    def motions_in(
        self, machine: Machine, axis: np.ndarray, wanted: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows of linear axes once for each wanted error motion; without any, the positioning deviation."""
        if not wanted:
            return np.arange(len(axis)), None
        linear = ~machine.rotary[[machine.index(name) for name in axis.tolist()]]
        rows = np.repeat(np.arange(len(axis)), np.where(linear, len(wanted), 1))
        return rows, np.concatenate([list(wanted) if own else [""] for own in linear.tolist()])

    def check_rows(self, table: Table, states: MeasurementStates) -> None:
        """UserError for observed error motions without a given uncertainty."""
        if states.component is None:
            return
        own = np.array([own_component(name) for name in table.texts(["axis"])["axis"].tolist()])
        positioning = (states.component == "") | (states.component == own)
        angular = np.isin(states.component, ANGULAR)
        for rows, u, key, quantity in (
            (positioning, self.u_um, "u_um", "positioning"),
            (~positioning & angular, self.u_angle_urad, "u_angle_urad", "angles"),
            (
                ~positioning & ~angular,
                self.u_straightness_um + self.u_straightness_um_per_m,
                "u_straightness_um",
                "straightness",
            ),
        ):
            if rows.any() and not u:
                raise UserError(
                    f"{table.source}: the standard uncertainty (k=1) of {quantity} is missing: state {key} above zero "
                    f"(header line '# {key}: ...')"
                )

    def row_covariances(self, measurement: Measurement) -> Array:
        """Those of the quantity; that of a length grows from the first position of the run."""
        machine, column, position = measurement.machine, measurement.axis_column, measurement.axis_position
        _, first, run = np.unique(measurement.groups, return_index=True, return_inverse=True)
        away = np.abs(position - position[first[run]])
        metres = np.where(machine.rotary[column], 0.0, away * 1e-3)
        u = np.where(
            measurement.straightness,
            self.u_straightness_um + self.u_straightness_um_per_m * metres,
            self.u_um + self.u_um_per_m * metres,
        )
        u = np.where(measurement.angular & ~machine.rotary[column], self.u_angle_urad, u)
        return np.asarray(((u * np.where(measurement.angular, 1e-6, 1e-3)) ** 2)[:, None, None])

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """Axis, target and deviation; linear and rotary axes have columns of their own, empty in the other rows."""
        machine, state = measurement.machine, measurement.state
        own = np.arange(len(measurement)), measurement.axis_column
        approach = state.need("approach", "an interferometer")[own]
        columns = {"axis": np.array(machine.names)[own[1]], "direction": approach.astype(int)}
        if measurement.component is not None:
            columns["component"] = measurement.component
        turns, angular = machine.rotary[own[1]], measurement.angular
        for rows, scale, unit in ((~turns, 1.0, "mm"), (turns, np.pi / 180.0, "deg")):
            if rows.any():
                columns[f"target_{unit}"] = only(rows, in_units(state.positions[own], scale))
        for rows, size, unit in ((~angular, UM, "um"), (angular, URAD, "urad")):
            if rows.any():
                columns[f"deviation_{unit}"] = only(rows, in_units(measurement.observed[:, 0], size))
        return columns
