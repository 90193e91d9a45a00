"""How commands read NC programs: their common options, and the set-up that these make."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.motion.motions import Motions


def _dialect_names() -> list[str]:
    from postproc.dialects import NAMES

    return list(NAMES)


Program = Annotated[str, typer.Argument(metavar="IN.nc", help="NC program; - for standard input.")]
DialectName = Annotated[
    str, typer.Option("--dialect", help="auto, iso, siemens or heidenhain.", autocompletion=_dialect_names)
]
WorkOffsets = Annotated[
    list[str] | None,
    typer.Option("--work-offset", metavar="G54=x,y,z", help="Work offset, mm; rotary: G54=x,y,z,C=deg. Repeatable."),
]
ToolLengths = Annotated[
    list[str] | None, typer.Option("--tool-length", metavar="T1=mm", help="Length of a tool. Repeatable.")
]
ToolTable = Annotated[
    list[Path] | None,
    typer.Option("--tool-table", metavar="FILE", help="Table of tools, presets or datums of a control. Repeatable."),
]
Datums = Annotated[
    list[str] | None,
    typer.Option(
        "--datum",
        metavar="G54=probed|true",
        help="How a work offset was obtained: touched off on the machine (G54=probed, G54=probed@C90,probe=120: "
        "machine position, length of the probe), or G54=true. Repeatable.",
    ),
]
SetUpZero = Annotated[
    bool,
    typer.Option("--set-up-zero", help="Take zero on purpose for work offsets and tool lengths that are not given."),
]
NoTravelCheck = Annotated[bool, typer.Option("--no-travel-check", help="Only note positions outside an axis' travel.")]
Temperatures = Annotated[
    list[str] | None,
    typer.Option("--temperature", metavar="NAME=degC", help="Of a sensor, while the program runs. Repeatable."),
]
Elapsed = Annotated[
    float | None,
    typer.Option("--elapsed", metavar="s", help="Since time zero of thermal effects, when the program starts."),
]
ConditionsLog = Annotated[
    Path | None,
    typer.Option("--log", metavar="FILE.csv", help="Columns time_s and temp_NAME, degC, up to the program's start."),
]


def setup_of(
    machine: Machine,
    offsets: list[str] | None,
    lengths: list[str] | None,
    tables: list[Path] | None,
    datums: list[str] | None = None,
    *,
    zero: bool = False,
) -> Setup:
    """The set-up of the control from the options; UserError for an option that can't be used.

    A work offset was touched off on the machine, unless the user or the machine file calls it true.
    """
    from postproc.control.setup import make_setup
    from postproc.tool_tables import read_tool_tables

    table = read_tool_tables(tables or ())
    return make_setup(machine, offsets or (), lengths or (), table, datums or (), probed=True, zero=zero)


def moves_of(program: str, dialect: str, machine: Machine, setup: Setup) -> Motions:
    """All moves of a program; prints the part of the set-up that is assumed."""
    from postproc.commands.show.terminal import say_assumed
    from postproc.correct.verify import run_motions
    from postproc.dialects import find_dialect
    from postproc.motion.motions import merged
    from postproc.text.notes import Notes
    from postproc.text.source import open_source

    source = open_source(program)
    language = find_dialect(dialect, source.name, source.text_head)
    interpreter = language.interpreter(machine, setup, Notes())
    motions = merged(run_motions(source, language, interpreter))
    say_assumed(interpreter.control_state.assumption())
    return motions
