"""Common options of commands that read NC programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import ncomp
from postproc.commands.options.declared import argument, option

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.compensation.conditions import Conditions
    from postproc.control.setup import Setup
    from postproc.motion.motions import Motions


def _dialect_names() -> list[str]:
    from postproc.dialects import NAMES

    return list(NAMES)


Program = Annotated[str, argument("NC program; `-` is standard input.", "IN.nc")]
Programs = Annotated[tuple[str, ...], argument("NC program, or several; `-` is standard input.", "IN.nc")]
NoTravelCheck = Annotated[
    bool, option("Report positions outside the travel of an axis as notes, and do not refuse them.", default=False)
]


@dataclass(frozen=True, kw_only=True)
class ToolOptions:
    """Tools of the control."""

    tool_length: tuple[str, ...] = option("Length of a tool, mm.", "T1=mm")
    tool_table: tuple[Path, ...] = option("Table of tools, presets or datums of a control.", "FILE")
    table_unit: Literal["mm", "inch"] | None = option(
        "Unit of the lengths in a table that contains none. Default: that of the machine file, or mm."
    )
    set_up_zero: bool = option("Use zero for every work offset and tool length that is not given.", default=False)

    def set_up(self, machine: Machine, **more: Sequence[str]) -> Setup:
        """The set-up of the control; more: the other arguments of `ncomp.set_up`. UserError for an unusable option."""
        return ncomp.set_up(
            machine,
            tool_length=self.tool_length,
            tool_table=self.tool_table,
            table_unit=self.table_unit,
            zero=self.set_up_zero,
            **more,
        )


@dataclass(frozen=True, kw_only=True)
class SetUpOptions(ToolOptions):
    """Dialect of a program, and work offsets and tools of the control."""

    dialect: str = option(
        "Dialect of the program.", "auto|iso|siemens|heidenhain", default="auto", complete=_dialect_names
    )
    work_offset: tuple[str, ...] = option(
        "Work offset, mm; with rotary axes, degrees: `G54=-30,-20,150,C=90`.", "G54=x,y,z"
    )
    pass_through: str | None = option(
        "Codes, cycles, calls and functions unknown to ncomp that pass unchanged, because on this control they move "
        "nothing and change no mode: G234,CYCLE977,FN33.",
        "NAME,...",
    )

    def setup(self, machine: Machine) -> Setup:
        """The set-up of the control; UserError for an option that cannot be used."""
        return self.set_up(machine, work_offset=self.work_offset, pass_through=self.passing)

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

    def setup(self, machine: Machine) -> Setup:
        """The set-up of the control; UserError for an option that cannot be used."""
        return self.set_up(machine, work_offset=self.work_offset, pass_through=self.passing, datum=self.datum)


@dataclass(frozen=True, kw_only=True)
class ConditionsOptions:
    """Conditions of the machine while the program runs."""

    temperature: tuple[str, ...] = option("Temperature of a sensor while the program runs: spindle=31.5.", "NAME=degC")
    elapsed: float | None = option("Time from the zero of the thermal effects to the program's start, s.", "s")
    log: Path | None = option("Log with columns time_s and temp_NAME, degC, up to the program's start.", "FILE.csv")

    def conditions(self) -> Conditions:
        """The conditions; UserError for an option that cannot be used."""
        return ncomp.conditions(temperature=self.temperature, elapsed=self.elapsed, log=self.log)


def moves_of(program: str, machine: Machine, setup: Setup, dialect: str) -> Motions:
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
    motions = merged(list(run_motions(source, language, interpreter)))
    say_assumed(interpreter.control_state.assumption())
    return motions
