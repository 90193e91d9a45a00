"""Cycles of Siemens programs: where they run and where they leave the tool; their arguments stay as they are."""

from __future__ import annotations

from postproc.control.channel import LEANS
from postproc.siemens.channel import Channel
from postproc.siemens.codes import CYCLES, CYCLES_AT_POSITION, DRILLING_CYCLES
from postproc.siemens.modal_state import Cycle
from postproc.siemens.variables import EMPTY
from postproc.siemens.words import Content
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown, Scope, number, whole

OLDER_MODE = range(100, 1_000_000)
"""Second arguments of CYCLE832 whose second last digit switches TRAORI; in others it is for the orientation."""


def read_cycle(channel: Channel, index: int, block: Block, content: Content) -> bool:
    """Take over a cycle that a block calls; False where it calls none.

    With MCALL before it, it runs after every move from then on; MCALL alone ends that.
    """
    called = [block.words[i] for name, i in content.names.items() if name in CYCLES]
    modal = "MCALL" in content.names
    if not called and not modal:
        return False
    if len(called) > 1 or len(content.names) > len(called) + modal or content.axes or content.g:
        raise block.refuse("a cycle call must be alone in its block: write the other words in a block before it")
    cycle = _cycle(called[0], channel.scope) if called else None
    if modal:
        channel.modal.cycle = cycle
    elif cycle is not None:
        _run(channel, index, block, cycle)
    return True


def run_modal_cycle(channel: Channel, index: int, block: Block) -> None:
    """The modal cycle, at the end of a move."""
    if channel.modal.cycle is not None:
        _run(channel, index, block, channel.modal.cycle)


def _cycle(word: Word, scope: Scope) -> Cycle:
    try:
        retraction = number((word.arguments or ())[0], scope)
    except (NotKnown, IndexError):
        retraction = None
    return Cycle(word.address, retraction)


def _run(channel: Channel, index: int, block: Block, cycle: Cycle) -> None:
    recorder, notes, name, axis = channel.recorder, channel.notes, cycle.name, channel.modal.plane_columns[2]
    if recorder.frame.tcp and not recorder.frame.couples:
        if name not in DRILLING_CYCLES:
            raise block.refuse(f"{name} while TRAORI is on is not corrected: write TRAFOOF before it")
        if channel.leans(axis):
            raise block.refuse(f"{name} while TRAORI is on {LEANS.format(axis=channel.modal.plane[2])}")
    if name not in CYCLES_AT_POSITION:
        channel.mark_unknown("XYZ")
        notes.add(f"{name}: the positions in its arguments stay as programmed and are not corrected", block.line)
        return
    notes.add(f"{name} runs from the corrected position; its arguments stay as programmed", block.line)
    if cycle.retraction is None:
        recorder.mark_unknown([axis])
    else:
        recorder.leave_at(index, axis, cycle.retraction * channel.modal.unit)


def check_tolerance_cycle(channel: Channel, block: Block, word: Word) -> None:
    """Refusal of CYCLE832, the tolerance of the path, in the older form, whose tens digit switches TRAORI."""
    given = word.arguments or ()
    try:
        mode = whole(given[1], channel.scope) if len(given) > 1 and given[1] != EMPTY else 0
    except NotKnown as reason:
        raise block.refuse(f"second argument of CYCLE832: {reason}") from None
    if mode in OLDER_MODE and mode // 10 % 10 != int(channel.modal.tcp):
        raise block.refuse(f"CYCLE832 with {mode} switches TRAORI by its tens digit: write TRAORI or TRAFOOF before it")
