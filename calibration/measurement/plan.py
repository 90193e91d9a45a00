"""Plan of a measurement: the choices for its positions and sequence, and the resulting table of states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from calibration.instruments import Instrument
from calibration.measurement.measurement import SPINDLE_NOSE, Target
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array
from rendering.shown import Shown

Order = Literal["given", "shuffled", "retraced"]
Rotary = Literal["fixed", "swept", "random", "simultaneous"]
TargetOrder = Literal["in-turn", "alternating"]
Approach = Literal["any", "positive", "negative"]


@dataclass(frozen=True)
class Timing:
    """Duration of a measurement; the virtual calibration paper, 3.2, has 15 s per point and 20 min of set-up."""

    point_s: float = 15.0
    """Time for each point, s."""
    setup_min: float = 20.0
    """Time for the set-up, min."""
    dwell_s: float | None = None
    """Dwell at each point with a given feed, s; the time between points is added."""
    feed: float | None = None
    """Feed, mm/min; degrees/min for rotary axes."""


@dataclass(frozen=True)
class Choices:
    """Choices for the positions and the measuring sequence of a strategy; lengths in mm, angles in degrees."""

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each axis within its travel; two equal ends fix the axis."""
    margin_mm: float = 0.0
    """Distance from the travel ends of linear axes without a range, mm."""
    planes_at: float = 1.0
    """Position of `planes` on the axes across them, as a share: 0 is the low end, 1 the high end."""
    rotary: Rotary = "fixed"
    """Rotary axes: fixed at home, swept one by one afterwards, random, or moved together with the linear axes."""
    rotary_points: int = 13
    """Number of positions of each rotary axis that is swept or measured alone."""
    order: Order = "given"
    """Order of the positions: as given, shuffled (drift apart from geometry), or there and back."""
    targets: Mapping[str, Target] = field(default_factory=lambda: {"1": SPINDLE_NOSE})
    """Targets by name; positions, mm, from the spindle nose, on the table or on the bed."""
    target_order: TargetOrder = "in-turn"
    """Order of the targets: the whole sequence with each target in turn, or all targets at each position."""
    references: int = 0
    """Number of positions between measurements of the reference position, also at start and end; 0 for none."""
    approach: Approach = "any"
    """Direction from which all axes approach each position."""
    overrun: float = 1.0
    """Distance of the approach to a position from a given side, mm or degrees."""
    runs: int = 1
    """Number of repetitions of the whole sequence."""
    timing: Timing = Timing()
    """Times of the measurement."""
    seed: int = 0
    """Seed of random positions and orders."""


class MeasuringSequence(NamedTuple):
    """Positions in the order of the path, in file units."""

    positions: Array
    """Axis positions `(n, axes)`, mm and degrees."""
    names: np.ndarray
    axis: np.ndarray | None = None
    """Name of the axis that is measured alone `(n,)`."""
    from_side: Array | None = None
    """Sign of the required direction of approach `(n, axes)`; 0 for any."""

    def rows(self, index: np.ndarray) -> MeasuringSequence:
        """Some of the positions, or another order."""
        axis = None if self.axis is None else self.axis[index]
        side = None if self.from_side is None else self.from_side[index]
        return MeasuringSequence(self.positions[index], self.names[index], axis, side)


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """Plan with one row per observation `n`, in the order of measuring."""

    machine: Machine
    """The machine."""
    strategy: str
    """Name of the strategy."""
    state: State
    """Positions, approach, last move, time, run as cycle, and target."""
    names: np.ndarray
    """Names of the points `(n,)`; a point that is measured again has a letter behind its name."""
    run: np.ndarray
    """Name of the run `(n,)`."""
    targets: Mapping[str, Target]
    """Targets by name, mm."""
    axis: np.ndarray | None = None
    """Name of the axis `(n,)` that is measured alone."""
    before: Array | None = None
    """Positions `(n, axes)`, mm and rad, to pass before a point without measuring; NaN for none."""
    minutes: float = 0.0
    """Duration with set-up, min."""
    requested: int | None = None
    """Requested number of positions."""
    position_count: int = 0
    """Number of positions of the strategy, without repetitions."""
    notes: tuple[str, ...] = field(default=())
    """Notes for the user."""
    spheres: Mapping[str, Vector] = field(default_factory=dict)
    """Stated centres of the spheres of a touch probe by name, mm, workpiece frame at zero pose; `state.station` has the
    sphere of each row."""
    stations: Mapping[str, Vector] = field(default_factory=dict)
    """Positions of the instrument by station, mm, workpiece frame; `state.station` has the station of each row. Empty
    where the whole plan is measured from stations that are stated later."""
    instrument: Instrument | None = None
    """The instrument for which the positions were chosen; None for any."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{self.machine.name}, {self.summary}"

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Axis positions, mm and degrees, names, runs, targets and times, s, of the observations by name `(n,)`."""
        axes = zip(self.machine.names, (self.positions / self.machine.scale).T, strict=True)
        others = {"time_s": self.state.time, "target": self.state.target, "run": self.run, "point": self.names}
        return dict(axes) | {name: column for name, column in others.items() if column is not None}

    def __len__(self) -> int:
        return len(self.state)

    @property
    def positions(self) -> Array:
        """Axis positions `(n, axes)` in chain order, mm and rad."""
        return self.state.positions

    @property
    def summary(self) -> str:
        """Text with numbers of positions and observations, and duration."""
        requested = "" if self.requested in (None, self.position_count) else f" ({self.requested} were requested)"
        observed = "" if len(self) == self.position_count else f", {len(self)} observations"
        return f"{self.strategy}: {self.position_count} positions{requested}{observed}, {self.minutes:.0f} min"
