"""Canned cycles of ISO programs: where they begin and end, and the moves to their holes."""

from __future__ import annotations

from postproc.control.channel import LEANS, AxisWords
from postproc.control.words import whole_of
from postproc.iso.arcs import end_words, go_polar
from postproc.iso.channel import Channel
from postproc.iso.cycles import CannedCycle, check_cycle_words
from postproc.iso.words import Content, sort_words
from postproc.motion.moves import Kind
from postproc.text.block import Block
from postproc.text.blocks import PlainRun

MOST_HOLES = 9999
HOLES_AT_ONCE = 1000
"""Lines, at most, in which holes are looked for together: a line with a depth ends them."""


def begin_cycle(channel: Channel, block: Block, code: float) -> None:
    """G81 and the other cycles; a cycle within another one takes its level."""
    modal = channel.modal
    if modal.compensated:
        raise block.refuse("a canned cycle under radius compensation is not corrected: write G40 before it")
    axis, begun = modal.plane_columns[2], modal.cycle
    if begun is None:
        modal.motion_before_cycle = modal.motion
    if begun is not None and begun.axis != axis:
        raise block.refuse("a change of the plane within a canned cycle is not corrected: write G80 before it")
    # the level before the first of several cycles is that of all
    level = channel.recorder.position[axis] if begun is None else begun.level
    known = channel.recorder.known[axis] if begun is None else begun.known
    counted, unit = not modal.absolute, modal.unit
    frame = channel.recorder.frame if begun is None else begun.frame
    drilled = begun is not None and begun.begun
    modal.cycle = CannedCycle(axis, counted, level, known, unit, frame, begun=drilled)
    alike = begun is not None and (begun.incremental, begun.unit) == (counted, unit)
    # another cycle without depth or R takes those of the one before; LinuxCNC refuses it
    if begun is not None and alike and (code == modal.motion or channel.family != "linuxcnc"):
        modal.cycle.retract, modal.cycle.depth = begun.retract, begun.depth
    modal.motion = code
    if axis != channel.x_y_z[2]:
        name = modal.plane[2]
        channel.notes.add(f"a canned cycle outside of G17 is taken to drill along {name}", block.line)


def end_cycle(channel: Channel) -> None:
    """G80. The motion from before holds again, or the next one needs a code: LinuxCNC refuses it without."""
    modal = channel.modal
    if modal.cycle is not None:
        holds = modal.motion_before_cycle in (0.0, 1.0) and channel.family != "linuxcnc"
        modal.motion, modal.cycle = modal.motion_before_cycle if holds else None, None


def drill(channel: Channel, index: int, content: Content, cycle: CannedCycle) -> None:
    """Record the holes of a block with coordinates in the cycle in force."""
    modal = channel.modal
    block = content.block
    rotary = any(channel.rotary[channel.recorder.axis(block, block.words[i].address)] for i in content.axes)
    check_cycle_words(content, rotary)
    _check_cycle_frame(channel, content, cycle)
    times = [whole_of(block, block.words[content.other[letter]]) for letter in "KL" if letter in content.other]
    if len(times) > 1 or any(not 0 <= n <= MOST_HOLES for n in times):
        raise content.refuse(f"a canned cycle takes one of K and L, from 0 to {MOST_HOLES}: write one of them")
    if "F" in content.other and block.words[content.other["F"]].value == 0.0:
        if channel.family == "linuxcnc":
            raise content.refuse("LinuxCNC refuses F0 in a canned cycle: write a feed")
        channel.notes.add("F0 in a canned cycle: some controls stop, and LinuxCNC refuses it", block.line)
    words, polar = end_words(channel, content)
    i = content.other.get("R")
    retract = None if i is None else (i, channel.number(block, i, modal.unit))
    if modal.not_programmed:
        channel.note_not_programmed(block.line, Kind.CYCLE)
    if times == [0]:
        _check_stored(channel, content, cycle, words)
        cycle.store(words, retract)
        return
    switched = cycle.incremental == modal.absolute
    # of several holes at one position only the first changes anything
    for _ in range(times[0] if times and not modal.absolute else 1):
        returns = _returns(channel, cycle)
        hole = cycle.hole(block, channel.recorder, words, retract, returns, channel.family, switched=switched)
        if polar is not None:
            go_polar(channel, hole.target, polar)
        channel.recorder.drill(index, hole.target, hole.level, modal.unit, hole.positions, hole.cycle)


def drill_lines(channel: Channel, index: int, run: PlainRun) -> int:
    """Record the first lines of a run, which give nothing but positions, as holes of the cycle in force; their number.

    None are recorded in a state in which they do not follow from their positions alone.
    """
    modal, recorder, cycle = channel.modal, channel.recorder, channel.modal.cycle
    special = modal.compensated or modal.cornered or modal.tilted or modal.polar is not None or modal.not_programmed
    if cycle is None or special or modal.ended or not cycle.begun or cycle.incremental or recorder.start.at:
        return 0
    run = run.part(0, min(len(run), HOLES_AT_ONCE))
    positions = [axis for axis, rotary in enumerate(channel.rotary) if not rotary and axis != cycle.axis]
    others = [i for i in range(len(run.lines.addresses)) if i not in positions]
    singly = (run.columns.end[others] > 0).any(axis=0) | (run.columns.motion >= 0) | (run.feeds == 0.0)
    lines = int(singly.argmax()) if singly.any() else len(run)
    if not lines or run.incremental or not recorder.rotary.plain or not channel.control_state.uses(recorder.frame):
        return 0
    part, block = run.part(0, lines), run.block(0)
    _check_cycle_frame(channel, sort_words(block), cycle)
    name = recorder.machine.names[cycle.axis]
    hole = cycle.in_force(block, name, _returns(channel, cycle), channel.family)
    recorder.drill_lines(index, part, recorder.plain_moves(part, modal.unit), hole, modal.unit)
    return lines


def _returns(channel: Channel, cycle: CannedCycle) -> bool | None:
    """End position of a hole, as `to_retract`; None if the level before the cycle belongs to another frame.

    There LinuxCNC returns to its number, and others to its position.
    """
    moved = channel.recorder.frame != cycle.frame and channel.family != "linuxcnc"
    return None if moved and not channel.modal.to_retract else channel.modal.to_retract


def _check_stored(channel: Channel, content: Content, cycle: CannedCycle, words: AxisWords) -> None:
    """K0 and L0 set the depth and R of the holes that come; LinuxCNC refuses them."""
    elsewhere = any(word.axis != cycle.axis for word, _ in words)
    if channel.family == "linuxcnc" or cycle.incremental or elsewhere:
        raise content.refuse(
            "the effect of K0 or L0 in this canned cycle depends on the control: write the cycle in the block of "
            "its first hole"
        )


def _check_cycle_frame(channel: Channel, content: Content, cycle: CannedCycle) -> None:
    modal = channel.modal
    if cycle.unit != modal.unit:
        raise content.refuse(
            "G20 or G21 within a canned cycle: some controls read its depth in the new unit. Write G80 before it"
        )
    if cycle.incremental == modal.absolute:
        _check_switched(channel, content, cycle)
    if cycle.axis != modal.plane_columns[2]:
        raise content.refuse("a change of the plane within a canned cycle is not corrected: write G80 before it")
    if not modal.tilted and channel.leans(cycle.axis):
        raise content.refuse(f"a canned cycle under TCP {LEANS.format(axis=modal.plane[2])}")
    if modal.scaled_along(cycle.axis):
        raise content.refuse(
            "controls differ in canned cycles with a scaled or mirrored depth: end the scale or mirror before it"
        )


def _check_switched(channel: Channel, content: Content, cycle: CannedCycle) -> None:
    """FANUC keeps the programmed positions of depth and R; LinuxCNC interprets their numbers again."""
    modal = channel.modal
    if channel.family != "fanuc":
        raise content.refuse(
            "G90 or G91 within a canned cycle: controls differ in the meaning of its depth; "
            'write family = "fanuc" in the machine file if the depth stays'
        )
    depth = any(content.block.words[i].address == modal.plane[2] for i in content.axes)
    if depth and "R" in content.other:
        cycle.incremental = not modal.absolute
    elif depth or "R" in content.other:
        raise content.refuse(
            "G90 or G91 changed within the cycle, and the block has only one of depth and R: write both"
        )
    if modal.polar is not None:
        raise content.refuse(
            "G90 or G91 within a canned cycle in polar coordinates is not corrected: write G15 before it"
        )
