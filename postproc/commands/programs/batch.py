"""`ncomp batch`: every program of a folder corrected into another folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from postproc.commands.options.declared import argument, option
from postproc.commands.options.program import ConditionsOptions, CorrectionOptions, DatumOptions, NoTravelCheck
from postproc.commands.options.recorded import RecordedOptions
from postproc.commands.options.shared import CalibrationName, DaskAddress, OptionalMachine
from postproc.commands.programs.given import GivenForAll, JobOption, own_in

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
    folder: Path = argument("Folder of NC programs, with its subfolders.", "IN", reads=True),
    output: Path = argument(
        "Folder of the corrected programs, with the same subfolders and names.",
        "OUT",
        writes="folder",
        may_replace="folder",
    ),
    machine: OptionalMachine,
    job: JobOption,
    calibration: CalibrationName,
    glob: tuple[str, ...] = option("Pattern of the programs' names instead of the usual suffixes.", "PATTERN"),
    jobs: int | None = option("Number of processes; default: one for each core.", "N", "-j", min=1),
    dask: DaskAddress,
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck,
    correction: CorrectionOptions,
    at: ConditionsOptions,
    others: RecordedOptions,
) -> None:
    """Correct every program of a folder, each as `ncomp correct` does, over several processes or a Dask cluster.

    Each output is written whole or not at all. A program that is refused does not stop the others: it is listed with
    file, line and reason, and the exit status is 2.
    """
    from postproc.commands.programs.several import correct_several
    from postproc.folders.programs import programs_of

    request = GivenForAll(machine, calibration, set_up, no_travel_check, correction, at).request("batch", job)
    programs = programs_of(folder, output, glob)
    if job is not None:
        programs = [replace(each, own=own_in(job, each.path)) for each in programs]
    command = f"ncomp batch {folder} {output} --machine {request.machine}"
    correct_several(programs, request, others, jobs=jobs, dask=dask, command=command)
