"""Blocks that change the meaning of ISO coordinates by their own words: G10, G43.1, G50 to G53.1, G68, G92."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

from postproc.control.channel import AxisWords
from postproc.control.words import whole_of
from postproc.iso.channel import Channel
from postproc.iso.codes import (
    BESIDE_COORDINATE_CHANGES,
    DATA,
    GIVEN_LENGTH,
    LOCAL,
    MIRROR_END,
    PRESET,
    PRESET_END,
    PRESET_OFF,
    PRESET_ON,
    SCALE,
    SCALE_END,
    TURNS,
    UPRIGHT,
)
from postproc.iso.datum_transformations import Programmed, check_perpendicular, end_mirror, end_turn, turn
from postproc.iso.families import ANY, GRBL, LINUXCNC
from postproc.iso.offsets import NUMBERED
from postproc.iso.selection import give_length
from postproc.iso.words import Content, decided_by_family
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.moves import Known

WORDS = {PRESET: "S", SCALE_END: "S", DATA: "LPRIJQ"}
"""Words that may be in such a block besides N, G and axes; for rotations see `MAKERS`."""
TURN_WORDS = "IJKRP"


class CoordinateChange(NamedTuple):
    """A block that changes the meaning of coordinates, with the state that it changes."""

    content: Content
    words: AxisWords
    """Its axis words, mm and degrees."""
    channel: Channel

    @property
    def shifts(self) -> dict[int, float]:
        """The values of its axis words, by axis."""
        return {word.axis: value for word, value in self.words}

    def whole(self, address: str) -> int:
        """The whole number of a word."""
        return whole_of(self.content.block, self.content.block.words[self.content.other[address]])

    def present_positions(self) -> dict[int, float]:
        """The present positions of its axes, by axis; Refusal where the program has not given them in this frame."""
        modal, recorder = self.channel.modal, self.channel.recorder
        if modal.placement_code or modal.tcp or modal.offsets.turn:
            raise self.content.refuse(
                "a preset of the present position (G92, G10 L20) is not corrected while the coordinates "
                "or the table are rotated: write it before the rotation"
            )
        for axis in self.shifts:
            if recorder.known[axis] != Known.PROGRAM and axis not in recorder.start.at:
                name = self.channel.machine.names[axis]
                raise self.content.refuse(
                    f"the preset of {name} needs a programmed position: write a move of {name} in this frame before it"
                )
        recorder.start.leave(())
        return {axis: recorder.position[axis] for axis in self.shifts}


def change_coordinates(channel: Channel, content: Content, code: float, words: AxisWords) -> bool:
    """Take over the block; True where its axis words are the new coordinates of the present positions."""
    beside = set(content.g) - BESIDE_COORDINATE_CHANGES - {code}
    if beside or content.m or content.other.keys() - {"N", *WORDS.get(code, TURN_WORDS if code in TURNS else "")}:
        raise content.refuse(
            f"G{code:g} cannot share a block with the other words of this one: write them in a block before it"
        )
    if not channel.modal.absolute and (words or code in TURNS):
        raise content.refuse(f"G{code:g} needs G90: write G90 before it")
    change = CoordinateChange(content, words, channel)
    if code in TURNS:
        turn(channel, code, _programmed(change))
        return False
    return bool(_MAKERS[code](change))


def _programmed(change: CoordinateChange) -> Programmed:
    """The words of a rotation, mirror or scale; lengths in mm."""
    block, machine = change.content.block, change.channel.machine
    axes = {}
    for word, value in change.words:
        if machine.names[word.axis] not in "XYZ":
            raise block.refuse(
                f"{machine.names[word.axis]} in a block that rotates, mirrors or scales the coordinates is not "
                "corrected: write X, Y and Z only"
            )
        axes[machine.names[word.axis]] = value
    others = {name: block.words[i].value or 0.0 for name, i in change.content.other.items() if name != "N"}
    return Programmed(block, change.channel.modal.plane, axes, others)


def _shift(change: CoordinateChange) -> None:
    """G52."""
    offsets = change.channel.modal.offsets
    if change.channel.modal.placement_code:
        raise change.content.refuse(
            "G52 while the coordinates are rotated, mirrored or scaled is not corrected: write G52 before that"
        )
    if offsets.preset and any(offsets.preset.values()):
        raise change.content.refuse(
            "G52 and G92 share one offset on some controls, not on others: cancel G92 before G52"
        )
    offsets.local.update(change.shifts)
    change.channel.change_frame(change.shifts)


def _preset(change: CoordinateChange) -> bool:
    """G92 X: the coordinate of the present position; G92 S: the fastest spindle."""
    if not change.words:
        if "S" not in change.content.other:
            raise change.content.refuse("G92 needs an axis word: write the new coordinates")
        return False
    change.channel.modal.offsets.preset_at(change.content.block, change.present_positions(), change.shifts)
    change.channel.change_frame(())
    return True


def _cancel_preset(change: CoordinateChange) -> None:
    """G92.1."""
    if change.words and change.channel.family != "fanuc":
        raise decided_by_family(
            change.content,
            change.channel.family,
            "axis words with G92.1 are a move on LinuxCNC and not on FANUC",
            linuxcnc="axis words with G92.1 are a move on LinuxCNC: write the move in a block of its own",
        )
    cancel_preset(change.channel, change.content, change.shifts or range(len(change.channel.machine.axes)))


def cancel_preset(channel: Channel, content: Content, axes: Iterable[int]) -> None:
    """G92.1 of these axes."""
    modal = channel.modal
    if modal.placement_code and modal.offsets.moved:
        raise content.refuse(
            "G92.1 while the coordinates are rotated, mirrored or scaled is not corrected: write it before that"
        )
    modal.offsets.cancel_preset(axes)
    channel.change_shifted(axes)


def _suspend(change: CoordinateChange, suspended: bool) -> None:
    """G92.2, G92.3."""
    if change.words:
        raise change.content.refuse(
            "axis words with G92.2 or G92.3 are a move on LinuxCNC: write the move in a block of its own"
        )
    offsets = change.channel.modal.offsets
    offsets.suspend(change.content.block, suspended)
    change.channel.change_shifted(offsets.preset or {})


def _unscale(change: CoordinateChange) -> None:
    if change.words:
        raise change.content.refuse(
            "G50 with axis words shifts the coordinates on lathes and is not corrected: write G50 alone to end a scale"
        )
    end_turn(change.channel, SCALE)


def _unmirror(change: CoordinateChange) -> None:
    names = change.channel.machine.names
    end_mirror(change.channel, change.content.block, [names[axis] for axis in change.shifts])


def _give_length(change: CoordinateChange) -> None:
    """G43.1 of LinuxCNC: the length in the block."""
    if change.channel.family not in (LINUXCNC, GRBL):
        raise decided_by_family(
            change.content,
            change.channel.family,
            "G43.1 sets a length on LinuxCNC and moves with another length on FANUC",
            fanuc="G43.1 of FANUC moves along the tool axis, which is not corrected: write G43 or G43.4",
        )
    if [change.channel.machine.names[word.axis] for word, _ in change.words] != ["Z"]:
        raise change.content.refuse("G43.1 is corrected with a length along Z only: write Z as its only axis word")
    give_length(change.channel, change.words[0][1])


_MAKERS: dict[float, Callable[[CoordinateChange], bool | None]] = {
    DATA: lambda change: bool(set_data(change)),
    GIVEN_LENGTH: _give_length,
    LOCAL: _shift,
    UPRIGHT: lambda change: check_perpendicular(change.channel, change.content.block),
    SCALE_END: _unscale,
    MIRROR_END: _unmirror,
    PRESET: _preset,
    PRESET_END: _cancel_preset,
    PRESET_OFF: lambda change: _suspend(change, True),
    PRESET_ON: lambda change: _suspend(change, False),
}


# ---- G10

WORK_OFFSET, WORK_OFFSET_HERE = 2, 20
GEOMETRY, WEAR = 10, 11
RADII = (12, 13)


def set_data(change: CoordinateChange) -> tuple[int, ...]:
    """Set the data of G10; the axes of which it gives the position and not the offset (LinuxCNC's L20).

    Refusal for other data.
    """
    content, shifts, channel = change.content, change.shifts, change.channel
    block, other, family = content.block, content.other, channel.family
    if not {"L", "P"} <= other.keys():
        raise content.refuse("G10 needs L and P, the kind and the number of the data: write both")
    kind, number = change.whole("L"), change.whole("P")
    if kind == WORK_OFFSET or (kind == WORK_OFFSET_HERE and family == "fanuc"):
        _refuse_but(content, "LP" if family == "fanuc" else "LPR")
        degrees = channel.number(block, other["R"], 1.0) if "R" in other else None
        in_force = kind == WORK_OFFSET and number == 0 and family in (LINUXCNC, GRBL)
        name = channel.modal.offsets.name if in_force else _name(content, kind, number)
        _enter_offset(change, name, degrees)
    elif kind == WORK_OFFSET_HERE and (family in (LINUXCNC, GRBL) or (family == ANY and number == 0)):
        _refuse_but(content, "LP")
        if number and NUMBERED.get(number) != channel.modal.offsets.name:
            raise content.refuse(
                "G10 L20 is corrected for the work offset in force only: select its work offset before"
            )
        _enter_here(change)
        return tuple(shifts)
    elif kind == WORK_OFFSET_HERE and family == ANY and _sets_what_is(change, number):
        _enter_offset(change, f"G54.1P{number}", None)
    elif kind in (1, WORK_OFFSET_HERE, GEOMETRY, WEAR):
        _set_length(change, kind, number)
    elif kind not in RADII:
        raise content.refuse(f"G10 L{kind}: this kind of data is not known to ncomp: set it on the control")
    return ()


def _enter_offset(change: CoordinateChange, name: str, degrees: float | None) -> None:
    """G10 L2: a work offset of the table, and by how many degrees it turns X and Y."""
    channel, offsets, shifts = change.channel, change.channel.modal.offsets, change.shifts
    if channel.modal.placement_code and name == offsets.name:
        raise change.content.refuse(
            "G10 changes the active work offset while the coordinates are rotated: write it before the rotation"
        )
    if degrees is not None and name == offsets.name and degrees != offsets.turn and offsets.moved:
        raise change.content.refuse(
            "LinuxCNC loses the positions of X and Y when G10 rotates the active work offset under G52 or G92: end "
            "G52 or G92 before it"
        )
    offsets.enter(name, shifts)
    channel.notes.add(f"{name} has the values that G10 sets", change.content.block.line)
    changed = set(shifts)
    if degrees is not None:
        offsets.turned[name] = degrees
        changed.update(channel.x_y_z[:2])
    if name == offsets.name:
        channel.change_frame(changed)


def _enter_here(change: CoordinateChange) -> None:
    """G10 L20 of LinuxCNC: the active work offset that gives the present positions these coordinates."""
    offsets, here = change.channel.modal.offsets, change.present_positions()
    work = offsets.work()
    offsets.enter(offsets.name, {axis: work[axis] + here[axis] - value for axis, value in change.shifts.items()})
    change.channel.change_frame(())


def _sets_what_is(change: CoordinateChange, number: int) -> bool:
    """True where LinuxCNC's G10 L20 gives the declared start the coordinates that it has: FANUC sets G54.1 only."""
    recorder, offsets = change.channel.recorder, change.channel.modal.offsets
    same = (abs(recorder.start.at.get(axis, math.inf) - value) < SAME_POINT_MM for axis, value in change.shifts.items())
    return NUMBERED.get(number) == offsets.name and not offsets.moved and all(same)


def _set_length(change: CoordinateChange, kind: int, number: int) -> None:
    content, channel = change.content, change.channel
    lengths, block, state = channel.modal.lengths, content.block, channel.control_state
    if kind == 1 and content.axes and channel.family != "fanuc":
        _refuse_but(content, "LPRIJQ")
        (index, *more) = content.axes
        if more or block.words[index].address != "Z":
            raise content.refuse("a tool offset along X or Y is not corrected: write Z alone")
        lengths.set(block, state.tools, number, channel.number(block, index, channel.modal.unit))
    elif kind in (GEOMETRY, WEAR) and channel.family == "fanuc" and "R" in content.other and not content.axes:
        _refuse_but(content, "LPR")
        store = state.tools if kind == GEOMETRY else state.wear
        lengths.set(block, store, number, channel.number(block, content.other["R"], channel.modal.unit))
    else:
        raise decided_by_family(
            content,
            channel.family,
            f"G10 L{kind} sets different data on FANUC and on LinuxCNC",
            fanuc=f"G10 L{kind} in this form is not followed for FANUC: write G10 L10 or L11 with P and R",
            linuxcnc=f"G10 L{kind} of LinuxCNC sets a length from the present position, which is not followed: write "
            "G10 L1 with P and Z",
        )


def _name(content: Content, kind: int, number: int) -> str:
    if kind == WORK_OFFSET_HERE:
        return f"G54.1P{number}"
    if number not in NUMBERED:
        raise content.refuse(
            f"G10 L2 P{number} sets the active offset on LinuxCNC and the common one, not corrected, on FANUC: "
            'write family = "linuxcnc" in the machine file'
            if number == 0
            else f"the work offset of G10 L2 P{number} depends on the control: write P from 1 to 9"
        )
    return NUMBERED[number]


def _refuse_but(content: Content, allowed: str) -> None:
    strange = sorted(content.other.keys() - {"N", *allowed})
    if strange:
        raise content.refuse(f"{strange[0]} in a G10 block is not corrected: leave it out")
