"""`ncomp watch`: programs that appear in a folder are corrected into another one."""

from __future__ import annotations

from pathlib import Path

from postproc.commands.options.declared import argument, option
from postproc.commands.options.program import ConditionsOptions, DatumOptions, NoTravelCheck
from postproc.commands.options.shared import CalibrationName, MachineName
from postproc.commands.programs.request import CorrectionOptions, Request

EPILOG = (
    "Examples:\n\n"
    "`ncomp watch posted corrected --machine dmu50`\n\n"
    "`ncomp watch posted corrected --machine mill.toml --calibration cal.json --tool-table tools.tbl --settle 5`"
)


def watch(
    *,
    folder: Path = argument("Folder in which NC programs appear, with its subfolders.", "IN"),
    output: Path = argument("Folder of the corrected programs, with the same subfolders and names.", "OUT"),
    machine: MachineName,
    calibration: CalibrationName,
    glob: tuple[str, ...] = option("Pattern of the programs' names instead of the usual suffixes.", "PATTERN"),
    settle: float = option(
        "Time, s, for which a file must not change before it counts as complete.", "s", default=2.0, min=0.1, max=600.0
    ),
    idle: float | None = option("Time, s, without work after which the command ends; default: never.", "s", min=0.0),
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck,
    correction: CorrectionOptions,
    at: ConditionsOptions,
) -> None:
    """Correct every program that appears or changes in a folder, each as `ncomp correct` does, until it is ended.

    A program that is refused is reported and does not stop the others; an earlier output of it is renamed to
    NAME.earlier, so that only present programs look corrected. Ctrl-C or SIGTERM ends the command with status 0.
    """
    from postproc.commands.programs.folder import check_folders
    from postproc.commands.programs.watching import Watch

    check_folders(folder, output)
    request = Request(
        machine=machine,
        calibration=calibration,
        set_up=set_up,
        travel_check=not no_travel_check,
        correction=correction,
        at=at,
    )
    Watch(folder, output, glob, request, settle).run(idle)
