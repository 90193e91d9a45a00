"""`ncomp history export`: the life of a machine as files."""

from __future__ import annotations

from pathlib import Path

from postproc.commands.options.declared import argument, option
from postproc.commands.options.files import file_if_there
from postproc.commands.options.recorded import Database

EPILOG = "Examples:\n\n`ncomp history export dmu50 -o dmu50_life`"


def export(
    *,
    machine: str = argument("Machine.", "MACHINE", reads=file_if_there),
    output: Path = option("New folder for the files.", "FOLDER", "-o", default=Path("history"), writes="folder"),
    db: Database,
) -> None:
    """Write the life of a machine into a folder: its entries, their figures as one table, and the documents.

    entries.json has all entries, figures.csv their numbers with standard uncertainties (k = 1), and NUMBER-KIND.json
    the calibration or the results of an entry, as they were entered.
    """
    from history.database import opened
    from history.entries import entries_of, machine_named
    from history.interface import place_of
    from history.reports import exported
    from kinematics.files import write_folder
    from postproc.commands.show.terminal import say

    address, name = place_of(machine, db)
    with opened(address, writes=False) as session:
        files = exported(entries_of(session, machine_named(session, str(name))))
    write_folder(output, files)
    say("note", f"{len(files)} files in {output}")
