"""Reversals of axes with backlash: arcs are cut there, and the backlash is taken up before the move continues.

The command is the position without backlash plus the correction for the direction of the last move, which jumps at a
reversal. An added block makes this jump before a feed move, so that the move is correct over its whole length; a rapid
makes the jump along its path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.correct.backlash.axis_targets import AxisTargets, ChunkTargets
from postproc.correct.backlash.drive_ends import DriveEnds
from postproc.correct.obstacles import TABLE, Asked, Change, obstacles, reasons
from postproc.motion.motions import Motions
from postproc.motion.moves import Known
from postproc.motion.path_points import path_points
from postproc.motion.reversals import after_cycles, axes_with_backlash, dead_band, feeds
from postproc.motion.segments import split, turning_points, with_backlash_take_ups
from postproc.text.block import Block
from postproc.text.notes import Notes

ALSO = tuple(i / 16 for i in range(1, 16))
"""Shares of moves with turning points at which the axes are followed too: their corrected paths turn beside these."""


class Directed(NamedTuple):
    """Moves, and the side of the play `(n, axes)`, -1 ... 1, on which each axis lies at their ends.

    None if no error depends on a direction.
    """

    motions: Motions
    approach: Array | None


class BacklashTakeUps:
    """Cuts arcs at reversals and inserts backlash take-ups, chunk after chunk."""

    def __init__(
        self,
        machine: Machine,
        models: tuple[ErrorModel, ErrorModel | None],
        conditions: Conditions,
        tolerance_um: float,
        notes: Notes,
    ) -> None:
        self.machine, self.conditions, self.notes = machine, conditions, notes
        self.axes = axes_with_backlash(models[0], machine)
        self.band = dead_band(machine, tolerance_um)
        self._translating = np.zeros(len(machine.axes), bool)
        self._translating[list(machine.translators)] = True
        self._linear = [axis for axis in self.axes if not machine.rotary[axis]]
        self._targets = AxisTargets(machine, models, conditions, self.band)
        self._drives, self._behind_cycle = DriveEnds(self.axes, self.band), False

    def prepare(self, motions: Motions) -> Directed:
        """The moves of a chunk with cut arcs and backlash take-ups; unchanged if no error depends on a direction."""
        if not self.axes:
            return Directed(motions, None)
        motions = split(motions, self._cuts(motions), at_quadrants=True)
        before = self._drives.last
        first, last = self._sides_of(motions)
        return self._with_backlash_take_ups(motions, np.vstack([before, last[:-1]]), first, last)

    def _cuts(self, motions: Motions) -> dict[int, list[float]]:
        """Shares at which arcs are cut, by row."""
        turning = {row: [p for p in turning_points(motions, row) if p[2] > self.band[p[1]]] for row in motions.arcs}
        rows = [row for row, points in turning.items() if any(axis in self.axes for _, axis, _ in points)]
        cuts: dict[int, list[float]] = {}
        for row, reason in zip(rows, reasons(Change.CUT, Asked(motions), rows), strict=True):
            if reason:
                self._note("an arc is not cut where an axis reverses", reason, motions.blocks[motions.block[row]])
                continue
            # a segment by its radius is at most a quarter: near half a circle a radius hardly determines the centre
            every = motions.arcs[row].form.startswith("radius")
            cuts[row] = [share for share, axis, _ in turning[row] if every or axis in self.axes]
        return cuts

    def _sides_of(self, motions: Motions) -> tuple[Array, Array]:
        """Sides of the play `(n, axes)` at the starts and ends of moves."""
        if not len(motions):
            return np.zeros_like(motions.target), np.zeros_like(motions.target)
        behind, self._behind_cycle = after_cycles(motions, self._behind_cycle)
        points = path_points(motions, self._linear, behind, ALSO)
        turning = np.bincount(points.row[~points.returning], minlength=len(motions)) > 1
        ready = (_obstacles(motions, turning) < 0)[:, None] & self._added_axes(motions)
        found, self._drives = ChunkTargets(self._targets, motions, points, ready).follow(self._drives)
        after_cycle = (found.returned * found.first < 0.0) & feeds(motions)[:, None]
        self._note_along(motions, after_cycle, "a canned cycle ends at its start")
        reverses = (found.first != found.last) & (turning & feeds(motions))[:, None]
        self._note_along(motions, reverses, "the axis reverses within the move")
        return found.first, found.last

    def _added_axes(self, motions: Motions) -> NDArrayBool:
        """True `(n, axes)` for axes that a backlash take-up before a feed move may move."""
        programmed = (motions.known_start == Known.PROGRAM) & (motions.known == Known.PROGRAM) & self._translating
        coupled = motions.coupled
        # here a machine axis depends on several programmed ones: all of them move, or none
        programmed[coupled] &= programmed[coupled][:, self._translating].all(axis=1, keepdims=True)
        return np.asarray(programmed & feeds(motions)[:, None])

    def _with_backlash_take_ups(self, motions: Motions, before: Array, first: Array, last: Array) -> Directed:
        self._note_unknown(motions, last)
        required = (first != before) & feeds(motions)[:, None]
        reversing, added = required & self._translating, self._added_axes(motions)
        turned = reversing.any(axis=1)
        found = _obstacles(motions, turned)
        ready = found < 0
        possible = np.where(motions.coupled[:, None], turned[:, None], reversing) & added & ready[:, None]
        self._note_along(motions, required & ~self._translating, "ncomp does not correct this axis")
        missing = reversing & ~possible
        for number in np.unique(found[missing.any(axis=1) & ~ready]).tolist():
            self._note_along(motions, missing & (found == number)[:, None], TABLE[number].reason)
        self._note_along(motions, missing & ready[:, None], "the program has not given the position of the axis")
        rows = np.flatnonzero(possible.any(axis=1))
        taken_up = np.where(possible & required, first, before)[rows]
        approach = np.insert(last, rows, taken_up, axis=0)
        return Directed(with_backlash_take_ups(motions, rows, possible[rows]), approach)

    def _note_along(self, motions: Motions, cells: NDArrayBool, why: str) -> None:
        """Note the moves and axes, true in `cells` `(n, axes)`, whose backlash is taken up along the move."""
        for row, axis in np.argwhere(cells):
            deviation = f"the backlash of {self.machine.names[axis]} is taken up along a feed move and not before it"
            self._note(deviation, why, motions.blocks[motions.block[row]])

    def _note_unknown(self, motions: Motions, approach: Array) -> None:
        """Note the axes that are assumed in the middle of their backlash."""
        for axis in self.axes:
            rows = np.flatnonzero(motions.evaluated & (approach[:, axis] == 0.0))
            if rows.size:
                line = motions.blocks[motions.block[rows[0]]].line
                name = self.machine.names[axis]
                text = f"{name} is assumed in the middle of its backlash until it moves from a programmed position"
                self.notes.add(text, line, rows.size)

    def _note(self, deviation: str, why: str, block: Block) -> None:
        self.notes.add(f"{deviation}, because {why}: the move may deviate by the backlash until its end", block.line)


def _obstacles(motions: Motions, with_words: NDArrayBool) -> np.ndarray:
    """Number `(n,)` of the obstacle to a block before each move, -1 for none.

    with_words `(n,)`: rows whose words are read.
    """
    return obstacles(Change.TAKE_UP, Asked(motions, with_words=with_words), np.arange(len(motions)))
