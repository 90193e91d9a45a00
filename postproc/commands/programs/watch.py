"""`ncomp watch`: programs that appear in a folder are corrected into another one."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.program import ConditionsOptions, CorrectionOptions, DatumOptions, NoTravelCheck
from postproc.commands.options.shared import CalibrationName, OptionalMachine
from postproc.commands.programs.drifting import DriftOptions
from postproc.commands.programs.each_result import EachResults
from postproc.commands.programs.given import GivenForAll, JobOption

EPILOG = (
    "Examples:\n\n"
    "`ncomp watch posted corrected --machine dmu50`\n\n"
    "`ncomp watch posted corrected --machine mill.toml --calibration cal.json --tool-table tools.tbl --settle 5`\n\n"
    "`ncomp watch posted corrected --machine mill.toml --calibration cal.json --drift touches.csv`"
)


def watch(
    *,
    folder: Path = argument(
        "Folder in which NC programs appear, with its subfolders; or a job file, without OUT.", "IN", reads=True
    ),
    output: Path | None = argument(
        "Folder of the corrected programs, with the same subfolders and names.",
        "OUT",
        default=None,
        writes="folder",
        may_replace="folder",
    ),
    machine: OptionalMachine,
    job: JobOption,
    calibration: CalibrationName,
    drift: DriftOptions,
    glob: tuple[str, ...] = option("Pattern of the programs' names instead of the usual suffixes.", "PATTERN"),
    settle: float = option(
        "Time, s, for which a file must not change before it counts as complete.", "s", default=2.0, min=0.1, max=600.0
    ),
    idle: float | None = option("Time, s, without work after which the command ends; default: never.", "s", min=0.0),
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck,
    correction: CorrectionOptions,
    at: ConditionsOptions,
    results: EachResults,
) -> None:
    """Correct every program that appears or changes in a folder, each as `ncomp correct` does, until it is ended.

    A program that is refused is reported and does not stop the others; an earlier output of it is renamed to
    NAME.earlier, so that only present programs look corrected. Ctrl-C or SIGTERM ends the command with status 0.
    """
    from postproc.interface.job_file import is_job_file
    from postproc.interface.watching import Folder, JobFile, Watch

    given = GivenForAll(machine, calibration, set_up, no_travel_check, correction, at)
    source: Folder | JobFile
    if is_job_file(folder):
        given.refuse(f"is an entry of the job file {folder}")
        if output is not None or job is not None or glob or drift.given:
            raise UserError(f"{folder} is a job file: give neither OUT nor --glob nor --drift (--job does)")
        source = JobFile(folder)
    else:
        if output is None:
            raise UserError(
                "watch: OUT is missing: folder of the corrected programs; 'ncomp watch --help' lists its options"
            )
        source = Folder(folder, output, glob, drift.requests(partial(given.request, "watch", job), _say, results), job)
    with suppress(SystemExit):  # of SIGTERM
        Watch(source, settle, _say, results).run(idle)


def _say(text: str) -> None:
    print(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}", file=sys.stderr, flush=True)
