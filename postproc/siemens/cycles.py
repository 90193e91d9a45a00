"""Cycles of Siemens programs: where they run and where they leave the tool; their arguments stay as they are."""

from __future__ import annotations

from dataclasses import dataclass

from postproc.control.interpreter import Interpreter
from postproc.siemens.codes import CYCLES, CYCLES_AT_POSITION
from postproc.siemens.words import Content
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown, number


@dataclass(frozen=True)
class Cycle:
    """A call of a cycle."""

    name: str
    retraction: float | None
    """Position of the tool along its axis after the cycle, in units of the program; None where it is not given."""


@dataclass
class Cycles:
    """The modal cycle, and the position after cycles."""

    control: Interpreter
    modal: Cycle | None = None

    def read(self, index: int, block: Block, content: Content) -> bool:
        """Take over a cycle that a block calls; False where it calls none.

        With MCALL before it, it runs after every move from then on; MCALL alone ends that.
        """
        called = [block.words[i] for name, i in content.names.items() if name in CYCLES]
        modal = "MCALL" in content.names
        if not called and not modal:
            return False
        if len(called) > 1 or len(content.names) > len(called) + modal or content.axes or content.g:
            raise block.refuse("a cycle call must be alone in its block: write the other words in a block before it")
        cycle = self._cycle(called[0]) if called else None
        if modal:
            self.modal = cycle
        elif cycle is not None:
            self._run(index, block, cycle)
        return True

    def run_modal(self, index: int, block: Block) -> None:
        """The modal cycle, at the end of a move."""
        if self.modal is not None:
            self._run(index, block, self.modal)

    def _cycle(self, word: Word) -> Cycle:
        try:
            retraction = number((word.arguments or ())[0], self.control.scope)
        except (NotKnown, IndexError):
            retraction = None
        return Cycle(word.address, retraction)

    def _run(self, index: int, block: Block, cycle: Cycle) -> None:
        control, recorder = self.control, self.control.recorder
        if recorder.frame.tcp and not recorder.frame.couples:
            raise block.refuse(f"{cycle.name} while TRAORI is on is not corrected: write TRAFOOF before it")
        if cycle.name not in CYCLES_AT_POSITION:
            control.mark_unknown("XYZ")
            text = f"{cycle.name}: the positions in its arguments stay as programmed and are not corrected"
            control.notes.add(text, block.line)
            return
        control.notes.add(
            f"{cycle.name} runs from the corrected position; its arguments stay as programmed", block.line
        )
        axis = control.plane_columns[2]
        if cycle.retraction is None:
            recorder.mark_unknown([axis])
        else:
            recorder.leave_at(index, axis, cycle.retraction * control.unit)
