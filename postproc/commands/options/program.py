"""Common options of commands that read NC programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import ncomp
from postproc.commands.options.declared import SET_UP, argument, option

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.compensation.conditions import Conditions
    from postproc.control.setup import Setup
    from postproc.motion.motions import Motions


def _dialect_names() -> list[str]:
    from postproc.dialects import NAMES

    return list(NAMES)


def _file_of_map(given: str | None) -> Path | None:
    """The file of a height map."""
    from postproc.control.setup import parse_height_map

    return None if given is None else parse_height_map(given)[0]


def folders_of(named: str | None) -> list[Path]:
    """Folders in a list with commas."""
    return [Path(each) for each in named.split(",")] if named is not None else []


Program = Annotated[str, argument("NC program; `-` is standard input.", "IN.nc", reads=True)]
OptionalProgram = Annotated[
    str | None, argument("NC program; `-` is standard input.", "IN.nc", default=None, reads=True)
]
Programs = Annotated[tuple[str, ...], argument("NC program, or several; `-` is standard input.", "IN.nc", reads=True)]
NoTravelCheck = Annotated[
    bool,
    option(
        "Report positions outside the travel of an axis as notes, and do not refuse them.", default=False, panel=SET_UP
    ),
]


@dataclass(frozen=True, kw_only=True)
class ToolOptions:
    """Tools of the control."""

    PANEL: ClassVar[str] = SET_UP

    tool_length: tuple[str, ...] = option("Length of a tool, mm.", "T1=mm")
    tool_table: tuple[Path, ...] = option("Table of tools, presets or datums of a control.", "FILE", reads=True)
    table_unit: Literal["mm", "inch"] | None = option(
        "Unit of the lengths in a table that contains none. Default: that of the machine file, or mm."
    )
    set_up_zero: bool = option("Use zero for every work offset and tool length that is not given.", default=False)

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of `ncomp.set_up`."""
        return {
            "tool_length": self.tool_length,
            "tool_table": self.tool_table,
            "table_unit": self.table_unit,
            "zero": self.set_up_zero,
        }

    def setup(self, machine: Machine) -> Setup:
        """The set-up of the control; UserError for an option that cannot be used."""
        return ncomp.set_up(machine, **self.arguments)


@dataclass(frozen=True, kw_only=True)
class SetUpOptions(ToolOptions):
    """Dialect of a program, and work offsets and tools of the control."""

    dialect: str = option(
        "Dialect of the program.", "auto|iso|siemens|heidenhain", default="auto", complete=_dialect_names
    )
    work_offset: tuple[str, ...] = option(
        "Work offset, mm; with rotary axes, degrees: `G54=-30,-20,150,C=90`.", "G54=x,y,z"
    )
    block_skip: Literal["on", "off"] | None = option(
        "Position of the block-skip switch: with `on`, blocks with a slash do not run. Default: that of the machine "
        "file; without it a program in which it matters is refused."
    )
    start: str | None = option(
        "Position of the axes when the program starts, mm and degrees, in the coordinates that are in force at its "
        "first move: for programs that begin with increments.",
        "X0,Y0,Z5",
    )
    probing: Literal["beside"] | None = option(
        "With `beside`, probing moves and cycles of the program pass: what they find changes no coordinate of its "
        "contour, and offsets that they set are those of the set-up. Default: that of the machine file; without it "
        "such programs are refused."
    )
    pass_through: str | None = option(
        "Codes, cycles, calls and functions unknown to ncomp that pass unchanged, because on this control they move "
        "nothing and change no mode: G234,CYCLE977,FN33.",
        "NAME,...",
    )

    definitions: tuple[Path, ...] = option(
        "File that defines variables of a Siemens control (GUD): `DEF CHAN REAL LAYER[3]`.", "FILE", reads=True
    )
    subprograms: str | None = option(
        "Folders of programs that the program calls, in addition to its own folder.", "DIR,...", reads=folders_of
    )

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of `ncomp.set_up`."""
        own = {
            "work_offset": self.work_offset,
            "block_skip": self.block_skip,
            "start": self.start,
            "probing": self.probing,
            "pass_through": self.passing,
            "subprograms": () if self.subprograms is None else tuple(self.subprograms.split(",")),
            "definitions": self.definitions,
        }
        return super().arguments | own

    def setup_of(self, program: str | Path, machine: Machine) -> Setup:
        """The set-up of the control, completed by the file next to a program."""
        from postproc.folders.own_set_up import of_program

        return ncomp.set_up(machine, **of_program(self.arguments, program, machine)[0])

    @property
    def passing(self) -> list[str]:
        """The names of `--pass-through`."""
        return [name for name in (self.pass_through or "").split(",") if name.strip()]


@dataclass(frozen=True, kw_only=True)
class DatumOptions(SetUpOptions):
    """Dialect of a program, work offsets with the method by which they were obtained, and tools of the control."""

    datum: tuple[str, ...] = option(
        "Origin of a work offset: probed on the machine (G54=probed; with machine position and probe length, mm, "
        "G54=probed@C90,probe=120), or free of machine errors (G54=true). Default: probed.",
        "G54=probed|true",
    )

    height_map: str | None = option(
        "Height map of the workpiece (docs/height_maps.md), and the work offset at which it was probed; default: the "
        "only one that is given, or G54.",
        "FILE[@G55]",
        reads=_file_of_map,
    )

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of `ncomp.set_up`."""
        return super().arguments | {"datum": self.datum, "height_map": self.height_map}


@dataclass(frozen=True, kw_only=True)
class CorrectionOptions:
    """Extent and limits of the correction, by the names of the public interface."""

    PANEL: ClassVar[str] = "Correction"

    classes: str | None = option("ISO/TR 16907 classes of errors to correct; default: all but FOR.", "L-VOL,R-VOL,...")
    tolerance_um: float = option(
        "Largest deviation of a feed move from its path, um; moves that deviate more are split.",
        "um",
        default=1.0,
        min=0.0,
    )
    max_correction_um: float | None = option(
        "Largest correction of a linear axis, um; a program that needs more is refused. Default: twice the "
        "calibration's largest error, at most 500.",
        "um",
        min=0.0,
        max=5000.0,
    )
    accept: str | None = option(
        "Implausible conditions to accept: stale, future, temperature, outside, insignificant, worse (docs/safety.md).",
        "NAME,...",
    )
    rotary_feed: Literal["leave", "inverse-time", "scaled"] | None = option(
        "Feed moves of rotary axes alone: left without a correction, or corrected in the programmed time, by G93 or by "
        "an F for X Y Z; default: the entry of the machine file, else leave.",
        "leave|inverse-time|scaled",
    )
    tcp: Literal["to-axes", "to-tcp"] | None = option(
        "Write a program of the tool point (G43.4, TRAORI, M128) as positions of the axes, for a control without TCP; "
        "or the reverse. With `--calibration none` by the machine file alone.",
    )
    tcp_feed: Literal["inverse-time", "scaled"] | None = option(
        "Feed of converted moves: by G93, or by an F for the new path; default: G93 for positions of the axes, an F in "
        "Klartext and for the tool point.",
    )
    outside: Literal["refuse", "leave"] = option(
        "Moves outside the range for which the calibration was measured: the program is refused, or they stay as "
        "programmed and are listed.",
        default="refuse",
    )
    unroll: bool = option("Write out loops and calls: each block as many times as it runs.", default=False)
    force: bool = option("Correct a program that ncomp has already corrected.", default=False)


@dataclass(frozen=True, kw_only=True)
class ConditionsOptions:
    """Conditions of the machine while the program runs."""

    PANEL: ClassVar[str] = SET_UP

    temperature: tuple[str, ...] = option("Temperature of a sensor while the program runs: spindle=31.5.", "NAME=degC")
    elapsed: float | None = option("Time from the zero of the thermal effects to the program's start, s.", "s")
    log: Path | None = option(
        "Log with columns time_s or time (time stamps), and temp_NAME, degC, up to the program's start.",
        "FILE.csv",
        reads=True,
    )
    log_columns: Path | None = option("Column map of a log with other columns.", "MAP.toml", reads=True)

    def conditions(self) -> Conditions:
        """The conditions; UserError for an option that cannot be used."""
        return ncomp.conditions(**vars(self))


def moves_of(program: str, machine: Machine, setup: Setup, dialect: str) -> Motions:
    """All moves of a program; prints the part of the set-up that is assumed."""
    from postproc.commands.show.terminal import say_assumed
    from postproc.dialects import find_dialect
    from postproc.text.source import open_source
    from postproc.verification.verify import assumed_motions

    source = open_source(program)
    language = find_dialect(dialect, source.name, source.text_head)
    motions, assumption = assumed_motions(source, language, machine, setup)
    say_assumed(assumption)
    return motions
