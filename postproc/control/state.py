"""Offsets and tools of the control while one program runs: the set-up, changed by the program, and its use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from kinematics.touch_off import TouchOff, touch_off
from postproc.control.setup import Origin, Setup
from postproc.control.tool_table import shown_tool, tool_key
from postproc.motion.frames import Frame, Placement, cartesian
from postproc.text.block import Block
from postproc.text.notes import Notes

SHORTEST_TOOL_MM = 1.0
"""A length below it is perhaps one in metres, of a tool up to 1 m."""
INCHES = "the program is in inches: --work-offset, --tool-length and the machine file are in mm"


class ControlState(msgspec.Struct):
    """Belongs to one interpreter: every reading of a program begins with a new one."""

    setup: Setup
    offsets: dict[str, dict[str, float]] = msgspec.field(default_factory=dict)
    """Work offsets that the program has set, by name and axis, mm or degrees; other axes are as in the set-up."""
    fine: dict[str, dict[str, float]] = msgspec.field(default_factory=dict)
    """Fine shifts of work offsets, which come on top, by name and axis, mm or degrees."""
    tools: dict[str, float] = msgspec.field(default_factory=dict)
    """Tool lengths that the program has set, mm, by number or name."""
    radii: dict[str, float] = msgspec.field(default_factory=dict)
    """Tool radii that the program has set, mm, by number or name."""
    wear: dict[str, float] = msgspec.field(default_factory=dict)
    """Added to tool lengths by the program, mm, by number."""
    used_offsets: dict[str, str] = msgspec.field(default_factory=dict)
    """Work offsets that a move was programmed in, with their values in words."""
    used_tools: dict[str, str] = msgspec.field(default_factory=dict)
    """Tools that a programmed move was made with, with their lengths, mm, in words."""
    assumed: dict[str, str] = msgspec.field(default_factory=dict)
    """Work offsets and tools among them that the machine file assumes, with their values in words."""
    taken: dict[str, str] = msgspec.field(default_factory=dict)
    """Other assumptions on the control that the program needs, by what they are about, as sentences."""
    _origins: dict[tuple[str, str, tuple[float, ...], float], str] = msgspec.field(default_factory=dict)
    """Origins, in words, of the frames of the programmed moves, by the names and values of the frames."""
    _frame: Frame | None = None
    """The last frame that was looked at."""

    # ---- work offsets

    def enter_offset(self, name: str, values: Mapping[str, float]) -> None:
        """Set axes of a work offset, mm or degrees."""
        self.offsets.setdefault(name, {}).update(values)

    def work_offset(self, name: str) -> tuple[float, ...]:
        """Work offset of every machine axis, mm or degrees: added to a programmed position.

        0 for machine zero, whose name is empty, and where nobody gave it.
        """
        values = self._offset_values(name) if name else {}
        return tuple(values.get(axis, 0.0) for axis in self.setup.machine.names)

    def names_offset(self, name: str) -> bool:
        """True for a work offset that is given by its own name, or set by the program."""
        return name in self.offsets or self.setup.names_offset(name)

    def _offset_values(self, name: str) -> dict[str, float]:
        given = self.setup.work_offset(name)
        values = {**(given.value if given else {}), **self.offsets.get(name, {})}
        for axis, shift in self.fine.get(name, {}).items():
            values[axis] = values.get(axis, 0.0) + shift
        return values

    def offset_origin(self, name: str) -> Origin | None:
        """Origin of a work offset; None if X, Y or Z is not given."""
        if set("XYZ") & set(self.setup.machine.names) <= self.offsets.get(name, {}).keys():
            return Origin.PROGRAM
        given = self.setup.work_offset(name)
        return given and given.origin

    def frame(
        self,
        offset: str,
        placed: Placement,
        shifts: Mapping[int, float] | None = None,
        *,
        tool: str,
        length: float,
        length_offset: float | None = None,
        tcp: bool,
    ) -> Frame:
        """The frame of a work offset, with the placement of X Y Z within it and shifts of other axes.

        shifts: by column, mm or degrees. tool, length: of the tool in the spindle, mm. length_offset: the length that
        Z is shifted by without TCP, mm; that of the tool where it is None.
        """
        machine = self.setup.machine
        values, x_y_z = list(self.work_offset(offset)), cartesian(machine)
        for axis, shift in (*zip(x_y_z, placed.shift, strict=True), *(shifts or {}).items()):
            values[axis] += shift
        if not tcp:
            values[x_y_z[2]] += length if length_offset is None else length_offset
        touched = self.touch_off(offset) if offset else None
        return Frame(tuple(values), length, tcp, placed.frame_turn, touched, offset, tool)

    # ---- tools

    def enter_length(self, tool: int | str, length: float) -> None:
        """Set the length of a tool, mm."""
        self.tools[tool_key(str(tool))] = length

    def touch_off(self, name: str) -> TouchOff | None:
        """The present touch-off of a work offset; None for one that is true."""
        datum = self.setup.datum(name)
        return touch_off(name, datum, self.work_offset(name), self.setup.machine) if datum.probed else None

    def tool_length(self, tool: int | str) -> float:
        """Length of a tool by number or name, mm, from the tool reference point to the tip, with its wear.

        0 where nobody gave it.
        """
        key = tool_key(str(tool))
        given = self.setup.tool_length(key)
        return self.tools.get(key, given.value if given else 0.0) + self.wear.get(key, 0.0)

    def tool_radius(self, tool: int | str) -> float | None:
        """Radius of a tool by number or name, mm; None where nothing gives it."""
        key = tool_key(str(tool))
        return self.radii.get(key, self.setup.tool_radius(key))

    def knows(self, tool: int | str) -> bool:
        """True for a tool whose length is given by its own name, or set by the program."""
        key = tool_key(str(tool))
        return key in self.tools or self.setup.names_tool(key)

    def tool_origin(self, key: str) -> Origin | None:
        """Origin of the length of a tool; None if it is not given."""
        if key in self.tools:
            return Origin.PROGRAM
        given = self.setup.tool_length(key)
        return given and given.origin

    # ---- the offsets and tools that a program uses

    def uses(self, frame: Frame | None) -> bool:
        """True if the last move before was in the same frame."""
        return frame is self._frame

    def use(self, block: Block, frame: Frame | None) -> None:
        """Register the frame of the last move of a block; Refusal if its offset or tool length is not given."""
        if frame is None or self.uses(frame):
            return
        self._frame = frame
        self._origins[_values_of(frame)] = self._origins_now(frame)
        offset, tool = frame.work_offset, tool_key(frame.tool_name)
        if offset and offset not in self.used_offsets:
            origin, text = self.offset_origin(offset), self._offset_text(offset)
            self.used_offsets[offset] = _with_origin(text, origin)
            if origin is None:
                raise block.refuse(f"work offset {offset} is not given; " + _how(f"--work-offset {offset}=x,y,z"))
            if origin is Origin.ASSUMED:
                self.assumed[f"work offset {offset}"] = f"{offset} {text}"
            self._use_table(f"offset {offset}", f"{offset} {text}")
        if frame.tool_name and tool not in self.used_tools:
            origin, text, shown = self.tool_origin(tool), f"{self.tool_length(tool):g}", shown_tool(tool)
            self.used_tools[tool] = _with_origin(text, origin)
            if origin is None:
                raise block.refuse(f"length of tool {shown} is not given; " + _how(f"--tool-length {shown}=mm"))
            if origin is Origin.ASSUMED:
                self.assumed[f"tool {shown}"] = f"{shown} {text} mm"
            self._use_table(f"tool {tool}", f"{shown} {text}")

    def _use_table(self, entry: str, text: str) -> None:
        """Register the assumed unit of the table of an entry, with the first values that are used."""
        if (table := self.setup.without_unit.get(entry)) is not None:
            self.assumed.setdefault(f"unit of {table}", f"{text} in mm")

    def meet_inches(self, block: Block, notes: Notes) -> None:
        """Refusal of a program in inches if a table has no unit; a note on set-up data that are in mm."""
        for table in self.setup.without_unit.values():
            raise block.refuse(
                f"the program is in inches, and {table} contains no unit: give it by --table-unit inch or mm, or by "
                'unit = "inch" in [control] of the machine file'
            )
        if self.setup.given_tools or self.setup.work_offsets:
            notes.add(INCHES, block.line)

    def _offset_text(self, name: str) -> str:
        return ", ".join(f"{axis} {value:g}" for axis, value in self._offset_values(name).items()) or "0"

    def origins(self, frame: Frame) -> str:
        """Work offset and tool length of a frame when it was used, with their origins, in words; empty for none."""
        return self._origins.get(_values_of(frame), "")

    def is_given(self, frame: Frame) -> bool:
        """True for a frame whose work offset and tool length are given, or assumed."""
        offset, tool = frame.work_offset, frame.tool_name
        if offset and self.offset_origin(offset) is None:
            return False
        return not tool or self.tool_origin(tool_key(tool)) is not None

    def _origins_now(self, frame: Frame) -> str:
        parts = []
        if name := frame.work_offset:
            parts.append(f"work offset {name} = {_with_origin(self._offset_text(name), self.offset_origin(name))}")
        if frame.tool_name:
            tool = tool_key(frame.tool_name)
            length = _with_origin(f"{self.tool_length(tool):g} mm", self.tool_origin(tool))
            parts.append(f"tool {shown_tool(tool)} = {length}")
        elif parts:
            parts.append("no tool length in force")
        return " and ".join(parts)

    def assumption(self) -> str:
        """Sentences on all that is assumed; empty for nothing."""
        return "\n".join(filter(None, (self._assumed_values(), *self.taken.values())))

    def _assumed_values(self) -> str:
        """A sentence on the work offsets and tools that are assumed; empty for none."""
        if not self.assumed:
            return ""
        *others, last = self.assumed
        names = f"{', '.join(others)} and {last}" if others else last
        options = [
            f"--{option}" for option in ("work-offset", "tool-length", "table-unit") if _gives(option, self.assumed)
        ]
        return (
            f"{names[0].upper()}{names[1:]} {'are' if others else 'is'} assumed: {'; '.join(self.assumed.values())}; "
            f"give {' / '.join(options)}"
        )

    def short_tools(self) -> list[str]:
        """Notes on lengths of used tools that are hardly mm."""
        lengths = {tool: self.tool_length(tool) for tool in self.used_tools}
        return [
            f"{shown_tool(tool)} is {length:g} mm long: lengths are in mm, from the spindle nose to the tip"
            for tool, length in lengths.items()
            if 0.0 < abs(length) < SHORTEST_TOOL_MM
        ]

    def left_out(self) -> list[str]:
        """Notes on linear axes that a work offset of the set-up leaves out, and for which zero was used."""
        linear = [axis for axis in "XYZ" if axis in self.setup.machine.names]
        notes = []
        for name in self.used_offsets:
            values = self._offset_values(name)
            axes = [axis for axis in linear if axis not in values]
            if axes and self.offset_origin(name) is not Origin.ZERO:
                they = "they count" if len(axes) > 1 else "it counts"
                notes.append(f"work offset {name} does not give {' and '.join(axes)}: {they} as 0")
        return notes


def _values_of(frame: Frame) -> tuple[str, str, tuple[float, ...], float]:
    return frame.work_offset, frame.tool_name, frame.offset, frame.tool_length


def _how(option: str) -> str:
    return (
        f"give it by {option}, by --tool-table, in the job file or in the machine file, or take zero on purpose by "
        "--set-up-zero"
    )


def _gives(option: str, names: Iterable[str]) -> bool:
    """True where the option gives one of the names: a work offset, a tool, or the unit of a table."""
    return any(name.split()[0] in option.split("-") for name in names)


def _with_origin(value: str, origin: Origin | None) -> str:
    """A value in words with its origin, where that is worth a word."""
    return f"{value} ({origin.value})" if origin is not None and origin.value else value
