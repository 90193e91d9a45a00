"""The page of a correction: set-up, errors before and after, corrections, and largest errors on the part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calibration.pages import Section, Table, page
from postproc.commands.show.job_figures import correction_figure, error_figure, plan_figure
from postproc.correct.report import Report, Statistic
from postproc.correct.trace import MoveEnd, Trace
from postproc.text.line_numbers import shortened

if TYPE_CHECKING:
    from postproc.correct.pipeline import Job

SIGNS = (
    "Errors are actual minus nominal, tool relative to workpiece: predicted by the exact error model of the "
    "calibration, not measured. A correction is what was added to a command."
)
RELATIVE = (
    " A work offset that was touched off on the machine holds the machine's error at that position, and the part lies "
    "there. An error relative to the datum is the error less the one at the touch-off: it is the error of the part. An "
    "absolute error takes the work offset for true."
)
DEMONSTRATION = "DEMONSTRATION CALIBRATION: it describes no real machine; don't cut with it."


def job_page(job: Job, report: Report, trace: Trace, command: str) -> bytes:
    """The page as one HTML file; `command`: the command line of the correction."""
    title = f"Correction of {report.program['name']}"
    lead = f"machine {report.machine['name']} · calibration {report.calibration['id']} · {command}"
    return page(title, lead, list(_sections(job, report, trace)), _verdict(report))


def _verdict(report: Report) -> str:
    """The result in a few sentences."""
    before, after = report.before, report.after
    warning = f"{report.assumption}. " if report.assumption else ""
    warning += f"{DEMONSTRATION} " if report.calibration["demonstration"] else ""
    if report.calibration["id"] == "none":
        return f"{warning}No calibration: the program was written back as it was."
    if not before.count:
        return f"{warning}Nothing is judged: no move says where all axes are that place the tool."
    sure = f"; standard uncertainty (k=1) of the prediction {report.uncertainty.rms:.2f} um RMS"
    return (
        f"{warning}Predicted {report.error} of the tool point at {before.count} block ends: "
        f"{before.rms:.2f} -> {after.rms:.2f} um RMS, "
        f"at most {before.largest:.2f} -> {after.largest:.2f} um{sure if report.uncertainty.largest else ''}."
    )


def _sections(job: Job, report: Report, trace: Trace) -> Iterator[Section]:
    yield Section("Set-up", table=Table(("", ""), [*report.facts(), *_choices(job, report)]))
    yield Section(
        "Errors",
        SIGNS + (RELATIVE if report.relative else ""),
        Table(("um", "max", "RMS", "number"), _error_rows(report, trace)),
    )
    if report.correction:
        yield Section("Corrections", table=Table(("um", "max", "RMS", "number"), _rows(report.corrections())))
    if report.straying:
        yield Section("Moves that stay whole", _whole_text(job), _whole_table(report))
    if report.notes:
        told_above = {straying.text(reason) for reason, straying in report.straying.items()}
        yield Section("Notes", "\n".join(note for note in report.notes if note not in told_above))
    yield from _figures(trace, report.error)
    for what, places in zip(("before", "after"), trace.worst, strict=True):
        if places:
            yield Section(f"Largest errors {what}", _WORST, _worst_table(trace, places))


_WORST = "Ends of moves, in programmed coordinates (mm, degrees)."


def _choices(job: Job, report: Report) -> list[tuple[str, str]]:
    """Rows on the options and on the calibration."""
    calibration, program = report.calibration, report.program
    rows = [
        ("classes", "all but FOR" if job.classes is None else ", ".join(sorted(job.classes))),
        ("tolerance", f"{job.tolerance_um:g} um between block ends"),
        ("travel", "outside it is refused" if job.travel_check else "outside it is noted only"),
        ("program's hash", f"{program['sha256']} (SHA-256, its beginning)"),
    ]
    if calibration["id"] == "none":
        return rows
    demonstration = "yes: it describes no real machine" if calibration["demonstration"] else "no"
    made = f"{calibration['made_at']} by {calibration['made_by']}"
    return [*rows, ("calibration made", made), ("demonstration", demonstration)]


def _rows(named: Sequence[tuple[str, Statistic]]) -> list[tuple[str, ...]]:
    return [(name, f"{s.largest:.3f}", f"{s.rms:.3f}", str(s.count)) for name, s in named]


def _error_rows(report: Report, trace: Trace) -> list[tuple[str, ...]]:
    """Rows of statistics, of the uncertainty, and of the significant share of the improvement."""
    what = f"{report.error} between block ends before"
    between = [(what, trace.between_before)] if trace.between_before.count else []
    named = report.errors()
    rows = _rows([*named[:2], *between, *named[2:]])
    rows.append(("moves that are not judged", "", "", str(report.not_judged)))
    if report.significance.share is not None:
        rows.append(("significant share of the improvement (k=2)", f"{report.significance.share:.0%}", "", ""))
    return rows


def _whole_text(job: Job) -> str:
    return f"Feed moves that stray by more than {job.tolerance_um:g} um between their ends and could not be split."


def _whole_table(report: Report) -> Table:
    rows = []
    for reason in report.straying:
        whole = report.straying[reason].json(reason)
        rows.append((reason, f"{whole['strays_up_to_um']:.3f}", shortened(whole["lines"])))
    return Table(("reason", "strays up to, um", "lines"), rows)


def _figures(trace: Trace, error: str) -> Iterator[Section]:
    """Figures along the program, and of the tool path; `error`: name of the error in the figures."""
    bins, ways = trace.bins, trace.paths
    if not bins.moves:
        return
    joined = f" Each step stands for {bins.width} moves: line RMS, area up to the largest." if bins.width > 1 else ""
    if not np.isnan(bins.largest).all():
        yield Section(
            f"{error.capitalize()} along the program",
            f"At the ends of moves, in the order they run; mind the two scales.{joined}",
            figure=error_figure(bins),
        )
    yield Section(
        "Corrections along the program",
        f"What was added to each axis.{' From the smallest to the largest of each step.' if bins.width > 1 else ''}",
        figure=correction_figure(bins, trace.machine),
    )
    if len(ways.points):
        some = f" One feed move in {ways.stride} is drawn." if ways.stride > 1 else ""
        yield Section(
            "Where on the part",
            f"Nominal tool path of feed moves in the workpiece frame, coloured by the {error} before correction.{some}",
            figure=plan_figure(ways),
        )


def _worst_table(trace: Trace, places: Sequence[MoveEnd]) -> Table:
    axes = [axis.name for axis in trace.machine.axes]
    rows = [(str(p.line), *(f"{value:.3f}" for value in p.target), f"{p.before:.3f}", f"{p.after:.3f}") for p in places]
    return Table(("line", *axes, "before, um", "after, um"), rows)
