"""`ncomp batch`: every program of a folder corrected into another folder."""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path

import ncomp
from postproc.commands.options.declared import argument, option
from postproc.commands.options.program import ConditionsOptions, DatumOptions, NoTravelCheck
from postproc.commands.options.shared import (
    CalibrationName,
    DaskAddress,
    MachineName,
    ResultOptions,
    check_files,
    number_of_workers,
    whole_results,
)
from postproc.commands.programs.correct import CorrectionOptions

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
    import grammars
    import kinematics
    import machines
    import postproc
    from kinematics.workers import workers
    from postproc.commands.programs.folder import check_targets, corrected, folders_for, programs_of
    from postproc.commands.programs.folder_report import Summary
    from postproc.commands.show.terminal import progress_of, show

    start, number = time.perf_counter(), number_of_workers(jobs, dask, "--jobs")
    programs = programs_of(folder, output, glob)
    inputs = (calibration if calibration != "none" else None, *set_up.tool_table, at.log)
    check_targets(programs, inputs)
    check_files((*inputs, *(each.path for each in programs)), others.by_option)
    found = ncomp.load_machine(machine)
    model = ncomp.load_calibration(found, calibration)
    one = partial(
        ncomp.correct,
        machine=found,
        model=model,
        dialect=set_up.dialect,
        setup=set_up.setup(found),
        conditions=at.conditions(),
        travel_check=not no_travel_check,
        **vars(correction),
    )
    number = min(number, len(programs))
    code = tuple(package.__name__ for package in (postproc, kinematics, machines, grammars))
    ends = {}
    with (
        whole_results(*others.files) as (results, page),
        folders_for(programs),
        workers(number, dask, code) as team,
        progress_of(sum(each.size for each in programs), f"correcting {len(programs)} programs") as progress,
    ):
        for program, outcome in corrected(programs, one, team, sent=dask is not None):
            ends[program] = outcome
            progress(program.size)
        ordered = {program: ends[program] for program in programs}
        summary = Summary(found, model, ordered, time.perf_counter() - start, number)
        shown = summary.report(f"ncomp batch {folder} {output} --machine {machine}")
        others.write(summary.json(), shown, (results, page))
    show(shown, *others.files)
    if summary.status:
        sys.exit(summary.status)
