"""Common options of commands that read NC programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import ncomp

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.compensation.conditions import Conditions
    from postproc.control.setup import Setup
    from postproc.motion.motions import Motions


def _dialect_names() -> list[str]:
    from postproc.dialects import NAMES

    return list(NAMES)


Program = Annotated[str, typer.Argument(metavar="IN.nc", help="NC program; - for standard input.")]
DialectName = Annotated[
    str, typer.Option("--dialect", help="auto, iso, siemens or heidenhain.", autocompletion=_dialect_names)
]
NoTravelCheck = Annotated[bool, typer.Option("--no-travel-check", help="Only note positions outside an axis' travel.")]


@dataclass(frozen=True, kw_only=True)
class _WorkOffsets:
    work_offset: Annotated[
        list[str] | None,
        typer.Option(
            "--work-offset", metavar="G54=x,y,z", help="Work offset, mm; rotary: G54=x,y,z,C=deg. Repeatable."
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class _Datums(_WorkOffsets):
    datum: Annotated[
        list[str] | None,
        typer.Option(
            "--datum",
            metavar="G54=probed|true",
            help="How a work offset was obtained: touched off on the machine (G54=probed, G54=probed@C90,probe=120: "
            "machine position, length of the probe), or G54=true. Repeatable.",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class ToolOptions:
    """Tools of the control."""

    tool_length: Annotated[
        list[str] | None, typer.Option("--tool-length", metavar="T1=mm", help="Length of a tool. Repeatable.")
    ] = None
    tool_table: Annotated[
        list[Path] | None,
        typer.Option(
            "--tool-table", metavar="FILE", help="Table of tools, presets or datums of a control. Repeatable."
        ),
    ] = None
    set_up_zero: Annotated[
        bool,
        typer.Option(
            "--set-up-zero", help="Take zero on purpose for work offsets and tool lengths that are not given."
        ),
    ] = False

    @property
    def files(self) -> list[Path]:
        """The tables that are read."""
        return self.tool_table or []

    def set_up(self, machine: Machine, work_offset: Sequence[str] = (), datum: Sequence[str] = ()) -> Setup:
        """The set-up of the control; UserError for an option that can't be used."""
        return ncomp.set_up(
            machine,
            work_offset=work_offset,
            tool_length=self.tool_length or (),
            tool_table=self.files,
            datum=datum,
            zero=self.set_up_zero,
        )


@dataclass(frozen=True, kw_only=True)
class SetUpOptions(ToolOptions, _WorkOffsets):
    """Work offsets and tools of the control."""

    def setup(self, machine: Machine) -> Setup:
        """The set-up of the control; UserError for an option that can't be used."""
        return self.set_up(machine, self.work_offset or ())


@dataclass(frozen=True, kw_only=True)
class DatumOptions(ToolOptions, _Datums):
    """Work offsets, the method by which they were obtained, and tools of the control."""

    def setup(self, machine: Machine) -> Setup:
        """The set-up of the control; UserError for an option that can't be used."""
        return self.set_up(machine, self.work_offset or (), self.datum or ())


@dataclass(frozen=True, kw_only=True)
class ConditionsOptions:
    """The machine's conditions while the program runs."""

    temperature: Annotated[
        list[str] | None,
        typer.Option("--temperature", metavar="NAME=degC", help="Of a sensor, while the program runs. Repeatable."),
    ] = None
    elapsed: Annotated[
        float | None,
        typer.Option("--elapsed", metavar="s", help="Since time zero of thermal effects, when the program starts."),
    ] = None
    log: Annotated[
        Path | None,
        typer.Option(
            "--log", metavar="FILE.csv", help="Columns time_s and temp_NAME, degC, up to the program's start."
        ),
    ] = None

    def conditions(self) -> Conditions:
        """The conditions; UserError for an option that can't be used."""
        return ncomp.conditions(temperature=self.temperature or (), elapsed=self.elapsed, log=self.log)


def moves_of(program: str, dialect: str, machine: Machine, setup: Setup) -> Motions:
    """All moves of a program; prints the part of the set-up that is assumed."""
    from postproc.commands.show.terminal import say_assumed
    from postproc.dialects import find_dialect
    from postproc.motion.motions import merged
    from postproc.text.notes import Notes
    from postproc.text.source import open_source
    from postproc.verification.verify import run_motions

    source = open_source(program)
    language = find_dialect(dialect, source.name, source.text_head)
    interpreter = language.interpreter(machine, setup, Notes())
    motions = merged(run_motions(source, language, interpreter))
    say_assumed(interpreter.control_state.assumption())
    return motions
