"""`ncomp history show`: the life of a machine: what has changed, its present state, and its forecast."""

from __future__ import annotations

import ncomp
from postproc.commands.options.declared import argument, option
from postproc.commands.options.files import file_if_there
from postproc.commands.options.recorded import Database
from postproc.commands.options.shared import ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp history show dmu50 --report dmu50.html`\n\n"
    '`ncomp history show dmu50 --limit "squareness X-Y=0.02mm/300mm" --limit "backlash X=0.01mm" --json -`'
)


def show(
    *,
    machine: str = argument("Machine.", "MACHINE", reads=file_if_there),
    limit: tuple[str, ...] = option(
        "Limit of a quantity in either direction, in mm at the part, or in its own unit: mm, um, um/m, urad; of an "
        "angle in mm over a length of the part.",
        "NAME=0.02mm/300mm",
    ),
    db: Database,
    others: ResultOptions,
) -> None:
    """Show the life of a machine: changes and drift of every quantity, its value with U, and its forecast.

    A change is announced by its odds, from the uncertainties of the results and the scatter of the machine itself. With
    --limit: when the quantity leaves it, when to measure again, and by which method.
    """
    from postproc.commands.show import terminal

    with terminal.console.status("reading") as status:
        found = ncomp.machine_history(machine, limit=limit, db=db, progress=status.update)
    report = found.report()
    with whole_results(*others.files) as files:
        others.write(found.json(), report, files, ())
    terminal.show(report, *others.files)
