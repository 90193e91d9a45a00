"""Selection of work offsets, tools, tool lengths and kinematics in ISO programs: G54 and its kin, M6, G43, G12.1."""

from __future__ import annotations

from postproc.control.words import whole_of
from postproc.iso.channel import Channel
from postproc.iso.codes import EXTENDED, ONE_SHOT
from postproc.iso.families import AXIS_KINEMATICS, GRBL, LINUXCNC, SELECT_KINEMATICS
from postproc.iso.offsets import TCP_CODES
from postproc.iso.words import Content

NO_TOOL = "the tool in the spindle, which is taken to be empty before the first tool change"


def change_tool(channel: Channel, content: Content) -> None:
    """M6."""
    hold_tool(channel, channel.modal.lengths.selected_tool)
    channel.move_for_tool_change(content.block)


def hold_tool(channel: Channel, number: int) -> None:
    """Another tool is in the spindle; the axes do not move."""
    modal = channel.modal
    modal.lengths.spindle_tool = number
    by_spindle_tool = (modal.tcp or modal.tilted) and modal.lengths.offset() is None
    channel.change_frame(channel.x_y_z if by_spindle_tool else ())


def select_offset(channel: Channel, content: Content, code: float) -> None:
    """G54 and its kin, G54.1 P. LinuxCNC keeps G52 and G92, which are one store there, in every offset."""
    extended, modal = _extended_offset(content, code), channel.modal
    if modal.placement_code or (modal.offsets.moved and channel.family not in (LINUXCNC, GRBL)):
        raise content.refuse(
            "the effect of a new work offset on an active G52, G92, rotation, mirror or scale depends on the "
            "control: end these before it"
        )
    modal.offsets.select(code, extended)


def _extended_offset(content: Content, code: float) -> int | None:
    """The P that a work offset is chosen by, None for one that has a code of its own."""
    extended = "P" in content.other and code in (54.0, *EXTENDED)
    if code in EXTENDED and not extended:
        raise content.refuse(f"G{code:g} needs P, the number of the work offset: write it")
    if extended and not ONE_SHOT.isdisjoint(content.g):
        raise content.refuse("two G codes of the block can use P: write them in two blocks")
    return whole_of(content.block, content.block.words[content.other["P"]]) if extended else None


def select_length(channel: Channel, content: Content, code: float) -> None:
    """G43, G43.4, G43.5, G49."""
    modal, block, linuxcnc = channel.modal, content.block, channel.family == "linuxcnc"
    lengths = modal.lengths
    number = whole_of(block, block.words[content.other["H"]]) if "H" in content.other else None
    if code in TCP_CODES and (modal.placement_code or modal.offsets.turn):
        raise block.refuse(
            f"G{code:g} while the coordinates are rotated, mirrored or scaled is not corrected: end this before it"
        )
    given = "H0" if number == 0 and linuxcnc and not lengths.with_tool_0 else ""
    by_spindle = code != 49.0 and (number is None or bool(given))
    if by_spindle and lengths.select_spindle(block, linuxcnc, given):
        tool = "the tool in the spindle" if lengths.spindle_tool is not None else NO_TOOL
        channel.notes.add(f"G43 {given or 'without H'} is taken to select the length of {tool}", block.line)
    lengths.select(code, None if by_spindle else number)
    modal.tcp = code in TCP_CODES or modal.kinematics_tcp
    if code in TCP_CODES:
        channel.note_tcp(f"G{code:g}", block)


def give_length(channel: Channel, length: float) -> None:
    """G43.1: a length given in the program, mm."""
    before = channel.modal.in_force
    channel.modal.lengths.give(length)
    channel.modal.tcp = channel.modal.kinematics_tcp
    channel.changed_since(before)


def select_kinematics(channel: Channel, content: Content, code: float) -> None:
    """G12.1 P, G13.1 of LinuxCNC 2.10: one of the kinematics that `kinematics_types` of the machine file names."""
    kinds = channel.machine.control.kinematics_types
    if not kinds:
        raise content.refuse(
            f"G{code:g} selects a kinematics of LinuxCNC, and the machine file does not name it: write "
            'kinematics_types = ["tool-point", "axes"] under [control], with the kinds in the order of their numbers'
        )
    number = kinds.index("axes") if code == AXIS_KINEMATICS and "axes" in kinds else 0
    if code == SELECT_KINEMATICS:
        if "P" not in content.other:
            raise content.refuse("G12.1 needs P, the number of the kinematics: write it")
        number = whole_of(content.block, content.block.words[content.other["P"]])
    if not 0 <= number < len(kinds):
        raise content.refuse(f"the machine file names no kinematics {number} (kinematics_types): correct P or the file")
    if channel.modal.placement_code or channel.modal.offsets.turn:
        raise content.refuse(
            "another kinematics while the coordinates are rotated is not corrected: write G69 before it"
        )
    channel.modal.kinematics_tcp = kinds[number] == "tool-point"
    channel.switch_tcp(channel.modal.kinematics_tcp)
    if channel.modal.tcp:
        channel.note_tcp(f"G12.1 P{number}", content.block)
