"""The report of a verification: tool point errors before and after correction, by one model or several."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from kinematics.files.report_head import calibration_text
from kinematics.machine import Machine
from postproc.correct.classes import ClassResiduals
from postproc.correct.report import DEMONSTRATION
from postproc.correct.report_figures import path_sections
from postproc.evaluation.predicted_errors import Statistic
from postproc.verification.verify import Verdict
from postproc.verification.verify_programs import Verification
from rendering.figures import AFTER, BEFORE, Figure, Panel, bars, grid, ranked
from rendering.report import Report, Section, Table, facts

LISTED_CONTRIBUTIONS = 10
"""Number of error motions that are listed with their contributions."""
HEAD = ("tool point error, um", "before max", "before RMS", "after max", "after RMS", "points")
CLASSES = ("classes corrected", "tool point max, um", "RMS, um", "tool axis max, urad", "RMS, urad", "rotary max, urad")


def verification_report(done: Verification, programs: str, machine: Machine) -> Report:
    """The result for people; `programs`: names of both programs."""
    models = "; ".join(calibration_text(model) for model, _ in done.models.by_key().values())
    head = machine.report.filled(machine=machine.name, calibration=models)
    shown = [model for model, _ in done.models.by_key().values() if model.demonstration]
    verdict = "\n".join([*([DEMONSTRATION] if shown else []), _verdict(done.verdict)])
    return Report("Verification", programs, list(_sections(done)), verdict, head=head)


def _verdict(verdict: Verdict) -> str:
    """The result in a sentence."""
    before, after = verdict.path_before, verdict.path_after
    where = f"along feed moves, at {before.count} points"
    if not before.count:
        before, after = verdict.before, verdict.after
        where = f"at {before.count} block ends"
    if not verdict.anywhere.where:
        return "No error is evaluated: no move gives the positions of all axes that position the tool."
    rms = f"{before.rms:.2f} -> {after.rms:.2f} um RMS {where}, " if before.count else ""
    return f"Tool point error{_relative(verdict)}: {rms}at most {verdict.anywhere.text()}."


def _relative(verdict: Verdict) -> str:
    return " relative to the datum" if verdict.relative else ""


def _sections(done: Verification) -> Iterator[Section]:
    if done.paths is not None:
        yield from path_sections(done.paths, f"tool point error{_relative(done.verdict)}")
    yield facts("Datums", done.datums.facts(done.setup.obtained))
    models = done.models.by_key()
    for key, (model, option) in models.items():
        by = ", ".join(filter(None, (f"by {model.id}", option))) if len(models) > 1 else ""
        yield from _of_model(done.verdicts[key], by, best_fit=done.models.true is not None)
    if done.classes:
        text = "The table has the errors after correction of these classes."
        yield Section("ISO/TR 16907 classes", text, Table(CLASSES, list(map(_left, done.classes))))


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
        rows.append(("best fit, along", "", f"{before['rms']:.2f}", "", f"{after['rms']:.2f}", str(before["count"])))
    title = " ".join(filter(None, (f"Tool point error{_relative(verdict)}", by)))
    yield Section(title, table=Table(HEAD, rows), figure=partial(_before_and_after, verdict))
    ranked_by_rms = sorted(verdict.contributions.items(), key=lambda item: -item[1].rms)[:LISTED_CONTRIBUTIONS]
    if ranked_by_rms:
        parts = [(name, f"{statistic.largest:.2f}", f"{statistic.rms:.2f}") for name, statistic in ranked_by_rms]
        title = " ".join(filter(None, ("Largest contributions before correction", by)))
        bars = [(name, statistic.rms, BEFORE) for name, statistic in ranked_by_rms]
        drawn = partial(ranked, bars, "RMS contribution to the tool point error, um", "um")
        yield Section(title, table=Table(("error motion", "max, um", "RMS, um"), parts), figure=drawn)


def _before_and_after(verdict: Verdict) -> Figure:
    """RMS and largest errors before and after, at block ends and along feed moves, on one scale."""
    pairs = {
        "block ends": (verdict.before, verdict.after),
        "along feed moves": (verdict.path_before, verdict.path_after),
    }
    panels = []
    for name, pair in pairs.items():
        panels.append(Panel("", "tool point error, um", name))
        for stage, statistic, colour in zip(("before", "after"), pair, (BEFORE, AFTER), strict=True):
            bars(panels[-1], ["RMS", "largest"], [statistic.rms, statistic.largest], colour, stage)
    return grid(panels, 2, same_y=True)


def _row(name: str, before: Statistic, after: Statistic) -> tuple[str, ...]:
    numbers = (before.largest, before.rms, after.largest, after.rms)
    return name, *(f"{number:.2f}" for number in numbers), str(before.count)


def _left(left: ClassResiduals) -> tuple[str, ...]:
    numbers = (
        left.position.largest,
        left.position.rms,
        left.tilt.largest,
        left.tilt.rms,
        left.rotary_correction.largest,
    )
    return left.choice, *(f"{number:.2f}" for number in numbers)
