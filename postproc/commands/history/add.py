"""`ncomp history add`: results that files contain, or a single check, entered into the life of a machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.files import file_if_there
from postproc.commands.options.recorded import Database, entering

if TYPE_CHECKING:
    from history.entries import Result

EPILOG = (
    "Examples:\n\n"
    "`ncomp history add dmu50 march.json june.json`  calibrations of ncomp fit and ncomp diagnose\n\n"
    "`ncomp history add dmu50 laser.json --at 2026-03-02`  results of ncomp iso230 or ncomp ballbar (--json)\n\n"
    '`ncomp history add dmu50 --check "squareness X-Y=12.4 +- 3 um/m" --method granite --at 2026-04-01`\n\n'
    "`ncomp history add dmu50 tables.spf --kind tables`  tables that were loaded into the control"
)


def add(
    *,
    given: tuple[str, ...] = argument("The machine, then the files.", "MACHINE FILE...", reads=file_if_there),
    kind: Literal["tables", "parameters"] | None = option(
        "What a file of a control is: tables of compensation, or kinematic parameters, that were loaded."
    ),
    check: tuple[str, ...] = option(
        "Result of a single check, with its U (k = 2); the unit is um, um/m or urad.", "NAME=VALUE +- U UNIT"
    ),
    at: str | None = option(
        "Date of the result, or date and time; default: that of the file's content, else now.", "DATE"
    ),
    method: str | None = option("Instrument or test that gave the result.", "NAME"),
    db: Database,
    force: bool = option("Enter although the clock of this computer contradicts the history.", default=False),
) -> None:
    """Enter results into the life of a machine: all of the files, or none of them.

    Files are calibrations (ncomp fit, ncomp diagnose), results of ncomp iso230, ballbar, etve and diagnose (--json),
    measurement files, corrected programs, and files that were loaded into the control (--kind). The history
    keeps calibrations and results, and of all files the path and the fingerprint, by which ncomp history verify notices
    a change.
    """
    from history.entries import moment_of
    from postproc.commands.history.recognised import check_result, result_of

    if not given:
        raise UserError("history add: MACHINE is missing: its name, or the path of its file")
    if len(given) == 1 and not check:
        raise UserError(f"history add {given[0]}: FILE is missing: name files of results, or give --check")
    machine = ncomp.load_machine(given[0])
    moment = None if at is None else moment_of(at, "--at")
    results: list[Result] = [result_of(machine, Path(name), kind, moment) for name in given[1:]]
    results += [check_result(check, moment)] if check else []
    if method is not None:
        results = [replace(each, method=method) for each in results]
    entering(machine, db, results, force=force)
