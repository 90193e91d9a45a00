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
from postproc.compensation.axis_positions import held_shifts
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import correct_ends
from postproc.motion.motions import Motions
from postproc.motion.moves import Known
from postproc.motion.reversals import (
    INNER,
    Directions,
    axes_with_backlash,
    axis_positions_along,
    dead_band,
    feeds,
    known_before,
    needs_direction,
    turns_inside,
)
from postproc.motion.segments import split, turning_points, with_backlash_take_ups
from postproc.text.block import Block
from postproc.text.notes import Notes
from postproc.write.added_blocks import NO_INSERTION, START_M

PRECISION = 0.1
"""Last step of the iteration that finds the directions of moves, as a fraction of the dead band."""
NOT_READY = "its block changes the frame, moves rotary axes only, is polar, has locked axes, or has no F under G93"


class Directed(NamedTuple):
    """Moves, and the direction `(n, axes)`, -1, 0, 1, of each at its end; None if no error depends on a direction."""

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
        model, orientation = models
        self.machine, self.conditions, self.notes = machine, conditions, notes
        self.axes = axes_with_backlash(model, machine)
        self.band = dead_band(machine, tolerance_um)
        self._plain = model.part(lambda effect: not needs_direction(effect))
        self._orientation = orientation and orientation.part(lambda effect: not needs_direction(effect))
        self._directions = Directions(self.axes, self.band)
        self._shift = np.zeros(len(machine.axes))
        """Corrected minus nominal axis positions `(axes,)` at the last row, mm and rad."""

    def prepare(self, motions: Motions) -> Directed:
        """The moves of a chunk with cut arcs and backlash take-ups; unchanged if no error depends on a direction."""
        if not self.axes:
            return Directed(motions, None)
        motions = split(motions, self._cuts(motions), at_quadrants=True)
        before = self._directions.last
        first, last = self._directions_of(motions)
        return self._with_backlash_take_ups(motions, np.vstack([before, last[:-1]]), first, last)

    def _cuts(self, motions: Motions) -> dict[int, list[float]]:
        """Shares at which arcs are cut, by row."""
        cuts: dict[int, list[float]] = {}
        for row, arc in motions.arcs.items():
            points = [p for p in turning_points(motions, row) if p[2] > self.band[p[1]]]
            if not any(axis in self.axes for _, axis, _ in points):
                continue
            block = motions.blocks[motions.block[row]]
            obstacle = _obstacle(motions, row, block)
            if obstacle:
                self._note("an arc is not cut where an axis reverses", obstacle, block)
                continue
            # a segment by its radius is at most a quarter: near half a circle a radius hardly determines the centre
            every = arc.form.startswith("radius")
            cuts[row] = [share for share, axis, _ in points if every or axis in self.axes]
        return cuts

    def _directions_of(self, motions: Motions) -> tuple[Array, Array]:
        """Directions `(n, axes)` at the starts and ends of moves, from the commands without backlash."""
        if not len(motions):
            return np.zeros_like(motions.target), np.zeros_like(motions.target)
        precision = PRECISION * float(self.band[list(self.machine.translators)].min())
        correction = correct_ends(motions, self._plain, self._orientation, self.conditions, precision=precision)
        shifts = held_shifts(motions, correction, self._shift)
        ends = correction.nominal + shifts
        certain = known_before(motions)
        winding = turns_inside(motions, self.axes, self.band)
        before, positions = np.vstack([self._shift, shifts[:-1]]), ends[:, None]
        if winding.any():
            share = np.array(INNER)[None, :, None]
            inner = axis_positions_along(motions, INNER) + before[:, None] + share * (shifts - before)[:, None]
            inner[~winding] = np.nan
            positions = np.concatenate([inner, positions], axis=1)
        starts = motions.in_machine(motions.start) + before
        found = self._directions.follow_moves(motions, positions, starts, certain)
        after_cycle = (self._directions.returned * found[:, 0] < 0.0) & feeds(motions)[:, None]
        self._note_along(motions, after_cycle, "a canned cycle ends at its start")
        if winding.any():
            found[~winding] = found[~winding, -1:]
            reverses = (found[:, 1:] != found[:, :-1]).any(axis=1) & (winding & feeds(motions))[:, None]
            self._note_along(motions, reverses, "the axis reverses within the move")
        self._shift = shifts[-1]
        return found[:, 0], found[:, -1]

    def _with_backlash_take_ups(self, motions: Motions, before: Array, first: Array, last: Array) -> Directed:
        self._note_unknown(motions, last)
        required = (first != before) & feeds(motions)[:, None]
        linear = np.zeros(len(self.machine.axes), bool)
        linear[list(self.machine.translators)] = True
        others = required & ~linear
        coupled = motions.coupled
        # here a machine axis depends on several programmed ones: all of them move, or none
        together = coupled[:, None] & linear & (required & linear).any(axis=1, keepdims=True)
        reversing = (required & linear) | together
        programmed = (motions.known_start == Known.PROGRAM) & (motions.known == Known.PROGRAM)
        closed = motions.blocks.marked(lambda block: block.no_insertion)[motions.block]
        ready = motions.frame_unchanged & ~motions.rotary_only & ~closed
        ready[[*motions.cutter_compensated, *motions.polars, *motions.locked_axes]] = False
        for row in np.flatnonzero(motions.timed & reversing.any(axis=1)):
            ready[row] &= _has_feed(motions.blocks[motions.block[row]])
        possible = reversing & programmed & ready[:, None]
        possible[coupled & (reversing & ~possible).any(axis=1)] = False
        self._note_along(motions, others, "ncomp does not correct this axis")
        missing = required & linear & ~possible
        self._note_along(motions, missing & closed[:, None], NO_INSERTION)
        self._note_along(motions, missing & ~(closed | ready)[:, None], NOT_READY)
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


def _obstacle(motions: Motions, row: int, block: Block) -> str:
    """Reason why an arc cannot be written in segments; empty if it can."""
    named = [word.axis for word in motions.words[row]]
    codes = {word.value or 0.0 for word in block.words if word.address == "M"}
    obstacles = {
        NO_INSERTION: block.no_insertion,
        "under TCP its axes are not the axes of the machine": motions.frames[motions.frame[row]].tcp,
        "cutter compensation is active": row in motions.cutter_compensated,
        "other axes move with it": any(axis not in motions.machine.translators for axis in named),
        "it has an increment from an unknown position": (motions.known[row, named] != Known.PROGRAM).any(),
        "an M function in its block may run before or after the move": not START_M.issuperset(codes),
        "its block has no F under G93": motions.timed[row] and not _has_feed(block),
    }
    return next((obstacle for obstacle, present in obstacles.items() if present), "")


def _has_feed(block: Block) -> bool:
    return any(word.address == "F" and word.value for word in block.words)
