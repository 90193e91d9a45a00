"""Blocks that change the meaning of ISO coordinates by their own words: G10, G43.1, G50 to G53.1, G68, G92."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from postproc.control.interpreter import AxisWords
from postproc.control.words import whole_of
from postproc.iso.codes import (
    BESIDE_COORDINATE_CHANGES,
    DATA,
    EXTENDED,
    GIVEN_LENGTH,
    LOCAL,
    MIRROR_END,
    ONE_SHOT,
    PRESET,
    PRESET_END,
    PRESET_OFF,
    PRESET_ON,
    SCALE,
    SCALE_END,
    TURNS,
    UPRIGHT,
)
from postproc.iso.datum_transformations import Programmed
from postproc.iso.modal_state import ModalState
from postproc.iso.offsets import NUMBERED
from postproc.iso.words import DIFFERS, Content

WORDS = {PRESET: "S", SCALE_END: "S", DATA: "LPRIJQ"}
"""Words that may be in such a block besides N, G and axes; for rotations see `MAKERS`."""
TURN_WORDS = "IJKRP"


class CoordinateChange(NamedTuple):
    """A block that changes the meaning of coordinates, with the state that it changes."""

    content: Content
    words: AxisWords
    """Its axis words, mm and degrees."""
    control: ModalState

    @property
    def shifts(self) -> dict[int, float]:
        """The values of its axis words, by axis."""
        return {word.axis: value for word, value in self.words}

    def whole(self, address: str) -> int:
        """The whole number of a word."""
        return whole_of(self.content.block, self.content.block.words[self.content.other[address]])


def change_coordinates(control: ModalState, content: Content, code: float, words: AxisWords) -> bool:
    """Take over the block; True where its axis words are the new coordinates of the present positions."""
    beside = set(content.g) - BESIDE_COORDINATE_CHANGES - {code}
    if beside or content.m or content.other.keys() - {"N", *WORDS.get(code, TURN_WORDS if code in TURNS else "")}:
        raise content.refuse(
            f"G{code:g} cannot share a block with the other words of this one: write them in a block before it"
        )
    if not control.absolute and (words or code in TURNS):
        raise content.refuse(f"G{code:g} needs G90: write G90 before it")
    change = CoordinateChange(content, words, control)
    if code in TURNS:
        control.turn(code, _programmed(change))
        return False
    return bool(_MAKERS[code](change))


def extended_offset(content: Content, code: float) -> int | None:
    """The P that a work offset is chosen by, None for one that has a code of its own."""
    extended = "P" in content.other and code in (54.0, *EXTENDED)
    if code in EXTENDED and not extended:
        raise content.refuse(f"G{code:g} needs P, the number of the work offset: write it")
    if extended and not ONE_SHOT.isdisjoint(content.g):
        raise content.refuse("two G codes of the block can use P: write them in two blocks")
    return whole_of(content.block, content.block.words[content.other["P"]]) if extended else None


def _programmed(change: CoordinateChange) -> Programmed:
    """The words of a rotation, mirror or scale; lengths in mm."""
    block, machine = change.content.block, change.control.machine
    axes = {}
    for word, value in change.words:
        if machine.names[word.axis] not in "XYZ":
            raise block.refuse(
                f"{machine.names[word.axis]} in a block that rotates, mirrors or scales the coordinates is not "
                "corrected: write X, Y and Z only"
            )
        axes[machine.names[word.axis]] = value
    others = {name: block.words[i].value or 0.0 for name, i in change.content.other.items() if name != "N"}
    return Programmed(block, change.control.plane, axes, others)


def _shift(change: CoordinateChange) -> None:
    if change.control.placement_code:
        raise change.content.refuse(
            "G52 while the coordinates are rotated, mirrored or scaled is not corrected: write G52 before that"
        )
    change.control.shift_origin(change.content.block, change.shifts)


def _preset(change: CoordinateChange) -> bool:
    """G92 X: the coordinate of the present position; G92 S: the fastest spindle."""
    if not change.words and "S" not in change.content.other:
        raise change.content.refuse("G92 needs an axis word: write the new coordinates")
    if change.words:
        change.control.preset_here(change.content.block, change.shifts)
    return bool(change.words)


def _cancel_preset(change: CoordinateChange) -> None:
    if change.words and change.control.family != "fanuc":
        raise change.content.refuse(f"axis words with G92.1 are a move on LinuxCNC and not on FANUC; {DIFFERS}")
    change.control.cancel_preset(change.content.block, change.shifts or range(len(change.control.machine.axes)))


def _suspend(suspended: bool) -> Callable[[CoordinateChange], None]:
    def maker(change: CoordinateChange) -> None:
        if change.words:
            raise change.content.refuse(
                "axis words with G92.2 or G92.3 are a move on LinuxCNC: write the move in a block of its own"
            )
        change.control.suspend(change.content.block, suspended)

    return maker


def _unscale(change: CoordinateChange) -> None:
    if change.words:
        raise change.content.refuse(
            "G50 with axis words shifts the coordinates on lathes and is not corrected: write G50 alone to end a scale"
        )
    change.control.end_turn(SCALE)


def _unmirror(change: CoordinateChange) -> None:
    names = change.control.machine.names
    change.control.end_mirror(change.content.block, [names[axis] for axis in change.shifts])


def _give_length(change: CoordinateChange) -> None:
    """G43.1 of LinuxCNC: the length in the block."""
    if change.control.family != "linuxcnc":
        raise change.content.refuse(
            f"G43.1 sets a length on LinuxCNC and moves with another length on FANUC; {DIFFERS}"
        )
    if [change.control.machine.names[word.axis] for word, _ in change.words] != ["Z"]:
        raise change.content.refuse("G43.1 is corrected with a length along Z only: write Z as its only axis word")
    change.control.give_length(change.words[0][1])


_MAKERS: dict[float, Callable[[CoordinateChange], bool | None]] = {
    DATA: lambda change: bool(set_data(change)),
    GIVEN_LENGTH: _give_length,
    LOCAL: _shift,
    UPRIGHT: lambda change: change.control.check_perpendicular(change.content.block),
    SCALE_END: _unscale,
    MIRROR_END: _unmirror,
    PRESET: _preset,
    PRESET_END: _cancel_preset,
    PRESET_OFF: _suspend(True),
    PRESET_ON: _suspend(False),
}


# ---- G10

WORK_OFFSET, WORK_OFFSET_HERE = 2, 20
GEOMETRY, WEAR = 10, 11
RADII = (12, 13)


def set_data(change: CoordinateChange) -> tuple[int, ...]:
    """Set the data of G10; the axes of which it gives the position and not the offset (LinuxCNC's L20).

    Refusal for other data.
    """
    content, shifts, control = change.content, change.shifts, change.control
    block, other, family = content.block, content.other, control.family
    if not {"L", "P"} <= other.keys():
        raise content.refuse("G10 needs L and P, the kind and the number of the data: write both")
    kind, number = change.whole("L"), change.whole("P")
    if kind == WORK_OFFSET or (kind == WORK_OFFSET_HERE and family == "fanuc"):
        _refuse_but(content, "LP" if family == "fanuc" else "LPR")
        turn = control.number(block, other["R"], 1.0) if "R" in other else None
        in_force = kind == WORK_OFFSET and number == 0 and family == "linuxcnc"
        name = control.offsets.name if in_force else _name(content, kind, number)
        control.enter_offset(block, name, shifts, turn)
    elif kind == WORK_OFFSET_HERE and family == "linuxcnc":
        _refuse_but(content, "LP")
        if number and NUMBERED.get(number) != control.offsets.name:
            raise content.refuse(
                "G10 L20 is corrected for the work offset in force only: select its work offset before"
            )
        control.enter_here(block, shifts)
        return tuple(shifts)
    elif kind in (1, WORK_OFFSET_HERE, GEOMETRY, WEAR):
        _set_length(change, kind, number)
    elif kind not in RADII:
        raise content.refuse(f"G10 L{kind}: this kind of data is not known to ncomp: set it on the control")
    return ()


def _set_length(change: CoordinateChange, kind: int, number: int) -> None:
    content, control = change.content, change.control
    lengths, block, state = control.lengths, content.block, control.control_state
    if kind == 1 and content.axes and control.family != "fanuc":
        _refuse_but(content, "LPRIJQ")
        (index, *more) = content.axes
        if more or block.words[index].address != "Z":
            raise content.refuse("a tool offset along X or Y is not corrected: write Z alone")
        lengths.set(block, state.tools, number, control.number(block, index, control.unit))
    elif kind in (GEOMETRY, WEAR) and control.family == "fanuc" and "R" in content.other and not content.axes:
        _refuse_but(content, "LPR")
        store = state.tools if kind == GEOMETRY else state.wear
        lengths.set(block, store, number, control.number(block, content.other["R"], control.unit))
    else:
        raise content.refuse(f"G10 L{kind} sets different data on FANUC and on LinuxCNC: {DIFFERS}")


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
