"""The page sheet.md beside the tables: meaning of the numbers, loading into the control, certainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from postproc.tables.export import Exported
from postproc.tables.not_representable import Unrepresented
from postproc.tables.parameters import parameter_rows

STAGES = {
    "before": "without compensation",
    "after_tables": "with these tables",
    "after_tables_and_datum_shift": "with these tables and the zero of the axes shifted as stated at the top",
    "after_nc_correction": "with corrected programs and no tables",
    "after_tables_and_nc_correction_of_the_rest": "with these tables and programs corrected for the remaining errors",
}


def sheet(exported: Exported, left: Iterable[Unrepresented], volume: dict[str, Any]) -> str:
    """The text of sheet.md, Markdown."""
    return "\n".join(_lines(exported, left, volume)) + "\n"


def _lines(exported: Exported, left: Iterable[Unrepresented], volume: dict[str, Any]) -> Iterator[str]:
    form, whole = exported.format, exported.whole
    x, y, z = exported.target.tool
    yield f"# {form.title}: machine {exported.target.machine.name}"
    yield ""
    yield f"Calibration {whole.id} of {whole.provenance.made_at:%Y-%m-%d}, tool tip at ({x:zg}, {y:zg}, {z:zg}) mm"
    yield "from the spindle nose. Positions are in machine coordinates."
    if whole.invented:
        yield "**Demonstration calibration: it describes no real machine. Do not load these tables.**"
    warning = shift_warning(exported.datum, volume["tool_point_um"])
    if warning:
        yield from ["", f"**Zero shift: {warning}.**"]
    meant = "the error (actual minus commanded)" if exported.content.sign == "error" else "the correction (added)"
    origin = "known for this format" if form.sign else "as given by --sign; no source confirms it"
    yield from ["", "## Meaning of the numbers", "", f"Values are {meant}: {origin}.", "", form.meaning]
    yield from ["", "## How to load them", "", form.loading, "", "## How certain this is", "", form.certainty]
    yield from ["", "## Tables", "", "| table | points | from | to | largest value |", "|---|---|---|---|---|"]
    yield from (
        f"| {row.name} | {row.points} | {row.first} | {row.last} | {row.largest} |" for row in table_rows(exported)
    )
    rows = parameter_rows(whole, exported.content, form.parameters)
    if rows:
        yield from [
            "",
            "## Parameters",
            "",
            "Values of the calibration; do not set a parameter whose value the tables contain already.",
        ]
        yield from ["", "| of | value | where | held by the tables |", "|---|---|---|---|"]
        yield from (f"| {' | '.join(row)} |" for row in rows)
    yield from ["", "## Remaining errors", "", "Tool point error over the working volume, um, by the exact model:", ""]
    yield from ["| | RMS | 95 % | max |", "|---|---|---|---|"]
    for stage, numbers in volume["tool_point_um"].items():
        yield f"| {STAGES[stage]} | {numbers['rms']:.2f} | {numbers['p95']:.2f} | {numbers['max']:.2f} |"
    yield from ["", "Not in the tables (RMS at the tool point, um):", ""]
    yield from (f"- {item.name}: {_size(item.rms_um)}, {item.why}" for item in left)
    yield "- the orientation of the tool: RMS " + f"{volume['tool_axis_urad']['after_tables']['rms']:.2f} urad"


def shift_warning(datum: Mapping[str, float], point_um: Mapping[str, Mapping[str, float]]) -> str:
    """The remaining error without a shift of the axes' zeros, and the shift; empty if none is needed."""
    if not datum:
        return ""
    before, alone, both = (point_um[stage] for stage in ("before", "after_tables", "after_tables_and_datum_shift"))
    worse = "; that is worse than no tables" if any(alone[k] > before[k] for k in ("rms", "max")) else ""
    shift = ", ".join(f"{axis} {value:+.6f}" for axis, value in datum.items())
    return (
        f"the tables hold no constant and alone leave {_pair(alone)} of {_pair(before)} um (RMS, max){worse}. "
        f"With the zeros of the axes shifted by {shift} (mm, degrees, added to commands) they leave {_pair(both)} um. "
        "Programs corrected with the calibration of --rest contain this shift already: do not shift the zeros for them"
    )


def _pair(numbers: Mapping[str, float]) -> str:
    return f"{numbers['rms']:.1f}, {numbers['max']:.1f}"


def _size(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


class TableRow(NamedTuple):
    """The contents of one table."""

    name: str
    points: str
    first: str
    last: str
    largest: str


def table_rows(exported: Exported) -> list[TableRow]:
    """Contents of all tables; positions in mm and degrees."""
    rows = []
    for term in exported.content.terms:
        unit = exported.target.machine.axes[exported.target.machine.index(term.output)].unit
        for k, factor in enumerate(term.factors):
            nodes = factor.nodes if isinstance(factor.nodes, tuple) else (factor.nodes,)
            first, last = (", ".join(f"{n[end]:g}" for n in nodes) for end in (0, -1))
            size = f"{np.abs(factor.values).max():.6f} {'x' if k else unit}"
            name = term.name if len(term.factors) == 1 else f"{term.name}, factor of {factor.axes[0]}"
            rows.append(TableRow(name, " x ".join(str(len(n)) for n in nodes), first, last, size))
    for table in exported.content.motions:
        largest = max(np.abs(table.forward).max(), np.abs(table.backward).max())
        size = f"{largest * 1e6:.3f} urad" if table.angular else f"{largest * 1e3:.3f} um"
        rows.append(TableRow(table.name, str(len(table.nodes)), f"{table.nodes[0]:g}", f"{table.nodes[-1]:g}", size))
    return rows
