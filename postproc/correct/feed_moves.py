"""Notes on feed moves: before any F, and by half a turn in a direction that depends on the control."""

from __future__ import annotations

import msgspec
import numpy as np

from kinematics.machine import TURN_DEG
from postproc.correct.obstacles import turns_unknown
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.notes import Notes

FEED_KINDS = (Kind.LINE, Kind.ARC, Kind.CYCLE)
FEEDS = frozenset(("F", "FU", "FZ", "FT", "FB", "FD", "FAUTO"))
"""Addresses of a feed, in all dialects."""
LONG_WAY = 330.0
"""Degrees of a turn in one feed move, from which it may be a mistake."""
WITHOUT_FEED = "a feed move has no F before it: the control takes a feed of its own, or refuses the program"


class FeedNotes(msgspec.Struct):
    """Takes the chunks of a program in their order, as the program has them."""

    notes: Notes
    given: bool = False
    """The program has an F, or the note is there."""

    def take(self, motions: Motions) -> None:
        """Add the notes on a chunk."""
        if not self.given:
            self._find_feed(motions)
        self._note_turns(motions)

    def _find_feed(self, motions: Motions) -> None:
        rows = np.flatnonzero(np.isin(motions.kind, FEED_KINDS))
        end = int(motions.block[rows[0]]) + 1 if rows.size else len(motions.blocks)
        named = (word.address for i in range(end) for word in motions.blocks[i].words)
        self.given = any(address in FEEDS for address in named)
        if rows.size and not self.given:
            self.notes.add(WITHOUT_FEED, int(motions.line[rows[0]]))
            self.given = True

    def _note_turns(self, motions: Motions) -> None:
        rotary = motions.machine.rotary
        if not rotary.any():
            return
        turned = np.abs(motions.target - motions.start)[:, rotary].max(axis=1, initial=0.0)
        for row in np.flatnonzero((motions.kind == Kind.LINE) & (turned >= TURN_DEG / 2 - 1e-6)).tolist():
            for axis in turns_unknown(motions, row):
                name = motions.machine.names[axis]
                text = (
                    f"{name} turns by half a turn or more in a feed move, and its direction depends on the control "
                    f"(rollover under [axes.{name}] in the machine file states it)"
                )
                self.notes.add(text, int(motions.line[row]))
        for row in np.flatnonzero(
            (motions.kind == Kind.LINE) & (turned >= LONG_WAY) & (turned < TURN_DEG - 1e-6)
        ).tolist():
            self._note_long_way(motions, row)

    def _note_long_way(self, motions: Motions, row: int) -> None:
        """A feed move that turns nearly a turn, as the program has it: from 355 to 5 degrees, perhaps by mistake."""
        incremental = [word.axis for word in motions.words[row] if word.incremental]
        but = {*turns_unknown(motions, row), *incremental}
        for axis, way in enumerate((motions.target[row] - motions.start[row]).tolist()):
            if motions.machine.rotary[axis] and LONG_WAY <= abs(way) < TURN_DEG - 1e-6 and axis not in but:
                self.notes.add(
                    f"{motions.machine.names[axis]} turns by {abs(way):.6g} degrees in a feed move, and the shortest "
                    f"way would be {TURN_DEG - abs(way):.6g} degrees back: check that the move is meant",
                    int(motions.line[row]),
                )
