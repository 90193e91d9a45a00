"""Work offsets and tool lengths: where they come from, and which of them a program used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from kinematics.errors import UserError
from kinematics.machine import Machine
from postproc.numbers import given_number, given_once
from postproc.tool_tables.table import ToolTable, tool_key


@dataclass
class Setup:
    """Offsets by name and tool lengths by number, for one machine; keeps account of what was looked up.

    From the machine's file, overruled by a tool table, overruled by options; zero where nothing is said.
    """

    machine: Machine
    work_offsets: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    tools: dict[str, float] = field(default_factory=dict)
    used_offsets: dict[str, str] = field(default_factory=dict)
    used_tools: dict[str, str] = field(default_factory=dict)
    given_tools: frozenset[str] = frozenset()
    """Numbers of tools whose lengths were given one by one, not in a table."""
    radii: Mapping[str, float] = field(default_factory=dict)
    """Of tools, mm, by number; from a table."""
    datums: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Lines of a datum table by number and axis, mm or degrees."""
    turned: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Work offsets that turn the coordinates, by name: degrees about X, Y, Z."""

    def work_offset(self, name: str) -> tuple[float, ...]:
        """Offset of every machine axis, mm or degrees: what is added to a programmed position."""
        values = self.work_offsets.get(name, self.machine.work_offsets.get(name))
        said = ", ".join(f"{axis} {value:g}" for axis, value in values.items()) if values else "0 (default)"
        self.used_offsets[name] = said
        return tuple((values or {}).get(axis, 0.0) for axis in self.machine.names)

    def unused(self) -> list[str]:
        """Names of work offsets that were given for this run and not looked up: misspelt, perhaps."""
        return sorted(self.work_offsets.keys() - self.used_offsets.keys())

    def unused_tools(self) -> list[str]:
        """Notes on tool lengths that were given for this run and not looked up."""
        left = sorted(self.given_tools - self.used_tools.keys(), key=int)
        return [f"tool length T{number} was given and is not used" for number in left]

    def tool_length(self, tool: int | str) -> float:
        """Length of a tool by number or name, mm, from the tool reference point to the tip."""
        key = tool_key(str(tool))
        length = self.tools.get(key, self.machine.tools.get(key))
        self.used_tools[key] = "0 (default)" if length is None else f"{length:g}"
        return length or 0.0

    def knows(self, tool: int | str) -> bool:
        """True for a tool whose length is given somewhere."""
        key = tool_key(str(tool))
        return key in self.tools or key in self.machine.tools

    def tool_radius(self, tool: int | str) -> float | None:
        """Radius of a tool by number or name, mm; None where no table says it."""
        return self.radii.get(tool_key(str(tool)))


def parse_work_offset(text: str, machine: Machine) -> tuple[str, dict[str, float]]:
    """`G54=10,20,-5` or `G54=10,20,-5,C=30` as name and offsets; UserError says what is wrong with it."""
    name, _, values = text.partition("=")
    if not name.strip() or not values.strip():
        raise UserError(f"--work-offset {text}: expected G54=x,y,z")
    offsets: dict[str, float] = {}
    unnamed = 0
    for i, entry in enumerate(values.split(",")):
        axis, equals, number = entry.rpartition("=")
        unnamed += not equals
        axis = axis.strip().upper() or ("XYZ"[i] if i < 3 else "")
        if axis not in machine.names:
            raise UserError(f"--work-offset {text}: no axis {axis or '(fourth value)'} on machine {machine.name}")
        if axis in offsets:
            raise UserError(f"--work-offset {text}: {axis} is given twice")
        offsets[axis] = given_number(number, f"--work-offset {text}")
    wanted = sum(axis in machine.names for axis in "XYZ")
    if 0 < unnamed < wanted:
        raise UserError(
            f"--work-offset {text}: expected G54=x,y,z, got {unnamed} of {wanted} values (or by name: G54=X=10)"
        )
    return "".join(name.split()).upper(), offsets


def parse_tool_length(text: str) -> tuple[str, float]:
    """`T1=120.5` as number and length, mm; UserError says what is wrong with it."""
    name, _, value = text.partition("=")
    number = name.strip().upper().lstrip("T")
    if not number.isdecimal() or not value.strip():
        raise UserError(f"--tool-length {text}: expected T1=mm")
    return str(int(number)), given_number(value, f"--tool-length {text}")


def make_setup(
    machine: Machine,
    work_offsets: Iterable[str] = (),
    tool_lengths: Iterable[str] = (),
    table: ToolTable | None = None,
) -> Setup:
    """The setup from the options of the command line and a tool table."""
    table = table or ToolTable()
    for name, values in table.work_offsets.items():
        for axis, value in values.items():
            if axis not in machine.names and value:
                raise UserError(f"tool table: work offset {name}: no axis {axis} on machine {machine.name}")
    given = given_once((parse_work_offset(text, machine) for text in work_offsets), "--work-offset ")
    lengths = given_once(map(parse_tool_length, tool_lengths), "--tool-length T")
    return Setup(
        machine,
        {**table.work_offsets, **given},
        {**table.tools, **lengths},
        given_tools=frozenset(lengths),
        radii=table.radii,
        datums=table.datums,
        turned=table.turned,
    )
