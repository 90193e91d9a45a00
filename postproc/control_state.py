"""Offsets and tools of the control while one program runs: the set-up, changed by the program, and its use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from kinematics.touch_off import TouchOff, touch_off
from postproc.setup import Setup
from postproc.tool_tables.table import tool_key


@dataclass
class ControlState:
    """Belongs to one interpreter: every reading of a program begins with a new one."""

    setup: Setup
    offsets: dict[str, dict[str, float]] = field(default_factory=dict)
    """Work offsets that the program has set, by name and axis, mm or degrees; other axes are as in the set-up."""
    tools: dict[str, float] = field(default_factory=dict)
    """Tool lengths that the program has set, mm, by number or name."""
    radii: dict[str, float] = field(default_factory=dict)
    """Tool radii that the program has set, mm, by number or name."""
    wear: dict[str, float] = field(default_factory=dict)
    """Added to tool lengths by the program, mm, by number."""
    used_offsets: dict[str, str] = field(default_factory=dict)
    """Work offsets that the program used, with their values in words."""
    used_tools: dict[str, str] = field(default_factory=dict)
    """Tools whose lengths the program used, with the lengths, mm, in words."""

    def enter_offset(self, name: str, values: Mapping[str, float]) -> None:
        """Set axes of a work offset, mm or degrees."""
        self.offsets.setdefault(name, {}).update(values)

    def enter_length(self, tool: int | str, length: float) -> None:
        """Set the length of a tool, mm."""
        self.tools[tool_key(str(tool))] = length

    def work_offset(self, name: str) -> tuple[float, ...]:
        """Work offset of every machine axis, mm or degrees: added to a programmed position."""
        given, entered = self.setup.work_offset(name), self.offsets.get(name, {})
        values = {**(given or {}), **entered}
        self.used_offsets[name] = ", ".join(f"{axis} {value:g}" for axis, value in values.items()) or "0 (default)"
        return tuple(values.get(axis, 0.0) for axis in self.setup.machine.names)

    def touch_off(self, name: str) -> TouchOff | None:
        """The touch-off of a work offset as it is now; None for one that is true."""
        datum = self.setup.datum(name)
        return touch_off(name, datum, self.work_offset(name), self.setup.machine) if datum.probed else None

    def tool_length(self, tool: int | str) -> float:
        """Length of a tool by number or name, mm, from the tool reference point to the tip, with its wear."""
        key = tool_key(str(tool))
        length = self.tools.get(key, self.setup.tool_length(key))
        total = (length or 0.0) + self.wear.get(key, 0.0)
        self.used_tools[key] = f"{total:g}" if self.knows(key) else "0 (default)"
        return total

    def tool_radius(self, tool: int | str) -> float | None:
        """Radius of a tool by number or name, mm; None where nothing gives it."""
        key = tool_key(str(tool))
        return self.radii.get(key, self.setup.tool_radius(key))

    def knows(self, tool: int | str) -> bool:
        """True for a tool whose length is given, or set by the program."""
        key = tool_key(str(tool))
        return key in self.tools or self.setup.tool_length(key) is not None

    def unused(self) -> list[str]:
        """Notes on work offsets and tool lengths that were given for this run and not used: misspelt, perhaps."""
        offsets = sorted(self.setup.work_offsets.keys() - self.used_offsets.keys())
        tools = sorted(self.setup.given_tools - self.used_tools.keys(), key=int)
        datums = sorted(self.setup.obtained.keys() - self.used_offsets.keys())
        return [
            *(f"work offset {name} was given and is not used" for name in offsets),
            *(f"the datum of {name} was given and is not used" for name in datums),
            *(f"tool length T{number} was given and is not used" for number in tools),
        ]
