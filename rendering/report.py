"""The report of a result: a verdict and sections of sentences, tables and figures, written once for all renderings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import msgspec

from kinematics.files.report_head import ReportHead

if TYPE_CHECKING:
    from rendering.figures import Figure


class Table(msgspec.Struct, frozen=True):
    """Rows of text below a heading row; with a heading row of empty cells: facts, each a name and its text."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]


class Section(msgspec.Struct, frozen=True):
    """A heading with its content; a section of a figure, without a table, is on the page only."""

    title: str
    text: str = ""
    """Sentences; each line is a paragraph."""
    table: Table | None = None
    figure: Callable[[], Figure] | None = None
    """Makes the figure."""
    detail: bool = False
    """True for a section that is on the page only, folded if it has no figure."""


class Report(msgspec.Struct, frozen=True):
    """The result of a command for people."""

    title: str
    lead: str
    """Inputs and command."""
    sections: Sequence[Section]
    verdict: str = ""
    """The result in a few sentences; each line is a paragraph."""
    refusal: str = ""
    """Sentence above everything else: the reason why a result is not written."""
    head: ReportHead = msgspec.field(default_factory=ReportHead)
    """Entries by which a shop files the page."""
    foot: str = ""
    """Name and hash of what the page is about, on each printed sheet; empty: the title."""


def with_notes(report: Report, notes: Sequence[str]) -> Report:
    """The report with those of these notes that it does not have yet, each once, at its end."""
    cells = (cell for each in report.sections if each.table is not None for row in each.table.rows for cell in row)
    present = "\n".join((report.verdict, *(each.text for each in report.sections), *cells))
    new = [note for note in dict.fromkeys(notes) if note not in present]
    if not new:
        return report
    title = "Further notes" if any(each.title == "Notes" for each in report.sections) else "Notes"
    return msgspec.structs.replace(report, sections=[*report.sections, Section(title, "\n".join(new))])


def facts(title: str, rows: Sequence[Sequence[str]]) -> Section:
    """A section of facts, each a name and its text."""
    return Section(title, table=Table(("", ""), rows))


def shortened(lines: Sequence[str], most: int, noun: str) -> list[str]:
    """The first lines of a long list, and the number of the others; `noun`: name of a line."""
    return [*lines[:most], *([f"... and {len(lines) - most} more {noun}"] if len(lines) > most else [])]
