"""`ncomp history event`: what happened to a machine."""

from __future__ import annotations

import datetime
from typing import Literal

import ncomp
from postproc.commands.options.declared import argument, option
from postproc.commands.options.files import machine_file
from postproc.commands.options.recorded import Database, entering

EPILOG = (
    "Examples:\n\n"
    "`ncomp history event dmu50 crash --at 2026-04-02`\n\n"
    '`ncomp history event dmu50 service --at 2026-05-11T16:00 --note "ball screw of X replaced"`'
)


def event(
    *,
    machine: str = argument("Name of a machine, or path of its .toml file.", "MACHINE", reads=machine_file),
    what: Literal["crash", "service", "moved", "spindle", "other"] = argument(
        "What happened: a crash, a service, the machine was moved, its spindle was changed.", "EVENT"
    ),
    at: str | None = option("Date, or date and time; default: now.", "DATE"),
    note: str = option("Remark.", "TEXT", default=""),
    db: Database,
    force: bool = option("Enter although the clock of this computer contradicts the history.", default=False),
) -> None:
    """Enter an event into the life of a machine, after which its errors may be others."""
    from history.entries import Result, moment_of

    moment = datetime.datetime.now(datetime.UTC) if at is None else moment_of(at, "--at")
    entering(ncomp.load_machine(machine), db, [Result(kind=what, at=moment, title=note or what)], force=force)
