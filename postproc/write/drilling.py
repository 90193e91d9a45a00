"""Holes of canned cycles written at their corrected depth; R goes with it, so that pecks stay as many as they were."""

from __future__ import annotations

from typing import NamedTuple

from postproc.motion.moves import Cycle
from postproc.text.editing import WordEditor


class Depth(NamedTuple):
    """Where a hole is to end along the axis that drills it; mm, programmed coordinates."""

    wanted: float
    nominal: float
    said: bool
    """The program has said where the axis stands: it is corrected."""


class Scale(NamedTuple):
    """Unit, decimals and extent of the written words of a block."""

    unit: float
    """Unit of the numbers, mm."""
    decimals: int
    corrected: bool
    """Depth and R are corrected, not left unchanged."""
    both: bool
    """Both R and the depth are written, even if one of them has not changed."""


class HoleWriter:
    """Says depth and R of holes; both hold from block to block where a block leaves them out.

    With increments R is never written without the depth: if only R changes, some controls keep the bottom and others
    its distance from R.
    """

    def __init__(self) -> None:
        self._level = 0.0
        """Where the axis stood before the first cycle, mm."""
        self._held: dict[str, float] = {}
        """Last written positions of R and the depth, mm."""

    def write(
        self, editor: WordEditor, cycle: Cycle, name: str, depth: Depth, held: float, unit: float, decimals: int
    ) -> tuple[float, float]:
        """Edit the block of a hole; its bottom as written, and where the axis comes back to, mm.

        name: of the axis that drills. held: where it stands.
        """
        if cycle.first:
            self._level = held
            self._held.clear()
        wanted = {"R": cycle.clear + depth.wanted - depth.nominal, "depth": depth.wanted}
        incremental = cycle.incremental != cycle.switched
        above = self._level if incremental else 0.0
        both = (incremental or cycle.switched) and self._differ(wanted, unit, decimals)
        scale = Scale(unit, decimals, depth.said, both)
        clear = self._say(editor, cycle.retract_word, ("R", "R"), wanted["R"], above, scale)
        bottom = self._say(editor, cycle.word, (name, "depth"), wanted["depth"], clear if incremental else 0.0, scale)
        return bottom, clear if cycle.to_retract else self._level

    def _differ(self, wanted: dict[str, float], unit: float, decimals: int) -> bool:
        """True if one of both differs from the value that the control has."""
        return any(self._differs(what, value, unit, decimals) for what, value in wanted.items())

    def _differs(self, what: str, wanted: float, unit: float, decimals: int) -> bool:
        return what not in self._held or round((wanted - self._held[what]) / unit, decimals) != 0

    def _say(
        self, editor: WordEditor, index: int | None, name: tuple[str, str], wanted: float, base: float, scale: Scale
    ) -> float:
        """Written position of one word, mm; unchanged if the axis is not corrected.

        `name`: its address and its quantity; `base`: origin of its value, mm.
        """
        (address, what), number = name, (wanted - base) / scale.unit
        if index is not None:
            stands = editor.block.words[index].value or 0.0
            said = editor.set(index, number, scale.decimals) if scale.corrected else stands
        elif scale.corrected and (scale.both or self._differs(what, wanted, scale.unit, scale.decimals)):
            said = editor.agreed(address, round(number, scale.decimals), scale.decimals)
            editor.insert(address, said, scale.decimals)
        else:
            return self._held.get(what, wanted)
        self._held[what] = base + scale.unit * said
        return self._held[what]
