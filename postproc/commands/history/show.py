"""`ncomp history show`: the life of a machine: what has changed, its present state, and its forecast."""

from __future__ import annotations

from typing import TYPE_CHECKING

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.files import file_if_there
from postproc.commands.options.recorded import Database, place_of
from postproc.commands.options.shared import ResultOptions, whole_results

if TYPE_CHECKING:
    from kinematics.error_model.priors import Priors

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
    from history.database import opened, shown
    from history.entries import entries_of, machine_named
    from history.reports import entries_json, show_report
    from history.trends.limits import limits_of
    from history.trends.report import moment_now
    from history.trends.series import series_of
    from history.trends.trend import trends_of
    from postproc.commands.show import terminal

    address, name = place_of(machine, db)
    with opened(address, writes=False) as session:
        entries = entries_of(session, machine_named(session, str(name)))
        series = series_of(entries)
        limits = limits_of(limit, {each.name: each.unit for each in series})
        with terminal.console.status("trends"):
            trends, short = trends_of(series, _priors(machine), moment_now(), limits)
        report = show_report(entries, str(name), shown(address), trends, short)
        answer = {"machine": name, "trends": [each.json() for each in trends], "entries": entries_json(entries)}
    with whole_results(*others.files) as files:
        others.write(answer, report, files, ())
    terminal.show(report, *others.files)


def _priors(machine: str) -> Priors:
    """What is known of the machine before any result; of one without a file, that of a machining centre."""
    from kinematics.error_model.priors import PRIORS

    try:
        return ncomp.load_machine(machine).priors
    except UserError:
        return PRIORS
