"""`ncomp JOB.toml`: the programs of a job file, with its machine, set-up and conditions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import ncomp
from postproc.commands.options.declared import argument, option
from postproc.commands.options.shared import DaskAddress

if TYPE_CHECKING:
    from postproc.commands.workplace.job_file import Job

EPILOG = (
    "Examples:\n\n"
    "`ncomp job.toml`  corrects the programs of the file (docs/job.md)\n\n"
    "`ncomp job.toml --check`  lists the lines that would be corrected, that pass and that are refused\n\n"
    "`ncomp job.toml --jobs 4`\n\n"
    "`ncomp init --help`  makes a machine file and a job file"
)


def job(
    *,
    file: Path = argument("Job file.", "JOB.toml"),
    jobs: int | None = option("Number of processes; default: one for each core.", "N", "-j", min=1),
    dask: DaskAddress,
    check: bool = option("Check the programs without correcting them, as ncomp check does.", default=False),
) -> None:
    """Correct the programs of a job file, which holds machine, calibration, set-up, conditions and outputs.

    Paths in the file are relative to its folder. A program that is refused does not stop the others: it is listed with
    file, line and reason, and the exit status is 2.
    """
    from postproc.commands.programs.correct import correct_one
    from postproc.commands.programs.folder import folders_for
    from postproc.commands.programs.several import correct_several
    from postproc.commands.workplace.job_file import read_job

    found = read_job(file)
    if check:
        _check(found)
        return
    if len(found.programs) == 1 and dask is None:
        (program,) = found.programs
        with folders_for(found.programs):
            correct_one(str(program.path), found.request, found.others, output=str(program.target), jobs=jobs)
        return
    correct_several(found.programs, found.request, found.others, jobs=jobs, dask=dask, command=f"ncomp {file}")


def _check(job: Job) -> None:
    """Show the check of each program; exit status 2 if one of them is refused."""
    from postproc.commands.show.terminal import show

    request, found = job.request, ncomp.load_machine(job.request.machine)
    setup, refused = request.set_up.setup(found), False
    for program in job.programs:
        findings = ncomp.check(
            program.path, found, dialect=request.set_up.dialect, setup=setup, travel_check=request.travel_check
        )
        show(findings.report(program.name))
        refused |= bool(findings.refused)
    if refused:
        sys.exit(2)
