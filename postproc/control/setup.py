"""The set-up that a program meets: work offsets and tools from the machine file, tables and options."""

from __future__ import annotations

import enum
import re
from collections.abc import Container, Iterable, Mapping
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import msgspec

from kinematics.effects import WorkpieceSurface
from kinematics.error_model.model import ErrorModel
from kinematics.files import read_input
from kinematics.files.mistaken import missing
from kinematics.machine import EVERY_OTHER, Machine, Probing
from kinematics.touch_off import Datum, read_datum
from kinematics.user_error import UserError
from postproc.control.block_skip import BlockSkip
from postproc.control.tool_table import ToolTable, is_number, shown_tool, tool_key
from postproc.text.number_style import given_number, given_once
from rendering.shown import Shown

NO_OFFSET = frozenset(("G53", "G500"))
"""Names of frames that are the machine's own: no work offset."""
T = TypeVar("T")


class Origin(enum.Enum):
    """Origin of a work offset or a tool length; the value is its text on screens."""

    GIVEN = ""
    """Options, a table of the control, or the machine file."""
    PROGRAM = "set by the program"
    ZERO = "--set-up-zero"
    ASSUMED = "assumed"
    """Assumed by the machine file, for all values that are not given."""


class Given(NamedTuple, Generic[T]):
    """A value with its origin."""

    value: T
    origin: Origin


class Setup(Shown, msgspec.Struct, frozen=True):
    """Offsets by name and tool lengths by number, as they are before a program runs on one machine.

    Options have priority over a tool table, and a tool table over the machine file. A value that is not given is zero
    if the user has requested zero, otherwise the value that the machine file assumes, otherwise missing.
    """

    machine: Machine
    """The machine."""
    work_offsets: Mapping[str, Mapping[str, float]] = msgspec.field(default_factory=dict)
    """Given for this run, by name and axis, mm or degrees."""
    tools: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Lengths given for this run, mm, by number or name."""
    given_tools: frozenset[str] = frozenset()
    """Numbers of tools whose lengths were given one by one, not in a table."""
    given_offsets: frozenset[str] = frozenset()
    """Names of work offsets that were given one by one, not in a table."""
    radii: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Tool radii, mm, by number or name; from a table."""
    datums: Mapping[str, Mapping[str, float]] = msgspec.field(default_factory=dict)
    """Lines of a datum table by number and axis, mm or degrees."""
    turned: Mapping[str, tuple[float, float, float]] = msgspec.field(default_factory=dict)
    """Work offsets that turn the coordinates, by name: degrees about X, Y, Z."""
    without_unit: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Files whose lengths are taken in mm because nothing states their unit, by `tool 5` or `offset G54`."""
    obtained: Mapping[str, Datum] = msgspec.field(default_factory=dict)
    """Datum entries of work offsets that are given for this run, by name."""
    probed: bool = False
    """All other work offsets were touched off on the machine; otherwise they are true."""
    zero: bool = False
    """Work offsets and tool lengths that nobody gave are zero on purpose (--set-up-zero)."""
    lengths_matter: bool = True
    """Some errors are rotations, so that the length of a tool matters also where no length offset is in force."""
    block_skip: BlockSkip = ""
    """Position of the block-skip switch."""
    start: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Position of axes when the program starts, mm or degrees, in the coordinates in force at its first move."""
    probing: Probing = ""
    """What the program's probing moves and cycles change."""
    pass_through: frozenset[str] = frozenset()
    """Constructs unknown to ncomp that pass unchanged, in capitals without blanks: G234, CYCLE977, FN33, CYCLDEF444."""
    surface: WorkpieceSurface | None = None
    """WorkpieceSurface of the workpiece, in machine coordinates, from a height map; None for a flat one."""
    surface_offset: str = ""
    """Work offset at which the map was probed; empty for machine coordinates."""
    surface_zero: float = 0.0
    """Machine position of Z from which the heights count, mm."""
    definitions: tuple[tuple[str, str], ...] = ()
    """Siemens: files of definitions of variables that the control has (GUD), by name and text."""
    subprograms: tuple[str, ...] = ()
    """Folders of programs that a program may call, in addition to its own folder."""
    correction_um: float | None = None
    """Largest correction that this run may make, um; None for that of the kind of machine."""

    @property
    def largest_correction_um(self) -> float:
        """Largest difference between a programmed position and the corrected one, um."""
        limit_um = self.correction_um
        return self.machine.priors.largest_correction_um if limit_um is None else limit_um

    @property
    def headline(self) -> str:
        """The result in a few words."""
        offsets, tools = ", ".join(self.work_offsets), ", ".join(map(str, self.tools))
        return f"{self.machine.name}, work offsets {offsets or 'none'}, tools {tools or 'none'}"

    def for_errors(self, *models: ErrorModel) -> Setup:
        """This set-up for the errors of these models."""
        matter = any(effect.angular for model in models for effect in model.effects)
        return msgspec.structs.replace(self, lengths_matter=matter)

    def datum(self, name: str) -> Datum:
        """Datum entry of a work offset; machine coordinates are true."""
        if name in NO_OFFSET:
            return Datum(probed=False)
        everywhere = self.machine.datums.get("default", Datum(self.probed))
        return self.obtained.get(name, self.machine.datums.get(name, everywhere))

    def datum_by_default(self, name: str) -> bool:
        """True for a work offset for which neither the user nor the machine file states how it was obtained."""
        return not {name, "default"} & self.machine.datums.keys() and name not in self.obtained

    def work_offset(self, name: str) -> Given[Mapping[str, float]] | None:
        """Work offset of a name by axis, mm or degrees; None where nobody gave it."""
        machine = self.machine
        return self._given(name, self.work_offsets, machine.work_offsets, machine.offsets_assumed, {})

    def tool_length(self, tool: int | str) -> Given[float] | None:
        """Length of a tool by number or name, mm, from the tool reference point to the tip; None where not given."""
        return self._given(tool_key(str(tool)), self.tools, self.machine.tools, self.machine.tools_assumed, 0.0)

    @property
    def usual_offset(self) -> str:
        """The only work offset that is given; G54 if there are several, or none."""
        given = {*self.work_offsets, *self.machine.work_offsets} - {EVERY_OTHER}
        return given.pop() if len(given) == 1 else "G54"

    def names_offset(self, name: str) -> bool:
        """True for a work offset that is given by its own name."""
        return name in self.work_offsets or name in self.machine.work_offsets

    def names_tool(self, tool: int | str) -> bool:
        """True for a tool whose length is given by its own number or name."""
        key = tool_key(str(tool))
        return key in self.tools or key in self.machine.tools

    def _given(
        self, name: str, own: Mapping[str, T], of_machine: Mapping[str, T], assumed: bool, zero: T
    ) -> Given[T] | None:
        if name in own:
            return Given(own[name], Origin.GIVEN)
        if name in of_machine and not assumed:
            return Given(of_machine[name], Origin.GIVEN)
        if self.zero:
            return Given(zero, Origin.ZERO)
        value = of_machine.get(name, of_machine.get(EVERY_OTHER))
        return None if value is None else Given(value, Origin.ASSUMED)

    def tool_radius(self, tool: int | str) -> float | None:
        """Radius of a tool by number or name, mm; None where no table gives it."""
        return self.radii.get(tool_key(str(tool)))


def construct(name: str) -> str:
    """The name of a code, cycle, call or function of a program, without blanks and in capitals."""
    return "".join(name.split()).upper()


def parse_work_offset(text: str, machine: Machine) -> tuple[str, dict[str, float]]:
    """`G54=10,20,-5` or `G54=10,20,-5,C=30` as name and offsets; UserError with the reason for any other form."""
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
            raise UserError(
                f"--work-offset {text}: machine {machine.name} has no axis {axis or 'for the fourth value'}: expected "
                "G54=x,y,z with '.' as the decimal point, and other axes by name, C=90"
            )
        if axis in offsets:
            raise UserError(f"--work-offset {text}: {axis} is given twice: give it once")
        offsets[axis] = given_number(number, f"--work-offset {text}")
    wanted = sum(axis in machine.names for axis in "XYZ")
    if 0 < unnamed < wanted:
        raise UserError(
            f"--work-offset {text}: expected G54=x,y,z, got {unnamed} of {wanted} values (or by name: G54=X=10)"
        )
    return "".join(name.split()).upper(), offsets


def parse_start(text: str, machine: Machine) -> dict[str, float]:
    """`X0,Y0,Z5,C=90` as positions by axis, mm or degrees; UserError with the reason for any other form."""
    found: dict[str, float] = {}
    for entry in filter(str.strip, text.split(",")):
        match = re.fullmatch(r"\s*([A-Za-z]\d*(?==)|[A-Za-z])\s*=?\s*(\S.*?)\s*", entry)
        axis = match[1].upper() if match else ""
        if match is None or axis not in machine.names:
            raise UserError(
                f"--start {text}: machine {machine.name} ({machine.chain}) has no axis {axis or entry.strip()!r}: "
                "expected X0,Y0,Z5 with '.' as the decimal point"
            )
        if axis in found:
            raise UserError(f"--start {text}: {axis} is given twice: give it once")
        found[axis] = given_number(match[2], f"--start {text}")
    return found


def parse_datum(text: str, machine: Machine) -> tuple[str, Datum]:
    """`G54=probed@C90,probe=120` as name and datum; UserError with the reason for any other form."""
    name, equals, obtained = text.partition("=")
    if not name.strip() or not equals:
        raise UserError(f"--datum {text}: expected e.g. G54=probed or G54=true")
    return "".join(name.split()).upper(), read_datum(obtained, machine.names, f"--datum {text}")


def parse_height_map(text: str) -> tuple[Path, str]:
    """The file of a height map, and its work offset, of `map.probe@G55`; the latter is empty where it is not given."""
    match = None if Path(text).exists() else re.fullmatch(r"(.+)@([A-Za-z]*[\d.]+)", text)
    return (Path(match[1]), match[2].upper()) if match else (Path(text), "")


def parse_tool_length(text: str) -> tuple[str, float]:
    """`T1=120.5` or `MILL_10=120.5` as number or name and length, mm; UserError with the reason for any other form."""
    given, _, value = text.rpartition("=")
    name = tool_key(given)
    if not name or not value.strip():
        raise UserError(f"--tool-length {text}: expected T1=mm, or NAME=mm for a tool that has a name")
    number = name.removeprefix("T")
    if number.startswith("-"):
        raise UserError(f"--tool-length {text}: the number of a tool is not negative")
    return tool_key(number) if is_number(number) else name, given_number(value, f"--tool-length {text}")


def _of_machine(table: ToolTable, machine: Machine) -> ToolTable:
    """The table; UserError for a work offset of an axis that the machine lacks."""
    for name, values in table.work_offsets.items():
        for axis, value in values.items():
            if axis not in machine.names and value:
                raise UserError(
                    f"tool table: work offset {name}, {axis} = {value:g}: machine {machine.name} has no axis "
                    f"{axis}: give the table of this machine, or delete the value"
                )
    return table


def make_setup(
    machine: Machine,
    work_offsets: Iterable[str] = (),
    tool_lengths: Iterable[str] = (),
    table: ToolTable | None = None,
    datums: Iterable[str] = (),
    *,
    probed: bool = False,
    zero: bool = False,
    block_skip: BlockSkip = "",
    start: str = "",
    probing: Probing = "",
    pass_through: Iterable[str] = (),
    subprograms: Iterable[str | Path] = (),
    definitions: Iterable[str | Path] = (),
) -> Setup:
    """The setup from the options of the command line and a tool table; work offsets are true unless `probed`."""
    table = _of_machine(table or ToolTable(), machine)
    given = given_once((parse_work_offset(text, machine) for text in work_offsets), "--work-offset ")
    lengths = _lengths(tool_lengths)
    return Setup(
        machine,
        {**table.work_offsets, **given},
        {**table.tools, **lengths},
        given_tools=frozenset(lengths),
        given_offsets=frozenset(given),
        radii=table.radii,
        datums=table.datums,
        turned=table.turned,
        without_unit=_without_unit(table, lengths, given),
        obtained=given_once((parse_datum(text, machine) for text in datums), "--datum "),
        probed=probed,
        zero=zero,
        block_skip=block_skip or machine.control.block_skip,
        start=parse_start(start or machine.control.start, machine),
        probing=probing or machine.control.probing,
        pass_through=frozenset(map(construct, (*machine.control.pass_through, *pass_through))),
        subprograms=tuple(map(_folder, subprograms)),
        definitions=_texts(definitions),
    )


def _lengths(texts: Iterable[str]) -> dict[str, float]:
    """The lengths of tools; UserError for one that is given twice."""
    named = [parse_tool_length(text) for text in texts]
    given_once(((shown_tool(tool), length) for tool, length in named), "--tool-length ")
    return dict(named)


def _without_unit(table: ToolTable, lengths: Container[str], offsets: Container[str]) -> dict[str, str]:
    """Files without a unit, by the tools and offsets of a table that are not given one by one."""
    return {
        name: path
        for name, path in table.without_unit.items()
        if name.removeprefix("tool ") not in lengths and name.removeprefix("offset ") not in offsets
    }


def _texts(paths: Iterable[str | Path]) -> tuple[tuple[str, str], ...]:
    """The names and texts of files."""
    read = ((str(path), read_input(Path(path), "definitions").decode("latin-1")) for path in paths)
    return tuple((name, text.removeprefix("\xef\xbb\xbf")) for name, text in read)


def _folder(name: str | Path) -> str:
    """A folder of subprograms; UserError for one that is not there."""
    if not str(name) or not Path(name).is_dir():
        why = "this is a file: give its folder" if Path(name).is_file() else f"No such folder{missing(name)}"
        raise UserError(f"--subprograms {name or repr('')}: {why}")
    return str(name)
