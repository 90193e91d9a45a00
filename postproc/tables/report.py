"""The report of an export: the errors with and without the tables, and the errors that no table holds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from kinematics.files.report_head import calibration_text
from postproc.tables.export import Exported
from postproc.tables.not_representable import Unrepresented
from postproc.tables.sheet import STAGES, shift_warning, table_rows
from rendering.figures import AFTER, BEFORE, Figure, ranked
from rendering.report import Report, Section, Table
from rendering.volume import Field, volume_section

DEMONSTRATION = "DEMONSTRATION CALIBRATION: it describes no real machine; do not load its tables."
DRAWN = 12
"""Most errors in the figure; the table has all."""
COLOURED = (("rms", BEFORE), ("max", AFTER))
"""Drawn sizes."""
SIZES = {"rms": "RMS", "p95": "95 %", "max": "largest"}


def export_report(
    exported: Exported, left: Sequence[Unrepresented], errors: Mapping[str, Any], folder: str, files: Sequence[str]
) -> Report:
    """The result for people; `errors`: over the volume, and along a program; `files` are in the folder."""
    machine, whole = exported.target.machine, exported.whole
    point = errors["volume"]["tool_point_um"]
    warning = shift_warning(exported.datum, point)
    stage = "after_tables_and_datum_shift" if exported.datum else "after_tables"
    verdict = [
        *([DEMONSTRATION] if whole.invented else []),
        f"Tool point error over the volume: {point['before']['rms']:.2f} -> {point[stage]['rms']:.2f} um RMS, at most "
        f"{point['before']['max']:.2f} -> {point[stage]['max']:.2f} um, {STAGES[stage]}."
        f"{' The largest error does not become smaller.' if point[stage]['max'] >= point['before']['max'] else ''}",
        *([f"Zero shift: {warning}."] if warning else []),
    ]
    head = machine.report.filled(machine=machine.name, calibration=calibration_text(whole))
    title = f"{exported.format.title}: machine {machine.name}"
    lead = f"{', '.join(files)} in {folder}"
    return Report(title, lead, list(_sections(exported, left, errors)), "\n".join(verdict), head=head)


def _sections(exported: Exported, left: Sequence[Unrepresented], errors: Mapping[str, Any]) -> Iterator[Section]:
    for where, numbers in errors.items():
        yield remaining_section(where, numbers, STAGES)
    fields = [Field("before, without tables", exported.whole), Field("after, left by the tables", exported.rest)]
    yield from volume_section(exported.target.machine, fields)
    yield Section(
        "Tables",
        "Positions are in mm and degrees.",
        Table(("table", "points", "from", "to", "largest value"), table_rows(exported)),
    )
    yield from left_section("Not in the tables", left)
    form, content = exported.format, exported.content
    meant = "the error (actual minus commanded)" if content.sign == "error" else "the correction (added)"
    origin = "known for this format" if form.sign else "as given by --sign; no source confirms it"
    yield Section("Meaning of the numbers", f"Values are {meant}: {origin}.\n{flowing(form.meaning)}")
    yield Section("Loading into the control", flowing(form.loading))
    yield Section("Certainty", flowing(form.certainty))


def flowing(text: str) -> str:
    """The text without the line ends inside its paragraphs."""
    return "\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def remaining_section(where: str, numbers: Mapping[str, Any], stages: Mapping[str, str]) -> Section:
    """Errors of each stage over a volume or along a program, as a table and on one scale."""
    found = {stages[stage]: sizes for stage, sizes in numbers["tool_point_um"].items()}
    rows = [(name, *(f"{sizes[key]:.2f}" for key in SIZES)) for name, sizes in found.items()]
    table = Table(("tool point error, um", *SIZES.values()), rows)
    return Section(f"Remaining errors over the {where}", table=table, figure=partial(_stages, found))


def left_section(title: str, left: Sequence[Unrepresented]) -> Iterator[Section]:
    """The errors that an export cannot hold, ranked, with the reasons."""
    if not left:
        return
    known = sorted((item for item in left if not math.isnan(item.rms_um)), key=lambda item: -item.rms_um)
    bars = [(item.name, item.rms_um, AFTER) for item in known[:DRAWN]]
    drawn = partial(ranked, bars, "RMS at the tool point, um", "um")
    rows = [(item.name, "" if math.isnan(item.rms_um) else f"{item.rms_um:.2f}", item.why) for item in left]
    yield Section(title, table=Table(("error", "RMS, um", "reason"), rows), figure=drawn if known else None)


def _stages(found: Mapping[str, Mapping[str, float]]) -> Figure:
    """RMS and largest error of each stage, on one scale."""
    rows = [(f"{name}, {SIZES[key]}", sizes[key], colour) for name, sizes in found.items() for key, colour in COLOURED]
    return ranked(rows, "tool point error, um", "um")
