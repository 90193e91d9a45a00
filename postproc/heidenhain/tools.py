"""Tools of Klartext: TOOL CALL, TOOL DEF, and the Q parameters of the tool in the spindle."""

from __future__ import annotations

from dataclasses import dataclass

from postproc.control.words import value_of
from postproc.heidenhain.channel import Channel
from postproc.heidenhain.modal_state import NO_TOOL
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown

Q_TOOL_RADIUS, Q_TOOL_LENGTH = 108.0, 114.0
"""Q parameters that the control sets to the active radius, and to the length."""


@dataclass
class Tools:
    """The tool of one control."""

    channel: Channel

    def __post_init__(self) -> None:
        scope = self.channel.scope
        scope.operations = {**scope.operations, "SYSREAD": self.read_system}

    def call(self, block: Block) -> None:
        """TOOL CALL: another tool, or oversizes of the present one."""
        words = {word.address: word for word in block.words}
        other_axis = [axis for axis in "XYUVW" if axis in words]
        if other_axis:
            raise block.refuse(f"the tool axis is {other_axis[0]}: only tools along Z are corrected")
        channel = self.channel
        modal = channel.modal
        longer, thicker = (value_of(block, words[name]) * modal.unit if name in words else 0.0 for name in ("DL", "DR"))
        if "T" in words:
            self._change(block, words["T"])
        elif "DL" not in words and modal.oversize:
            raise block.refuse("TOOL CALL without a tool ends DL on some controls only: write DL")
        modal.oversize, modal.radius_oversize = longer, thicker
        self._set_tool_parameters()
        channel.set_by_control("TOOL CALL")
        channel.change_frame(channel.x_y_z[2:])

    def _change(self, block: Block, word: Word) -> None:
        channel, modal = self.channel, self.channel.modal
        if modal.tcp:
            raise block.refuse("a tool is called while M128 is on: write M129 before TOOL CALL")
        modal.tool = self._named(block, word)
        modal.tool_length = channel.control_state.tool_length(modal.tool) if modal.tool != NO_TOOL else 0.0
        channel.mark_unknown(channel.machine.control.tool_change_moves)

    def define(self, block: Block) -> None:
        """TOOL DEF."""
        words, channel = {word.address: word for word in block.words}, self.channel
        if not words.keys() & {"L", "R"}:
            return
        if "T" not in words:
            raise block.refuse("TOOL DEF has a length or radius, but no tool: write its number")
        key = self._named(block, words["T"])
        if "L" in words:
            channel.control_state.enter_length(key, value_of(block, words["L"]) * channel.modal.unit)
        if "R" in words:
            channel.control_state.radii[key] = value_of(block, words["R"]) * channel.modal.unit

    def _named(self, block: Block, word: Word) -> str:
        """The tool that a word names, as tables have it."""
        text = block.text[word.at : word.end]
        return text.strip('"').upper() if text.startswith('"') else f"{value_of(block, word):.10g}"

    def radius(self) -> float | NotKnown:
        """Radius of the tool in the spindle, mm, with its oversize; or the reason why it is not known."""
        modal = self.channel.modal
        if modal.tool == NO_TOOL:
            return modal.radius_oversize
        radius = modal.control_state.tool_radius(modal.tool)
        if radius is None:
            return NotKnown(f"no tool table (--tool-table) gives the radius of tool {modal.tool}")
        return radius + modal.radius_oversize

    def _set_tool_parameters(self) -> None:
        radius, modal, scope = self.radius(), self.channel.modal, self.channel.scope
        scope.set("Q", (Q_TOOL_RADIUS,), radius if isinstance(radius, NotKnown) else radius / modal.unit)
        known = modal.tool == NO_TOOL or modal.control_state.knows(modal.tool)
        missing = NotKnown(f"neither --tool-length nor --tool-table gives the length of tool {modal.tool}")
        scope.set("Q", (Q_TOOL_LENGTH,), (modal.tool_length + modal.oversize) / modal.unit if known else missing)

    # ---- reading of the tool table by the program

    def read_system(self, group: float, number: float, index: float | None = None) -> float:
        """SYSREAD ID50 NR1 and NR2: length and radius of a tool, in units of the program; NotKnown for all else."""
        channel = self.channel
        if group != 50.0 or number not in (1.0, 2.0):
            raise NotKnown("SYSREAD reads data of the control that ncomp does not have")
        state, key = channel.control_state, channel.modal.tool if index is None else f"{index:.10g}"
        found = state.tool_radius(key) if number == 2.0 else state.tool_length(key) if state.knows(key) else None
        if found is None:
            quantity = "radius" if number == 2.0 else "length"
            raise NotKnown(f"no tool table (--tool-table) gives the {quantity} of tool {key}")
        return found / channel.modal.unit
