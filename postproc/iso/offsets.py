"""Offsets of ISO coordinates: work offsets, G52, G92, and tool lengths (G43 and its kin)."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from postproc.control.codes import TOOL_CHANGE
from postproc.control.state import ControlState
from postproc.iso.codes import TOOL_IS, WORK_OFFSETS
from postproc.text.block import Block

Shifts = dict[int, float]
"""By axis, mm or degrees."""
NUMBERED = dict(enumerate([*(f"G{g}" for g in range(54, 60)), "G59.1", "G59.2", "G59.3"], start=1))
"""Work offsets by the P of G10 L2."""


class Offsets(msgspec.Struct):
    """The work offset in force, and the shifts that the program adds to it."""

    state: ControlState
    name: str = "G54"
    selected: bool = False
    """The program has selected the one in force."""
    local: Shifts = msgspec.field(default_factory=dict)
    """G52."""
    preset: Shifts | None = None
    """G92; None before the first one."""
    suspended: bool = False
    """G92.2."""
    turned: dict[str, float] = msgspec.field(default_factory=dict)
    """Degrees by which G10 has turned X and Y of work offsets (LinuxCNC)."""

    def work(self) -> list[float]:
        """The work offset of every axis, mm or degrees."""
        return list(self.state.work_offset(self.name))

    def added(self) -> Shifts:
        """The shifts of G52 and G92, inside the work offset and its rotation."""
        found = dict(self.local)
        for axis, value in ({} if self.suspended else self.preset or {}).items():
            found[axis] = found.get(axis, 0.0) + value
        return found

    @property
    def turn(self) -> float:
        """Degrees by which the work offset in force turns X and Y."""
        return self.turned.get(self.name, 0.0)

    @property
    def moved(self) -> bool:
        """True while G52 or G92 shifts an axis."""
        return any(self.local.values()) or any((self.preset or {}).values())

    def select(self, code: float, extended: int | None) -> None:
        """Take a work offset: by its code, or by the P of G54.1."""
        self.name = WORK_OFFSETS[code] if extended is None else f"G54.1P{extended}"
        self.selected = True

    def enter(self, name: str, values: Shifts) -> None:
        """Set a work offset along the axes of the block."""
        names = self.state.setup.machine.names
        self.state.enter_offset(name, {names[axis]: value for axis, value in values.items()})

    def preset_at(self, block: Block, here: Shifts, values: Shifts) -> None:
        """G92: the positions `here` have the coordinates `values` from now on."""
        if any(self.local.values()):
            raise block.refuse("G92 and G52 share one offset on some controls, not on others: cancel G52 before G92")
        preset = {} if self.suspended or self.preset is None else self.preset
        for axis, value in values.items():
            preset[axis] = preset.get(axis, 0.0) + here[axis] - value
        self.preset, self.suspended = preset, False

    def cancel_preset(self, axes: Iterable[int]) -> None:
        """G92.1: G92 and G52 end for these axes."""
        for axis in axes:
            self.local.pop(axis, None)
            (self.preset or {}).pop(axis, None)

    def suspend(self, block: Block, suspended: bool) -> None:
        """G92.2: no G92 for a while; G92.3: again."""
        if any(self.local.values()):
            code = "G92.2" if suspended else "G92.3"
            raise block.refuse(
                f"{code} and G52 act on one offset on some controls, not on others: cancel G52 before {code}"
            )
        if not suspended and self.preset is None:
            raise block.refuse(
                "G92.3 restores the G92 of another program, which is not known: write G92 with its values"
            )
        self.suspended = suspended


# ---- tools and their lengths

TCP_CODES = frozenset((43.4, 43.5))
"""The coordinates are those of the tool point in the workpiece frame; the latter gives the tool axis as a vector."""


TOOL_CODES = frozenset((TOOL_CHANGE, TOOL_IS))
"""M codes that put another tool into the spindle."""


class Lengths(msgspec.Struct):
    """The length in force."""

    state: ControlState
    selected_tool: int = 0
    spindle_tool: int | None = None
    number: int | None = None
    """Number of the length offset; None without one."""
    given: float | None = None
    """The length of G43.1, mm."""
    selected: bool = False
    """The program has selected the one in force."""
    vectors: bool = False
    """I J K of a move are its tool axis (G43.5)."""
    with_tool_0: bool = False
    """Tool 0 is a tool of the table (LinuxCNC with a random tool changer); otherwise it is no tool."""

    @property
    def key(self) -> tuple[int, float | None] | None:
        """Two lengths that may differ have different keys; None where the program has not set it yet."""
        return (self.number or 0, self.given) if self.selected else None

    def offset(self) -> float | None:
        """The length, mm, that coordinates are shifted by; None for none."""
        if self.given is not None:
            return self.given
        return self.state.tool_length(str(self.number)) if self._is_tool(self.number) else None

    def tool(self) -> float:
        """Length of the tool in the spindle as far as it is known, mm."""
        if self.given is not None:
            return self.given
        return self.state.tool_length(self.tool_name) if self.tool_name else 0.0

    @property
    def tool_name(self) -> str:
        """Number of the tool whose length is looked up: that of the length offset, else the one in the spindle."""
        numbers = (self.number, self.spindle_tool) if self.given is None else ()
        return next((str(number) for number in numbers if self._is_tool(number)), "")

    def name_in_frame(self, *, tcp: bool) -> str:
        """Number of the tool whose length a frame needs; empty for a length that nobody gives and nothing needs."""
        name, setup = self.tool_name, self.state.setup
        needed = tcp or self.offset() is not None or setup.lengths_matter
        given = bool(name) and (self.state.knows(name) or setup.tool_length(name) is not None)
        return name if needed or given else ""

    def _is_tool(self, number: int | None) -> bool:
        return number is not None and (number != 0 or self.with_tool_0)

    def set(self, block: Block, store: dict[str, float], number: int, length: float) -> None:
        """G10: a length of the table, or its wear, from now on; mm."""
        if number == self.number:
            raise block.refuse(
                "G10 changes the length offset in force, which some controls apply at once and others at "
                "the next G43: write G49 before it and G43 H after it"
            )
        store[str(number)] = length

    def give(self, length: float) -> None:
        """G43.1: a length given in the program, mm."""
        self.number, self.given, self.selected, self.vectors = None, length, True, False

    def select(self, code: float, number: int | None) -> None:
        """G43, G43.4, G43.5 with the H of the block, or with the present number; G49."""
        self.selected, self.given, self.vectors = True, None, code == 43.5
        if number is not None or code == 49.0:
            self.number = number if code != 49.0 else None

    def select_spindle(self, block: Block, always: bool, given: str = "") -> bool:
        """G43 without H: the length of the tool in the spindle, `always` or where no number is in force.

        `given`: the H that selects it (LinuxCNC). Refusal where controls differ, or where the tool is not known.
        """
        if given and any(word.address == "M" and word.value in TOOL_CODES for word in block.words):
            raise block.refuse(
                f"G43 {given} in the block of a tool change selects the length of the tool before the change on "
                f"LinuxCNC: write G43 {given} in the next block, or the number of the tool as H"
            )
        if self.with_tool_0 and self.spindle_tool is None:
            raise block.refuse(
                "with a random tool changer a tool is in the spindle before the first tool change, and the program "
                "does not name it: write T and M6 before this block, or H"
            )
        if self.number is None or always:
            self.number = self.spindle_tool or 0
            return True
        if self.spindle_tool not in (None, self.number):
            raise block.refuse(
                f"G43 without H while tool {self.spindle_tool} is in the spindle and H{self.number} in force: "
                "some controls use the length of the tool, others that of H. Write H"
            )
        return False
