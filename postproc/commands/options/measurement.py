"""Common options of commands that read measured data, and the reading itself with its notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import option

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
    ),
]

Noise = Annotated[
    Literal["sheet", "estimate"],
    option(
        "Instrument's uncertainty: by its specification unless the residuals contradict it, or estimated from them.",
        default="sheet",
    ),
]

Force = Annotated[
    bool,
    option("Write the calibration although too many rows disagree, or it predicts no better.", default=False),
]


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """The form of files with measured data."""

    format: str = option(
        "Format of the data: auto, ncomp, rtl, iso230-table, ecmc-report, cmm, epics, twincat-scope, ballbar-angles, "
        "robot, delimited.",
        default="auto",
        complete=_formats,
    )
    header: HeaderLines
    columns: str | None = option(
        "Column map of a delimited export: spatialanalyzer, polyworks, leica, or a file.", "MAP.toml", complete=_maps
    )
    plan: Path | None = option(
        "Axis positions of the data: by the names of points, by the standstills in a log, or a robot's joints.",
        "PLAN.csv",
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
            header = header_of(self.header)
            each.append(
                ncomp.read_measurement(
                    path, machine, format=self.format, header=header, columns=self.columns, plan=self.plan
                )
            )
            for note in each[-1].notes:
                say("note", note)
        return each


def header_of(lines: Sequence[str]) -> dict[str, str]:
    """Lines `KEY=VALUE` as a header; UserError for another form, and for a key that is given twice."""
    header: dict[str, str] = {}
    for line in lines:
        key, equals, value = (part.strip() for part in line.partition("="))
        if not (key and equals and value):
            raise UserError(f"--header {line}: expected KEY=VALUE, as in u_um=0.3")
        if key in header:
            raise UserError(f"--header {line}: {key} is given twice: give it once")
        header[key] = value
    return header
