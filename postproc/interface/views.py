"""The reports of results on programs, as a session shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from postproc.correct.check import Findings
    from postproc.folders.summary import Summary
    from postproc.interface.programs import Corrected
    from postproc.verification.verify_programs import Verification
    from rendering.report import Report


def _corrected(done: Corrected) -> Report:
    from postproc.correct.report import correction_report

    return correction_report(done.job, done.report, done.trace, "ncomp.correct")


def _verification(done: Verification) -> Report:
    from postproc.verification.report import verification_report

    return verification_report(done, "two programs", done.setup.machine)


def _findings(found: Findings) -> Report:
    return found.report("the program")


def _summary(done: Summary) -> Report:
    return done.report("ncomp.batch")


REPORTS: dict[str, Callable[[Any], Report]] = {
    "Corrected": _corrected,
    "Verification": _verification,
    "Findings": _findings,
    "Summary": _summary,
}
"""The report of a result, by the name of its class."""
