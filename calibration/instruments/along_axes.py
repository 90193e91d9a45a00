"""Instruments that observe one axis at a time: readings along, across or about its line, in runs.

observed = deviation along a line, or rotation about it + zero of the run (+ slope of a straightness run) + noise.
Values are exact; derivatives are those at nominal positions, first order in the errors.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, ClassVar, get_args

import numpy as np

from calibration.instruments.base import ErrorsShown, InstrumentBase, PlannedReadings
from calibration.registration.derived import derived
from calibration.registration.registration import Registration
from kinematics.deviation import exact_deviation
from kinematics.effects.base import COMPONENTS, UM, URAD, Component, own_component
from kinematics.error_transform import error_transform_with_tool, pose_slopes
from kinematics.forward import axis_frames
from kinematics.machine import Machine
from kinematics.transforms import Array, turn
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from kinematics.error_model.model import Observation
    from kinematics.transforms import Pose


LINE_SLOPE_RAD = 5e-4
"""Half-width of the random slope of a line of straightness against the axis, of virtual instruments."""


class AlongAxes(InstrumentBase, frozen=True):
    """Base of the instruments that observe one axis at a time."""

    FOLLOWED_UP = True
    REQUIRED = ("axis", "run", "direction")
    IF_TOO_FEW = "repeat the runs, or measure more positions"
    CHECKS: ClassVar[tuple[str, ...]] = ("deviations",)

    def errors_shown(self, measurement: Measurement, axis: str) -> ErrorsShown:
        """The error motions that were observed, and the backlash."""
        return ErrorsShown(observed_components(measurement, axis), backlash=True)

    def groups(self, measurement: Measurement) -> np.ndarray:
        """The runs: each observes an axis, or one error motion of it, and has an unknown zero."""
        parts = [measurement.axis, measurement.run, measurement.component]
        first, *others = [part.astype(str) for part in parts if part is not None]
        return reduce(lambda names, part: np.char.add(np.char.add(names, " "), part), others, first)

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """See `InstrumentBase.first_registration`."""
        names, groups = np.unique(measurement.groups).tolist(), measurement.groups
        across = dict.fromkeys(np.unique(groups[measurement.straightness]).tolist(), 0.0)
        zeros = {name: _mean_zero(measurement.observed, groups == name, trusted) for name in names}
        return Registration(zeros=zeros, slopes=across)

    def last_visit(self, measurement: Measurement) -> np.ndarray:
        """The last run of each axis."""
        last = np.zeros(len(measurement), bool)
        for rows in measurement.axis_rows.values():
            names = np.asarray(measurement.run)[rows]
            last[rows] = names == names[-1]
        return last

    def nominally_observed(
        self, measurement: Measurement, registration: Registration
    ) -> tuple[Measurement, Registration]:
        """See `InstrumentBase.nominally_observed`."""
        zeros = dict(registration.zeros) | dict.fromkeys(np.unique(measurement.groups).tolist(), 0.0)
        across, known = np.unique(measurement.groups[measurement.straightness]).tolist(), dict(registration.slopes)
        slopes = known | {name: known.get(name, 0.0) for name in across}
        done = replace(measurement, observed=np.zeros((len(measurement), 1)))
        return done, replace(registration, zeros=zeros, slopes=slopes)

    def expected(self, measurement: Measurement, registration: Registration, effects: Observation) -> Array:
        """See `InstrumentBase.expected`; NaN for runs whose zero is missing in the registration."""
        machine, q = measurement.machine, measurement.state.positions
        position, turned = exact_deviation(machine, q, effects.errors, measurement.tool)
        along = np.concatenate([position, turned], axis=1)
        zeros = np.array([registration.zeros.get(group, np.nan) for group in measurement.groups.tolist()])
        slopes = np.array([registration.slopes.get(group, 0.0) for group in measurement.groups.tolist()])
        own = np.sum(_lines(measurement) * along, axis=1)
        return np.asarray((own + zeros + slopes * measurement.axis_position)[:, None])

    def transform(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.transform`."""
        six = error_transform_with_tool(measurement.machine, measurement.state.positions, measurement.tool)
        own = np.einsum("nk,nkp->np", _lines(measurement), six)[:, None]
        return np.concatenate([own, np.zeros((len(measurement), 1, 3))], axis=2)

    def registration_design(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.registration_design`."""
        groups = measurement.groups
        zeros = [np.equal(groups, group).astype(float)[:, None] for group in registration.zeros]
        position = measurement.axis_position
        slopes = [np.where(groups == group, position, 0.0)[:, None] for group in registration.slopes]
        return np.stack([*zeros, *slopes], axis=2)

    @classmethod
    def check_plan(cls, axis: np.ndarray | None, run: np.ndarray | None) -> None:
        """UserError for a plan without an axis and a run in each row."""
        if axis is None or run is None:
            raise UserError(f"{cls.a_kind()} measures one axis at a time, in runs: it needs strategy axes")

    def readings_in(
        self, machine: Machine, axis: np.ndarray | None, rows: np.ndarray, wanted: Sequence[str] = ()
    ) -> PlannedReadings:
        """One or more readings in each row; none of a plan without axes, which `check_plan` refuses."""
        if axis is None:
            return super().readings_in(machine, axis, rows, wanted)
        own = axis[rows]
        taken, component = self.motions_in(machine, own, wanted)
        return PlannedReadings(taken, own[taken], component)

    @abstractmethod
    def motions_in(
        self, machine: Machine, axis: np.ndarray, wanted: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows `(m,)`, once for each reading, of axes `(n,)`, and the error motion of each, None for its own."""

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """Zeros, and random slopes of the lines of straightness."""
        groups, across = np.unique(blank.groups).tolist(), np.unique(blank.groups[blank.straightness]).tolist()
        slopes = dict(zip(across, rng.uniform(-LINE_SLOPE_RAD, LINE_SLOPE_RAD, len(across)).tolist(), strict=True))
        return Registration(zeros=dict.fromkeys(groups, 0.0), slopes=slopes)

    def zeroed(self, blank: Measurement, exact: Array) -> Array:
        """Each run reads zero at its start."""
        _, first, which = np.unique(blank.groups, return_index=True, return_inverse=True)
        return np.asarray(exact - exact[first[which]])

    def read_out(self, measurement: Measurement) -> Array:
        """Rounded to nm and nrad."""
        size = np.where(measurement.angular, URAD, UM)[:, None]
        return np.asarray(np.round(measurement.observed / size, 3) * size)

    def by_axes(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.by_axes`."""
        own = np.equal(measurement.axis_column[:, None], np.arange(len(measurement.machine.axes)))
        return np.asarray((own & measurement.positioning[:, None])[:, None, :], float)


def observed_components(measurement: Measurement, axis: str) -> list[Component]:
    """Error motions of an axis that an interferometer observes."""
    named = measurement.motions[measurement.axis_rows[axis]]
    letters = {letter or own_component(axis) for letter in np.unique(named).tolist()}
    return [component for component in get_args(Component) if component in letters]


@derived
def _lines(measurement: Measurement) -> Array:
    """Directions `(n, 6)`, of displacement or rotation, that are observed, workpiece frame.

    The direction is that of the axis' motion, or of the error frame for a named error motion.
    """
    machine = measurement.machine
    slopes = pose_slopes(machine, measurement.state.positions)
    lines = np.zeros((len(measurement), 6))
    for name, rows in measurement.axis_rows.items():
        i = machine.index(name)
        part = slice(3, 6) if machine.axes[i].rotary else slice(0, 3)
        lines[rows, part] = slopes[rows, part, i]
    return _with_named(measurement, lines)


def _with_named(measurement: Measurement, lines: Array) -> Array:
    """The directions `(n, 6)`; those of named error motions are axes of the error frame."""
    machine = measurement.machine
    frames = axis_frames(machine, measurement.state.positions)
    for name, of_axis in measurement.axis_rows.items():
        i = machine.index(name)
        for k, letter in enumerate(COMPONENTS):
            rows = of_axis[measurement.motions[of_axis] == letter]
            along = turn(frames[i].rotation, machine.axes[i].error_frame[:, k % 3])
            lines[rows] = 0.0
            lines[rows[:, None], 3 * (k // 3) + np.arange(3)] = np.broadcast_to(along, (len(lines), 3))[rows]
    return lines


def _mean_zero(observed: Array, mine: np.ndarray, trusted: np.ndarray) -> float:
    """Mean reading of a run, mm or rad."""
    return float(observed[mine & trusted if (mine & trusted).any() else mine].mean())
