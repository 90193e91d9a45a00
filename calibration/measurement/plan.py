"""Plan: how a measurement is to be laid and visited, and the table of states that comes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from calibration.measurement.measurement import SPINDLE_NOSE, Target
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

Order = Literal["given", "shuffled", "retraced"]
Rotary = Literal["fixed", "swept", "random", "simultaneous"]
TargetOrder = Literal["in-turn", "alternating"]
Approach = Literal["any", "positive", "negative"]


@dataclass(frozen=True)
class Timing:
    """How long a measurement takes; the virtual calibration paper, 3.2, has 15 s per point and 20 min to set up."""

    point_s: float = 15.0
    setup_min: float = 20.0
    dwell_s: float | None = None
    """With a feed: the time at each point, the way between points counted apart."""
    feed: float | None = None
    """mm/min, degrees/min of rotary axes."""


@dataclass(frozen=True)
class Choices:
    """How the positions of a strategy are laid and visited; lengths in mm, angles in degrees."""

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """By axis, the part of its travel; two equal ends fix it."""
    margin_mm: float = 0.0
    """Kept from the travel ends of linear axes that have no range."""
    planes_at: float = 1.0
    """Where `planes` lie on the axes across them: 0 the low, 1 the high end."""
    rotary: Rotary = "fixed"
    """Fixed at home, swept one by one afterwards, at random, or moving together with the linear axes."""
    rotary_points: int = 13
    """Positions of each rotary axis that is swept, or measured on its own."""
    order: Order = "given"
    targets: Mapping[str, Target] = field(default_factory=lambda: {"1": SPINDLE_NOSE})
    target_order: TargetOrder = "in-turn"
    """Everything with the one, then with the next; or all at each position."""
    references: int = 0
    """A reference position is measured at the start, after each so many positions, and at the end; 0 for never."""
    approach: Approach = "any"
    overrun: float = 1.0
    """Way to a position that is approached from a given side."""
    runs: int = 1
    timing: Timing = Timing()
    seed: int = 0


class Way(NamedTuple):
    """Positions on the way, in file units."""

    positions: Array
    """`(n, axes)`"""
    names: np.ndarray
    axis: np.ndarray | None = None
    """Axis that is measured on its own `(n,)`."""
    from_side: Array | None = None
    """Sign of the approach that is to be `(n, axes)`; 0 as it comes."""

    def rows(self, index: np.ndarray) -> Way:
        """The way at some of its rows, or in another order."""
        axis = None if self.axis is None else self.axis[index]
        side = None if self.from_side is None else self.from_side[index]
        return Way(self.positions[index], self.names[index], axis, side)


@dataclass(frozen=True)
class Plan:
    """One row per observation `n`, in the order of measuring."""

    machine: Machine
    strategy: str
    state: State
    """Positions, approach, last move, time, run as cycle, and target."""
    names: np.ndarray
    """Of the points `(n,)`; a point that is measured again keeps its name."""
    run: np.ndarray
    """Name of the run `(n,)`."""
    targets: Mapping[str, Target]
    axis: np.ndarray | None = None
    """Name of the axis `(n,)` that is measured on its own."""
    before: Array | None = None
    """Positions `(n, axes)`, mm and rad, to be passed on the way to a point, unmeasured; not a number for none."""
    minutes: float = 0.0
    """How long it takes, with setting up."""
    asked: int | None = None
    """Number of positions that was asked for."""
    places: int = 0
    """Number of positions of the strategy, before they are visited again in any way."""
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.state)

    @property
    def positions(self) -> Array:
        """Axis positions `(n, axes)` in chain order, mm and rad."""
        return self.state.positions

    @property
    def summary(self) -> str:
        """Counts and time, for people."""
        asked = "" if self.asked in (None, self.places) else f" (asked for {self.asked})"
        observed = "" if len(self) == self.places else f", {len(self)} observations"
        return f"{self.strategy}: {self.places} positions{asked}{observed}, {self.minutes:.0f} min"
