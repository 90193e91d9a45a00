"""Tools of Klartext: TOOL CALL, TOOL DEF, and the Q parameters of the tool in the spindle."""

from __future__ import annotations

from dataclasses import dataclass

from postproc.control.words import value_of
from postproc.heidenhain.modal_state import ModalState
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown

RADIUS, LENGTH = 108.0, 114.0
"""Q parameters that the control sets to the active radius, and to the length."""


@dataclass
class Tools:
    """The tool of one control."""

    control: ModalState
    key: str = "0"
    """Number or name of the tool in the spindle."""
    length: float = 0.0
    """Without oversizes, mm."""
    more: float = 0.0
    """Oversize of its radius by TOOL CALL, mm."""

    def __post_init__(self) -> None:
        scope = self.control.scope
        scope.operations = {**scope.operations, "SYSREAD": self.read_system}

    def call(self, block: Block) -> None:
        """TOOL CALL: another tool, or oversizes of the present one."""
        words = {word.address: word for word in block.words}
        other_axis = [axis for axis in "XYUVW" if axis in words]
        if other_axis:
            raise block.refuse(f"the tool axis is {other_axis[0]}: only tools along Z are corrected")
        control = self.control
        oversize, more = (
            value_of(block, words[name]) * control.unit if name in words else 0.0 for name in ("DL", "DR")
        )
        if "T" in words:
            self._change(block, words["T"])
        elif "DL" not in words and control.oversize:
            raise block.refuse("TOOL CALL without a tool ends DL on some controls only: write DL")
        control.oversize, control.tool_length, self.more = oversize, self.length, more
        self._set_tool_parameters()
        control.change_frame(control.x_y_z[2:])

    def _change(self, block: Block, word: Word) -> None:
        control = self.control
        if control.tcp:
            raise block.refuse("a tool is called while M128 is on: write M129 before TOOL CALL")
        self.key = self._named(block, word)
        self.length = control.control_state.tool_length(self.key) if self.key != "0" else 0.0
        control.tool_name = self.key if self.key != "0" else ""
        control.mark_unknown(control.machine.control.tool_change_moves)

    def define(self, block: Block) -> None:
        """TOOL DEF."""
        words, control = {word.address: word for word in block.words}, self.control
        if not words.keys() & {"L", "R"}:
            return
        if "T" not in words:
            raise block.refuse("TOOL DEF has a length or radius, but no tool: write its number")
        key = self._named(block, words["T"])
        if "L" in words:
            control.control_state.enter_length(key, value_of(block, words["L"]) * control.unit)
        if "R" in words:
            control.control_state.radii[key] = value_of(block, words["R"]) * control.unit

    def _named(self, block: Block, word: Word) -> str:
        """The tool that a word names, as tables have it."""
        text = block.text[word.at : word.end]
        return text.strip('"').upper() if text.startswith('"') else f"{value_of(block, word):.10g}"

    def radius(self) -> float | NotKnown:
        """Radius of the tool in the spindle, mm, with its oversize; or the reason why it is not known."""
        if self.key == "0":
            return self.more
        radius = self.control.control_state.tool_radius(self.key)
        if radius is None:
            return NotKnown(f"no tool table (--tool-table) gives the radius of tool {self.key}")
        return radius + self.more

    def _set_tool_parameters(self) -> None:
        radius, unit = self.radius(), self.control.unit
        scope = self.control.scope
        scope.set("Q", (RADIUS,), radius if isinstance(radius, NotKnown) else radius / unit)
        known = self.key == "0" or self.control.control_state.knows(self.key)
        missing = NotKnown(f"neither --tool-length nor --tool-table gives the length of tool {self.key}")
        scope.set("Q", (LENGTH,), (self.length + self.control.oversize) / unit if known else missing)

    # ---- reading of the tool table by the program

    def read_system(self, group: float, number: float, index: float | None = None) -> float:
        """SYSREAD ID50 NR1 and NR2: length and radius of a tool, in units of the program; NotKnown for all else."""
        if group != 50.0 or number not in (1.0, 2.0):
            raise NotKnown("SYSREAD reads data of the control that ncomp does not have")
        state, key = self.control.control_state, self.key if index is None else f"{index:.10g}"
        found = state.tool_radius(key) if number == 2.0 else state.tool_length(key) if state.knows(key) else None
        if found is None:
            quantity = "radius" if number == 2.0 else "length"
            raise NotKnown(f"no tool table (--tool-table) gives the {quantity} of tool {key}")
        return found / self.control.unit
