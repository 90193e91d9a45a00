"""Targets of axes with backlash: the commands that a machine without play would need.

The errors of a move may depend on the sides of the play on which other axes lie: a rotary axis with play turns the tool
point, and play across a guide shifts it. So the targets of linear axes are found again with the sides that follow from
them, until these do not change.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from kinematics.error_model.model import ErrorModel
from kinematics.error_model.play import directed_otherwise, half_play
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.axis_positions import held_shifts, moved_anew
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import Correction, correct_ends
from postproc.correct.backlash.drive_ends import DriveEnds, Sides, Targets
from postproc.motion.along import positions_along
from postproc.motion.motions import Motions
from postproc.motion.path_points import PathPoints
from postproc.motion.reversals import known_before, needs_direction

PRECISION = 0.1
"""Last step of the iteration that finds targets, as a fraction of the dead band."""
MOST_SIDE_PASSES = 6
"""Most repetitions with the sides found before; without play across guides the second one changes nothing."""
SAME_SIDE_TARGET = 1e-7
"""mm or rad: a smaller difference of targets changes no side."""


class AxisTargets:
    """Targets in a program, chunk after chunk."""

    def __init__(
        self,
        machine: Machine,
        models: tuple[ErrorModel, ErrorModel | None],
        conditions: Conditions,
        band: Array,
    ) -> None:
        """models: of the tool point and, if it is corrected, of the orientation. band `(axes,)`: the dead band."""
        model, orientation = self.models = models
        self.conditions = conditions
        self.directed = model.part(needs_direction)
        self.plain = (
            model.part(lambda effect: not needs_direction(effect)),
            orientation and orientation.part(lambda effect: not needs_direction(effect)),
        )
        self.precision = PRECISION * float(band[list(machine.translators)].min())
        self.corrected_axes = np.ones(len(machine.axes), bool) if orientation else ~machine.rotary
        """True `(axes,)` for the axes that the correction moves."""
        self.shift = np.zeros(len(machine.axes))
        """Targets minus nominal positions `(axes,)` after the last row, mm and rad."""


class ChunkTargets:
    """Targets in one chunk."""

    def __init__(self, program: AxisTargets, motions: Motions, points: PathPoints, ready: NDArrayBool) -> None:
        self._program, self._motions, self._points = program, motions, points
        self._before = program.shift
        correction = correct_ends(motions, *program.plain, program.conditions, precision=program.precision)
        self._nominal, self._shifts = correction.nominal, held_shifts(motions, correction, self._before)
        self._inner = np.flatnonzero(points.share < 1.0)
        """Numbers of the points before the ends of moves."""
        axis = self._positions(np.zeros_like(self._shifts), np.zeros_like(self._shifts))
        forward = program.conditions.state(axis, np.ones_like(axis))
        anew = moved_anew(motions)
        self.now = Targets(
            points,
            axis,
            np.zeros_like(axis),
            half_play(motions.machine, program.directed, forward),
            known_before(motions),
            motions.movable & anew & program.corrected_axes,
            ~anew,
            ready,
        )
        corrected = np.flatnonzero(program.corrected_axes).tolist()
        self._beside = directed_otherwise(motions.machine, program.directed, forward, corrected)
        self._sided: tuple[Array, Correction] | None = None
        """Sides at the ends of moves, and the correction with them, as found last."""

    def follow(self, drives: DriveEnds) -> tuple[Sides, DriveEnds]:
        """The sides of the play in the chunk, and the drives after it; `drives`: before it."""
        after = drives.copied()
        found = after.follow(self.now)
        for _ in range(MOST_SIDE_PASSES):
            if not self._improve(drives, found):
                break
            after = drives.copied()
            found = after.follow(self.now)
        self._program.shift = self._shifts[-1]
        return found, after

    def _improve(self, drives: DriveEnds, sides: Sides) -> bool:
        """Find the targets for these sides; false if they are what they were."""
        last, now = self._points.ends, self.now
        ahead = np.where(now.chosen, sides.last * now.half[last], 0.0)
        if self._beside:
            found = self._corrected(sides.last)
            found = replace(found, corrected=found.corrected - ahead)
            self._shifts = held_shifts(self._motions, found, self._before)
        axis, drift = now.axis, now.drift
        nothing = np.zeros_like(ahead)
        self.now = now._replace(axis=self._positions(nothing, nothing))
        if len(self._inner):
            starts = np.vstack([drives.ahead, ahead[:-1]])
            starts = np.where(now.ready, sides.first * now.half[last], starts)
            share, row = self._points.share[:, None], self._points.row
            straight = (1.0 - share) * starts[row] + share * ahead[row]
            self.now = self.now._replace(drift=self._positions(starts, ahead) - self.now.axis - straight)
        moved = max(float(np.abs(new - old).max()) for new, old in ((self.now.axis, axis), (self.now.drift, drift)))
        return moved > SAME_SIDE_TARGET

    def _corrected(self, approach: Array) -> Correction:
        """The correction of the ends of moves with these sides `(n, axes)`: anew where they are others than before."""
        program, motions = self._program, self._motions
        if self._sided is None:
            found = correct_ends(motions, *program.models, program.conditions, approach, precision=program.precision)
        else:
            before, found = self._sided
            rows = np.flatnonzero((approach != before).any(axis=1))
            if len(rows):
                part, sides = motions.bare.take(rows), approach[rows]
                anew = correct_ends(part, *program.models, program.conditions, sides, precision=program.precision)
                corrected, target = found.corrected.copy(), found.target.copy()
                corrected[rows], target[rows] = anew.corrected, anew.target
                found = replace(found, corrected=corrected, target=target)
        self._sided = approach, found
        return found

    def _positions(self, starts: Array, ends: Array) -> Array:
        """Axis positions `(k, axes)` at the points, with these additions `(n, axes)` at starts and ends of moves."""
        motions, row = self._motions, self._points.row
        positions = (self._nominal + self._shifts + ends)[row]
        if not len(self._inner):
            return np.asarray(positions)
        some, share = row[self._inner], self._points.share[self._inner]
        part, before = motions.bare.take(some), np.vstack([self._before, self._shifts[:-1]])
        start = part.in_machine(motions.start[some])
        at_start = part.in_program(start + (before + starts)[some]) - motions.start[some]
        at_end = part.in_program(positions[self._inner]) - motions.target[some]
        shift = at_start + share[:, None] * (at_end - at_start)
        positions[self._inner] = part.in_machine(positions_along(motions, some, share) + shift)
        return np.asarray(positions)
