"""By what a program was corrected, and whether it was edited since, from its mark alone."""

from __future__ import annotations

from typing import Any

from postproc.correct.mark import Statement
from rendering.report import Report, facts


def of_statement(statement: Statement) -> dict[str, Any]:
    """The machine-readable form."""
    return {**statement._asdict(), "edited": statement.edited}


def mark_report(statement: Statement, name: str) -> Report:
    """What a mark says, for people; `name`: of the program."""
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
    return Report("Mark", f"{name}, line {statement.line}", [facts("Fingerprints", rows)], _verdict(statement))


def _verdict(statement: Statement) -> str:
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
    return f"The program was corrected {by}.\n{edited}"
