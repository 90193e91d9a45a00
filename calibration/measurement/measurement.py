"""Measurement: columns of states and observations, independent of the file format (contract 4.2)."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from calibration.instruments import Instrument
from calibration.instruments.base import ErrorsShown
from calibration.instruments.targets import SPINDLE_NOSE, Carrier, Distance, Target
from calibration.measurement.estimated_noise import EstimatedNoise, inverse_roots
from calibration.measurement.in_motion import AcrossPath
from calibration.registration.derived import unchangeable
from calibration.registration.first import first_registration
from calibration.registration.measured_centre import arms_of
from calibration.registration.observed_points import target_points
from calibration.registration.registration import Registration
from kinematics.basis import Interval
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine, Vector
from kinematics.state import REFERENCE_DEGC, State, with_moves
from kinematics.transforms import Array, read_only
from kinematics.turn import measured_arc, swept_arc
from kinematics.user_error import UserError
from rendering.shown import Shown

__all__ = ["SPINDLE_NOSE", "STANDSTILL_RANGE", "AcrossPath", "Carrier", "Distance", "Measurement", "Target"]
__all__ += ["changed", "with_moves"]

STANDSTILL_RANGE = 1e-6
"""Range, mm or degrees, up to which an axis does not move."""
SAME_POSITION_MM, SAME_POSITION_DEG = 1e-3, 1e-4
"""Differences within which axis positions are the same."""
STILL = 1e-9
"""Difference, mm or rad, below which an axis has not moved."""


@dataclass(frozen=True, repr=False)
class Measurement(Shown):
    """States and observations, one row per observation, in the order of acquisition; mm and rad.

    A column that is derived from these fields is calculated once, when it is first needed, and is read-only. It is
    derived here, or by a function that is marked `derived` (`calibration/registration/derived.py`) in the module to
    which the derivation belongs.
    """

    machine: Machine
    """The machine."""
    instrument: Instrument
    """The instrument with its standard uncertainties (k = 1), um."""
    state: State
    """State with approach, last move, run as cycle, station and target; for a tracker and a part also `observed`."""
    observed: Array
    """Observations `(n, components)`: points in the instrument's or the part's frame, mm; deviations of an
    interferometer, mm, or rad for angles; lengths of a ballbar, mm; of a touch probe the vectors from a sphere's centre
    to the tip, mm, in the workpiece frame."""
    targets: Mapping[str, Target] = field(default_factory=lambda: {"1": SPINDLE_NOSE})
    """Targets by the names in `state.target`."""
    stands_on: Literal["workpiece", "bed"] = "workpiece"
    """Base of the instrument: the workpiece's table, or the bed (the floor)."""
    axis: np.ndarray | None = None
    """Name of the measured axis `(n,)`, for an interferometer."""
    run: np.ndarray | None = None
    """Name of the run `(n,)`."""
    actual: Array | None = None
    """Read-back positions `(n, axes)`, mm and rad; NaN for an axis without read-back."""
    feed: Array | None = None
    """Feed `(n,)`, mm/min; 0 at standstill."""
    part_zero: Vector = (0.0, 0.0, 0.0)
    """Zero of a part's frame in the workpiece frame at zero pose of the machine, mm; a first value."""
    lines: np.ndarray | None = None
    """Line number in the file `(n,)`, for messages."""
    source: str = "measurement"
    """Name of the file."""
    fingerprint: str = ""
    """Fingerprint of the file's content."""
    notes: tuple[str, ...] = ()
    """Notes on the assumptions made in reading."""
    file: np.ndarray | None = None
    """Name of the file `(n,)`, for several files together."""
    across: AcrossPath | None = None
    """Directions and weights of data taken on the fly."""
    component: np.ndarray | None = None
    """Error motion `(n,)` observed by an interferometer, X ... C of the axis' error frame; empty for the positioning
    deviation, along a positive command. None if all are empty."""
    scatter: Array | None = None
    """Standard uncertainty `(n,)`, mm, of each coordinate, from the scatter of the readings in the mean of a row."""
    spheres: Mapping[str, Vector] = field(default_factory=dict)
    """Centres of a touch probe's spheres, or of a ballbar's table ball, mm, in the workpiece frame at zero pose of the
    machine, as the header states them: first values, by group."""
    distances: tuple[Distance, ...] = ()
    """Calibrated distances between spheres."""
    noise: EstimatedNoise | None = None
    """Noise estimated from the data; None for that of the instrument's specification."""
    simulated: bool = False
    """True for data of a virtual machine."""
    measured: datetime.date | None = None
    """Date of the measurement, of several the earliest; None where it is not known."""
    start: datetime.datetime | None = None
    """Time of second 0, by the clock of the rows; None where it is not known."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        kind = type(self.instrument).__name__
        return f"{self.machine.name}, {len(self)} observations by {kind}, {self.source}"

    def __len__(self) -> int:
        return len(self.observed)

    @property
    def components(self) -> int:
        """Number d of scalars that count in an observation."""
        return self.instrument.components if self.across is None else 2

    @cached_property
    def counted(self) -> Array:
        """Components of the observations that count `(n, d)`, mm and rad."""
        return self.observed if self.across is None else read_only(self.across.of(self.observed))

    def components_of(self, vectors: Array) -> Array:
        """The components that count `(n, d, ...)` of vectors or matrices `(n, 3, ...)` in the instrument's frame."""
        return vectors[:, : self.components] if self.across is None else self.across.of(vectors)

    @cached_property
    def groups(self) -> np.ndarray:
        """Registration group `(n,)`: a tracker's station, a probe's sphere, a table ball, an interferometer's run."""
        return read_only(self.instrument.groups(self))

    @cached_property
    def axis_rows(self) -> Mapping[str, np.ndarray]:
        """Numbers of the rows of each axis that is observed by itself; empty where rows observe all axes together."""
        names = [] if self.axis is None else np.unique(self.axis).tolist()
        return {name: read_only(np.flatnonzero(self.axis == name)) for name in names}

    @cached_property
    def motions(self) -> np.ndarray:
        """Error motion `(n,)` that a row observes, X ... C; empty for positioning deviations, and for points."""
        return read_only(np.full(len(self), "") if self.component is None else self.component)

    @cached_property
    def temperatures(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest temperature, degC, of each sensor with a value in every row."""
        known = {sensor: kelvin for sensor, kelvin in self.state.temperatures.items() if np.isfinite(kelvin).all()}
        ends = {sensor: np.round([kelvin.min(), kelvin.max()], 6) + REFERENCE_DEGC for sensor, kelvin in known.items()}
        return {sensor: (float(low), float(high)) for sensor, (low, high) in ends.items()}

    @cached_property
    def tool(self) -> Array:
        """Nominal positions `(n, 3)`, mm, of the targets on their carriers."""
        return read_only(np.array([target.position for target in self.targets.values()])[self.target_number])

    @cached_property
    def target_number(self) -> np.ndarray:
        """Index `(n,)` of the row's target in `targets`."""
        names = np.array(list(self.targets))
        order = np.argsort(names)
        assert self.state.target is not None
        return read_only(np.asarray(order[np.searchsorted(names, self.state.target, sorter=order)]))

    @cached_property
    def moving(self) -> Mapping[str, Interval]:
        """The axes that move, and are measured, with the interval that they cover, mm or degrees.

        For an axis that turns fully, the interval is the measured arc.
        """
        positions = (self.state.positions if self.across is None else self.across.ends) / self.machine.scale
        low, high = positions.min(axis=0), positions.max(axis=0)
        # rounding removes the error of the conversion from rad
        ends = np.round(np.stack([low, high], axis=1), 9).tolist()
        for i, axis in enumerate(self.machine.axes):
            if axis.turns_fully:
                ends[i] = measured_arc(positions[:, i]) if self.across is None else swept_arc(*ends[i])
        names = self.machine.names
        measured = self.axis_rows or names
        moved = zip(names, ends, strict=True)
        return {name: (a, b) for name, (a, b) in moved if b - a > STANDSTILL_RANGE and name in measured}

    @cached_property
    def distinct_positions(self) -> Mapping[str, int]:
        """Number of different positions of each axis, to 1 um or a thousandth of a degree."""
        rounded = {name: np.round(self.state.position(self.machine, name), 3) for name in self.machine.names}
        return {name: len(np.unique(positions)) for name, positions in rounded.items()}

    @cached_property
    def positions_in_tolerances(self) -> Array:
        """Axis positions `(n, axes)` in units of the differences within which they are the same."""
        same = np.where(self.machine.rotary, np.radians(SAME_POSITION_DEG), SAME_POSITION_MM)
        return read_only(np.asarray(self.state.positions / same))

    @cached_property
    def moved(self) -> np.ndarray:
        """True `(n,)` for rows at other positions than the row before."""
        return read_only(changed(self.positions_in_tolerances))

    @cached_property
    def stops(self) -> np.ndarray:
        """Numbers `(n,)` of the stops, from 0, in the order of the rows.

        A stop ends where a position, a direction of approach, the set-up or the run changes; the target may change.
        """
        state = self.state
        new = self.moved.copy()
        if state.approach is not None:  # a stated one: a move of a fraction of `SAME_POSITION_MM` has a direction too
            still = np.append(False, np.abs(np.diff(state.positions, axis=0)).max(axis=1, initial=0.0) < STILL)
            new |= still[: len(state)] & changed(2.0 * state.approach)
        for names in (state.station, self.run, self.axis, self.file):
            if names is not None:
                new |= np.append(True, names[1:] != names[:-1])
        return read_only(np.asarray(np.cumsum(new) - 1))

    @cached_property
    def axis_column(self) -> np.ndarray:
        """Column `(n,)` among the positions of the axis that a row observes; 0 where rows observe all together."""
        columns = np.zeros(len(self), int)
        for name, rows in self.axis_rows.items():
            columns[rows] = self.machine.index(name)
        return read_only(columns)

    @cached_property
    def axis_position(self) -> Array:
        """Position `(n,)`, mm or rad, of the axis in `axis_column`."""
        return read_only(np.asarray(self.state.positions[np.arange(len(self)), self.axis_column]))

    @cached_property
    def per_micro(self) -> Array:
        """Factors `(n, 1)` from mm to um, and from rad to urad, of each observation."""
        return read_only(np.where(self.angular, 1e6, 1e3)[:, None])

    @property
    def unit(self) -> str:
        """Unit of its residuals on screens: um, urad where angles are observed, or both."""
        if not self.angular.any():
            return "um"
        return "urad" if self.angular.all() else "um or urad"

    @cached_property
    def angular(self) -> np.ndarray:
        """Mask `(n,)` of the observations of angles: of rotary axes, and angular error motions of linear ones."""
        mask = np.isin(self.motions, list("ABC"))
        for name, rows in self.axis_rows.items():
            mask[rows] |= self.machine.rotary[self.machine.index(name)]
        return read_only(mask)

    @cached_property
    def positioning(self) -> np.ndarray:
        """Mask `(n,)` of the observations of an axis along, or about, its own line."""
        mask = np.ones(len(self), bool)
        for name, rows in self.axis_rows.items():
            mask[rows] = np.isin(self.motions[rows], ["", own_component(name)])
        return read_only(mask)

    @cached_property
    def straightness(self) -> np.ndarray:
        """Mask `(n,)` of the observations across the line of a linear axis."""
        return read_only(np.asarray(~self.positioning & ~self.angular))

    @cached_property
    def nominal_points(self) -> Array:
        """Targets `(n, 3)`, mm, of the nominal machine, where they are stated to be; as `target_points`."""
        return read_only(target_points(self, None, self.tool))

    @cached_property
    def first_registration(self) -> tuple[Registration, np.ndarray]:
        """A registration on the nominal machine, and a mask `(n,)` of the rows in it: those without gross errors."""
        return unchangeable(first_registration(self))

    @cached_property
    def arms(self) -> Mapping[str, Array]:
        """The arms of the centre of the measured points, by linear axis, as `arms_of`."""
        return unchangeable(arms_of(self))

    @cached_property
    def errors_shown(self) -> Mapping[str, ErrorsShown]:
        """Errors of each axis that moves which the observations may show."""
        return {axis: self.instrument.errors_shown(self, axis) for axis in self.moving}

    @property
    def specified_covariances(self) -> Array:
        """Covariances `(n, d, d)`, mm2 or rad2, by the instrument's specification; rows in motion are means.

        Specification and scatter describe the same readings (GUM 4.3.10): scatter counts as far as it exceeds the
        specification of the instrument.
        """
        return self.instrument.row_covariances(self)

    @property
    def covariances(self) -> Array:
        """Covariances `(n, d, d)`, mm2 or rad2, of the components that count, each row by itself.

        By the estimated noise, else by the specification.
        """
        specified = self.specified_covariances
        return specified if self.noise is None else self.noise.covariance(specified)

    @cached_property
    def whiteners(self) -> Array:
        """Matrices W `(n, d, d)` that make the noise of each row white: W C W' = 1.

        UserError for an instrument without uncertainty in some direction.
        """
        found = inverse_roots(self.covariances)
        if found is None:
            keys = [field for field in self.instrument.__struct_fields__ if field.startswith("u_")]
            raise UserError(
                f"{self.source}: the uncertainty of the instrument is zero in some direction, so that the weight of "
                f"its rows has no limit: state {', '.join(keys)} (k=1)"
            )
        return read_only(found)

    @cached_property
    def copies(self) -> np.ndarray:
        """True `(n,)` for rows that repeat an earlier one to the last digit, observation included: copies, not repeats.

        A single number, such as an interferometer's reading to 0.01 um, can recur by chance: without a time such rows
        are repeats.
        """
        time = self.state.time
        if self.instrument.components == 1 and time is None:
            return read_only(np.zeros(len(self), bool))
        _, group = np.unique(self.groups, return_inverse=True)
        columns = [self.state.positions, self.observed, self.target_number[:, None], group[:, None]]
        table = np.concatenate([*columns, *([] if time is None else [time[:, None]])], axis=1)
        copy = np.ones(len(self), bool)
        copy[np.unique(table, axis=0, return_index=True)[1]] = False
        return read_only(copy)

    @cached_property
    def without_copies(self) -> Measurement:
        """The measurement without rows that are copies of others."""
        return self.rows(np.flatnonzero(~self.copies))

    @cached_property
    def nominal_model(self) -> ErrorModel:
        """The model of its machine without errors."""
        return no_errors(self.machine)

    def rows(self, index: slice | np.ndarray) -> Measurement:
        """The measurement with some of its rows; approach and last move do not change."""

        def at(column: np.ndarray | None) -> np.ndarray | None:
            return None if column is None else column[index]

        state = self.state.rows(index)
        if state is self.state:
            return self
        return replace(
            self,
            state=state,
            observed=self.observed[index],
            axis=at(self.axis),
            run=at(self.run),
            actual=at(self.actual),
            feed=at(self.feed),
            lines=at(self.lines),
            file=at(self.file),
            across=None if self.across is None else self.across.rows(index),
            component=at(self.component),
            scatter=at(self.scatter),
            noise=None if self.noise is None else self.noise.rows(index),
        )

    def where(self, row: int) -> str:
        """Source and line of a row, for messages."""
        source = self.source if self.file is None else str(self.file[row])
        return source if self.lines is None else f"{source}:{self.lines[row]}"

    @cached_property
    def _derived(self) -> dict[Callable[[Measurement], Any], Any]:
        """Results of the functions that are `derived`, by function."""
        return {}


def changed(values: Array) -> np.ndarray:
    """True `(n,)` for rows in which a value differs from the row before by more than 1, or that are the first."""
    differs = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0) > 1.0
    return np.append(np.ones(min(len(values), 1), bool), differs)
