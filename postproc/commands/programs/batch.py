"""`ncomp batch`: every program of a folder corrected into another folder."""

from __future__ import annotations

from pathlib import Path

from postproc.commands.options.declared import argument, option
from postproc.commands.options.program import ConditionsOptions, DatumOptions, NoTravelCheck
from postproc.commands.options.shared import (
    CalibrationName,
    DaskAddress,
    MachineName,
    ResultOptions,
)
from postproc.commands.programs.request import CorrectionOptions, Request

EPILOG = (
    "Examples:\n\n"
    "`ncomp batch posted corrected --machine dmu50`\n\n"
    "`ncomp batch posted corrected --machine mill.toml --calibration cal.json --work-offset G54=12.5,-80,210 "
    "--tool-table tools.tbl --jobs 8 --json summary.json`\n\n"
    "`ncomp batch posted corrected --machine dmu50 --glob '*.txt' --glob 'O[0-9]*'`  programs with other names\n\n"
    "`ncomp batch posted corrected --machine dmu50 --dask tcp://scheduler:8786`  on the workers of a Dask cluster"
)


def batch(
    *,
    folder: Path = argument("Folder of NC programs, with its subfolders.", "IN"),
    output: Path = argument("Folder of the corrected programs, with the same subfolders and names.", "OUT"),
    machine: MachineName,
    calibration: CalibrationName,
    glob: tuple[str, ...] = option("Pattern of the programs' names instead of the usual suffixes.", "PATTERN"),
    jobs: int | None = option("Number of processes; default: one for each core.", "N", "-j", min=1),
    dask: DaskAddress,
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck,
    correction: CorrectionOptions,
    at: ConditionsOptions,
    others: ResultOptions,
) -> None:
    """Correct every program of a folder, each as `ncomp correct` does, over several processes or a Dask cluster.

    Each output is written whole or not at all. A program that is refused does not stop the others: it is listed with
    file, line and reason, and the exit status is 2.
    """
    from postproc.commands.programs.folder import programs_of
    from postproc.commands.programs.several import correct_several

    request = Request(
        machine=machine,
        calibration=calibration,
        set_up=set_up,
        travel_check=not no_travel_check,
        correction=correction,
        at=at,
    )
    programs = programs_of(folder, output, glob)
    command = f"ncomp batch {folder} {output} --machine {machine}"
    correct_several(programs, request, others, jobs=jobs, dask=dask, command=command)
