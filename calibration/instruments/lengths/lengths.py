"""Lengths: a ruler or calipers between two positions of the machine, and a dial gauge against a square or a wire.

An observation of a length is half of it at either end, along the line from the first position to the second; the zero
of the two is unknown, so that only their distance counts. It is exact for the pair, also for errors of millimetres. The
scale of the ruler is unknown within its uncertainty. A reading of a dial gauge is the position of the tool along its
direction, with an unknown zero for each run and, against a wire or a ruler, an unknown slope. The two legs of a square
have a common turn, and the error of its angle, which counts with the opposite sign where the square is turned round.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from calibration.instruments.base import ErrorsShown, InstrumentBase, LeastErrors, along_itself, axes_of
from calibration.instruments.lengths import reading
from calibration.instruments.lengths.geometry import (
    RIGHT_ANGLE,
    RULER,
    half_lengths,
    lines_of,
    moved_axes,
    nominal_offsets,
    pairs_of,
    parameters_beside,
    slopes_of,
)
from calibration.instruments.lengths.written import file_columns
from calibration.instruments.targets import SPINDLE_NOSE
from calibration.registration.observed_points import (
    derivatives_by_errors,
    derivatives_by_positions,
    target_points,
)
from calibration.registration.registration import Registration
from kinematics.effects import Component
from kinematics.effects.base import UM, URAD, own_component
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.instruments.targets import Target
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from kinematics.effects import Effect
    from kinematics.error_model.model import Observation
    from kinematics.state import State
    from kinematics.transforms import Pose

SCALE_U, SQUARE_U = "u_scale_um_per_m", "u_square_urad"
"""Header keys of the uncertainties of the ruler's scale and of the square's angle."""
ANY_SLOPE_UM_PER_MM, ANY_BACKLASH_UM = 100.0, 1000.0
"""Slopes, um/mm, and backlash, um, of a router or printer of which nothing is known: ten times what users report."""
ANY_SCALE = 1000.0
"""Standard uncertainty of the scale of a ruler without a statement, um/m: a steel tape of class II by the European
directive on measuring instruments is within 0.3 mm + 0.2 mm/m, one of paper or cloth within some mm/m."""
ANY_SQUARE = 1e4
"""Standard uncertainty of the angle of a square that is turned round, urad: the readings show it."""
ANGLES = 24
"""Least number of readings from which angular error motions are fitted."""
LEAST_OBSERVED_COMPONENT = 1e-6
"""Least component of the direction of a row along an axis of the frame that it observes."""
LEAST_END_U_UM = 1e-3
"""Smallest standard uncertainty, um, of an end whose other end is missing."""


class Lengths(InstrumentBase, frozen=True, tag="lengths"):
    """A ruler or calipers, and a dial gauge."""

    PARTS = ("length",)
    OBSERVED = (reading.OBSERVED,)
    OPTIONAL = (reading.SCATTER,)
    HEADER_KEYS = (SCALE_U, SQUARE_U)
    NEEDED = ((reading.U_RULER, reading.U_RULER_PER_M, reading.U_GAUGE),)
    MAY_BE_FEW = True
    CHECKS = ("lengths",)
    IF_TOO_FEW = "a search for causes needs many readings: 'ncomp fit' takes few"
    IN_ORDER_OF_MOVES = False

    u_um: float = 0.0
    """Standard uncertainty of a length, um."""
    u_um_per_m: float = 0.0
    """Standard uncertainty of a length for each metre of it, um."""
    u_gauge_um: float = 0.0
    """Standard uncertainty of a reading of the dial gauge, um."""
    scale_um_per_m: float | None = None
    """Standard uncertainty of the scale of the ruler, um/m; None where it is not stated, 0 without lengths."""
    square_urad: float | None = None
    """Standard uncertainty of the angle of the square, urad; None where it is not stated, 0 without a square."""
    components: Literal[1] = 1
    """Number of observed values in a row."""

    @classmethod
    def typical(cls) -> Lengths:
        """See `InstrumentBase.typical`."""
        return cls(u_um=200.0, u_gauge_um=10.0, scale_um_per_m=200.0, square_urad=100.0)

    @property
    def least_errors(self) -> LeastErrors:
        """Slopes and backlash: lengths come from machines of which nothing is known."""
        return LeastErrors(slope_um_per_mm=ANY_SLOPE_UM_PER_MM, backlash_um=ANY_BACKLASH_UM)

    @property
    def knows_scale(self) -> bool:
        """True where the scale of the ruler is stated."""
        return self.scale_um_per_m is not None

    @classmethod
    def check_stated(cls, table: Table, values: Mapping[str, float]) -> None:
        """Nothing: the rows were checked where they were read, because each may have its own uncertainty."""

    @classmethod
    def converted(cls, table: Table, machine: Machine) -> Table:
        """The table with one row for each observation."""
        return reading.converted(table, machine, cls.kind())

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """Uncertainties of the ruler's scale and of the square's angle; UserError for a square that shows nothing."""
        scale, square = _stated(table, SCALE_U), _stated(table, SQUARE_U)
        kinds = {run.partition(" ")[0] for run in np.unique(table.cells([reading.RUN])[reading.RUN]).tolist()}
        if square is None and len(kinds & {"square", "reversed"}) == 1:
            raise UserError(
                f"{table.source}: header line '# {SQUARE_U}: ...' is missing: the standard uncertainty of the angle of "
                "the square, urad (50 for a good one, 200 for a carpenter's); or turn the square round, and read it "
                "again with 'reversed' in the column square"
            )
        _check_legs(table)
        return {
            "scale_um_per_m": scale if "length" in kinds else 0.0,
            "square_urad": square if kinds & {"square", "reversed"} else 0.0,
        }

    def shared(self, others: Sequence[InstrumentBase]) -> Lengths:
        """The instrument of all files: one ruler and one square, where no two files state different ones."""
        alike = [each for each in others if isinstance(each, Lengths)]
        scales = {each.scale_um_per_m for each in alike} - {0.0}
        squares = {each.square_urad for each in alike} - {0.0}
        return Lengths(
            u_um=max(each.u_um for each in alike),
            u_um_per_m=max(each.u_um_per_m for each in alike),
            u_gauge_um=max(each.u_gauge_um for each in alike),
            scale_um_per_m=next(iter(scales)) if len(scales) == 1 else self.scale_um_per_m,
            square_urad=next(iter(squares)) if len(squares) == 1 else self.square_urad,
        )

    @classmethod
    def read_targets(cls, table: Table) -> tuple[dict[str, Target], np.ndarray] | None:
        """The tool reference point, unless the header has a target."""
        if any(key.partition(".")[0] in ("target", "table", "bed") for key in table.entries):
            return None
        return {"1": SPINDLE_NOSE}, np.full(len(table), "1")

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Observations `(n, 1)`, mm."""
        return table.numbers([reading.OBSERVED])[reading.OBSERVED][:, None]

    @classmethod
    def in_order(cls, state: State) -> State:
        """The state without moves: marks were made in any order. Directions are those of the rows."""
        still = np.zeros_like(state.positions)
        return replace(state, last_move=still, approach=still)

    def would_show(self, measurement: Measurement, effects: Sequence[Effect]) -> str:
        """The lengths and readings that would determine the effects for a ruler and a dial gauge."""
        if all(along_itself(effect) for effect in effects):
            names = ", ".join(sorted(axes_of(effects)))
            return f"a length along {names}, over the whole range, would show it, or more lengths where it bends"
        if any(effect.angular for effect in effects):
            return "a level would show it, or lengths in several planes at different heights"
        return (
            "both diagonals of a rectangle in the plane of the two axes, or a square and a dial gauge, would show it; "
            "where it bends, a dial gauge along a straight edge"
        )

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The uncertainties of the ruler's scale and of the square's angle."""
        if self.scale_um_per_m:
            yield f"{SCALE_U}: {self.scale_um_per_m!r}"
        if self.square_urad:
            yield f"{SQUARE_U}: {self.square_urad!r}"

    def errors_shown(self, measurement: Measurement, axis: str) -> ErrorsShown:
        """Translations along which a row observes, all six from ANGLES readings on; and backlash.

        A dial gauge shows backlash where it read the axis from both sides.

        X is x, and Y lies in the plane of x and y: other slopes are a turn of the frame, so that E_YX, E_ZX and E_ZY
        are left to readings of a dial gauge, which show their bends.
        """
        lines, own, i = np.abs(lines_of(measurement)), own_component(axis), measurement.machine.index(axis)
        seen = lines.max(axis=0, initial=0.0) > LEAST_OBSERVED_COMPONENT
        dialled = moved_axes(measurement) == i
        bent = lines[dialled].max(axis=0, initial=0.0) > LEAST_OBSERVED_COMPONENT
        sides = measurement.state.need("approach", "a dial gauge")[dialled, i]
        backlash = bool((sides > 0.0).any() and (sides < 0.0).any())
        if seen.all() and _readings(measurement) >= ANGLES:
            return ErrorsShown(get_args(Component), backlash)
        seen_or_bent = ((each, seen[k] and (each <= own or bent[k])) for k, each in enumerate(get_args(Component)[:3]))
        return ErrorsShown([each for each, shown in seen_or_bent if shown], backlash)

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """See `InstrumentBase.first_registration`."""
        names, groups = np.unique(measurement.groups).tolist(), measurement.groups
        off = measurement.observed[:, 0] - nominal_offsets(measurement)
        zeros = {}
        for name in names:
            mine = groups == name
            zeros[name] = float(off[mine & trusted if (mine & trusted).any() else mine].mean())
        beside = dict.fromkeys(parameters_beside(measurement), 0.0)
        return Registration(zeros=zeros | beside, slopes=dict.fromkeys(slopes_of(measurement), 0.0))

    def nominally_observed(
        self, measurement: Measurement, registration: Registration
    ) -> tuple[Measurement, Registration]:
        """See `InstrumentBase.nominally_observed`."""
        return replace(measurement, observed=nominal_offsets(measurement)[:, None]), registration

    def expected(self, measurement: Measurement, registration: Registration, effects: Observation) -> Array:
        """See `InstrumentBase.expected`; NaN for groups whose zero is missing in the registration."""
        errors = effects.errors if effects.errors.any() else None
        nominal, lines = measurement.nominal_points, lines_of(measurement)
        points = target_points(measurement, errors, registration.tool(measurement)) + effects.shift
        own = nominal_offsets(measurement) + np.sum(lines * (points - nominal), axis=1)
        first, second = pairs_of(measurement)
        length = np.linalg.norm(points[second] - points[first], axis=1)
        scale = registration.zeros.get(RULER, 0.0)
        missing = (length * (1.0 + scale) - (own[second] - own[first])) / 2.0
        own[first] -= missing
        own[second] += missing
        for name, column in parameters_beside(measurement).items():
            own = own + (0.0 if name == RULER else registration.zeros.get(name, 0.0)) * column
        for group, column in slopes_of(measurement).items():
            own = own + registration.slopes.get(group, 0.0) * column
        zeros = np.array([registration.zeros.get(group, np.nan) for group in measurement.groups.tolist()])
        return np.asarray((own + zeros)[:, None])

    def transform(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.transform`."""
        lines = lines_of(measurement)[:, None]
        return np.concatenate([lines @ derivatives_by_errors(measurement, measurement.tool), lines], axis=2)

    def registration_design(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.registration_design`."""
        groups, beside, slopes = measurement.groups, parameters_beside(measurement), slopes_of(measurement)
        nothing = np.zeros(len(measurement))
        columns = [
            beside.get(name, nothing) if name in beside else np.equal(groups, name).astype(float)
            for name in registration.zeros
        ]
        columns += [slopes.get(name, nothing) for name in registration.slopes]
        return np.stack(columns, axis=1)[:, None]

    def by_axes(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.by_axes`."""
        lines = lines_of(measurement)[:, None]
        return np.asarray(lines @ derivatives_by_positions(measurement, measurement.tool))

    def stated_residuals(self, measurement: Measurement, registration: Registration) -> Array:
        """Stated minus present scale of the ruler and angle of the square, in standard uncertainties `(k,)`."""
        return np.array([-registration.zeros[name] / u for name, u in self._stated_u(registration).items()])

    def stated_design(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.stated_design`."""
        names, stated = list(registration.zeros), self._stated_u(registration)
        design = np.zeros((len(stated), len(registration.names)))
        for row, (name, u) in enumerate(stated.items()):
            design[row, names.index(name)] = 1.0 / u
        return design

    def _stated_u(self, registration: Registration) -> dict[str, float]:
        """Standard uncertainties of the parameters that are known to them, by name; mm/mm and rad."""
        scale = ANY_SCALE if self.scale_um_per_m is None else self.scale_um_per_m
        square = ANY_SQUARE if self.square_urad is None else self.square_urad
        sizes = {RULER: scale * UM * 1e-3, RIGHT_ANGLE: square * URAD}
        return {name: u for name, u in sizes.items() if name in registration.zeros}

    def planned(self, state: State) -> tuple[State, np.ndarray]:
        """Two rows each are the ends of a length; UserError for an odd number of rows, and for two equal ends."""
        count = len(state) // 2
        if 2 * count != len(state):
            raise UserError(
                f"a ruler measures from each position to the next: the plan has {len(state)} rows, not pairs"
            )
        apart = np.linalg.norm(state.positions[::2] - state.positions[1::2], axis=1)
        if len(same := np.flatnonzero(apart < reading.SAME_END_MM)):
            raise UserError(
                f"rows {2 * same[0] + 1} and {2 * same[0] + 2} of the plan are at the same position: no length"
            )
        names = np.repeat([f"length {number}" for number in range(1, count + 1)], 2)
        still = np.zeros_like(state.positions)
        own = replace(state, station=names, approach=still, last_move=still, time=None, cycle=None)
        return own, np.full(len(state), "length")

    def file_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """See `InstrumentBase.file_columns`."""
        return file_columns(measurement)

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """Random scale of the ruler and angle of the square; zeros are those of the first registration."""
        found = self.first_registration(blank, np.ones(len(blank), bool))
        drawn = {name: float(rng.normal(0.0, u)) for name, u in self._stated_u(found).items()}
        zeros = {name: drawn.get(name, 0.0) for name in found.zeros}
        return Registration(zeros=zeros, slopes=found.slopes)

    def row_covariances(self, measurement: Measurement) -> Array:
        """Squares of the uncertainties of the rows; half of that of a length for each of its ends."""
        if measurement.scatter is not None:
            return np.asarray(measurement.scatter[:, None, None] ** 2)
        first, second = pairs_of(measurement)
        u = np.where(moved_axes(measurement) < 0, max(self.u_um, LEAST_END_U_UM), self.u_gauge_um) * UM
        length = 2.0 * half_lengths(measurement)[second]
        u[first] = u[second] = (self.u_um + self.u_um_per_m * length * 1e-3) * UM * 0.5**0.5
        return np.asarray(u[:, None, None] ** 2)

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """The observations, mm."""
        return {reading.OBSERVED: measurement.observed[:, 0]}


def _readings(measurement: Measurement) -> int:
    """Number of lengths, and of readings of a dial gauge beyond the first of their runs."""
    return len(measurement) - len(np.unique(measurement.groups))


def _stated(table: Table, key: str) -> float | None:
    """A standard uncertainty in the header; None without it, UserError unless above zero."""
    if key not in table.entries:
        return None
    (value,) = table.header_numbers(key, 1)
    if value <= 0.0:
        table.header_fault(key, f"{value:g} is not above 0: a standard uncertainty, k=1")
    return value


def _check_legs(table: Table) -> None:
    """UserError for a square of which the readings show one leg only, or whose legs are not two."""
    columns = table.cells(["station", reading.RUN])
    legs: dict[str, dict[str, int]] = {}
    for row, (group, run) in enumerate(zip(*(column.tolist() for column in columns.values()), strict=True)):
        kind, along = reading.role_of(run)
        if kind in ("square", "reversed"):
            set_up, _, axis = group.rpartition(" ")
            legs.setdefault(set_up, {})[f"{axis} read along {along}"] = row
    for set_up, found in legs.items():
        if len(found) == 2:
            continue
        there, row = " and ".join(found), next(iter(found.values()))
        why = (
            "a square has two legs. Move one axis along the first leg and read the dial gauge along the other axis, "
            "then exchange them; where the first leg was set to 0 and 0 at its ends, write these two rows too"
            if len(found) == 1
            else "give each set-up of the square a name of its own in the column run"
        )
        table.fault(row, reading.AXIS, f"{set_up} has readings of {there}: {why}")
