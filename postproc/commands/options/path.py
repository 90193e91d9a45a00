"""Common options of commands that read the path of a program, and readings along it; results of such data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from kinematics.user_error import UserError
from postproc.commands.options.declared import option, refuse_given
from postproc.commands.options.measurement import DataOptions, header_of
from postproc.commands.options.program import SetUpOptions

if TYPE_CHECKING:
    from calibration.on_the_fly.along_path import OnTheFly
    from calibration.on_the_fly.nominal_path import NominalPath
    from kinematics.machine import Machine
    from postproc.control.setup import Setup


@dataclass(frozen=True, kw_only=True)
class OnTheFlyOptions:
    """Data that were taken while the machine moved."""

    PANEL: ClassVar[str] = "Data taken on the fly"

    path: str | None = option(
        "NC program that ran while the tracker followed; the data then have columns time_s,x,y,z"
        "[,target][,station][,run].",
        "PATH.nc",
    )
    cell_mm: float | None = option(
        "Length of the cells of the path, mm; the readings in a cell are averaged. Default 4.", "mm", min=0.1
    )
    corner_mm: float = option(
        "Length of path before and after a corner whose readings are left out, mm.", "mm", default=5.0, min=0.0
    )
    reversal: Literal["none", "constant", "curves"] = option(
        "Errors that depend on the direction of motion: none, backlash and a constant of each error motion, or curves.",
        default="none",
    )

    def check(self, data: DataOptions, set_up: SetUpOptions) -> None:
        """UserError for options of data taken on the fly without a path, and for a plan together with a path."""
        if self.path is None:
            reason = "is for data taken on the fly: give --path PATH.nc too"
            refuse_given(reason, self, "cell_mm", "reversal")
            refuse_given(reason, set_up, "work_offset", "tool_length", "set_up_zero")
        elif data.plan is not None:
            raise UserError(
                "--plan is for measurements at standstill, --path for data taken on the fly: give one of them"
            )

    def read(self, readings: Path, path: NominalPath, data: DataOptions) -> OnTheFly:
        """Readings along a path as a measurement; shows their notes."""
        from calibration.measurement.readers import table_in
        from calibration.on_the_fly.along_path import on_path
        from calibration.on_the_fly.corrected_positions import with_corrected_positions
        from calibration.on_the_fly.readings import read_readings
        from postproc.commands.show.terminal import console, say

        header = header_of(data.header)
        table, notes = table_in(readings, path.machine, data.format, header=header, columns=data.columns)
        read = read_readings(table, path.machine)
        for note in (*notes, *read.notes):
            say("note", note)
        with console.status("reading") as status:
            taken = on_path(read, path, cell_mm=self.cell_mm, corner_mm=self.corner_mm, progress=status.update)
            status.update("positions of the readings on the path")
            return replace(taken, measurement=with_corrected_positions(taken))


def read_path(program: str, machine: Machine, setup: Setup, dialect: str = "auto") -> NominalPath:
    """The path of a program; shows its notes. UserError for a construct that cannot be followed."""
    from calibration.on_the_fly.nominal_path import NominalPath
    from postproc.commands.show.terminal import say
    from postproc.dialects import find_dialect
    from postproc.program_path import program_path
    from postproc.text.source import open_source

    source = open_source(program)
    found = program_path(source, find_dialect(dialect, source.name, source.text_head), machine, setup)
    for note in found.notes:
        say("note", note)
    return NominalPath(machine, found.positions, found.length, found.counts, source.name, source.hash)
