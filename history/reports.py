"""Entries for people and for programs."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import msgspec

from history.causes import cause_json, causes_section
from history.trends.report import question_of_cause, trend_sections, verdict_of
from history.trends.series import Series
from history.trends.trend import Trend
from kinematics.files.number_text import plus_minus
from kinematics.files.report_head import ReportHead
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from history.entries import Checked, Life
    from history.schema import Entry, FigureRow

ENTRIES = ("entry", "date", "kind", "what", "figures")
COLUMNS = ("entry", "at", "kind", "method", "name", "unit", "value", "u")


def list_report(entries: Sequence[Entry], machine: str, address: str) -> Report:
    """The entries of a machine."""
    return Report(f"History of {machine}", address, [_life(entries)], _count(entries))


def machines_report(lives: Sequence[Life], address: str) -> Report:
    """A line for each machine."""
    rows = [(each.machine, str(each.entries), each.first[:10], each.last[:10]) for each in lives]
    section = Section("Machines", table=Table(("machine", "entries", "first", "last"), rows))
    return Report("History of the machines", address, [section], f"{len(rows)} machines")


def _count(entries: Sequence[Entry]) -> str:
    kinds = Counter(entry.kind for entry in entries)
    return f"{len(entries)} entries: " + ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())


def _life(entries: Sequence[Entry]) -> Section:
    rows = [(str(each.id), each.at[:10], each.kind, each.title, str(len(each.figures) or "")) for each in entries]
    return Section("Results and events", table=Table(ENTRIES, rows))


def show_report(
    entries: Sequence[Entry], machine: str, address: str, trends: Sequence[Trend], short: Sequence[Series]
) -> Report:
    """The trends, the latest figures, and the life."""
    rows = [
        (figure.name, plus_minus(figure.value, 2.0 * figure.u, 2), figure.unit, entry.at[:10], entry.method)
        for entry, figure in latest(entries)
    ]
    head = ("quantity", "value and U (k=2)", "unit", "date", "method")
    figures = Section("Latest figures", table=Table(head, rows))
    sections = [*trend_sections(trends, short), *causes_section(entries), figures, _life(entries)]
    verdict = "\n".join(filter(None, (verdict_of(trends), question_of_cause(trends, entries, machine))))
    return Report(f"Life of {machine}", address, sections, verdict, head=ReportHead(machine=machine))


def latest(entries: Sequence[Entry]) -> list[tuple[Entry, FigureRow]]:
    """The last figure of each quantity, by their names."""
    found = {figure.name: (entry, figure) for entry in entries for figure in entry.figures}
    return [found[name] for name in sorted(found)]


def entries_json(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Entries for programs, without their documents."""
    return [
        {
            "entry": each.id, "machine": each.machine.name, "kind": each.kind, "at": each.at,
            "entered_at": each.entered_at, "title": each.title, "method": each.method, "made_by": each.made_by,
            "fingerprint": each.fingerprint,
            "figures": [{"name": f.name, "unit": f.unit, "value": f.value, "u": f.u} for f in each.figures],
            "causes": list(map(cause_json, each.causes)),
            "files": [{"path": file.path, "fingerprint": file.fingerprint} for file in each.files],
        }
        for each in entries
    ]  # fmt: skip


def verify_report(found: Sequence[Checked], address: str) -> Report:
    """The files that are not as they were entered."""
    rows = [(str(each.entry), each.name, each.state) for each in found if each.state != "as entered"]
    verdict = f"{len(found) - len(rows)} of {len(found)} files and documents are as they were entered."
    sections = [Section("Changed or gone", table=Table(("entry", "file", "state"), rows))] if rows else []
    return Report("Files of the history", address, sections, verdict)


def exported(entries: Sequence[Entry]) -> dict[str, bytes]:
    """The files of an export, by name."""
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([COLUMNS, *figure_rows(entries)])
    listed = msgspec.json.format(msgspec.json.encode(entries_json(entries)), indent=1)
    documents = {f"{each.id}-{each.kind}.json": each.document for each in entries if each.document is not None}
    return {"entries.json": listed + b"\n", "figures.csv": table.getvalue().encode(), **documents}


def figure_rows(entries: Sequence[Entry]) -> Iterator[tuple[object, ...]]:
    """The columns of the figures, row by row."""
    for entry in entries:
        for each in entry.figures:
            yield entry.id, entry.at, entry.kind, entry.method, each.name, each.unit, each.value, each.u
