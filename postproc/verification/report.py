"""The report of a verification: tool point errors before and after correction, by one model or several."""

from __future__ import annotations

from collections.abc import Iterator

from postproc.correct.classes import ClassResiduals
from postproc.evaluation.predicted_errors import Statistic
from postproc.verification.verify import Verdict
from postproc.verification.verify_programs import Verification
from rendering.report import Report, Section, Table, facts

LARGEST = 10
"""Number of error motions that are listed with their contributions."""
HEAD = ("tool point error, um", "before max", "before RMS", "after max", "after RMS", "points")
CLASSES = ("classes corrected", "tool point max, um", "RMS, um", "tool axis max, urad", "RMS, urad", "rotary max, urad")


def verification_report(done: Verification) -> Report:
    """The result for people."""
    return Report("Verification", "", list(_sections(done)))


def _sections(done: Verification) -> Iterator[Section]:
    yield facts("Datums", done.datums.facts(done.setup.obtained))
    models = done.models.by_key()
    for key, (model, option) in models.items():
        by = ", ".join(filter(None, (f"by {model.id}", option))) if len(models) > 1 else ""
        yield from _of_model(done.verdicts[key], by, best_fit=done.models.true is not None)
    if done.classes:
        yield Section(
            "ISO/TR 16907 classes", "Errors after correction.", Table(CLASSES, list(map(_left, done.classes)))
        )


def _of_model(verdict: Verdict, by: str, *, best_fit: bool) -> Iterator[Section]:
    """The errors by one model; `best_fit`: also those of the part aligned best fit."""
    absolute = verdict.absolute
    rows = [
        _row("block ends", verdict.before, verdict.after),
        _row("along feed moves", verdict.path_before, verdict.path_after),
    ]
    if verdict.relative:
        rows.append(_row("absolute, at ends", absolute.before, absolute.after))
        rows.append(_row("absolute, along", absolute.path_before, absolute.path_after))
    if best_fit:
        before, after = (fit.json() for fit in verdict.best_fit)
        rows.append(("best fit, along", "", f"{before['rms']:.3f}", "", f"{after['rms']:.3f}", str(before["count"])))
    reference = "relative to the datum" if verdict.relative else ""
    yield Section(" ".join(filter(None, ("Tool point error", reference, by))), table=Table(HEAD, rows))
    ranked = sorted(verdict.contributions.items(), key=lambda item: -item[1].rms)[:LARGEST]
    if ranked:
        parts = [(name, f"{statistic.largest:.2f}", f"{statistic.rms:.2f}") for name, statistic in ranked]
        title = " ".join(filter(None, ("Largest contributions before correction", by)))
        yield Section(title, table=Table(("error motion", "max, um", "RMS, um"), parts))


def _row(name: str, before: Statistic, after: Statistic) -> tuple[str, ...]:
    numbers = (before.largest, before.rms, after.largest, after.rms)
    return name, *(f"{number:.3f}" for number in numbers), str(before.count)


def _left(left: ClassResiduals) -> tuple[str, ...]:
    numbers = (
        left.position.largest,
        left.position.rms,
        left.tilt.largest,
        left.tilt.rms,
        left.rotary_correction.largest,
    )
    return left.choice, *(f"{number:.2f}" for number in numbers)
