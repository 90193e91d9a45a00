"""Tools and cutting edges of Siemens programs: T, M6 and D."""

from __future__ import annotations

from postproc.control.codes import TOOL_CHANGE
from postproc.control.words import whole_of
from postproc.siemens.channel import Channel
from postproc.siemens.control_data import edge_key
from postproc.siemens.words import Content
from postproc.text.block import Block


def take_functions(channel: Channel, block: Block, content: Content) -> None:
    """The M functions of a block, its tool and its edge."""
    modal = channel.modal
    before = modal.spindle_tool, modal.edge, modal.length
    if "T" in content.other:
        word = block.words[content.other["T"]]
        modal.selected_tool = word.mode or whole_of(block, word)
    for code in content.m:
        channel.take_function(block, code)
        if code == TOOL_CHANGE:
            modal.spindle_tool = modal.selected_tool
            channel.move_for_tool_change(block)
    if "D" in content.other:
        modal.edge = whole_of(block, block.words[content.other["D"]])
    if "D" in content.other or TOOL_CHANGE in content.m:
        modal.length = _tool_length(channel, block)
    if (modal.spindle_tool, modal.edge, modal.length) != before:
        _note_edge(channel, block)
        channel.change_frame(channel.x_y_z if channel.recorder.frame.tcp else channel.x_y_z[2:])


def _tool_length(channel: Channel, block: Block) -> float:
    """The length of the edge in force, mm, whose name in the set-up becomes `length_key`."""
    modal, state, data = channel.modal, channel.control_state, channel.scope.data
    modal.length_key = ""
    if not modal.edge or not modal.spindle_tool:
        return 0.0
    state.tools.update(data.tools())
    key = edge_key(modal.spindle_tool, modal.edge)
    if key in data.worn():
        raise block.refuse(
            f"the program sets wear or base of tool {key} without its length: set the length ($TC_DP3) too"
        )
    modal.length_key = key if state.knows(key) else str(modal.spindle_tool)
    return state.tool_length(modal.length_key)


def _note_edge(channel: Channel, block: Block) -> None:
    tool, edge = channel.modal.spindle_tool, channel.modal.edge
    if tool and edge > 1 and not channel.control_state.knows(edge_key(tool, edge)):
        channel.notes.add(f"D{edge} of tool {tool} is taken to be as long as D1", block.line)
