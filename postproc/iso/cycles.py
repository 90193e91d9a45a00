"""Cycles and macros of ISO programs that run at each position: canned cycles (G81), modal macros (G66)."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

from postproc.control.channel import AxisWords
from postproc.iso.codes import COORDINATE_CHANGES, CYCLE_WORDS, LENGTH_CODES, NOT_MOVING
from postproc.iso.words import DIFFERS, Content
from postproc.motion.frames import Frame
from postproc.motion.moves import AxisWord, Cycle, Known
from postproc.motion.recorder import Recorder
from postproc.text.block import Block


class Hole(NamedTuple):
    """One hole; positions in mm and degrees, programmed coordinates."""

    target: list[float]
    """The bottom."""
    level: float
    """Where the axis that drills comes back to."""
    positions: tuple[AxisWord, ...]
    """The words of its position."""
    cycle: Cycle


class CannedCycle(msgspec.Struct):
    """The cycle in force, from its G code to the code that ends it."""

    axis: int
    """Column of the axis that drills."""
    incremental: bool
    """G91 was in force where it began."""
    level: float
    """Position of the axis then, mm."""
    known: Known
    """How that is known."""
    unit: float
    """Unit of its numbers, mm."""
    frame: Frame
    """Frame in which it began."""
    retract: float | None = None
    depth: float | None = None
    begun: bool = False

    def store(self, words: AxisWords, retract: tuple[int, float] | None) -> None:
        """Take over the depth and R of a block, for the holes that come."""
        self.retract = self.retract if retract is None else retract[1]
        self.depth = next((value for word, value in words if word.axis == self.axis), self.depth)

    def hole(
        self,
        block: Block,
        recorder: Recorder,
        words: AxisWords,
        retract: tuple[int, float] | None,
        to_retract: bool | None,
        family: str,
        *,
        switched: bool = False,
    ) -> Hole:
        """The next hole; `family`: of controls, which differ in the return from an R above the level.

        words: the axis words of the block with their values; retract: its R, index and value. Values in mm.
        switched: the block is in G91 and the start of the cycle in G90, or the reverse.
        """
        axis = self.axis
        programmed = {word.axis: (word.word, value) for word, value in words}
        self.store(words, retract)
        cycle, bottom, level = self.in_force(block, recorder.machine.names[axis], to_retract, family)
        positions = [(word, value) for word, value in words if word.axis != axis]
        target = recorder.target(block, positions)
        target[axis] = bottom
        depth_word = programmed[axis][0] if axis in programmed else None
        retract_word = None if retract is None else retract[0]
        cycle = cycle._replace(word=depth_word, retract_word=retract_word, switched=switched)
        self.begun = True
        return Hole(target, level, tuple(word for word, _ in positions), cycle)

    def in_force(self, block: Block, name: str, to_retract: bool | None, family: str) -> tuple[Cycle, float, float]:
        """The cycle of a hole with the depth and R in force, its bottom, and where the axis comes back to, mm.

        name: of the axis. to_retract, family: as of `hole`.
        """
        clear, bottom = self._level_and_bottom(block, name, to_retract)
        to_retract = self._return(block, clear, bottom, to_retract, family)
        cycle = Cycle(self.axis, None, None, clear, self.incremental, to_retract, not self.begun)
        return cycle, bottom, clear if to_retract else self.level

    def _level_and_bottom(self, block: Block, name: str, to_retract: bool | None) -> tuple[float, float]:
        """Positions of R and of the bottom, mm, along the axis of this name; Refusal where the program gives none."""
        if self.retract is None or self.depth is None:
            raise block.refuse(f"the canned cycle needs {name} and R: write both")
        if self.incremental and (to_retract is None or not self.known):
            raise block.refuse(
                f"a canned cycle with increments needs G98 or G99 and a known position of {name} before it: write both"
            )
        level = self.retract + (self.level if self.incremental else 0.0)
        return level, level + self.depth if self.incremental else self.depth

    def _return(self, block: Block, level: float, bottom: float, to_retract: bool | None, family: str) -> bool | None:
        """End position of a hole, as `to_retract`, for R and bottom in mm; Refusal where controls differ in it."""
        if family == "linuxcnc" and bottom > level:
            raise block.refuse("the bottom of this canned cycle is above its R, which LinuxCNC refuses: correct R")
        if not self.known or level <= self.level or to_retract or family == "fanuc":
            return to_retract
        if family == "linuxcnc":
            return True
        if bottom > level:
            return to_retract  # those controls take it that return to the level before the cycle
        raise block.refuse(
            "R is above the level before the cycle, and controls differ in the return: move the tool "
            f"above R before the cycle, or {DIFFERS}"
        )


def check_cycle_words(content: Content, rotary: bool) -> None:
    """Refuse words that some controls do not take in a cycle, or use differently."""
    strange = sorted(content.other.keys() - CYCLE_WORDS)
    if strange:
        raise content.refuse(f"the effect of {strange[0]} in a canned cycle depends on the control: leave it out")
    if rotary:
        raise content.refuse(
            "a rotary axis in the block of a canned cycle is not corrected: move it in a block before the cycle"
        )


# ---- modal macros


def calls_macro(content: Content, claimed: float | None, inside: str, stayed: bool) -> bool:
    """Whether the macro runs after a block; Refusal where that depends on the control.

    `claimed`: the code that takes the coordinates of the block; `inside`: another mode that is active; `stayed`: its
    move has no length.
    """
    if claimed in NOT_MOVING or claimed in COORDINATE_CHANGES:
        return False
    if claimed is not None:
        raise content.refuse(
            f"G{claimed:g} while G66 is active: not all controls run the macro after it. Write G67 before it"
        )
    if not content.moves:
        if LENGTH_CODES.isdisjoint(content.g):
            return False
        raise content.refuse(
            "a length offset without coordinates while G66 is active: not all controls run the macro after it. "
            "Write G67 before it"
        )
    if inside:
        raise content.refuse(
            f"{inside} while G66 is active: the order of the two is not documented. Write G67 before it"
        )
    if stayed:
        raise content.refuse(
            "the block moves to the present position while G66 is active: whether its macro runs is not "
            "documented. Delete the block or write G67 before it"
        )
    return True
