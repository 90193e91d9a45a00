"""The report of a correction: set-up, errors before and after, corrections, and largest errors on the part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from kinematics.files.report_head import calibration_text
from kinematics.running.durations import age_in_words
from postproc.control.tool_table import shown_tool
from postproc.correct.result import CorrectionResult
from postproc.evaluation.predicted_errors import Statistic
from postproc.text.line_numbers import ranges, shortened
from postproc.text.line_numbers import shown as line_text
from rendering.report import Report, Section, Table, facts

if TYPE_CHECKING:
    from postproc.correct.job import Job
    from postproc.evaluation.trace import MoveEnd, Trace

SIGNS = (
    "Errors are actual minus nominal, tool relative to workpiece: predicted by the exact error model of the "
    "calibration, not measured. A correction is the change of a command."
)
RELATIVE = (
    "A work offset that was touched off on the machine contains the machine's error at that position, and the part "
    "has the same offset. An error relative to the datum is the error minus the error at the touch-off: it is the "
    "error of the part. An absolute error assumes that the work offset is true."
)
DEMONSTRATION = "DEMONSTRATION CALIBRATION: it describes no real machine; do not cut with it."
HEAD = ("um", "max", "RMS", "number")
CONVERSIONS = {
    "to-axes": "Tool point (TCP) written as positions of the axes",
    "to-tcp": "Positions of the axes written as those of the tool point (TCP)",
}


def correction_report(job: Job, result: CorrectionResult, trace: Trace | None, command: str) -> Report:
    """The result for people; `trace`: the moves, for figures; `command`: the command line of the correction."""
    lead = f"machine {result.machine['name']} · calibration {result.calibration['id']}"
    head = job.machine.report.filled(machine=job.machine.name, calibration=calibration_text(job.model), command=command)
    warnings = [result.assumption, DEMONSTRATION if job.model.invented else ""]
    verdict = "\n".join(line for line in (*warnings, _verdict(result)) if line)
    name = Path(result.program["name"]).name
    foot = f"{name}, SHA-256 {result.program['sha256']} · {lead}"
    return Report(f"Correction of {name}", lead, list(_sections(job, result, trace)), verdict, head=head, foot=foot)


def _verdict(result: CorrectionResult) -> str:
    """The result in a few sentences."""
    before, after = result.before, result.after
    if result.conversion:
        converted = f"{CONVERSIONS[result.conversion]}: {result.converted_moves} of {result.moves} moves. "
        return (
            f"{converted}{_verdict(replace(result, conversion=''))}"
            if result.calibration["id"] != "none"
            else converted
        )
    if result.calibration["id"] == "none":
        return "No calibration: the program was written back as it was."
    if not result.anywhere.where:
        return "No error is evaluated: no move gives the positions of all axes that position the tool."
    ends = f"{before.rms:.2f} -> {after.rms:.2f} um RMS at {before.count} block ends, " if before.count else ""
    sure = f"; standard uncertainty (k=1) of the prediction {result.uncertainty.rms:.2f} um RMS"
    return (
        f"Predicted tool point {result.error}: {ends}at most {result.anywhere.text()}"
        f"{sure if result.uncertainty.largest else ''}."
    )


def _sections(job: Job, result: CorrectionResult, trace: Trace | None) -> Iterator[Section]:
    if trace is not None:
        if (surface := job.setup.surface) is not None:
            from postproc.correct.report_figures import surface_section

            yield surface_section(surface, trace.paths)
        yield from _figures(trace, result.error)
    yield facts("Set-up", list(_set_up(result)))
    yield Section("Options and inputs", table=Table(("", ""), _choices(job, result)), detail=True)
    yield Section("Conventions", f"{SIGNS}\n{RELATIVE if result.relative else ''}", detail=True)
    if result.calibration["id"] != "none":
        yield Section("Errors", "\n".join(_about_errors(result)), Table(HEAD, _error_rows(result, trace)))
    if result.correction and result.calibration["id"] != "none":
        corrections = [(f"correction {axis}", statistic) for axis, statistic in result.correction.items()]
        corrections += [(f"correction {axis}, urad", statistic) for axis, statistic in result.rotary_correction.items()]
        yield Section("Corrections", table=Table(HEAD, _rows(corrections)))
    if result.not_split:
        rows = [
            (reason, f"{not_split.largest_um:.2f}", shortened(ranges(not_split.lines)))
            for reason, not_split in result.not_split.items()
        ]
        text = f"These feed moves deviate by more than {job.tolerance_um:g} um between their ends."
        yield Section("Moves that were not split", text, Table(("reason", "largest deviation, um", "lines"), rows))
    listed = {not_split.text(reason) for reason, not_split in result.not_split.items()}
    if notes := [note for note in result.notes if note not in listed]:
        yield Section("Notes", "\n".join(notes))
    if trace is not None:
        for stage, ends in zip(("before", "after"), trace.worst, strict=True):
            if ends:
                text = "The table has the ends of moves in programmed coordinates (mm, degrees)."
                yield Section(f"Largest errors {stage}", text, _worst_table(trace, ends), detail=True)


def _set_up(result: CorrectionResult) -> Iterator[tuple[str, str]]:
    """Program, set-up and numbers of moves."""
    program, machine, calibration = result.program, result.machine, result.calibration
    age = f", {age_in_words(calibration['age_days'])}" if calibration["id"] != "none" else ""
    age = ", a demonstration" if calibration["demonstration"] else age
    yield "program", f"{program['name']}  ({program['dialect']}, {result.blocks} blocks, SHA-256 {program['sha256']})"
    yield "machine", f"{machine['name']}  {machine['chain']}"
    yield "calibration", f"{calibration['id']}{age}"
    if (surface := result.datums.setup.surface) is not None:
        yield "height map", f"{surface.note}: {', '.join(surface.size_summary)}"
    yield "work offsets", "; ".join(f"{name}: {value}" for name, value in result.work_offsets.items())
    yield from result.datums.facts(result.work_offsets)
    tools = ", ".join(f"{shown_tool(tool)}: {length}" for tool, length in result.tools.items())
    yield "tool lengths", f"{tools or 'none called: length 0'} (mm)"
    if conditions := result.conditions.text():
        yield "conditions", conditions
    split = f"; {result.split_moves} moves split" if result.split_moves else ""
    divided = result.split_moves or result.conversion
    where = "backlash is taken up or moves are split" if divided else "backlash is taken up"
    added = f"{split}; {result.added_blocks} blocks added where {where}" if result.added_blocks else ""
    changed = f"{result.converted_moves} converted" if result.conversion else f"{result.corrected} corrected"
    yield "moves", f"{result.moves} read, {changed} in {result.changed_blocks} blocks{added}"
    yield from (("accepted", f"{name}: {found}") for name, found in result.accepted.items())


def _choices(job: Job, result: CorrectionResult) -> list[tuple[str, str]]:
    """Rows on the options and on the calibration."""
    calibration = result.calibration
    rows = [
        ("classes", "all but FOR" if job.classes is None else ", ".join(sorted(job.classes))),
        ("tolerance", f"{job.tolerance_um:g} um between block ends"),
        ("travel", "moves outside it are refused" if job.travel_check else "moves outside it are noted"),
    ]
    if calibration["id"] == "none":
        return rows
    return [*rows, ("calibration", f"made {calibration['made_at'][:10]} by {calibration['made_by']}")]


def _rows(named: Sequence[tuple[str, Statistic]]) -> list[tuple[str, ...]]:
    return [(name, f"{s.largest:.2f}", f"{s.rms:.2f}", str(s.count)) for name, s in named]


def _error_rows(result: CorrectionResult, trace: Trace | None) -> list[tuple[str, ...]]:
    """Rows of statistics and of the uncertainty, um unless named."""
    error = result.error
    absolute = [result.absolute_before, result.absolute_after] if result.relative else [Statistic(), Statistic()]
    named = [
        (f"{error} at block ends before", result.before),
        (f"{error} at block ends after", result.after),
        (f"{error} between block ends before", Statistic() if trace is None else trace.between_before),
        (f"{error} between block ends after", result.between_ends),
        ("absolute error at block ends before", absolute[0]),
        ("absolute error at block ends after", absolute[1]),
        ("tool axis before, urad", result.tilt_before),
        ("tool axis after, urad", result.tilt_after),
        ("standard uncertainty (k=1)", result.uncertainty),
    ]
    return _rows([(name, statistic) for name, statistic in named if statistic.count])


def _about_errors(result: CorrectionResult) -> Iterator[str]:
    """Sentences on the moves without a predicted error, and on the certainty of the improvement."""
    if result.not_evaluated:
        yield (
            f"Without a predicted error: {result.not_evaluated} of {result.moves} moves, at which the program has not "
            "given all positions yet, or moves in machine coordinates."
        )
    if result.significance.share is not None:
        rest = " The rest may be no improvement." if result.significance.share < 1.0 else ""
        yield (
            f"{100.0 * result.significance.share:.0f} % of the improvement is certain: it is at moves whose "
            f"improvement exceeds twice its standard uncertainty (k=2).{rest}"
        )


def _figures(trace: Trace, error: str) -> Iterator[Section]:
    """Figures along the program, and of the tool path; `error`: name of the error in the figures."""
    from postproc.correct.report_figures import correction_figure, error_figure, path_sections

    bins = trace.bins
    yield from path_sections(trace.paths, error)
    if not bins.moves:
        return
    steps = f" Each step joins {bins.width} moves: the line is their RMS, the area reaches to the largest."
    joined = steps if bins.width > 1 else ""
    if not np.isnan(bins.largest).all():
        text = f"The errors are those at the ends of moves, in the order of execution.{joined}"
        yield Section(f"{error.capitalize()} along the program", text, figure=partial(error_figure, bins))
    text = "The curves are the corrections of each axis"
    text += ", from the smallest to the largest of each step." if bins.width > 1 else "."
    yield Section("Corrections along the program", text, figure=partial(correction_figure, bins, trace.machine))


def _worst_table(trace: Trace, ends: Sequence[MoveEnd]) -> Table:
    rows = [
        (line_text(p.line), f"{p.before:.2f}", f"{p.after:.2f}", *(f"{value:.3f}" for value in p.target)) for p in ends
    ]
    return Table(("line", "before, um", "after, um", *trace.machine.names), rows)
