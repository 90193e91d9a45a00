"""G10: what it sets, by its words; forms that controls read in different ways ask for `family` in the machine file."""

from __future__ import annotations

from kinematics.machine import Control
from postproc.iso.frames import Frames
from postproc.iso.values import Values
from postproc.iso.words import Content
from postproc.iso.work_offsets import NUMBERED, Shifts

WORK_OFFSET, WORK_OFFSET_HERE = 2, 20
GEOMETRY, WEAR = 10, 11
RADII = (12, 13)
DIFFERS = 'reads differently on FANUC and LinuxCNC: write family = "fanuc" or "linuxcnc" in the machine file'


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
        raise content.refuse(f"G10 L{kind} {DIFFERS}")


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
