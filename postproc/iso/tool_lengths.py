"""Tools and their lengths in ISO programs: T M6, G43 and its kin, lengths that G10 sets."""

from __future__ import annotations

from dataclasses import dataclass

from kinematics.machine import Control
from postproc.control.state import ControlState
from postproc.text.block import Block
from postproc.text.notes import Notes

TCP_CODES = frozenset((43.4, 43.5))
"""The coordinates are those of the tool point in the workpiece frame; the latter says the tool axis as a vector."""


@dataclass
class Lengths:
    """The length in force."""

    state: ControlState
    notes: Notes
    control: Control
    selected_tool: int = 0
    spindle_tool: int | None = None
    number: int | None = None
    """Of the length offset, None for none."""
    given: float | None = None
    """The length that G43.1 has said, mm."""
    said: bool = False
    """The program has said which one is in force."""
    vectors: bool = False
    """I J K of a move are its tool axis (G43.5)."""

    def __post_init__(self) -> None:
        self.tcp = self.control.tcp_at_start

    @property
    def key(self) -> tuple[int, float | None] | None:
        """Two lengths that may differ have different keys; None where the program has said nothing of it yet."""
        return (self.number or 0, self.given) if self.said else None

    def offset(self) -> float | None:
        """The length, mm, that coordinates are shifted by; None for none."""
        if self.given is not None:
            return self.given
        return self.state.tool_length(self.number) if self.number else None

    def tool(self) -> float:
        """Length of the tool in the spindle as far as it is known, mm."""
        if self.given is not None:
            return self.given
        return self.state.tool_length(self.tool_name) if self.tool_name else 0.0

    @property
    def tool_name(self) -> str:
        """Number of the tool whose length is looked up: that of the length offset, else the one in the spindle."""
        return "" if self.given is not None else str(self.number or self.spindle_tool or "")

    def set(self, block: Block, store: dict[str, float], number: int, length: float) -> None:
        """G10: a length of the table, or its wear, from now on; mm."""
        if number == self.number:
            raise block.refuse("changes the length in force: some controls take it at once, others do not")
        store[str(number)] = length

    def give(self, length: float) -> None:
        """G43.1: a length said in the program, mm."""
        self.number, self.given, self.said = None, length, True
        self.tcp, self.vectors = self.control.tcp_at_start, False

    def select(self, block: Block, code: float, number: int | None) -> None:
        """G43, G43.4, G43.5 with the H of the block, or none; G49."""
        self.said, self.given, self.vectors = True, None, code == 43.5
        if code == 49.0:
            self.number, self.tcp = None, self.control.tcp_at_start
            return
        if number is not None:
            self.number = number
        elif self.number is None or self.control.family == "linuxcnc":
            self.number = self.spindle_tool or 0
            self.notes.add("G43 without H: taken for the length of the tool in the spindle", block.line)
        elif self.spindle_tool not in (None, self.number):
            raise block.refuse(
                f"G43 without H while tool {self.spindle_tool} is in the spindle and H{self.number} in force: "
                "some controls take the one, some the other"
            )
        self.tcp = code in TCP_CODES or self.control.tcp_at_start
        if code in TCP_CODES:
            self.notes.add(
                f"G{code:g}: X Y Z taken as the tool point in the workpiece frame that turns with a table", block.line
            )
