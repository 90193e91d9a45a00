"""Output on the terminal: tables, notes and progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.table import Table
from rich.text import Text

from kinematics.machine import Machine
from postproc.correct.check import Findings
from postproc.correct.classes import ClassResiduals
from postproc.correct.report import Report, Statistic
from postproc.text.line_numbers import ranges
from postproc.verification.verify import Verdict

console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
"""Standard error, for text beside a program or JSON on the standard output."""
output = Console(highlight=False, markup=False, soft_wrap=True)
"""Standard output, for results of commands."""

LONG = 1_000_000
"""Smallest size of a program, bytes, for which progress is shown."""


@contextmanager
def progress_of(total: int, what: str, long: int = LONG) -> Iterator[Callable[[int], None]]:
    """A function to call with each amount done of a total; a bar on a terminal from `long` on, nothing in a pipe."""
    if total < long or not console.is_terminal:
        yield lambda _: None
        return
    from rich.progress import Progress

    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.advance(task, done)


def show_report(report: Report) -> None:
    """Show the summary of a correction."""
    say_assumed(report.assumption)
    if report.calibration["demonstration"]:
        say("demonstration calibration", "it describes no real machine; don't cut with it")
    show_facts(report.facts(), console)
    if report.correction:
        console.print(_correction_table(report))
    for note in report.notes:
        say("note", note)


def show_findings(findings: Findings, name: str, *, to_errors: bool = False) -> None:
    """Show the findings of `ncomp check`."""
    to = console if to_errors else output
    if findings.assumption:
        to.print(findings.assumption)
    moves = len(findings.corrected) + len(findings.not_programmed) + len(findings.machine)
    to.print(f"program      {name}  ({findings.dialect}, {findings.blocks} blocks, {moves} moves)")
    for what, lines in (
        ("corrected", findings.corrected),
        ("not said", findings.not_programmed),
        ("machine", findings.machine),
        ("repeated", findings.repeated),
        ("not run", findings.not_run),
    ):
        if lines:
            to.print(f"{what:<12} {len(lines)}: lines {ranges(lines)}")
    for note in findings.notes:
        to.print(f"note         {note}")
    if findings.refused and findings.evidence:
        to.print(f"note         {findings.evidence}")
    for line, text, reason in findings.refused:
        to.print(f"refused      line {line}: {text!r}: {reason}")
    if not findings.refused:
        to.print("accepted")


def show_verdict(verdict: Verdict, to: Console, by: str = "", *, best_fit: bool = False) -> None:
    """Show the result of a verification; `by`: the model; `best_fit`: also the errors of the part aligned best fit."""
    absolute = verdict.absolute
    title = "; ".join(filter(None, ("relative to the datum" if verdict.relative else "", by)))
    table = Table("tool point error, um", "before max", "before RMS", "after max", "after RMS", "points", title=title)
    _row(table, "block ends", verdict.before, verdict.after)
    _row(table, "along feed moves", verdict.path_before, verdict.path_after)
    if verdict.relative:
        _row(table, "absolute, at ends", absolute.before, absolute.after)
        _row(table, "absolute, along", absolute.path_before, absolute.path_after)
    if best_fit:
        before, after = (fit.json() for fit in verdict.best_fit)
        table.add_row("best fit, along", "", f"{before['rms']:.3f}", "", f"{after['rms']:.3f}", str(before["count"]))
    to.print(table)
    parts = Table("what makes it (before)", "max um", "RMS um")
    ranked = sorted(verdict.contributions.items(), key=lambda item: -item[1].rms)
    for name, statistic in ranked[:10]:
        parts.add_row(name, f"{statistic.largest:.2f}", f"{statistic.rms:.2f}")
    if ranked:
        to.print(parts)


def show_facts(facts: list[tuple[str, str]], to: Console) -> None:
    """Show facts, each as a name and a text, one a line."""
    for what, text in facts:
        to.print(f"{what:<12} {text}")


def show_classes(rows: list[ClassResiduals], to: Console) -> None:
    """Show the errors that each choice of compensation classes would leave."""
    table = Table(
        "classes corrected",
        "tool point max um",
        "RMS um",
        "tool axis max urad",
        "RMS urad",
        "rotary axes moved, max urad",
    )
    for left in rows:
        numbers = (left.position.largest, left.position.rms, left.tilt.largest, left.tilt.rms, left.turning.largest)
        table.add_row(left.choice, *(f"{number:.2f}" for number in numbers))
    to.print(table)


def show_machine(machine: Machine, calibration: str) -> None:
    """Show a machine's chain and axes."""
    output.print(f"{machine.name}  {machine.description}")
    output.print(f"chain        {machine.chain}   (ISO 10791-6, workpiece to tool)")
    output.print(f"calibration  {calibration}")
    table = Table("axis", "carries", "tool moves (ISO 841)", "point, mm", "travel", "home", "resolution")
    for axis in machine.axes:
        way = "turns about" if axis.rotary else "along"
        table.add_row(
            axis.name,
            axis.side,
            f"{way} ({', '.join(f'{v:g}' for v in axis.direction)})",
            f"({', '.join(f'{v:g}' for v in axis.point)})",
            f"{axis.travel[0]:g}..{axis.travel[1]:g} {axis.unit}",
            f"{axis.home:g}",
            f"{axis.resolution:g}",
        )
    output.print(table)
    for name, offset in machine.work_offsets.items():
        values = ", ".join(f"{axis} {value:g}" for axis, value in offset.items()) or "0"
        output.print(f"work offset  {name}: {values}{' (assumed)' if machine.offsets_assumed else ''}")
    for name, length in machine.tools.items():
        output.print(f"tool length  {name}: {length:g} mm{' (assumed)' if machine.tools_assumed else ''}")


def say_assumed(sentence: str) -> None:
    """Show the part of the set-up that is assumed, as the first line of a run; nothing for an empty sentence."""
    if sentence:
        console.print(Text(sentence, "yellow"))


def say(what: str, text: str) -> None:
    """Show one line that a person must notice."""
    console.print(Text.assemble((f"{what}: ", "yellow"), text))


def _correction_table(report: Report) -> Table:
    table = Table("um", "max", "RMS")
    for name, statistic in report.corrections():
        table.add_row(name, f"{statistic.largest:.2f}", f"{statistic.rms:.2f}")
    table.add_section()
    for name, statistic in report.errors():
        table.add_row(name, f"{statistic.largest:.3f}", f"{statistic.rms:.3f}")
    if report.significance.share is not None:
        table.add_row("share of the improvement that is significant (k=2)", f"{report.significance.share:.0%}", "")
    return table


def _row(table: Table, name: str, before: Statistic, after: Statistic) -> None:
    numbers = (before.largest, before.rms, after.largest, after.rms)
    table.add_row(name, *(f"{number:.3f}" for number in numbers), str(before.count))
