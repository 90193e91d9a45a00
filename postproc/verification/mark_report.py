"""By what a program was corrected, and whether it was edited since, from its mark alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from postproc.correct.mark import Statement
from rendering.report import Report, facts

Called = Sequence[tuple[Path, Statement]]
"""The files that a program calls, with what their marks say."""


def of_statement(statement: Statement, called: Called) -> dict[str, Any]:
    """The machine-readable form."""
    files = [{"name": str(path), **own._asdict(), "edited": own.edited} for path, own in called]
    return {**statement._asdict(), "edited": statement.edited, "called": files}


def mark_report(statement: Statement, name: str, called: Called) -> Report:
    """What a mark says, for people, and those of the files that the program calls; `name`: of the program."""
    rows = (
        ("version of ncomp", statement.version),
        ("machine", statement.machine),
        ("calibration", statement.calibration),
        ("original program", statement.program or "not stated"),
        ("set-up", statement.setup or "not stated"),
        ("datum", statement.datum or "not stated"),
        ("text after the correction", statement.text or "not stated"),
        ("text now", statement.found),
        ("mark", statement.words),
    )
    return Report("Mark", f"{name}, line {statement.line}", [facts("Fingerprints", rows)], _verdict(statement, called))


def _verdict(statement: Statement, called: Called) -> str:
    by = (
        f"by ncomp {statement.version} for the machine {statement.machine} with the calibration {statement.calibration}"
    )
    match statement.edited:
        case None:
            edited = "Its mark is of an older version and does not say whether it was edited since."
        case True:
            edited = "It was EDITED since: its text is no longer the one of the correction. Correct the original again."
        case _:
            edited = "It was not edited since: its text is the one of the correction."
    return "\n".join([f"The program was corrected {by}.", edited, *_of_called(statement, called)])


def _of_called(statement: Statement, called: Called) -> Iterator[str]:
    """Sentences on the files that the program calls: each has a mark of its own."""
    for path, own in called:
        if own.edited:
            yield f"{path}, which it calls, was EDITED since: correct the original again, with all that it calls."
        elif (own.calibration, own.setup, own.datum) != (statement.calibration, statement.setup, statement.datum):
            yield (
                f"{path}, which it calls, is of ANOTHER correction, with the calibration {own.calibration}: correct "
                "the original again, with all that it calls."
            )
    fine = sum(own.edited is False for _, own in called)
    if called and fine == len(called):
        yield f"Nor were the files that it calls: {', '.join(str(path) for path, _ in called)}."
