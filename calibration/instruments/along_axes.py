"""Instruments that observe one axis at a time: readings along, across or about its line, in runs.

observed = deviation along a line, or rotation about it + zero of the run (+ slope of a straightness run) + noise.
Values are exact; derivatives are those at nominal positions, first order in the errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, get_args

import numpy as np

from calibration.instruments.base import ErrorsShown, InstrumentBase
from calibration.registration.derived import derived
from calibration.registration.registration import Registration
from kinematics.deviation import exact_deviation
from kinematics.effects.base import COMPONENTS, UM, URAD, Component, own_component
from kinematics.error_transform import error_transform_with_tool, pose_slopes
from kinematics.forward import axis_frames
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

    OBSERVES = "deviation"
    FOLLOWED_UP = True
    REQUIRED = ("axis", "run", "direction")

    def errors_shown(self, measurement: Measurement, axis: str) -> ErrorsShown:
        """The error motions that were observed, and the backlash."""
        return ErrorsShown(observed_components(measurement, axis), backlash=True)

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """See `InstrumentBase.first_registration`."""
        names, groups = np.unique(measurement.groups).tolist(), measurement.groups
        across = dict.fromkeys(np.unique(groups[measurement.straightness]).tolist(), 0.0)
        zeros = {name: _mean_zero(measurement.observed, groups == name, trusted) for name in names}
        return Registration(zeros=zeros, slopes=across)

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
        assert measurement.axis is not None
        own = np.equal(measurement.axis[:, None], np.array(measurement.machine.names))
        return np.asarray((own & measurement.positioning[:, None])[:, None, :], float)


def observed_components(measurement: Measurement, axis: str) -> list[Component]:
    """Error motions of an axis that an interferometer observes."""
    rows = np.equal(np.asarray(measurement.axis), axis)
    named = np.full(len(measurement), "") if measurement.component is None else measurement.component
    letters = {letter or own_component(axis) for letter in np.unique(named[rows]).tolist()}
    return [component for component in get_args(Component) if component in letters]


@derived
def _lines(measurement: Measurement) -> Array:
    """Directions `(n, 6)`, of displacement or rotation, that are observed, workpiece frame.

    The direction is that of the axis' motion, or of the error frame for a named error motion.
    """
    machine = measurement.machine
    assert measurement.axis is not None
    slopes = pose_slopes(machine, measurement.state.positions)
    lines = np.zeros((len(measurement), 6))
    for name in np.unique(measurement.axis).tolist():
        i, rows = machine.index(name), measurement.axis == name
        part = slice(3, 6) if machine.axes[i].rotary else slice(0, 3)
        lines[rows, part] = slopes[rows, part, i]
    return lines if measurement.component is None else _with_named(measurement, lines)


def _with_named(measurement: Measurement, lines: Array) -> Array:
    """The directions `(n, 6)`; those of named error motions are axes of the error frame."""
    machine, component = measurement.machine, measurement.component
    assert measurement.axis is not None
    assert component is not None
    frames = axis_frames(machine, measurement.state.positions)
    for name, letter in np.unique(np.stack([measurement.axis, component], axis=1).astype(str), axis=0).tolist():
        if not letter:
            continue
        i, k = machine.index(name), COMPONENTS.index(letter)
        rows = np.flatnonzero((measurement.axis == name) & (component == letter))
        along = turn(frames[i].rotation, machine.axes[i].error_frame[:, k % 3])
        lines[rows] = 0.0
        lines[rows[:, None], 3 * (k // 3) + np.arange(3)] = np.broadcast_to(along, (len(lines), 3))[rows]
    return lines


def _mean_zero(observed: Array, mine: np.ndarray, trusted: np.ndarray) -> float:
    """Mean reading of a run, mm or rad."""
    return float(observed[mine & trusted if (mine & trusted).any() else mine].mean())
