"""The set-up of one program: in its entry of a job file, or in the file NAME.toml in the folder of the program NAME."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from kinematics.files import read_input
from kinematics.files.toml_entries import at_line, entry, read_table, utf8_text
from kinematics.machine import Machine
from kinematics.running.given_texts import texts
from kinematics.touch_off import read_datum
from kinematics.user_error import UserError
from postproc.control.setup import parse_datum, parse_tool_length, parse_work_offset
from postproc.control.tool_table import shown_tool
from postproc.program_set import SET_UP

Offsets = dict[str, dict[str, float | str]]
"""Work offsets by name and axis, mm or degrees; the entry `datum` says how an offset was obtained."""


class OwnSetUp(msgspec.Struct, frozen=True):
    """Work offsets, datums, tool lengths and a height map, as the options of the command line give them."""

    work_offset: tuple[str, ...] = ()
    datum: tuple[str, ...] = ()
    tool_length: tuple[str, ...] = ()
    height_map: tuple[str, ...] = ()
    """`FILE` or `FILE@G55`; none or one."""
    source: str = ""
    """Name of the file that they are from; empty where nothing is given."""

    @property
    def names(self) -> list[str]:
        """Names of the parts that are given: `work offset G54`, `the datum of G54`, `tool length T1`."""
        offsets = ("".join(each.partition("=")[0].split()).upper() for each in self.work_offset)
        datums = ("".join(each.partition("=")[0].split()).upper() for each in self.datum)
        tools = (shown_tool(parse_tool_length(each)[0]) for each in self.tool_length)
        return [
            *(f"work offset {name}" for name in offsets),
            *(f"the datum of {name}" for name in datums),
            *(f"tool length {name}" for name in tools),
            *(f"height map {text}" for text in self.height_map),
        ]


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    work_offsets: Offsets = {}
    tools: dict[str, Any] = {}
    height_map: str | None = None


def set_up_beside(program: Path, machine: Machine) -> OwnSetUp:
    """The set-up in the file of a program; an empty one without such a file. UserError with the line of a fault."""
    path = program.with_name(program.name + SET_UP)
    if str(program) == "-" or not path.is_file():
        return OwnSetUp()
    where = f"set-up {path}"
    text = utf8_text(read_input(path, "set-up"), where)
    table = read_table(text, where)
    try:
        content = entry(table, _Content)
        offsets, datums = offsets_in(content.work_offsets, machine)
        return OwnSetUp(offsets, datums, tools_in(content.tools), map_in(content.height_map, path.parent), str(path))
    except UserError as fault:
        raise at_line(text, where, fault) from None


def offsets_in(table: Offsets, machine: Machine, above: str = "") -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Work offsets and their datums as options; UserError, with the entry, for one that cannot be used."""
    offsets, datums = list[str](), list[str]()
    for name, values in table.items():
        where, given = f"{above}work_offsets.{name}", dict(values)
        if (datum := given.pop("datum", None)) is not None:
            read_datum(str(datum), machine.names, f"{where}.datum")
            datums.append(f"{name}={datum}")
        for axis, value in given.items():
            if axis not in machine.names:
                raise UserError(f"{where}.{axis}: machine {machine.name} ({machine.chain}) has no axis {axis}")
            if isinstance(value, str):
                raise UserError(f"{where}.{axis}: expected a number, not {value!r}")
        if not given:
            raise UserError(f"{where}: expected the offset of each axis, {{ X = -30, Y = -20, Z = 150 }}")
        offsets.append(f"{name}={','.join(f'{axis}={value!r}' for axis, value in given.items())}")
    return tuple(offsets), tuple(datums)


def tools_in(table: Mapping[str, Any], above: str = "") -> tuple[str, ...]:
    """Tool lengths as options; UserError, with the entry, for one that cannot be used."""
    tools, found = list[str](), dict[str, str]()
    for name, length in table.items():
        where = f"{above}tools.{name}"
        number = entry(length, float, where)
        tools.append(f"T{name}={number!r}" if name.isdigit() else f"{name}={number!r}")
        try:
            tool, _ = parse_tool_length(tools[-1])
        except UserError as fault:
            raise UserError(f"{where}: {fault}") from None
        if other := found.get(tool):
            raise UserError(f"{where}: this is tool {other} again: give its length once")
        found[tool] = name
    return tuple(tools)


def map_in(name: str | None, folder: Path) -> tuple[str, ...]:
    """A height map of a file in this folder as the option."""
    return () if name is None else (str(folder / name),)


def of_program(
    set_up: Mapping[str, Any], program: str | Path, machine: Machine, own: OwnSetUp | None = None
) -> tuple[Mapping[str, Any], list[str]]:
    """The arguments of `ncomp.set_up` with the set-up of one program, and the names of the parts of that set-up.

    set_up: the arguments for all programs. own: the set-up in the entry of a job file, which replaces parts of the
    arguments. UserError where the file NAME.toml of the program contradicts the arguments or the entry.
    """
    beside, entered = set_up_beside(Path(program), machine), own or OwnSetUp()
    if not (beside.source or entered.source):
        return set_up, []
    names = set_up.keys() & {"work_offset", "datum", "tool_length"}
    given: dict[str, Any] = {name: tuple(texts(set_up[name])) for name in names}
    given["height_map"] = () if set_up.get("height_map") is None else (set_up["height_map"],)
    whole = joined(joined(OwnSetUp(**given), entered, machine, own_first=True), beside, machine, own_first=False)
    found = {name: getattr(whole, name) for name in names} | {"height_map": next(iter(whole.height_map), None)}
    return {**set_up, **found}, [*entered.names, *beside.names]


def joined(general: OwnSetUp, own: OwnSetUp, machine: Machine, *, own_first: bool) -> OwnSetUp:
    """The general set-up and that of one program together.

    own_first: a part that both give is taken from the program's; otherwise UserError where they differ.
    """

    def both(field: str, name: Callable[[str], str]) -> tuple[str, ...]:
        """One field of both, each part once; name: what a text of this field is for."""
        one, other = ({name(text): text for text in getattr(each, field)} for each in (general, own))
        for key in one.keys() & other.keys():
            if not own_first and one[key] != other[key]:
                option = field.replace("_", "-")
                raise UserError(
                    f"{own.source} gives {key} too, and differs from --{option} {one[key]}: give one of them"
                )
        return tuple((one | other).values())

    return OwnSetUp(
        both("work_offset", lambda text: parse_work_offset(text, machine)[0]),
        both("datum", lambda text: parse_datum(text, machine)[0]),
        both("tool_length", lambda text: parse_tool_length(text)[0]),
        both("height_map", lambda _: "a height map"),
        own.source or general.source,
    )
