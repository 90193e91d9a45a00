"""The page sheet.md on the data of a control: meaning of the numbers, loading into the control, certainty."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from postproc.control_data.exported import ExportedData, Unrepresented


def sheet(exported: ExportedData, left: Iterable[Unrepresented], volume: dict[str, Any]) -> str:
    """The text of sheet.md, Markdown; `volume`: the remaining errors."""
    return "\n".join(_lines(exported, left, volume)) + "\n"


def _lines(exported: ExportedData, left: Iterable[Unrepresented], volume: dict[str, Any]) -> Iterator[str]:
    form, whole, page = exported.format, exported.whole, exported.page(volume)
    yield from (f"# {form.title}: machine {exported.machine.name}", "")
    yield f"Calibration {whole.id} of {whole.provenance.made_at:%Y-%m-%d}, {page.tool}"
    if whole.invented:
        yield f"**Demonstration calibration: it describes no real machine. Do not load these {form.KIND}.**"
    for notice in page.notices:
        yield from ("", notice)
    yield from _part("Meaning of the numbers", *page.meanings)
    yield from _part("How to load them", exported.loading)
    yield from _part("How certain this is", form.certainty)
    for each in page.listings:
        if each.sheet is not None:
            yield from (*_part(each.title, *filter(None, [each.sheet])), "", *_table(each.head, each.rows))
    yield from _part("Remaining errors", "Tool point error over the working volume, um, by the exact model:")
    sizes = volume["tool_point_um"].items()
    rows = [(page.stages[stage], *(f"{size[key]:.2f}" for key in SIZES)) for stage, size in sizes]
    yield from ("", *_table(("", *SIZES.values()), rows))
    yield from ("", f"Not in the {form.KIND} (RMS at the tool point, um):", "")
    yield from (f"- {each.name}: {_size(each.rms_um, page.decimals)}, {each.why}" for each in left)
    yield from page.closing


SIZES = {"rms": "RMS", "p95": "95 %", "max": "max"}


def _part(title: str, *paragraphs: str) -> Iterator[str]:
    yield from ("", f"## {title}")
    for paragraph in paragraphs:
        yield from ("", paragraph)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |".replace("|  |", "| |")
    yield "|---" * len(head) + "|"
    yield from (f"| {' | '.join(row)} |" for row in rows)


def _size(value: float, decimals: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{decimals}f}"
