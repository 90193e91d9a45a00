"""`ncomp history verify`: whether the files of the history are still those that were entered."""

from __future__ import annotations

from collections import Counter

from kinematics.user_error import UserError
from postproc.commands.options.declared import argument
from postproc.commands.options.files import file_if_there
from postproc.commands.options.recorded import Database
from postproc.commands.options.shared import ResultOptions, whole_results

EPILOG = "Examples:\n\n`ncomp history verify`\n\n`ncomp history verify dmu50 --json -`"


def verify(
    *,
    machine: str | None = argument("Machine; without one, all machines.", "MACHINE", default=None, reads=file_if_there),
    db: Database,
    others: ResultOptions,
) -> None:
    """Check all files that entries name, and the documents that they contain, against their fingerprints.

    Exit status 2 where one has changed or is gone. ncomp history export writes the documents again.
    """
    from history.database import opened, shown
    from history.entries import check_files, entries_of, machine_named
    from history.interface import place_of
    from history.reports import verify_report
    from postproc.commands.show.terminal import show

    address, name = place_of(machine, db)
    with opened(address, writes=False) as session:
        entries = entries_of(session, None if name is None else machine_named(session, name))
        found = check_files(entries)
    report = verify_report(found, shown(address))
    with whole_results(*others.files) as files:
        others.write({"checked": [each._asdict() for each in found]}, report, files, ())
    show(report, *others.files)
    states = Counter(each.state for each in found)
    if bad := states["changed"] + states["gone"]:
        raise UserError(
            f"{bad} of {len(found)} files and documents of the history are not as they were entered: put the files "
            "back, or enter the changed ones as new results; 'ncomp history export' writes the documents again"
        )
