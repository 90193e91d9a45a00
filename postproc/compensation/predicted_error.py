"""Predicted errors of a program: the correctable part of a model, in the approach directions of the program."""

from __future__ import annotations

import bisect

import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions, States
from postproc.compensation.datum import datum_shifts
from postproc.motion.motions import Motions
from postproc.motion.reversals import (
    INNER,
    Directions,
    axes_with_backlash,
    axis_positions_along,
    dead_band,
    known_before,
    turns_inside,
)


def in_a_program(effect: Effect) -> bool:
    """True for effects of the machine that a corrected program, or a simpler remedy, can correct."""
    return effect.ACTS_ON != "instrument" and effect.REMEDY != "none"


def model_notes(model: ErrorModel, conditions: Conditions) -> list[str]:
    """Notes for the user on a model under these conditions; UserError if a condition that it needs is missing."""
    beyond = [e.name for e in model.effects if e.ACTS_ON != "instrument" and not in_a_program(e)]
    notes = (
        [f"{', '.join(beyond)}: no program can correct this, and predicted errors do not contain it"] if beyond else []
    )
    return notes + conditions.notes(model.part(in_a_program))


class MachineStates:
    """Follows the moves of one program text, chunk after chunk, and gives the state of the machine at their ends."""

    def __init__(
        self,
        model: ErrorModel,
        machine: Machine,
        conditions: Conditions,
        tolerance_um: float,
        *,
        written: bool = False,
    ) -> None:
        self.axes = axes_with_backlash(model, machine)
        self.band = dead_band(machine, tolerance_um)
        if written:
            # moves below the dead band remain below it after rounding; a backlash take-up is longer
            self.band = 2 * self.band + dead_band(machine, 0.0)
        self._model, self._conditions = model, conditions
        self._directions = Directions(self.axes, self.band)
        self.approach: Array | None = None
        """Directions `(n, axes)` at the ends of the moves of the last chunk."""
        self._along: Array | None = None
        """Directions `(n, shares, axes)` at INNER and the ends of its moves; None if only the ends are evaluated."""

    def datum_shifts(self, motions: Motions) -> Array:
        """Displacement of the part from its nominal position `(n, 3)`, mm, workpiece frame, at the rows of a chunk."""
        return datum_shifts(motions, self._model, self._conditions)

    def along(self, motions: Motions) -> Array | None:
        """Directions `(n, shares, axes)` at the shares INNER of the moves, and at their ends; None without backlash."""
        if not self.axes:
            return None
        return self._follow(motions, axis_positions_along(motions, (*INNER, 1.0)))

    def _follow(self, motions: Motions, positions: Array) -> Array:
        """Directions at positions `(n, shares, axes)` along the moves of a chunk; the last share is the end."""
        starts = motions.in_machine(motions.start)
        along = self._directions.follow_moves(motions, positions, starts, known_before(motions))
        self.approach, self._along = along[:, -1], along if along.shape[1] > 1 else None
        return along

    def states(self, motions: Motions, rows: NDArrayBool) -> States:
        """The state at the ends of rows of a chunk, by a mask `(n,)`."""
        if self.axes and len(motions):
            if turns_inside(motions, self.axes, self.band).any():
                self.along(motions)
            else:
                self._follow(motions, motions.machine_target[:, None])
        return self.last_states(rows)

    def last_states(self, rows: np.ndarray, share: float = 1.0) -> States:
        """The state at rows of the last chunk, by a mask or by their numbers, at a share of their paths."""
        if self._along is not None:
            looked_at = bisect.bisect_left((*INNER, 1.0), share)
            return self._conditions.states(self._along[rows, looked_at])
        return self._conditions.states(None if self.approach is None else self.approach[rows])


def directions_at(approach: Array | None, share: int, rows: np.ndarray) -> Array | None:
    """Directions at these rows and the share with this index, from directions along moves; None for None."""
    return None if approach is None else np.asarray(approach[rows, share])
