"""The report of positioning tests by ISO 230-2."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibration.single_axis.iso230 import DIRECTIONS, AxisTest
from kinematics.report_head import ReportHead
from rendering.figures import COLOURS, band
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

IN_THE_CHART = ("A", "E", "R", "B", "M")
"""Symbols of the values beside the chart of an axis."""


def iso230_report(tests: Sequence[AxisTest], lead: str, head: ReportHead) -> Report:
    """The result for people; `lead`: the data, for the page."""
    return Report("ISO 230-2:2014", lead, [section for test in tests for section in _sections(test)], head=head)


def _sections(test: AxisTest) -> Iterator[Section]:
    unit = test.unit
    rows = []
    for i, position in enumerate(test.positions):
        cells = [cell for direction in range(len(DIRECTIONS)) for cell in _cells(test, direction, i)]
        rows.append((f"{position:g}", *cells, number(test.reversal[i])))
    head = [cell for direction in DIRECTIONS for cell in (f"{direction} mean", "s", "runs")]
    table = Table((f"target, {test.position_unit}", *head, "reversal B_i"), rows)
    yield Section(f"Axis {test.axis}: deviations in {unit}", "Measured minus target.", table)
    text = (
        "Means of each direction, with bands of twice the estimator s. Dashed: the ends of A, the accuracy of both "
        "directions."
    )
    yield Section(f"Axis {test.axis}: chart", text, figure=partial(_chart, test))
    values = [(value.symbol, value.title, number(value.value), number(value.U)) for value in test.values]
    head = [f"value, {unit}", f"U (k=2, instrument), {unit}"]
    yield Section(f"Axis {test.axis}: ISO 230-2:2014", table=Table(("", "", *head), values))


def _chart(test: AxisTest, canvas: Figure) -> None:
    """Means and spreads over the targets, with the values of the axis."""
    canvas.set_size_inches(7.5, 3.4)
    panel, spread = canvas.subplots(1, 1), np.nan_to_num(test.spread)
    for direction, colour in enumerate(COLOURS[: len(DIRECTIONS)]):
        rows = test.count[direction] > 0
        if rows.any():
            x, mean = test.positions[rows], test.mean[direction, rows]
            band(panel, x, mean, 2.0 * spread[direction, rows], colour, DIRECTIONS[direction])
            panel.plot(x, mean, "." if direction else "o", color=colour, markersize=4)
    if test.both.any():
        high, low = test.mean + 2.0 * spread, test.mean - 2.0 * spread
        for end in (high[:, test.both].max(), low[:, test.both].min()):
            panel.axhline(end, color="#555", linewidth=0.8, linestyle="--")
    panel.axhline(0.0, color="#888", linewidth=0.6)
    panel.set_xlabel(f"{test.axis}, {test.position_unit}")
    panel.set_ylabel(f"measured minus target, {test.unit}")
    values = {value.symbol: value for value in test.values}
    shown = [f"{name} {number(values[name].value)}" for name in IN_THE_CHART if name in values]
    panel.set_title(f"{', '.join(shown)} {test.unit}" if shown else "")
    panel.legend(frameon=False)


def _cells(test: AxisTest, direction: int, i: int) -> tuple[str, str, str]:
    return number(test.mean[direction, i]), number(test.spread[direction, i]), str(test.count[direction, i])


def number(value: float) -> str:
    """A value with two decimals; empty where it is unknown (nan)."""
    return "" if math.isnan(value) else f"{value:z.2f}"
