"""The ballbar: its two balls, its length, and its circles in a measurement file.

The tool ball is the one target on the tool. The table ball is a set-up with an unknown centre, in the workpiece frame
at zero pose of the machine. An observation is the distance of the two balls as the bar reads it: the unknown error of
the bar's length is in all readings, and is known to its uncertainty where the bar was calibrated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np

from calibration.instruments.base import along_itself
from calibration.instruments.exact_numbers import joined
from calibration.instruments.of_points import OfDistances, centred_pose
from calibration.registration.registration import SHIFTS, Registration
from kinematics.error_model.model import Observation
from kinematics.machine import Machine, Vector
from kinematics.state import State, with_moves
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.instruments.targets import Distance
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from kinematics.effects import Effect

CENTRE, LENGTH, LENGTH_U, RADIUS = "centre", "length_mm", "length_u_um", "radius_mm"
"""Header keys of the table ball and of the length, and the column of the readings."""
LENGTH_ERROR = "length"
"""Name of the error of the bar's length among the zeros of a registration."""
ONE_SET_UP = "1"
"""Name of the set-up: a file has one position of the table ball."""
SHORTEST_BAR_MM, LONGEST_BAR_MM = 10.0, 5000.0
"""Lengths of a bar that are accepted, mm."""
LENGTH_ABOUT = 1.0
"""Standard uncertainty of a length that is not calibrated, mm: it is only about right."""
CENTRE_U = 10.0
"""Standard uncertainty of the stated position of a table ball, mm."""
FIRST_READING_U_MM, LAST_REGISTRATION_STEP_MM, MOST_REGISTRATION_STEPS = 0.01, 1e-6, 10
"""Weight of the readings in a first registration as an uncertainty, and its last step, mm; most steps."""
SAME_WAY = 1e-6
"""Change between rows, mm or rad, below which an axis rests."""


class Ballbar(OfDistances, frozen=True, tag="ballbar"):
    """A telescopic bar between a ball in the spindle and a ball on the table, which reads the distance of the balls."""

    PARTS = ("distance",)
    OBSERVED = (RADIUS,)
    HEADER_KEYS = (CENTRE, LENGTH, LENGTH_U)
    RECOGNISED_BY = LENGTH
    CHECKS = ("circles",)
    ON_CIRCLES = True

    u_um: float = 0.0
    """Standard uncertainty of a reading, um."""
    length_mm: float = 150.0
    """Nominal length of the bar between the centres of its balls, mm."""
    length_u_um: float | None = None
    """Standard uncertainty of the length by calibration, um; None where the length is fitted."""
    components: Literal[1] = 1
    """Number of observed values in a row."""

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """Length of the bar, and its standard uncertainty."""
        return read_length(table)

    @classmethod
    def read_set_ups(cls, table: Table) -> tuple[dict[str, Vector], tuple[Distance, ...]]:
        """The centre of the table ball."""
        return read_centre(table), ()

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Readings `(n, 1)`, mm."""
        return read_radius(table)

    @classmethod
    def in_order(cls, state: State) -> State:
        """The state with moves within the runs."""
        return in_runs(state)

    @classmethod
    def own_velocities(cls, machine: Machine, state: State, feed: Array) -> Array | None:
        """Velocities along the circles."""
        return velocities_on_circles(machine, state, feed)

    @property
    def length_u(self) -> float:
        """Standard uncertainty of the bar's length, mm."""
        return LENGTH_ABOUT if self.length_u_um is None else self.length_u_um * 1e-3

    @property
    def fits_length(self) -> bool:
        """True without a calibration of the bar."""
        return self.length_u_um is None

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """First centres of table balls and the error of the length, from the stated ones, by trusted rows."""
        n = len(measurement)
        nominal = Observation(np.zeros((n, len(measurement.machine.axes) + 1, 6)), np.zeros((n, 3)))
        names = np.unique(measurement.groups).tolist()
        poses = {name: centred_pose(measurement.spheres[name]) for name in names}
        found = Registration(poses, dict.fromkeys(names, np.zeros(3)), SHIFTS, {LENGTH_ERROR: 0.0})
        for _ in range(MOST_REGISTRATION_STEPS):
            residual = (measurement.observed - self.expected(measurement, found, nominal))[trusted, 0]
            rows = self.registration_design(measurement, found)[trusted, 0] / FIRST_READING_U_MM
            matrix = np.concatenate([rows, self.stated_design(measurement, found)])
            right = np.concatenate([residual / FIRST_READING_U_MM, self.stated_residuals(measurement, found)])
            step = np.linalg.lstsq(matrix, right)[0]
            found = found.moved(step)
            if np.abs(step).max() < LAST_REGISTRATION_STEP_MM:
                break
        return found

    def zero_names(self, measurement: Measurement) -> np.ndarray:
        """The error of the length in all rows."""
        return np.full(len(measurement), LENGTH_ERROR)

    def stated_residuals(self, measurement: Measurement, registration: Registration) -> Array:
        """Stated minus present position of the table ball, and length, in standard uncertainties `(4,)`."""
        centres = [np.subtract(measurement.spheres[name], own) for name, own in registration.sphere_centres.items()]
        length = -registration.zeros[LENGTH_ERROR] / self.length_u
        return np.append(np.concatenate(centres) / CENTRE_U, length)

    def stated_design(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.stated_design`."""
        moves = len(registration.names) - 1
        return np.diag(np.append(np.full(moves, -1.0 / CENTRE_U), 1.0 / self.length_u))

    @classmethod
    def typical(cls) -> Ballbar:
        """See `InstrumentBase.typical`."""
        return cls(u_um=0.3)

    def row_covariances(self, measurement: Measurement) -> Array:
        """The same for each reading."""
        return np.full((len(measurement), 1, 1), (self.u_um * 1e-3) ** 2)

    def would_show(self, measurement: Measurement, effects: Sequence[Effect]) -> str:
        """The circles or instruments that would determine the effects for a ballbar."""
        machine = measurement.machine
        moved = np.ptp(measurement.state.positions, axis=0) > 0.0
        still = [
            axis.name for axis, own in zip(machine.axes, moved.tolist(), strict=True) if not own and not axis.rotary
        ]
        if self.fits_length and all(along_itself(effect) for effect in effects):
            return (
                "a bar whose length is fitted shows no scale, only differences of the axes' scales: calibrate its "
                "length (# length_u_um: u), or use an interferometer"
            )
        if still:
            return f"circles in the planes with {', '.join(still)} would show some of it"
        if any(effect.angular for effect in effects):
            return "circles with a tool ball of another length, or at other positions of the table ball, would show it"
        return "circles of another radius, or at other positions of the table ball, would show some of it"

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The bar, and the table ball."""
        yield f"{LENGTH}: {self.length_mm!r}"
        if self.length_u_um is not None:
            yield f"{LENGTH_U}: {self.length_u_um!r}"
        (centre,) = measurement.spheres.values()
        yield f"{CENTRE}: {joined(centre)}"

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """The readings."""
        return {RADIUS: measurement.observed[:, 0]}


def read_length(table: Table) -> dict[str, float | None]:
    """Length of the bar, mm, and its standard uncertainty, um, by header key; None where the length is fitted."""
    if LENGTH not in table.entries:
        _missing(table, LENGTH, "150", "the length of the bar between the centres of its balls, mm")
    (length,) = table.header_numbers(LENGTH, 1)
    if not SHORTEST_BAR_MM <= length <= LONGEST_BAR_MM:
        table.header_fault(
            LENGTH, f"{length:g} mm is no length of a ballbar ({SHORTEST_BAR_MM:g} to {LONGEST_BAR_MM:g} mm)"
        )
    if LENGTH_U not in table.entries:
        return {LENGTH: length, LENGTH_U: None}
    (u,) = table.header_numbers(LENGTH_U, 1)
    if u <= 0.0:
        table.header_fault(LENGTH_U, f"{u:g} is not above 0; without this line the length is fitted")
    return {LENGTH: length, LENGTH_U: u}


def read_centre(table: Table) -> dict[str, Vector]:
    """Stated centre of the table ball, mm, by the name of the set-up; UserError without it, and for several set-ups."""
    if "station" in table.names:
        table.fault(0, "station", "a file of a ballbar has one position of the table ball: give several files")
    if CENTRE not in table.entries:
        _missing(table, CENTRE, "x y z", "about where the table ball is, in the workpiece frame with all axes at 0, mm")
    if not any(key.partition(".")[0] == "target" for key in table.entries):
        _missing(table, "target.NAME", "x y z", "the centre of the tool ball from the spindle nose, mm")
    x, y, z = table.header_numbers(CENTRE, 3)
    return {ONE_SET_UP: (x, y, z)}


def read_radius(table: Table) -> Array:
    """Readings `(n, 1)`, mm; UserError for rows without motion, and for readings that are no lengths."""
    table.need_columns(["run", "feed", RADIUS], "a ballbar")
    columns = table.numbers(["feed", RADIUS])
    for name, column in columns.items():
        if np.any(column <= 0.0):
            why = "is not above 0: a ballbar measures circles in motion" if name == "feed" else "is not above 0"
            table.fault(int(np.argmax(column <= 0.0)), name, why)
    return columns[RADIUS][:, None]


def in_runs(state: State) -> State:
    """The state with moves within the runs: a circle begins with an overshoot, in which the axes move already.

    The move to the first row of a run is that of the circle continued backwards from the next two rows. A row that does
    not move an axis keeps the last move of its run.
    """
    q, cycle = state.positions, state.cycle
    if cycle is None:
        return with_moves(state)
    first = run_starts(state)
    moves = np.diff(q, axis=0, prepend=q[:1])
    for row in np.flatnonzero(first).tolist():
        following = q[row : row + 3]
        if len(following) == 3 and not first[row + 1 : row + 3].any():
            moves[row] = -2.0 * following[0] + 3.0 * following[1] - following[2]
    moves[np.abs(moves) < SAME_WAY] = 0.0
    kept = np.where((moves != 0.0) | first[:, None], np.arange(len(state))[:, None], 0)
    last = np.take_along_axis(moves, np.maximum.accumulate(kept, axis=0), axis=0)
    return replace(state, last_move=last, approach=np.sign(last))


def velocities_on_circles(machine: Machine, state: State, feed: Array) -> Array:
    """Velocities `(n, axes)`, mm/s and rad/s, of rows on circles at feeds `(n,)`, mm/min, of the linear axes together.

    Directions are central differences within the run: those of single steps are half a step late.
    """
    starts = np.flatnonzero(run_starts(state)).tolist()
    along = np.zeros_like(state.positions)
    for low, high in pairwise([*starts, len(state)]):
        if high - low > 2:
            along[low:high] = np.gradient(state.positions[low:high], axis=0, edge_order=2)
        elif high - low > 1:
            along[low:high] = np.gradient(state.positions[low:high], axis=0)
    along[np.abs(along) < SAME_WAY] = 0.0
    length = np.linalg.norm(along[:, ~machine.rotary], axis=1)
    speed = np.where(length > 0.0, feed / 60.0, 0.0) / np.where(length > 0.0, length, 1.0)
    return np.asarray(along * speed[:, None])


def run_starts(state: State) -> np.ndarray:
    """True `(n,)` for the first row of each run."""
    number = np.zeros(len(state)) if state.cycle is None else state.cycle
    return np.append(True, np.diff(number) != 0.0)[: len(state)]


def _missing(table: Table, key: str, value: str, meaning: str) -> NoReturn:
    raise UserError(f"{table.source}: header line '# {key}: {value}' is missing: {meaning}")
