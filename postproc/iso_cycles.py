"""Canned cycles of ISO programs: one hole at each position, with the depth and the levels that still hold."""

from __future__ import annotations

from dataclasses import dataclass

from postproc.iso_codes import CYCLE_WORDS
from postproc.motions import AxisWord, Cycle, Known, Recorder
from postproc.program import Block


@dataclass
class CannedCycle:
    """The cycle in force, from its G code to the code that ends it."""

    incremental: bool
    """G91 was in force where it began."""
    level: float
    """Where Z stood then, mm."""
    known: Known
    """How that is known."""
    retract: float | None = None
    depth: float | None = None
    begun: bool = False

    def hole(
        self,
        block: Block,
        recorder: Recorder,
        words: list[tuple[AxisWord, float]],
        retract: float | None,
        to_retract: bool | None,
    ) -> tuple[list[float], float, tuple[AxisWord, ...], Cycle]:
        """Bottom of the next hole, the level that Z comes back to, the words of its place, and what it is.

        words: the axis words of the block with their values; retract: its R. Values in mm.
        """
        z = recorder.machine.index("Z")
        said = {word.axis: (word.word, value) for word, value in words}
        self.retract = self.retract if retract is None else retract
        self.depth = said[z][1] if z in said else self.depth
        if self.retract is None or self.depth is None:
            raise block.refuse("a canned cycle without Z or R")
        if self.incremental and (to_retract is not False or not self.known):
            raise block.refuse("a canned cycle with increments, and no G98 before it or no known level")
        above = self.level if self.incremental else 0.0
        level = above + self.retract
        if self.known and level > self.level:
            raise block.refuse("R lies above the level before the cycle: controls differ in how they return")
        places = [(word, value) for word, value in words if word.axis != z]
        target = recorder.target(block, places)
        target[z] = level + self.depth if self.incremental else self.depth
        cycle = Cycle(said[z][0] if z in said else None, self.retract, self.incremental, to_retract, not self.begun)
        self.begun = True
        return target, level if to_retract else self.level, tuple(word for word, _ in places), cycle


def check_cycle_words(block: Block, addresses: set[str], rotary: bool, plane: str, tcp: bool) -> None:
    """Refuse what some controls do not take in a cycle, or take in ways of their own."""
    strange = sorted(addresses - CYCLE_WORDS)
    if strange:
        raise block.refuse(f"{strange[0]} in a canned cycle: what it does depends on the control")
    if any(word.address == "K" and word.value != 1.0 for word in block.words):
        raise block.refuse("a canned cycle that repeats")
    if rotary:
        raise block.refuse("a rotary axis in a canned cycle")
    if plane != "XYZ" or tcp:
        raise block.refuse("canned cycles are corrected along Z (G17) and without TCP only")
