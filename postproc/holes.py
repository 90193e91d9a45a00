"""Holes of canned cycles written at their corrected depth; R goes with it, so that pecks stay as many as they were."""

from __future__ import annotations

from typing import NamedTuple

from postproc.moves import Cycle
from postproc.words import WordEditor


class Depth(NamedTuple):
    """Where a hole is to end along the axis that drills it; mm, programmed coordinates."""

    wanted: float
    nominal: float
    said: bool
    """The program has said where the axis stands: it is corrected."""


class HoleWriter:
    """Says depth and R of holes; both hold from block to block where a block leaves them out."""

    def __init__(self) -> None:
        self._level = 0.0
        """Where the axis stood before the first cycle, mm."""
        self._held = {"R": 0.0, "depth": 0.0}
        """As last said, in units of the words."""

    def write(
        self, editor: WordEditor, cycle: Cycle, name: str, depth: Depth, held: float, unit: float, decimals: int
    ) -> tuple[float, float]:
        """Edit the block of a hole; its bottom as written, and where the axis comes back to, mm.

        name: of the axis that drills. held: where it stands.
        """
        if cycle.first:
            self._level = held
        above = self._level if cycle.incremental else 0.0
        clear = cycle.clear + depth.wanted - depth.nominal
        words = (cycle.retract_word, cycle.word)
        clear = above + unit * self._say(editor, words[0], "R", "R", (clear - above) / unit, decimals, depth.said)
        base = clear if cycle.incremental else 0.0
        number = (depth.wanted - base) / unit
        bottom = base + unit * self._say(editor, words[1], name, "depth", number, decimals, depth.said)
        return bottom, clear if cycle.to_retract else self._level

    def _say(
        self, editor: WordEditor, index: int | None, name: str, what: str, number: float, decimals: int, said: bool
    ) -> float:
        """One word, in its unit; as it stands where the axis is not corrected."""
        if index is not None:
            stands = editor.block.words[index].value or 0.0
            self._held[what] = editor.set(index, number, decimals) if said else stands
        elif said and round(number - self._held[what], decimals) != 0.0:
            self._held[what] = round(number, decimals)
            editor.insert(name, self._held[what], decimals)
        return self._held[what]
