"""The report of positioning tests by ISO 230-2."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from calibration.single_axis.cells import DIRECTIONS
from calibration.single_axis.diagonals import largest_of_diagonals
from calibration.single_axis.iso230 import AxisTest
from kinematics.files.number_text import plus_minus, uncertainty
from kinematics.files.report_head import ReportHead
from rendering.figures import COLOURS, Figure, Panel, band, dots, extent, level
from rendering.report import Report, Section, Table, shortened

LISTED_ASTRAY = 4
"""Most readings in the verdict that disagree with the others; the JSON has all."""
IN_THE_VERDICT = ("A", "R", "B")
"""Symbols of the values of the verdict."""
LINES = {"A": ("dash", 1.0), "E": ("dot", 0.0), "M": ("dashdot", 0.5)}
"""Form of the lines at the ends of each value, and the position of its label."""
CURVES = (
    "The curves are the means of each direction, with bands of twice the estimator s. Horizontal lines show the "
    "ends of the accuracy A (dashed), of the systematic deviation E (dotted) and of the mean deviation M "
    "(dash-dotted) of both directions. Vertical lines mark the targets with the largest reversal value B and "
    "repeatability R."
)
"""Meaning of the lines of all charts."""
OLDER = (
    "ISO 230-2:1988 counts 3 s to each side of a mean, where ISO 230-2 counts 2 s since 1997. VDI/DGQ 3441 has half of "
    "the reversal error and 3 times the mean s of both directions to each side of the mean of both directions."
)
"""What differs between the standards."""


def iso230_report(tests: Sequence[AxisTest], lead: str, head: ReportHead) -> Report:
    """The result for people; `lead`: the data, for the page."""
    sections = [section for test in tests for section in _sections(test, CURVES if test is tests[0] else "")]
    verdict, standard = "\n".join(map(_verdict, tests)), "ISO 230-2:2014"
    if any(test.diagonal for test in tests):
        standard = "body diagonals, ISO 230-6"
        most = (
            f"{each.title}: {each.symbol} {plus_minus(each.value, each.U, 2)} um"
            for each in largest_of_diagonals(tests)
        )
        verdict = f"Largest {'; largest '.join(most)}.\n{verdict}"
    return Report(f"Positioning test, {standard}", lead, sections, verdict, head=head)


def iso230_json(tests: Sequence[AxisTest]) -> dict[str, Any]:
    """The results for programs, with those of all diagonals where there are some."""
    diagonals = [test for test in tests if test.diagonal]
    answer: dict[str, Any] = {"axes": [test.json() for test in tests]}
    return answer | ({"diagonals": tests[0].listed(largest_of_diagonals(diagonals))} if diagonals else {})


def _verdict(test: AxisTest) -> str:
    """The values of an axis in a sentence."""
    values = {value.symbol: value for value in test.values if not math.isnan(value.value)}
    parts = [
        f"{values[name].title.split(',')[0]} {name} {plus_minus(values[name].value, values[name].U, 2)} {test.unit}"
        for name in IN_THE_VERDICT
        if name in values
    ]
    text = f"{_noun(test)} {test.axis}: {', '.join(parts) or 'no target has readings in both directions'}."
    return " ".join([text, *_disagreeing(test)])


def _noun(test: AxisTest) -> str:
    return "Diagonal" if test.diagonal else "Axis"


def _disagreeing(test: AxisTest) -> Iterator[str]:
    """A sentence on the readings that disagree with the others, and on the repeatability without them."""
    if not test.astray:
        return
    readings, runs = int(test.count.sum()), {each.run for each in test.astray}
    each = [f"{one.where} ({one.deviation:+.3g} {test.unit})" for one in test.astray]
    where = f", all in run {next(iter(runs))}" if len(runs) == 1 and len(each) > 1 and "" not in runs else ""
    without = [f"{value.symbol} {value.value:.2f} {test.unit}" for value in test.without if value.symbol in ("A", "R")]
    yield (
        f"{len(each)} of {readings} readings disagree with the others of their target{where}: "
        f"{'; '.join(shortened(each, LISTED_ASTRAY, 'readings'))}. ISO 230-2 counts them; without them the axis has "
        f"{', '.join(without)}."
    )


def _sections(test: AxisTest, text: str) -> Iterator[Section]:
    """Chart and tables of an axis; `text`: above the chart."""
    unit = test.unit
    yield Section(f"{_noun(test)} {test.axis}: chart", text, figure=partial(_chart, test))
    values = [(value.symbol, value.title, number(value.value), _uncertainty(value.U)) for value in test.values]
    head = [f"value, {unit}", f"U (k=2, instrument), {unit}"]
    standard = "ISO 230-6" if test.diagonal else "ISO 230-2:2014"
    yield Section(f"{_noun(test)} {test.axis}: {standard}", table=Table(("symbol", "parameter", *head), values))
    yield _others(test)
    rows = []
    for i, position in enumerate(test.positions):
        cells = [cell for direction in range(len(DIRECTIONS)) for cell in _cells(test, direction, i)]
        rows.append((f"{position:g}", *cells, number(test.reversal[i])))
    head = [cell for direction in DIRECTIONS for cell in (f"{direction} mean", "s", "runs")]
    table = Table((f"target, {test.position_unit}", *head, "reversal B_i"), rows)
    yield Section(f"{_noun(test)} {test.axis}: deviations in {unit}", "Deviations are measured minus target.", table)


def _others(test: AxisTest) -> Section:
    """The values by older standards."""
    rows = [
        (standard, value.symbol, value.title, number(value.value), _uncertainty(value.U))
        for standard, values in test.others.items()
        for value in values
    ]
    head = ("standard", "symbol", "parameter", f"value, {test.unit}", f"U (k=2, instrument), {test.unit}")
    return Section(
        f"{_noun(test)} {test.axis}: the same readings by older standards", OLDER, Table(head, rows), detail=True
    )


def _chart(test: AxisTest) -> Figure:
    """Means and spreads over the targets, with the values of the axis."""
    label = f"measured minus target, {test.unit}"
    panel, spread = Panel(f"{test.axis}, {test.position_unit}", label), np.nan_to_num(test.spread)
    for direction, colour in enumerate(COLOURS[: len(DIRECTIONS)]):
        rows = test.count[direction] > 0
        if rows.any():
            x, mean = test.positions[rows], test.mean[direction, rows]
            band(panel, x, mean, 2.0 * spread[direction, rows], colour, f"{DIRECTIONS[direction]}, mean ± 2 s")
            dots(panel, x, mean, colour, size=6, opacity=1)
    if test.both.any():
        _ends(panel, test, {value.symbol: number(value.value) for value in test.values if not math.isnan(value.value)})
    return Figure([panel], height=380)


def _ends(panel: Panel, test: AxisTest, values: Mapping[str, str]) -> None:
    """Lines at the ends of A, E and M, and at the targets with the largest reversal value B and repeatability R."""
    positions, mean = test.positions[test.both], test.mean[:, test.both]
    half, middle = 2.0 * np.nan_to_num(test.spread)[:, test.both], mean.mean(axis=0)
    for symbol, low, high in (("A", mean - half, mean + half), ("E", mean, mean), ("M", middle, middle)):
        if symbol in values:
            dash, place = LINES[symbol]
            label, upper = f"{symbol} {values[symbol]}", symbol == "E"
            level(panel, float(low.min()), "" if upper else label, dash=dash, at=place, below=symbol == "A")
            level(panel, float(high.max()), label if upper else "", dash=dash, at=place)
    for symbol, low, high in (("B", mean, mean), ("R", mean - half, mean + half)):
        if symbol in values:
            at = int(np.argmax(high.max(axis=0) - low.min(axis=0)))
            ends = float(low[:, at].min()), float(high[:, at].max())
            extent(panel, float(positions[at]), *ends, f"{symbol} {values[symbol]}", below=symbol == "B")


def _cells(test: AxisTest, direction: int, i: int) -> tuple[str, str, str]:
    return number(test.mean[direction, i]), number(test.spread[direction, i]), str(test.count[direction, i])


def _uncertainty(u: float) -> str:
    """An uncertainty as `number` has it, but not zero."""
    return "" if math.isnan(u) else uncertainty(u, 2)


def number(value: float) -> str:
    """A value with two decimals; empty where it is unknown (nan)."""
    return "" if math.isnan(value) else f"{value:z.2f}"
