"""`ncomp history list`: the machines of the history, or the entries of one."""

from __future__ import annotations

from typing import Any

from postproc.commands.options.declared import argument
from postproc.commands.options.files import file_if_there
from postproc.commands.options.recorded import Database
from postproc.commands.options.shared import ResultOptions, whole_results

EPILOG = "Examples:\n\n`ncomp history list`\n\n`ncomp history list dmu50 --json -`"


def list(
    *,
    machine: str | None = argument("Machine; without one, all machines.", "MACHINE", default=None, reads=file_if_there),
    db: Database,
    others: ResultOptions,
) -> None:
    """List the machines of the history, or the results and events of one machine by their dates."""
    from history.database import opened, shown
    from history.entries import entries_of, lives, machine_named
    from history.interface import place_of
    from history.reports import entries_json, list_report, machines_report
    from postproc.commands.show.terminal import show

    address, name = place_of(machine, db)
    answer: dict[str, Any]
    with opened(address, writes=False) as session:
        if name is None:
            found = lives(session)
            answer = {"machines": [each._asdict() for each in found]}
            report = machines_report(found, shown(address))
        else:
            entries = entries_of(session, machine_named(session, name))
            answer, report = {"entries": entries_json(entries)}, list_report(entries, name, shown(address))
    with whole_results(*others.files) as files:
        others.write(answer, report, files, ())
    show(report, *others.files)
