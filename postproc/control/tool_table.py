"""The contents of a table of a control: tools, work offsets, datums."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec.structs import replace

from kinematics.user_error import UserError

_NUMBER = re.compile(r"\d+(\.\d+)?")
_ROTARY = frozenset("ABC")


class ToolTable(msgspec.Struct, frozen=True):
    """The set-up data of a table; lengths in mm, angles in degrees."""

    tools: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Lengths by tool: its number as text (`5`, `5.1` where tools have indices), or its name in capitals."""
    work_offsets: Mapping[str, Mapping[str, float]] = msgspec.field(default_factory=dict)
    """By name (`G54`, or the number of a preset) and axis."""
    radii: Mapping[str, float] = msgspec.field(default_factory=dict)
    """By tool, as lengths."""
    datums: Mapping[str, Mapping[str, float]] = msgspec.field(default_factory=dict)
    """Lines of a datum table, which shift within the work offset, by number and axis."""
    turned: Mapping[str, tuple[float, float, float]] = msgspec.field(default_factory=dict)
    """Work offsets that turn the coordinates, by name: about X, Y and Z, applied in this order, about fixed axes."""
    without_unit: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Files of tools and work offsets whose table contains no unit, and none was given, by `tool 5`, `offset G54`."""

    def in_unit(self, unit: float) -> ToolTable:
        """The table, read as if in mm, with its lengths in a unit, mm."""
        return replace(
            self,
            tools={tool: length * unit for tool, length in self.tools.items()},
            radii={tool: radius * unit for tool, radius in self.radii.items()},
            work_offsets={
                name: {axis: value * (1.0 if axis in _ROTARY else unit) for axis, value in values.items()}
                for name, values in self.work_offsets.items()
            },
        )

    def marked(self, path: Path) -> ToolTable:
        """The table with the note that the file contains no unit."""
        names = (*(f"tool {tool}" for tool in self.tools), *(f"offset {name}" for name in self.work_offsets))
        return replace(self, without_unit=dict.fromkeys(names, str(path)))


def checked(table: ToolTable, path: Path) -> ToolTable:
    """The table with its names in the form of programs; UserError for a value that is not finite."""
    numbers = {"tools": table.tools, "radii": table.radii, **table.work_offsets, **table.datums}
    for name, values in numbers.items():
        for key, value in values.items():
            if not math.isfinite(value):
                raise UserError(f"tool table {path}: {name}: {key}: {value} is not a finite number")
    return replace(
        table,
        tools={tool_key(tool): length for tool, length in table.tools.items()},
        radii={tool_key(tool): radius for tool, radius in table.radii.items()},
        work_offsets={"".join(name.split()).upper(): values for name, values in table.work_offsets.items()},
    )


def tool_key(tool: str) -> str:
    """A tool as tables name it: `05` is `5`, `mill ` is `MILL`."""
    text = tool.strip().upper()
    return text.lstrip("0") or "0" if text.isdecimal() else text


def is_number(tool: str) -> bool:
    """True for a tool number, with an index or without."""
    return _NUMBER.fullmatch(tool) is not None


def shown_tool(key: str) -> str:
    """A tool as options and messages write it: T5, or its name."""
    return f"T{key}" if is_number(key) else key


def joined(tables: Mapping[Path, ToolTable]) -> ToolTable:
    """Several tables as one; UserError for an entry that two of them have."""
    found: dict[str, dict[str, object]] = {}
    for path, table in tables.items():
        for name in ("tools", "work_offsets", "radii", "datums", "turned", "without_unit"):
            values, part = found.setdefault(name, {}), getattr(table, name)
            twice = sorted(values.keys() & part.keys())
            if twice:
                raise UserError(
                    f"tool table {path}: {name.replace('_', ' ')}: {twice[0]} is in another table too: keep one of them"
                )
            values.update(part)
    return ToolTable(**found)  # type: ignore[arg-type]
