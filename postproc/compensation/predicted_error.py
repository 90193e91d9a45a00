"""Predicted errors of a program: the correctable part of a model, in the approach directions of the program."""

from __future__ import annotations

import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.play import InPlay, PlayOperator, half_play
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions, States
from postproc.compensation.datum import datum_shifts
from postproc.motion.motions import Motions
from postproc.motion.path_points import PathPoints, axis_positions, path_points
from postproc.motion.reversals import (
    after_cycles,
    axes_with_backlash,
    dead_band,
    known_before,
    needs_direction,
    play_limits,
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
    """Follows the moves of one program text, chunk after chunk, and gives the state of the machine along them."""

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
        limits = play_limits(machine, tolerance_um)
        if written:
            # moves below the dead band remain below it after rounding; a backlash take-up is longer
            limits = limits._replace(band=2 * limits.band + dead_band(machine, 0.0))
        self._model, self._conditions, self._machine = model, conditions, machine
        self._directed = model.part(needs_direction)
        self._linear = [axis for axis in self.axes if not machine.rotary[axis]]
        self._play, self._behind_cycle = PlayOperator(self.axes, limits), False
        self.approach: Array | None = None
        """Sides of the play `(n, axes)` at the ends of the moves of the last chunk; None without backlash."""
        self.reverses: NDArrayBool | None = None
        """Moves `(n,)` of the last chunk in which an axis with backlash reverses; None without backlash."""
        self.steady: NDArrayBool | None = None
        """Moves `(n,)` of the last chunk along which each axis stays on its side of the play; None without backlash."""
        self._points = PathPoints(np.empty(0, int), np.empty(0), np.empty(0, int))
        self._in_play = self._play.last
        self._known: NDArrayBool = np.empty((0, len(machine.axes)), bool)
        """Drives and axes before the last chunk and at its points; where the position before a move was known."""

    def datum_shifts(self, motions: Motions) -> Array:
        """Displacement of the part from its nominal position `(n, 3)`, mm, workpiece frame, at the rows of a chunk."""
        return datum_shifts(motions, self._model, self._conditions)

    def follow(self, motions: Motions) -> None:
        """Follow the moves of the next chunk."""
        if not self.axes or not len(motions):
            return
        behind, self._behind_cycle = after_cycles(motions, self._behind_cycle)
        points = path_points(motions, self._linear, behind)
        before, known = self._play.last, known_before(motions)
        drive = axis_positions(motions, points.row, points.share)
        found = self._play.follow(drive, self._half_play(drive), known[points.row])
        self._points, self._known = points, known
        self._in_play = InPlay(*(np.concatenate(columns) for columns in zip(before, found, strict=True)))
        self.approach = found.side[points.ends]
        self.reverses = self._reversing(points, before, found)
        side = np.concatenate([before.side, found.side[:-1]])[points.ends]
        alone = np.diff(points.ends, prepend=-1) == 1
        self.steady = alone & known.all(axis=1) & (side == self.approach).all(axis=1)

    def _reversing(self, points: PathPoints, before: InPlay, found: InPlay) -> NDArrayBool:
        """Moves `(n,)` in which a drive moves by more than the dead band without its axis."""
        behind, side = (
            np.diff(column, axis=0, prepend=last)
            for column, last in ((found.behind, before.behind), (found.side, before.side))
        )
        reverses = (np.abs(side) >= 1.0) | ((side != 0.0) & (np.abs(behind) > self._play.limits.band / 2.0))
        return np.asarray(np.bincount(points.row, reverses.any(axis=1), len(points.ends)) > 0.0)

    def states(self, motions: Motions, rows: NDArrayBool) -> States:
        """The state at the ends of rows of the next chunk, by a mask `(n,)`."""
        self.follow(motions)
        return self._conditions.states(None if self.approach is None else self.approach[rows])

    def states_at(self, rows: np.ndarray, shares: Array | float, drive: Array) -> States:
        """The state at rows of the last chunk, by a mask or by their numbers.

        At shares of their paths, where the command is `drive` `(k, axes)`, mm and rad.
        """
        if self.approach is None or self.steady is None:
            return self._conditions.states(None)
        rows = np.flatnonzero(rows) if rows.dtype == bool else rows
        side, turning = self.approach[rows], np.flatnonzero(~self.steady[rows])
        if len(turning):
            some, there = rows[turning], drive[turning]
            at = self._points.before(some, np.broadcast_to(shares, rows.shape)[turning])
            found = self._play.limits.moved(self._in_play.rows(at + 1), there, self._half_play(there))
            side[turning] = np.where(self._known[some], np.nan_to_num(found.side), 0.0)
        return self._conditions.states(side)

    def _half_play(self, q: Array) -> Array:
        return half_play(self._machine, self._directed, self._conditions.state(q, np.ones_like(q)))
