"""The report of an export: the errors with and without the data in the control, and the errors that they leave."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from kinematics.files.report_head import calibration_text
from postproc.control_data.exported import ExportedData, Page, Unrepresented
from rendering.figures import AFTER, BEFORE, Figure, ranked
from rendering.report import Report, Section, Table
from rendering.volume import volume_section

DRAWN_ERRORS = 12
"""Most errors in the figure; the table has all."""
COLOURED = (("rms", BEFORE), ("max", AFTER))
"""Drawn sizes."""
SIZES = {"rms": "RMS", "p95": "95 %", "max": "largest"}


def export_report(
    exported: ExportedData, left: Sequence[Unrepresented], errors: Mapping[str, Any], folder: str, files: Sequence[str]
) -> Report:
    """The result for people; `errors`: over the volume, and along a program; `files` are in the folder."""
    whole, form, page = exported.whole, exported.format, exported.page(errors["volume"])
    before, after = (errors["volume"]["tool_point_um"][stage] for stage in ("before", page.stage))
    verdict = [
        *([f"DEMONSTRATION CALIBRATION: it describes no real machine; do not load its {form.KIND}."] * whole.invented),
        f"Tool point error over the volume: {before['rms']:.2f} -> {after['rms']:.2f} um RMS, at most "
        f"{before['max']:.2f} -> {after['max']:.2f} um, {page.stages[page.stage]}.{page.remark}",
        *([f"{page.shift}."] if page.shift else []),
        *(note.strip("*") for note in exported.unit_notes),
    ]
    head = exported.machine.report.filled(machine=exported.machine.name, calibration=calibration_text(whole))
    title, lead = f"{form.title}: machine {exported.machine.name}", f"{', '.join(files)} in {folder}"
    return Report(title, lead, list(_sections(exported, page, left, errors)), "\n".join(verdict), head=head)


def _sections(
    exported: ExportedData, page: Page, left: Sequence[Unrepresented], errors: Mapping[str, Any]
) -> Iterator[Section]:
    for where, numbers in errors.items():
        yield _remaining(where, numbers, page.stages)
    if page.fields:
        yield from volume_section(exported.machine, page.fields, sizes=False)
    for each in page.listings:
        if each.report is not None:
            yield Section(each.title, each.report, Table(each.head, each.rows))
    yield from _left(f"Not in the {exported.format.KIND}", left)
    yield Section("Meaning of the numbers", "\n".join(map(_flowing, page.meanings)))
    yield Section("Loading into the control", _flowing(exported.loading))
    yield Section("Certainty", _flowing(exported.format.certainty))


def _flowing(text: str) -> str:
    """The text without the line ends inside its paragraphs."""
    return "\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _remaining(where: str, numbers: Mapping[str, Any], stages: Mapping[str, str]) -> Section:
    """Errors of each stage over a volume or along a program, as a table and on one scale."""
    found = {stages[stage]: sizes for stage, sizes in numbers["tool_point_um"].items()}
    rows = [(name, *(f"{sizes[key]:.2f}" for key in SIZES)) for name, sizes in found.items()]
    table = Table(("tool point error, um", *SIZES.values()), rows)
    return Section(f"Remaining errors over the {where}", table=table, figure=partial(_stages, found))


def _left(title: str, left: Sequence[Unrepresented]) -> Iterator[Section]:
    """The errors that an export cannot hold, ranked, with the reasons."""
    if not left:
        return
    known = sorted((item for item in left if not math.isnan(item.rms_um)), key=lambda item: -item.rms_um)
    bars = [(item.name, item.rms_um, AFTER) for item in known[:DRAWN_ERRORS]]
    drawn = partial(ranked, bars, "RMS at the tool point, um", "um")
    rows = [(item.name, "" if math.isnan(item.rms_um) else f"{item.rms_um:.2f}", item.why) for item in left]
    yield Section(title, table=Table(("error", "RMS, um", "reason"), rows), figure=drawn if known else None)


def _stages(found: Mapping[str, Mapping[str, float]]) -> Figure:
    """RMS and largest error of each stage, on one scale."""
    rows = [(f"{name}, {SIZES[key]}", sizes[key], colour) for name, sizes in found.items() for key, colour in COLOURED]
    return ranked(rows, "tool point error, um", "um")
