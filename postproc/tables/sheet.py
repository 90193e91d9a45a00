"""The sheet that goes beside the files: what the numbers mean, how they get into the control, how sure that is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from postproc.tables.export import Exported
from postproc.tables.not_carried import Left
from postproc.tables.parameters import parameter_rows

STAGES = {
    "before": "without compensation",
    "after_tables": "with these tables",
    "after_tables_and_datum_shift": "with these tables and the zero of the axes shifted by the constants above",
    "after_nc_correction": "with corrected programs and no tables",
    "after_tables_and_nc_correction_of_the_rest": "with these tables and programs corrected for the rest",
}


def sheet(exported: Exported, left: Iterable[Left], volume: dict[str, Any]) -> str:
    """The text of the sheet, Markdown."""
    return "\n".join(_lines(exported, left, volume)) + "\n"


def _lines(exported: Exported, left: Iterable[Left], volume: dict[str, Any]) -> Iterator[str]:
    form, whole = exported.format, exported.whole
    x, y, z = exported.target.tool
    yield f"# {form.title}: machine {exported.target.machine.name}"
    yield ""
    yield f"Calibration {whole.id} of {whole.provenance.made_at:%Y-%m-%d}, tool tip at ({x:zg}, {y:zg}, {z:zg}) mm"
    yield "from the spindle nose. Positions are in machine coordinates."
    if whole.demonstration:
        yield "**Demonstration calibration: it describes no real machine. Do not load these tables.**"
    meant = "the error (actual minus commanded)" if exported.content.sign == "error" else "the correction (added)"
    told = "known for this format" if form.sign else "as said by --sign; no source confirms it"
    yield from ["", "## What the numbers mean", "", f"Values are {meant}: {told}.", "", form.meaning]
    yield from ["", "## How to load them", "", form.loading, "", "## How certain this is", "", form.certainty]
    yield from ["", "## Tables", "", "| table | points | from | to | largest value |", "|---|---|---|---|---|"]
    yield from _tables(exported)
    if exported.datum:
        yield from ["", "Constants that the tables must not hold, as corrections: shift the zero of the axis, or leave"]
        yield "them to the work offset: " + ", ".join(f"{axis} {value:.6f}" for axis, value in exported.datum.items())
    rows = parameter_rows(whole, exported.target.machine, form.parameters)
    if rows:
        yield from ["", "## Parameters", "", "| of | value | where |", "|---|---|---|"]
        yield from (f"| {row.what} | {row.value} | {row.place} |" for row in rows)
    yield from ["", "## What this leaves", "", "Tool point error over the working volume, um, by the exact model:", ""]
    yield from ["| | RMS | 95 % | max |", "|---|---|---|---|"]
    for stage, numbers in volume["tool_point_um"].items():
        yield f"| {STAGES[stage]} | {numbers['rms']:.3f} | {numbers['p95']:.3f} | {numbers['max']:.3f} |"
    yield from ["", "Not in the tables (RMS at the tool point, um):", ""]
    yield from (f"- {item.name}: {_size(item.rms_um)}, {item.why}" for item in left)
    yield "- the orientation of the tool: RMS " + f"{volume['tool_axis_urad']['after_tables']['rms']:.2f} urad"


def _size(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _tables(exported: Exported) -> Iterator[str]:
    for term in exported.content.terms:
        for factor in term.factors:
            nodes = factor.nodes if isinstance(factor.nodes, tuple) else (factor.nodes,)
            points = " x ".join(str(len(n)) for n in nodes)
            ends = [", ".join(f"{n[k]:g}" for n in nodes) for k in (0, -1)]
            yield f"| {term.name} | {points} | {ends[0]} | {ends[1]} | {np.abs(factor.values).max():.6f} |"
    for table in exported.content.motions:
        largest = max(np.abs(table.forward).max(), np.abs(table.backward).max()) * (1e6 if table.angular else 1e3)
        unit = "urad" if table.angular else "um"
        yield f"| {table.name} | {len(table.nodes)} | {table.nodes[0]:g} | {table.nodes[-1]:g} | {largest:.3f} {unit} |"
