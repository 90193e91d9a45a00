"""The public function on the life of a machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from history.reports import COLUMNS, entries_json, figure_rows, show_report
from kinematics.machine import Machine
from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, texts
from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError
from rendering import shown as views
from rendering.shown import Shown

if TYPE_CHECKING:
    from history.schema import Entry
    from history.trends.series import Series
    from history.trends.trend import Trend
    from rendering.report import Report


@dataclass(frozen=True, repr=False)
class MachineHistory(Shown):
    """The life of a machine: its results and events, and the trends of its quantities."""

    machine: str
    """Its name."""
    database: str
    """The file or the address, without a password."""
    trends: tuple[Trend, ...]
    """Changes, present value and forecast of each quantity with three results or more."""
    short: tuple[Series, ...]
    """The results of quantities with fewer."""
    entries: tuple[Entry, ...]
    """Results and events by time, with `figures`, `causes` and `files`."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        changes = [each for trend in self.trends for each in trend.changes if each.verdict == "announced"]
        counts = f"{len(self.entries)} entries, {len(self.trends)} trends, {len(changes)} changes announced"
        return f"{self.machine}, {counts}"

    @property
    def columns(self) -> dict[str, Any]:
        """All figures by time: entry, at, kind, method, name, unit, value, u (k = 1) by name `(n,)`."""
        import numpy as np

        rows = list(zip(*figure_rows(self.entries), strict=True)) or [()] * len(COLUMNS)
        return {name: np.array(row) for name, row in zip(COLUMNS, rows, strict=True)}

    def json(self) -> dict[str, Any]:
        """The result for programs; U with k = 2, u with k = 1."""
        trends = [each.json() for each in self.trends]
        return {"machine": self.machine, "trends": trends, "entries": entries_json(self.entries)}

    def report(self) -> Report:
        """The result for people."""
        return show_report(self.entries, self.machine, self.database, self.trends, self.short)


views.VIEWS["MachineHistory"] = MachineHistory.report


@public
def machine_history(
    machine: str | Path | Machine,
    *,
    limit: Texts = (),
    db: str | Path | None = None,
    progress: Progress = silent,
) -> MachineHistory:
    """The life of a machine in the history of a shop: changes and drift of every quantity, its value and forecast.

    machine: also the name of one without a file. limit: limits of quantities in their own units or in mm at the part
    (`{"squareness X-Y": "0.02mm/300mm"}`). db: a file of SQLite, or `postgresql://USER@HOST/DATABASE`; by default the
    `history` of the machine file, `$NCOMP_HISTORY`, or a file in the user's data folder. progress: called with the text
    of each step.

    UserError for a database that is not there or cannot be read, for a machine without entries, and for a limit of a
    quantity without results.
    """
    from history.database import opened, shown
    from history.entries import entries_of, machine_named
    from history.trends.limits import limits_of
    from history.trends.report import moment_now
    from history.trends.series import series_of
    from history.trends.trend import trends_of
    from kinematics.error_model.priors import PRIORS

    found = machine_if_known(machine)
    address, name = place_of(machine, None if db is None else str(db))
    with opened(address, writes=False) as session:
        entries = entries_of(session, machine_named(session, str(name)))
        series = series_of(entries)
        limits = limits_of(texts(limit), {each.name: each.unit for each in series})
    progress("trends")
    trends, short = trends_of(series, PRIORS if found is None else found.priors, moment_now(), limits)
    return MachineHistory(str(name), shown(address), tuple(trends), tuple(short), tuple(entries))


def machine_if_known(machine: str | Path | Machine) -> Machine | None:
    """The machine of a name, or of a file; None for a name of none, which a history may know."""
    from machines.given import load_machine

    try:
        return load_machine(machine)
    except UserError:
        if str(machine).lower().endswith(".toml"):
            raise
        return None


def place_of(machine: str | Path | Machine | None, db: str | None) -> tuple[str, str | None]:
    """The database, and the name of the machine in it; machine: a name, also of one without a file, or a file."""
    from history.database import default_address

    found = None if machine is None else machine_if_known(machine)
    own = None if found is None else found.history
    name = None if machine is None else str(machine) if found is None else found.name
    return db or own or default_address(), name
