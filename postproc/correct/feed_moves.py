"""Notes on feed moves: before any F, and by half a turn in a direction that depends on the control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.machine import TURN
from postproc.correct.obstacles import turns_unknown
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.notes import Notes

FEED_KINDS = (Kind.LINE, Kind.ARC, Kind.CYCLE)
FEEDS = frozenset(("F", "FU", "FZ", "FT", "FB", "FD", "FAUTO"))
"""Addresses of a feed, in all dialects."""
WITHOUT_FEED = "a feed move has no F before it: the control takes a feed of its own, or refuses the program"


@dataclass
class FeedNotes:
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
        for row in np.flatnonzero((motions.kind == Kind.LINE) & (turned >= TURN / 2 - 1e-6)).tolist():
            for axis in turns_unknown(motions, row):
                name = motions.machine.names[axis]
                text = (
                    f"{name} turns by half a turn or more in a feed move, and its direction depends on the control "
                    f"(rollover under [axes.{name}] in the machine file states it)"
                )
                self.notes.add(text, int(motions.line[row]))
