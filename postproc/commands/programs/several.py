"""Correction of several programs: of a folder, of a list, or of a job file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from kinematics.files import changed_since_read
from kinematics.files.mistaken import missing
from kinematics.user_error import UserError
from postproc.commands.options.files import check_files
from postproc.commands.options.recorded import RecordedOptions, program_entry
from postproc.commands.options.shared import number_of_workers, whole_results
from postproc.folders.programs import FolderProgram
from postproc.interface.request import Request


def listed_programs(inputs: Sequence[str], output: str | None, machine: str) -> list[FolderProgram]:
    """Programs that are given by name, each with its output of the same name in the folder `output`."""
    if output in (None, "-"):
        raise UserError(f"{len(inputs)} programs are given: name a folder for their outputs, -o FOLDER")
    if "-" in inputs:
        raise UserError("standard input (-) is one program: it cannot stand beside others")
    folder, found = Path(str(output)), list[FolderProgram]()
    if folder.exists() and not folder.is_dir():
        raise UserError(f"--output {output} is a file, and {len(inputs)} programs are given: name a folder")
    for name in inputs:
        path = Path(name)
        if path.is_dir():
            hint = f"ncomp batch {quote(name)} {quote(str(output))} --machine {quote(machine)}"
            raise UserError(f"{name} is a folder: '{hint}' corrects its programs")
        if not path.is_file():
            raise UserError(f"program {name}: No such file{missing(name)}")
        target = folder / path.name
        if other := next((each.path for each in found if each.target == target), None):
            raise UserError(f"{other} and {name} have the same name, and so the same output {target}: name each once")
        found.append(FolderProgram(name, path, target, path.stat().st_size))
    return found


def correct_several(
    programs: Sequence[FolderProgram],
    request: Request,
    others: RecordedOptions,
    *,
    jobs: int | None,
    dask: str | None,
    command: str,
) -> None:
    """Correct programs, each into its own file, show the summary, and exit with its status unless that is 0."""
    from machines.given import load_machine
    from postproc.commands.show.terminal import progress_of, say, show

    number = number_of_workers(jobs, dask, "--jobs")
    files = request.files
    check_files((*files, *(each.path for each in programs)), others.by_option)
    inputs = (*request.inputs, *(each.path for each in programs))
    with (
        others.recorded(load_machine(request.machine)) as record,
        whole_results(*others.files) as (results, page),
        progress_of(sum(each.size for each in programs), f"correcting {len(programs)} programs") as progress,
    ):
        summary = request.corrected(programs, others.by_option, number, dask, progress)
        for path in changed_since_read(files):
            say("note", f"{path} was changed during the run: all programs are corrected by its content at the start")
        shown = summary.report(command)
        others.write(summary.json(), shown, (results, page), inputs)
        for program, outcome in summary.outcomes.items():
            if outcome.result:
                record(program_entry(outcome.result, program.target, (*request.inputs, program.path)))
    show(shown, *others.files)
    if summary.status:
        sys.exit(summary.status)
