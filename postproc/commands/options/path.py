"""Common options of commands that read the path of a program, and readings along it; results of such data."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import option, refuse_given
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.program import SetUpOptions

if TYPE_CHECKING:
    from calibration.on_the_fly.along_path import OnTheFly
    from calibration.on_the_fly.nominal_path import NominalPath
    from kinematics.machine import Machine
    from postproc.control.setup import Setup

Reversal = Literal["none", "constant", "curves"]


@dataclass(frozen=True, kw_only=True)
class OnTheFlyOptions:
    """Data that were taken while the machine moved."""

    PANEL: ClassVar[str] = "Data taken on the fly"

    path: str | None = option(
        "NC program that ran while the tracker followed; the data then have columns time_s,x,y,z"
        "[,target][,station][,run].",
        "PATH.nc",
        reads=True,
    )
    cell_mm: float | None = option(
        "Length of the cells of the path, mm; the readings in a cell are averaged. Default 4.", "mm", min=0.1
    )
    corner_mm: float = option(
        "Length of path before and after a corner whose readings are left out, mm.", "mm", default=5.0, min=0.0
    )
    reversal: Reversal = option(
        "Errors that depend on the direction of motion: none, backlash and a constant of each error motion, or curves.",
        default="none",
    )

    def check(self, data: DataOptions, set_up: SetUpOptions) -> None:
        """UserError for options of data taken on the fly without a path, and for a plan together with a path."""
        if self.path is None:
            reason = "is for data taken on the fly: give --path PATH.nc too"
            refuse_given(reason, self, "cell_mm", "reversal")
            refuse_given(reason, self, "corner_mm")
            refuse_given(reason, set_up, *(each.name for each in fields(set_up)))
        elif data.plan is not None:
            raise UserError(
                "--plan is for measurements at standstill, --path for data taken on the fly: give one of them"
            )

    def read(self, readings: Path, path: NominalPath, data: DataOptions) -> OnTheFly:
        """Readings along a path as a measurement; shows their notes."""
        from postproc.commands.show.terminal import console, say

        with console.status("reading") as status:
            taken = ncomp.read_on_the_fly(
                readings,
                path,
                format=data.format,
                header=data.header,
                columns=data.columns,
                log=data.log,
                log_columns=data.log_columns,
                cell_mm=self.cell_mm,
                corner_mm=self.corner_mm,
                progress=status.update,
            )
        for note in taken.notes:
            say("note", note)
        return taken


def read_path(program: str, machine: Machine, setup: Setup, dialect: str = "auto") -> NominalPath:
    """The path of a program; shows its notes. UserError for a construct that cannot be followed."""
    from postproc.commands.show.terminal import say

    found = ncomp.read_path(program, machine, setup=setup, dialect=dialect)
    for note in found.notes:
        say("note", note)
    return found
