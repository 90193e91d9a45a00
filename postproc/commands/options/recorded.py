"""The options of commands whose results can be entered into the history of a machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from kinematics.user_error import UserError
from postproc.commands.options.declared import OUTPUT, option
from postproc.commands.options.files import file_of_database
from postproc.commands.options.shared import ResultOptions

if TYPE_CHECKING:
    import datetime
    from pathlib import Path

    from sqlalchemy.orm import Session

    from calibration.measurement.measurement import Measurement
    from history.entries import Quantity, Result
    from kinematics.machine import Machine
    from rendering.report import Report

Database = Annotated[
    str | None,
    option(
        "Database of the history: a file of SQLite, or postgresql://USER@HOST/DATABASE; default: the `history` of the "
        "machine file, $NCOMP_HISTORY, or a file in the user's data folder.",
        "FILE|URL",
        panel=OUTPUT,
        reads=file_of_database,
    ),
]
Record = Callable[[Callable[[], "Result"]], None]
"""Enters a result, which is made only if there is a history."""


@dataclass(frozen=True, kw_only=True)
class HistoryOptions:
    """The history into which the results of a command are entered."""

    PANEL: ClassVar[str] = OUTPUT

    history: bool = option(
        "Enter the result into the history of the machine (ncomp history); a `history` in the machine file does so "
        "without this option.",
        default=False,
    )
    db: Database

    def __post_init__(self) -> None:
        """UserError for a database that nothing is written to."""
        if self.db is not None and not self.history:
            raise UserError(f"--db {self.db}: is the database of the history: give --history too")

    def address(self, machine: Machine) -> str | None:
        """The database; None where the result is not entered."""
        if self.db or machine.history or not self.history:
            return self.db or machine.history or None
        from history.database import default_address

        return default_address()

    @contextmanager
    def recorded(self, machine: Machine | None) -> Iterator[Record]:
        """Enters results in one transaction, which ends when the block, which writes the files, has ended well."""
        address = None if machine is None else self.address(machine)
        entered: list[int] = []
        with ExitStack() as stack:
            sessions: list[Session] = []

            def record(result: Callable[[], Result]) -> None:
                """Enter the result; one that the history has keeps its number."""
                if machine is not None and address is not None:
                    from history.database import opened
                    from history.entries import enter, same_as

                    made = result()
                    sessions[:] = sessions or [stack.enter_context(opened(address, writes=True))]
                    entered.append((same_as(sessions[0], machine, made) or enter(sessions[0], machine, made)).id)

            yield record
        if entered and machine is not None and address is not None:
            from history.database import shown
            from postproc.commands.show.terminal import say

            numbers = f"entry {entered[0]}" if len(entered) == 1 else f"entries {entered[0]} to {entered[-1]}"
            say("note", f"entered into the history {shown(address)} as {numbers} of {machine.name}")


@dataclass(frozen=True, kw_only=True)
class RecordedOptions(ResultOptions, HistoryOptions):
    """Results in addition to the main output, and the history."""

    PANEL: ClassVar[str] = OUTPUT

    def __post_init__(self) -> None:
        """UserError for options that do not belong together."""
        ResultOptions.__post_init__(self)
        HistoryOptions.__post_init__(self)


def calibration_entry(
    machine: Machine,
    content: bytes,
    output: str | None,
    report: Report,
    inputs: Iterable[str | Path | None],
    *,
    kind: str = "calibration",
    title: str = "",
    effects: Sequence[Mapping[str, Any]] = (),
) -> Callable[[], Result]:
    """Makes the entry of a calibration that is written to a file; report: the page of its result.

    effects: those in the results of a diagnosis.
    """

    def made() -> Result:
        """The entry, with the fingerprints of the files as they are now."""
        from history.causes import of_diagnosis
        from history.results import fingerprints, instant, of_calibration
        from kinematics.files import fingerprint

        written = {} if output in (None, "-") else {str(output): fingerprint(content)}
        files = {**fingerprints(inputs), **written}
        method = f"{report.head.instrument or kind} {report.head.instrument_number}".strip()
        given = {"kind": kind, "method": method, "title": title}
        at = instant(None) if kind == "check" else None
        causes = of_diagnosis(effects)
        return of_calibration(machine, content, str(output), files=files, at=at, causes=causes, **given)

    return made


def results_entry(
    kind: str,
    title: str,
    results: Mapping[str, Any],
    figures: Callable[[], Iterable[Quantity]],
    inputs: Iterable[str | Path | None],
    measurement: Measurement | None = None,
    *,
    method: str = "",
    measured: datetime.date | None = None,
) -> Callable[[], Result]:
    """Makes the entry of results for programs, of a measurement or of none; method and measured: without one."""

    def made() -> Result:
        """The entry, with the fingerprints of the files as they are now."""
        from history.results import fingerprints, instant, of_results

        by, day = method, measured
        if measurement is not None:
            number = measurement.machine.report.instrument_number
            by, day = f"{measurement.instrument.kind()} {number}".strip(), measurement.measured
        files = fingerprints(inputs)
        return of_results(kind, title, results, figures(), method=by, files=files, at=instant(day))

    return made


def program_entry(
    results: dict[str, Any], target: str | Path | None, inputs: Iterable[str | Path | None]
) -> Callable[[], Result]:
    """Makes the entry of a corrected program, with its mark; target: its file, if it is written already."""
    title = f"{results['program']['name']}: {results['mark'] or 'unchanged'}"
    return results_entry("program", title, results, tuple, (*inputs, target))


def entering(machine: Machine, db: str | None, results: Iterable[Result], *, force: bool) -> None:
    """Enter results in one transaction, and show their numbers."""
    from history.database import default_address, opened, shown
    from history.entries import enter
    from postproc.commands.show.terminal import say

    address = db or machine.history or default_address()
    with opened(address, writes=True) as session:
        entered = [enter(session, machine, result, force=force) for result in results]
        lines = [f"entry {each.id} of {machine.name}: {each.at[:10]} {each.kind}, {each.title}" for each in entered]
    for line in lines:
        say("note", line)
    say("note", f"history {shown(address)}")
