"""Blocks that change what ISO coordinates mean, by their own words: G10, G43.1, G50 to G53.1, G68, G92."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from kinematics.machine import Control
from postproc.iso.codes import (
    BESIDE_PLACING,
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
from postproc.iso.datum_transformations import Said
from postproc.iso.frames import Frames
from postproc.iso.modes import Modes
from postproc.iso.offsets import NUMBERED, Shifts
from postproc.iso.words import DIFFERS, Content, Values
from postproc.motion.moves import AxisWord

WORDS = {PRESET: "S", SCALE_END: "S", DATA: "LPRIJQ"}
"""What may stand in a block beside N, G and axes; of turns see `MAKERS`."""
TURN_WORDS = "IJKRP"


class Placing(NamedTuple):
    """A block that changes what coordinates mean, and what it works on."""

    content: Content
    words: list[tuple[AxisWord, float]]
    """Its axis words, mm and degrees."""
    frames: Frames
    values: Values
    modes: Modes

    @property
    def family(self) -> str:
        """Whose reading counts where controls differ."""
        return self.frames.machine.control.family

    @property
    def shifts(self) -> dict[int, float]:
        """What its axis words say, by axis."""
        return {word.axis: value for word, value in self.words}


def place(
    content: Content,
    code: float,
    words: list[tuple[AxisWord, float]],
    frames: Frames,
    values: Values,
    modes: Modes,
) -> bool:
    """Take over the block; True where its axis words say what the places are called at which the axes stand."""
    beside = set(content.g) - BESIDE_PLACING - {code}
    if beside or content.m or content.other.keys() - {"N", *WORDS.get(code, TURN_WORDS if code in TURNS else "")}:
        raise content.refuse(
            f"G{code:g} does not go with the other words of its block: write them in a block before it"
        )
    if not modes.absolute and (words or code in TURNS):
        raise content.refuse(f"G{code:g} needs G90")
    placing = Placing(content, words, frames, values, modes)
    if code in TURNS:
        frames.turn(code, _said(placing))
        return False
    return bool(_MAKERS[code](placing))


def extended_offset(values: Values, content: Content, code: float) -> int | None:
    """The P that a work offset is chosen by, None for one that has a code of its own."""
    extended = "P" in content.other and code in (54.0, *EXTENDED)
    if code in EXTENDED and not extended:
        raise content.refuse(f"G{code:g} without P")
    if extended and not ONE_SHOT.isdisjoint(content.g):
        raise content.refuse("two G codes of the block can use P: write them in two blocks")
    return values.whole(content.block, content.other["P"]) if extended else None


def _said(placing: Placing) -> Said:
    """What a turn is said by; lengths in mm."""
    block, machine = placing.content.block, placing.frames.machine
    axes = {}
    for word, value in placing.words:
        if machine.names[word.axis] not in "XYZ":
            raise block.refuse(f"{machine.names[word.axis]} in a turn of the coordinates")
        axes[machine.names[word.axis]] = value
    others = {name: block.words[i].value or 0.0 for name, i in placing.content.other.items() if name != "N"}
    return Said(block, placing.modes.plane, axes, others)


def _shift(placing: Placing) -> None:
    if placing.frames.placed_by:
        raise placing.content.refuse("G52 while the coordinates are turned")
    placing.frames.shift_origin(placing.content.block, placing.shifts)


def _call(placing: Placing) -> bool:
    """G92 X: the place where the tool stands; G92 S: the fastest spindle."""
    if not placing.words and "S" not in placing.content.other:
        raise placing.content.refuse("G92 without an axis")
    if placing.words:
        placing.frames.call_here(placing.content.block, placing.shifts)
    return bool(placing.words)


def _uncall(placing: Placing) -> None:
    if placing.words and placing.family != "fanuc":
        raise placing.content.refuse(f"axis words beside G92.1: a move on LinuxCNC, not so on FANUC; {DIFFERS}")
    placing.frames.uncall(placing.content.block, placing.shifts or range(len(placing.frames.machine.axes)))


def _suspend(suspended: bool) -> Callable[[Placing], None]:
    def maker(placing: Placing) -> None:
        if placing.words:
            raise placing.content.refuse("axis words beside G92.2 or G92.3: a move on LinuxCNC")
        placing.frames.suspend(placing.content.block, suspended)

    return maker


def _unscale(placing: Placing) -> None:
    if placing.words:
        raise placing.content.refuse("G50 with axes: shifts the coordinates, on lathes")
    placing.frames.end_turn(SCALE)


def _unmirror(placing: Placing) -> None:
    names = placing.frames.machine.names
    placing.frames.end_mirror(placing.content.block, [names[axis] for axis in placing.shifts])


def _give_length(placing: Placing) -> None:
    """G43.1 of LinuxCNC: the length in the block."""
    if placing.family != "linuxcnc":
        raise placing.content.refuse(f"G43.1: a length on LinuxCNC, a move with another length on FANUC; {DIFFERS}")
    if [placing.frames.machine.names[word.axis] for word, _ in placing.words] != ["Z"]:
        raise placing.content.refuse("G43.1 without Z alone: a length along a tool that is turned, or sideways")
    before = placing.frames.state()
    placing.frames.lengths.give(placing.words[0][1])
    placing.frames.changed_since(before)


def _data(placing: Placing) -> bool:
    content, shifts, frames = placing.content, placing.shifts, placing.frames
    return bool(set_data(content, shifts, frames, placing.values, placing.modes.unit))


_MAKERS: dict[float, Callable[[Placing], bool | None]] = {
    DATA: _data,
    GIVEN_LENGTH: _give_length,
    LOCAL: _shift,
    UPRIGHT: lambda placing: placing.frames.stand_upright(placing.content.block),
    SCALE_END: _unscale,
    MIRROR_END: _unmirror,
    PRESET: _call,
    PRESET_END: _uncall,
    PRESET_OFF: _suspend(True),
    PRESET_ON: _suspend(False),
}


# ---- G10

WORK_OFFSET, WORK_OFFSET_HERE = 2, 20
GEOMETRY, WEAR = 10, 11
RADII = (12, 13)


def set_data(content: Content, shifts: Shifts, frames: Frames, values: Values, unit: float) -> tuple[int, ...]:
    """Take over what G10 sets; the axes whose place it says rather than their offset (LinuxCNC's L20).

    shifts: the axis words of the block. Refusal for what is not followed.
    """
    other, family = content.other, frames.machine.control.family
    if not {"L", "P"} <= other.keys():
        raise content.refuse("G10 without L and P")
    kind, number = values.whole(content.block, other["L"]), values.whole(content.block, other["P"])
    if kind == WORK_OFFSET or (kind == WORK_OFFSET_HERE and family == "fanuc"):
        _refuse_but(content, "LP" if family == "fanuc" else "LPR")
        turn = values.number(content.block, other["R"], 1.0) if "R" in other else None
        in_force = kind == WORK_OFFSET and number == 0 and family == "linuxcnc"
        name = frames.offsets.name if in_force else _name(content, kind, number)
        frames.enter_offset(content.block, name, shifts, turn)
    elif kind == WORK_OFFSET_HERE and family == "linuxcnc":
        _refuse_but(content, "LP")
        if number and NUMBERED.get(number) != frames.offsets.name:
            raise content.refuse("G10 L20 of a work offset that is not in force")
        frames.enter_here(content.block, shifts)
        return tuple(shifts)
    elif kind in (1, WORK_OFFSET_HERE, GEOMETRY, WEAR):
        _set_length(content, kind, number, frames, values, unit)
    elif kind not in RADII:
        raise content.refuse(f"G10 L{kind}: what it sets is not known")
    return ()


def _set_length(content: Content, kind: int, number: int, frames: Frames, values: Values, unit: float) -> None:
    control: Control = frames.machine.control
    lengths, block = frames.lengths, content.block
    if kind == 1 and content.axes and control.family != "fanuc":
        _refuse_but(content, "LPRIJQ")
        (index, *more) = content.axes
        if more or block.words[index].address != "Z":
            raise content.refuse("a tool offset sideways is not corrected")
        lengths.set(block, lengths.state.tools, number, values.number(block, index, unit))
    elif kind in (GEOMETRY, WEAR) and control.family == "fanuc" and "R" in content.other and not content.axes:
        _refuse_but(content, "LPR")
        store = lengths.state.tools if kind == GEOMETRY else lengths.state.wear
        lengths.set(block, store, number, values.number(block, content.other["R"], unit))
    else:
        raise content.refuse(f"G10 L{kind} reads differently on FANUC and LinuxCNC: {DIFFERS}")


def _name(content: Content, kind: int, number: int) -> str:
    if kind == WORK_OFFSET_HERE:
        return f"G54.1P{number}"
    if number not in NUMBERED:
        raise content.refuse(
            f"G10 L2 P{number}: the active offset on LinuxCNC, the common offset on FANUC, which is not corrected; "
            'write family = "linuxcnc" in the machine file'
            if number == 0
            else f"G10 L2 P{number}: which offset that is depends on the control"
        )
    return NUMBERED[number]


def _refuse_but(content: Content, allowed: str) -> None:
    strange = sorted(content.other.keys() - {"N", *allowed})
    if strange:
        raise content.refuse(f"{strange[0]} in G10: not followed")
