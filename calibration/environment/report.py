"""The report of an environmental temperature variation error."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from calibration.environment.etve import Etve
from kinematics.files.number_text import plus_minus
from kinematics.files.report_head import ReportHead
from rendering.figures import COLOURS, Figure, Panel, grid, line
from rendering.report import Report, Section, Table

VARIATIONS = ("reading", "ETVE, U (k=2)", "unit", "extremes at, h", "u of a measurement so long")
TEMPERATURES = ("sensor", "lowest, degC", "highest, degC", "range in this time, K")


def etve_report(found: Etve, lead: str, head: ReportHead) -> Report:
    """The result for people."""
    sizes = ", ".join(f"{each.name} {plus_minus(each.value, each.U, 1)} {each.unit}" for each in found.variations)
    verdict = (
        f"Within {found.period_h:.3g} h the standing machine moves by up to (U, k=2): {sizes}.\n"
        f"From {len(found.time)} readings in {found.time[-1]:.3g} h."
    )
    title = "Environmental temperature variation error, ISO 230-3"
    return Report(title, lead, list(_sections(found)), verdict, head=head)


def _sections(found: Etve) -> Iterator[Section]:
    rows = [
        (
            each.name, plus_minus(each.value, each.U, 2), each.unit, f"{each.begin_h:.2f} and {each.end_h:.2f}",
            f"{each.u_measurement:.2f}",
        )
        for each in found.variations
    ]  # fmt: skip
    text = (
        "ETVE: the largest range of a reading within this time, wherever in the log it lies; the noise of the readings "
        "is in it. A and B: tilts about X and Y. u: standard uncertainty (k=1) of a measurement of this length by the "
        "variation, if all values in the range are equally likely (GUM 4.3.7)."
    )
    yield Section("Variation", text, Table(VARIATIONS, rows))
    warm = [
        (name, f"{values.min():.2f}", f"{values.max():.2f}", f"{found.range_of_temperature(name):.2f}")
        for name, values in found.temperatures.items()
    ]
    if warm:
        yield Section("Temperatures", "", Table(TEMPERATURES, warm))
    yield Section("Over time", "From the first reading; temperatures as they are.", figure=partial(_figure, found))


def _figure(found: Etve) -> Figure:
    panels = []
    for unit in dict.fromkeys(each.unit for each in found.variations):
        panel = Panel("time, h", unit, "displacement" if unit == "um" else "tilt")
        for each in (one for one in found.variations if one.unit == unit):
            values, colour = found.readings[each.name], COLOURS[("XYZ" if unit == "um" else "AB").index(each.name[0])]
            dash = "dash" if each.name.endswith("2") else "solid"
            line(panel, found.time, values - values[0], colour, each.name, dash=dash)
        panels.append(panel)
    if found.temperatures:
        panel = Panel("time, h", "degC", "temperature")
        for number, (name, values) in enumerate(found.temperatures.items()):
            line(panel, found.time, values, COLOURS[number % len(COLOURS)], name)
        panels.append(panel)
    return grid(panels, 1)
