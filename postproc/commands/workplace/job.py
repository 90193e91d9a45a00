"""`ncomp JOB.toml`: the programs of a job file, with its machine, set-up and conditions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.shared import DaskAddress

if TYPE_CHECKING:
    from postproc.interface.job_file import Job

EPILOG = (
    "Examples:\n\n"
    "`ncomp job.toml`  corrects the programs of the file (docs/job.md)\n\n"
    "`ncomp job.toml --check`  lists the lines that would be corrected, that pass and that are refused\n\n"
    "`ncomp job.toml --jobs 4`\n\n"
    "`ncomp init --help`  makes a machine file and a job file"
)


def job(
    *,
    file: Path = argument("Job file.", "JOB.toml", reads=True),
    jobs: int | None = option("Number of processes; default: one for each core.", "N", "-j", min=1),
    dask: DaskAddress,
    check: bool = option("Check the programs without correcting them, as ncomp check does.", default=False),
) -> None:
    """Correct the programs of a job file, which holds machine, calibration, set-up, conditions and outputs.

    Paths in the file are relative to its folder. A program that is refused does not stop the others: it is listed with
    file, line and reason, and the exit status is 2.
    """
    from postproc.commands.options.recorded import RecordedOptions
    from postproc.commands.programs.correct import correct_one
    from postproc.commands.programs.several import correct_several
    from postproc.folders.programs import folders_for
    from postproc.interface.job_file import read_job

    found = read_job(file)
    if check:
        _check(found)
        return
    others = RecordedOptions(**vars(found.results), db=None)
    if len(found.programs) == 1 and dask is None:
        (program,) = found.programs
        with folders_for(found.programs):
            correct_one(
                str(program.path), found.request, others, output=str(program.target), jobs=jobs, own=program.own
            )
        return
    correct_several(found.programs, found.request, others, jobs=jobs, dask=dask, command=f"ncomp {file}")


def _check(job: Job) -> None:
    """Show the check of each program; exit status 2 if one of them is refused."""
    from postproc.commands.show.terminal import show
    from postproc.folders.checked import Checked

    findings = {}
    for program, found in job.request.checks(job.programs):
        findings[program] = found
        show(found.report(program.name))
    checked = Checked(ncomp.load_machine(job.request.machine), findings)
    if checked.unused:
        raise UserError(checked.unused[0])
    if checked.status:
        sys.exit(checked.status)
