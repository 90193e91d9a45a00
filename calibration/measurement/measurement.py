"""Measurement: columns of states and observations, independent of the file format (contract 4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from calibration.measurement.estimated_noise import EstimatedNoise
from calibration.measurement.instruments import Instrument
from kinematics.basis import Interval
from kinematics.effects.base import own_component
from kinematics.machine import Machine, Vector
from kinematics.state import REFERENCE, State
from kinematics.transforms import Array, read_only
from kinematics.turn import measured_arc, swept_arc

STANDSTILL = 1e-6
"""Range, mm or degrees, up to which an axis does not move."""
Carrier = Literal["tool", "table", "bed"]


@dataclass(frozen=True)
class Target:
    """A reflector and its position on its carrier."""

    position: Vector
    """Position, mm: from the tool reference point, in the tool's directions; on the table or the bed, in the workpiece
    frame at zero pose of the machine."""
    carrier: Carrier = "tool"
    free: bool = False
    """True for a target on the tool whose position the registration also estimates."""
    spindle_deg: float = 0.0
    """Angle by which the spindle was turned about +z when a touch probe measured, degrees; `position` is turned too."""

    @property
    def known(self) -> bool:
        """False where the position is a first value for the registration: on the table, on the bed, and where free."""
        return self.carrier == "tool" and not self.free


SPINDLE_NOSE = Target((0.0, 0.0, 0.0))


class Distance(NamedTuple):
    """A calibrated distance between the centres of two spheres, such as the length of a scale bar."""

    one: str
    other: str
    length: float
    """Distance, mm."""
    u: float
    """Standard uncertainty of the distance, mm."""


@dataclass(frozen=True)
class AcrossPath:
    """Observations in motion: only components across the path count, and each row is the mean of several readings."""

    directions: Array
    """Directions `(n, 2, 3)`, orthonormal and perpendicular to the path, in the instrument's frame."""
    readings: Array
    """Number of independent readings in the mean of each row `(n,)`."""
    ends: Array
    """Smallest and largest axis positions of the path `(2, axes)`, mm and rad."""
    distances: Array
    """Distance along the path `(n,)`, mm."""

    def rows(self, index: slice | np.ndarray) -> AcrossPath:
        """Some of the rows; the path stays the same."""
        return AcrossPath(self.directions[index], self.readings[index], self.ends, self.distances[index])

    def of(self, vectors: Array) -> Array:
        """Components across the path `(n, 2, ...)` of vectors or matrices `(n, 3, ...)` in the instrument's frame."""
        if vectors.ndim == 2:
            return np.asarray((self.directions @ vectors[:, :, None])[:, :, 0])
        return np.asarray(self.directions @ vectors)


@dataclass(frozen=True)
class Measurement:
    """States and observations, one row per observation, in the order of acquisition; mm and rad."""

    machine: Machine
    instrument: Instrument
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
    source: str = ""
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

    def __len__(self) -> int:
        return len(self.observed)

    @property
    def components(self) -> int:
        """Number d of scalars that count in an observation."""
        return self.instrument.components if self.across is None else 2

    @property
    def counted(self) -> Array:
        """Components of the observations that count `(n, d)`, mm and rad."""
        return self.observed if self.across is None else self.across.of(self.observed)

    @cached_property
    def groups(self) -> np.ndarray:
        """Registration group `(n,)`: a tracker's station, a probe's sphere, a table ball, an interferometer's run."""
        if self.axis is not None:
            assert self.run is not None
            names = np.char.add(np.char.add(self.axis.astype(str), " "), self.run.astype(str))
            if self.component is not None:
                names = np.char.add(np.char.add(names, " "), self.component.astype(str))
            return read_only(names)
        station = self.state.station
        return read_only(np.full(len(self), "1") if station is None else station.astype(str))

    @property
    def temperatures(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest temperature, degC, of each sensor with a value in every row."""
        known = {sensor: kelvin for sensor, kelvin in self.state.temperatures.items() if np.isfinite(kelvin).all()}
        ends = {sensor: np.round([kelvin.min(), kelvin.max()], 6) + REFERENCE for sensor, kelvin in known.items()}
        return {sensor: (float(low), float(high)) for sensor, (low, high) in ends.items()}

    @property
    def tool(self) -> Array:
        """Nominal positions `(n, 3)`, mm, of the targets on their carriers."""
        return np.asarray(np.array([target.position for target in self.targets.values()])[self.target_number])

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
        measured = set(names) if self.axis is None else set(self.axis.tolist())
        moved = zip(names, ends, strict=True)
        return {name: (a, b) for name, (a, b) in moved if b - a > STANDSTILL and name in measured}

    @property
    def per_micro(self) -> Array:
        """Factors `(n, 1)` from mm to um, and from rad to urad, of each observation."""
        if self.axis is None:
            return np.full((len(self), 1), 1e3)
        return np.where(self.angular, 1e6, 1e3)[:, None]

    @property
    def angular(self) -> np.ndarray:
        """Mask `(n,)` of the observations of angles: of rotary axes, and angular error motions of linear ones."""
        rotary = [axis.name for axis in self.machine.axes if axis.rotary]
        mask = np.isin(self.axis, rotary) if self.axis is not None else np.zeros(len(self), bool)
        return mask if self.component is None else mask | np.isin(self.component, list("ABC"))

    @property
    def positioning(self) -> np.ndarray:
        """Mask `(n,)` of the observations of an axis along, or about, its own line."""
        if self.axis is None or self.component is None:
            return np.ones(len(self), bool)
        own = np.array([own_component(name) for name in self.axis.tolist()])
        return np.asarray((self.component == "") | (self.component == own))

    @property
    def straightness(self) -> np.ndarray:
        """Mask `(n,)` of the observations across the line of a linear axis."""
        return np.asarray(~self.positioning & ~self.angular)

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


def with_moves(state: State, approach: Array | None = None) -> State:
    """The state with the last move of each axis, from the order of its rows, and the approach unless given.

    A row that does not move an axis keeps its last move and its approach; both are 0 before the first move.
    """
    moves = np.diff(state.positions, axis=0, prepend=state.positions[:1])
    moves[np.abs(moves) < 1e-9] = 0.0
    moved = np.where(moves != 0.0, np.arange(len(state))[:, None], 0)
    last = np.take_along_axis(moves, np.maximum.accumulate(moved, axis=0), axis=0)
    return replace(state, last_move=last, approach=np.sign(last) if approach is None else approach)


def in_space(observed: Array) -> Array | None:
    """Observed points `(n, 3)`, mm, of observations `(n, components)`; z = 0 where a part is measured in x and y.

    None for an interferometer, which observes no points.
    """
    if observed.shape[1] == 1:
        return None
    return np.concatenate([observed, np.zeros((len(observed), 3 - observed.shape[1]))], axis=1)
