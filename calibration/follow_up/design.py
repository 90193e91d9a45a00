"""A follow-up design, a measurement that could follow the data, and the data that it continues.

It uses the same machine and instrument; its observations are those of the machine without errors. It is another file:
a set-up of the instrument with a registration of its own (`calibration/measurement/joining.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from calibration.follow_up.fixed_standards import Length
from calibration.measurement.measurement import Measurement, with_moves
from calibration.registration.registration import Registration
from kinematics.effects import Effect, TrackerDrift
from kinematics.state import State
from kinematics.transforms import Array

MOST_DESIGN_ROWS = 400
TIME_OF_ROW_S = 15.0
"""Time per row, s, where the data have no times; the virtual calibration paper, 3.2."""
NEW = "next"
"""Name of a station, a target or a run that the data do not have."""


class FollowUpDesign(NamedTuple):
    """A measurement that could follow the data."""

    name: str
    does: str
    """Instruction, in the imperative."""
    minutes: float
    measurement: Measurement
    registration: Registration
    """Registration of the data and of this measurement."""
    lengths: tuple[Length, ...] = ()
    """Known distances between its targets."""
    unknown: tuple[Effect, ...] = ()
    """Effects that are unknown in it and are estimated with the registration."""
    again: np.ndarray | None = None
    """Rows `(n,)` of the data that it repeats, in its own order; None where it measures other points."""


@dataclass(frozen=True)
class Data:
    """The data, and the rows of them that are measured again."""

    measurement: Measurement
    registration: Registration
    most: int = MOST_DESIGN_ROWS
    """Most rows that are measured again."""

    @cached_property
    def index(self) -> np.ndarray:
        """Rows that are measured again: those of the last run at the last station, evenly at most `most`."""
        rows = np.flatnonzero(self.measurement.instrument.last_visit(self.measurement))
        return rows[np.linspace(0, len(rows) - 1, min(len(rows), self.most)).astype(int)] if len(rows) else rows

    @cached_property
    def set_up(self) -> str | None:
        """Name of the next set-up of an instrument with stations or spheres; None for others."""
        poses = self.registration.poses
        return unused(list(poses)) if poses else None

    @cached_property
    def registered_again(self) -> Registration:
        """The registration of the data and of the next set-up, where the tracker keeps its position."""
        if self.set_up is None:
            return self.registration
        poses, centres, last = self.registration.poses, self.registration.centres, str(self.measurement.groups[-1])
        return replace(
            self.registration,
            poses={**poses, self.set_up: poses[last]},
            centres={**centres, self.set_up: centres[last]},
        )

    @cached_property
    def in_motion(self) -> bool:
        """True where most rows were recorded in motion."""
        velocity = self.measurement.state.velocity
        return velocity is not None and float(np.mean(np.any(velocity[self.index] != 0.0, axis=1))) > 0.5

    @cached_property
    def step_s(self) -> float:
        """Time per row, s."""
        time = self.measurement.state.time
        steps = np.diff(time) if time is not None else np.zeros(0)
        steps = steps[steps > 0.0]
        return float(np.median(steps)) if len(steps) else TIME_OF_ROW_S

    @property
    def own_drift(self) -> tuple[Effect, ...]:
        """Drift of a tracker that is set up again, or on another day: the data do not determine it."""
        tracker = self.measurement.instrument.BY_BEAM
        return (TrackerDrift(),) if tracker and self.measurement.state.time is not None else ()

    @property
    def positions(self) -> str:
        """Description of the positions that are measured again."""
        count = len(self.index)
        return (
            "the same path"
            if self.in_motion
            else (f"{count} of the" if count == self.most else f"all {count}") + " positions"
        )

    def clock(self, index: np.ndarray) -> Array:
        """Times `(n,)`, s, of rows in a new order, the first one a step after the start."""
        time = self.measurement.state.time
        if not self.in_motion or time is None:
            return np.asarray(self.step_s * np.arange(1, len(index) + 1))
        return np.asarray(np.abs(time[index] - time[index[0]]) + self.step_s)

    def following(self, index: np.ndarray, pause_min: float = 0.0, **changes: Any) -> Measurement:
        """Rows of the data again, in this order, after their end; `changes` replace columns of the state.

        The machine continues from its last position; temperatures go on as in the last half of the data.
        """
        m = self.measurement
        before, state = m.state, m.state.rows(index)
        n, clock = len(index), self.clock(index)
        late = 60.0 * pause_min + clock
        columns: dict[str, Any] = {
            "past": before,
            "time": None if before.time is None else before.time.max() + late,
            "temperatures": {
                name: _continued(before.time, kelvin, late) for name, kelvin in before.temperatures.items()
            },
            "cycle": None if before.cycle is None else np.full(n, before.cycle.max() + 1.0),
            "station": None if self.set_up is None else np.full(n, self.set_up),
        }
        state = replace(state, **(columns | changes))
        if before.last_move is not None:
            last, approach = _moves_after(before, state.positions)
            state = replace(state, last_move=last, approach=None if before.approach is None else approach)
        run = None if m.run is None else np.full(n, NEW)
        return replace(m.rows(index), state=state, run=run)

    def plan(
        self,
        name: str,
        does: str,
        measurement: Measurement,
        registration: Registration | None = None,
        pause_min: float = 0.0,
    ) -> FollowUpDesign:
        """The design with the observations of the machine without errors, and its duration."""
        registration = registration or self.registered_again
        done, registration = measurement.instrument.nominally_observed(measurement, registration)
        time = measurement.state.time
        seconds = len(done) * self.step_s if time is None or not self.in_motion else float(np.ptp(time)) + self.step_s
        return FollowUpDesign(name, does, pause_min + seconds / 60.0, done, registration)


def _continued(time: Array | None, kelvin: Array, late: Array) -> Array:
    """Temperatures at times `late` after the end of the data, along the line through those of the last half."""
    half = slice(len(kelvin) // 2, None)
    if time is None or np.ptp(time[half]) == 0.0:
        return np.full(len(late), kelvin[-1])
    return np.asarray(kelvin[-1] + np.polyfit(time[half] - time.max(), kelvin[half], 1)[0] * late)


def unused(names: list[str]) -> str:
    """A name for a new station, target or run that is not among these."""
    return next(name for name in (NEW, *(f"{NEW}{i}" for i in range(len(names) + 1))) if name not in names)


def _moves_after(before: State, positions: Array) -> tuple[Array, Array]:
    """Last move and approach `(n, axes)` at positions after a state; those at its end until an axis moves."""
    assert before.last_move is not None
    moved = with_moves(State(np.concatenate([before.positions[-1:], positions]))).rows(slice(1, None))
    assert moved.last_move is not None
    assert moved.approach is not None
    still = moved.last_move == 0.0
    ended = np.sign(before.last_move[-1]) if before.approach is None else before.approach[-1]
    return np.where(still, before.last_move[-1], moved.last_move), np.where(still, ended, moved.approach)
