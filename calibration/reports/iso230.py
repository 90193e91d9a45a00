"""The report of positioning tests by ISO 230-2."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from calibration.single_axis.iso230 import DIRECTIONS, AxisTest
from rendering.report import Report, Section, Table


def iso230_report(tests: Sequence[AxisTest]) -> Report:
    """The result for people."""
    return Report("ISO 230-2:2014", "", [section for test in tests for section in _sections(test)])


def _sections(test: AxisTest) -> Iterator[Section]:
    unit = test.unit
    rows = []
    for i, position in enumerate(test.positions):
        cells = [cell for direction in range(len(DIRECTIONS)) for cell in _cells(test, direction, i)]
        rows.append((f"{position:g}", *cells, number(test.reversal[i])))
    head = [cell for direction in DIRECTIONS for cell in (f"{direction} mean", "s", "runs")]
    table = Table((f"target, {test.position_unit}", *head, "reversal B_i"), rows)
    yield Section(f"Axis {test.axis}: deviations in {unit}", "Measured minus target.", table)
    values = [(value.symbol, value.title, number(value.value), number(value.U)) for value in test.values]
    head = [f"value, {unit}", f"U (k=2, instrument), {unit}"]
    yield Section(f"Axis {test.axis}: ISO 230-2:2014", table=Table(("", "", *head), values))


def _cells(test: AxisTest, direction: int, i: int) -> tuple[str, str, str]:
    return number(test.mean[direction, i]), number(test.spread[direction, i]), str(test.count[direction, i])


def number(value: float) -> str:
    """A value with two decimals; empty where it is unknown (nan)."""
    return "" if math.isnan(value) else f"{value:z.2f}"
