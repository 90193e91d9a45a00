"""Common options of commands that read measured data, and the reading itself with its notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import ncomp
from postproc.commands.options.declared import DATA, MODEL, option
from postproc.commands.options.files import file_if_there

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from kinematics.machine import Machine


def _formats() -> list[str]:
    from calibration.measurement.readers import FORMATS

    return list(FORMATS)


def _maps() -> list[str]:
    from calibration.measurement.readers.delimited import map_names

    return map_names()


HeaderLines = Annotated[
    tuple[str, ...],
    option(
        "Entry that the data lack, by a key of the measurement file: u_um=0.3, axis=X, target.t1='0 0 -120'.",
        "KEY=VALUE",
        panel=DATA,
    ),
]

Noise = Annotated[
    Literal["sheet", "estimate"],
    option(
        "Instrument's uncertainty: by its specification unless the residuals contradict it, or estimated from them.",
        default="sheet",
        panel=MODEL,
    ),
]

Force = Annotated[
    bool,
    option(
        "Write the calibration although too many rows disagree, or it predicts no better.", default=False, panel=MODEL
    ),
]


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """The form of files with measured data."""

    PANEL: ClassVar[str] = DATA

    format: str = option(
        "Format of the data: auto, ncomp, rtl, iso230-table, ecmc-report, cmm, epics, twincat-scope, ballbar-angles, "
        "target-readings, robot, delimited.",
        default="auto",
        complete=_formats,
    )
    header: HeaderLines
    columns: str | None = option(
        "Column map of a delimited export: spatialanalyzer, polyworks, leica, or a file.",
        "MAP.toml",
        complete=_maps,
        reads=file_if_there,
    )
    plan: Path | None = option(
        "Axis positions of the data: by the names of points, by the standstills in a log, or a robot's joints.",
        "PLAN.csv",
        reads=True,
    )
    measured: str | None = option(
        "Date of the measurement, where the data do not state it: the validity of a calibration begins then. With the "
        "time of second 0 for a log of time stamps.",
        "'YYYY-MM-DD HH:MM:SS'",
    )
    log: Path | None = option(
        "Temperatures by time (time_s, or time with time stamps, and temp_NAME), joined to the rows of the data.",
        "FILE.csv",
        reads=True,
    )
    log_columns: Path | None = option("Column map of a log with other columns.", "MAP.toml", reads=True)

    @property
    def entries(self) -> tuple[str, ...]:
        """Entries that the data lack, with the date of the measurement."""
        return self.header if self.measured is None else (*self.header, f"measured={self.measured}")

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files that are read besides the data."""
        return (self.plan, self.log, self.log_columns)

    def note_date(self, measurements: Sequence[Measurement]) -> None:
        """Note for the user where a calibration is made from data without a date."""
        from postproc.commands.show.terminal import say

        if any(each.measured is None and not each.simulated for each in measurements):
            say(
                "note",
                "the data state no date of the measurement: the validity of the calibration begins today; --measured "
                "YYYY-MM-DD states the date",
            )

    def read(self, paths: Sequence[Path], machine: Machine) -> Measurement:
        """The measurement in a file, or in several as one; shows the notes of each."""
        from calibration.measurement.joining import joined

        return joined(self._each(paths, machine))

    def by_instrument(self, paths: Sequence[Path], machine: Machine) -> list[Measurement]:
        """The measurements in files, those by the same instrument as one; shows the notes of each file."""
        from calibration.measurement.joining import by_instrument

        return by_instrument(self._each(paths, machine))

    def _each(self, paths: Sequence[Path], machine: Machine) -> list[Measurement]:
        from postproc.commands.show.terminal import say

        each = []
        for path in paths:
            each.append(
                ncomp.read_measurement(
                    path,
                    machine,
                    format=self.format,
                    header=self.entries,
                    columns=self.columns,
                    plan=self.plan,
                    log=self.log,
                    log_columns=self.log_columns,
                )
            )
            for note in each[-1].notes:
                say("note", note)
        return each
