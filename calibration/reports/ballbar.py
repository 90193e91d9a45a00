"""The report of circular tests with a ballbar."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from calibration.circles.figures import CircularTest
from calibration.circles.result import Share, Shares
from calibration.circles.spikes import kept
from calibration.circles.terms import OTHER
from calibration.reports.causes.text import with_uncertainty
from kinematics.effects import KINDS
from kinematics.files.number_text import plus_minus, uncertainty
from kinematics.files.report_head import ReportHead
from rendering.figures import COLOURS, MACHINE, Figure, Panel, grid, ranked
from rendering.report import Report, Section, Table, facts

NOT_CORRECTED = ("servo-mismatch", "reversal-spike")
"""Causes that depend on the dynamics of the drives: corrected positions do not remove them."""
EFFECTS_OF = {
    "squareness": "location", "straightness": "error-motion", "positioning-curve": "error-motion",
    "scale-mismatch": "scale", "other-error-motions": "error-motion",
}  # fmt: skip
"""Kinds of effects by kinds of causes of circles that have another name."""
TABLES = ("backlash", "lateral-play")
"""Causes that differ by the direction of motion."""


def ballbar_json(tests: Sequence[CircularTest], shares: Shares) -> dict[str, Any]:
    """The result for programs."""
    return {
        "tests": [test.json() for test in tests],
        "causes": [cause.json() for cause in shares.causes],
        "centre_offset_um": dict(shares.offset_um),
        "centre_offset_U_um": {name: 2.0 * u for name, u in shares.offset_u.items()},
        "before_rms_um": shares.before_um,
        "unexplained_rms_um": shares.unexplained_um,
        "noise_um": shares.noise_um,
        "rows_left_out": shares.left_out,
        "not_visible": list(shares.hidden),
        "detection_limits": [limit.json() for limit in shares.limits],
    }


def ballbar_report(tests: Sequence[CircularTest], shares: Shares, lead: str, head: ReportHead) -> Report:
    """The result for people."""
    sections = [*_polar(tests), *_ranking(shares), *_figures(tests), *_causes(shares)]
    return Report("Circular test, ISO 230-4:2005", lead, sections, _verdict(shares), head=head)


def _verdict(shares: Shares) -> str:
    names = ", ".join(f"{cause.name} ({100.0 * cause.share:.0f} %)" for cause in shares.causes[:3])
    found = f"Largest causes: {names}." if names else "No cause is significant."
    return (
        f"{found} Deviation {shares.before_um:.2f} um RMS, with the causes {shares.unexplained_um:.2f} um; "
        f"noise of the bar {shares.noise_um:.2f} um."
    )


def _figures(tests: Sequence[CircularTest]) -> Iterator[Section]:
    rows = [
        (test.plane, f"{test.feed:g}", each.symbol, each.title, f"{each.value:z.2f}", uncertainty(each.U, 2))
        for test in tests
        for each in test.figures
    ]
    yield Section(
        "Circular deviation",
        "Deviations are about the least-squares circle. U (k = 2) contains the uncertainties of the readings and of "
        "the bar's length; a range is the difference of two readings. Fmax, Fmin and D need a calibrated length.",
        Table(("plane", "feed, mm/min", "symbol", "deviation", "value, um", "U, um"), rows),
    )


def _causes(shares: Shares) -> Iterator[Section]:
    rows = []
    for cause in shares.causes:
        sizes = [_size(cause, name, value) for name, value in cause.parameters.items()]
        verdict = f"TIED: {', '.join(cause.tied_with)}" if cause.tied_with else "clear"
        share = f"{100.0 * cause.share:.0f} %"
        rows.append((cause.name, "; ".join(sizes), f"{cause.range_um:.2f}", share, verdict, _remedy(cause)))
    yield Section(
        "Shares of the causes",
        "Errors are actual minus nominal (ISO 841, ISO 230-1). The range is that of the signal on the circles without "
        "shift and radius; the share is of the mean square. TIED means that these circles do not distinguish the "
        "causes.\nDrive settings: servo mismatch and reversal spikes depend on the feed and on friction; a correction "
        "of positions, in a table or in a program, does not remove them, and ncomp leaves them out.",
        Table(("cause", "size and U (k=2)", "range, um", "share", "verdict", "remedy"), rows),
    )
    yield from _by_feed(shares)
    offset = ", ".join(
        f"{name} {plus_minus(value, 2.0 * shares.offset_u[name], 1, '+')} um"
        for name, value in shares.offset_um.items()
    )
    set_up = [("table ball from the stated centre", offset)]
    if shares.left_out:
        set_up.append(("rows left out", str(shares.left_out)))
    if shares.hidden:
        set_up.append(("not visible in these circles", ", ".join(shares.hidden)))
    yield facts("Set-up", set_up)
    yield Section(
        "Detection limits",
        "The table has the smallest size of each other cause that these circles would show beside the found ones (odds "
        "of 150 to 1), for the period or the decay that is seen best, and for the one that is seen worst.",
        Table(
            ("cause", "best", "worst", "unit"),
            [(each.name, f"{each.smallest:.2g}", f"{each.largest:.2g}", each.unit) for each in shares.limits],
        ),
        detail=True,
    )


KEPT = {
    "time": "it keeps its time: friction and control",
    "way": "it keeps its distance: mechanics",
    "both": "these feeds do not separate time and distance",
    "neither": "it keeps neither its distance nor its time",
}


def _by_feed(shares: Shares) -> Iterator[Section]:
    rows = []
    for cause in shares.causes:
        for each in cause.by_feed:
            way, time = plus_minus(each.way_mm, each.U_way, 3), plus_minus(each.time_ms, each.U_time, 1)
            rows.append((cause.name, f"{each.feed:g}", way, time, KEPT[kept(cause.by_feed)]))
    if rows:
        yield Section(
            "Reversal spikes by feed",
            "The spike decays over this distance since the reversal, and over this time on the circle, with U (k = 2).",
            Table(("cause", "feed, mm/min", "distance, mm", "time, ms", "conclusion"), rows),
        )


def _size(cause: Share, name: str, value: float) -> str:
    parameter, _, unit = name.partition("_")
    side, _, rest = unit.partition("_")
    label = f"{parameter} {'+' if side == 'plus' else '-'}" if side in ("plus", "minus") else parameter
    unit = (rest if side in ("plus", "minus") else unit).replace("_per_", "/")
    size = with_uncertainty(value, cause.U[name] / 2.0) if name in cause.U else f"{value:z.2f}"
    return f"{label} {size} {unit}"


def _remedy(cause: Share) -> str:
    if cause.kind in NOT_CORRECTED:
        return "drive settings"
    if cause.kind == OTHER:
        return "program; circles elsewhere and other instruments part them"
    return "bidirectional table, program" if cause.kind in TABLES else "table, program"


def _ranking(shares: Shares) -> Iterator[Section]:
    """Shares of the causes with their usual origin in the workshop and the repair."""
    if not shares.causes:
        return
    ordered = sorted(shares.causes, key=lambda cause: -cause.share)
    rows = [
        (cause.name, f"{100.0 * cause.share:.0f} %", *KINDS[EFFECTS_OF.get(cause.kind, cause.kind)].WORKSHOP)
        for cause in ordered
    ]
    table = Table(("cause", "share", "usual origin", "repair"), rows)
    drawn = partial(ranked, [(cause.name, cause.share, MACHINE) for cause in ordered], "% of the mean square")
    yield Section("Share by cause", table=table, figure=drawn, detail=True)


def _polar(tests: Sequence[CircularTest]) -> Iterator[Section]:
    text = "The curves are the enlarged deviations of both directions about the least-squares circle, um, on one scale."
    yield Section("Circles", text, figure=partial(_circles, tests))


def _circles(tests: Sequence[CircularTest]) -> Figure:
    largest = max(float(np.abs(values).max(initial=0.0)) for test in tests for values in test.deviations)
    return grid([_circle(test, largest or 1.0) for test in tests], 3, height=430)


def _circle(test: CircularTest, largest: float) -> Panel:
    """The deviations of both directions, enlarged, about the least-squares circle."""
    first, second = test.plane[0], test.plane[1]
    panel = Panel(kind="polar", title=f"Plane {test.plane}, feed {test.feed:g} mm/min")
    for circle, values, colour in zip(test.circles, test.deviations, COLOURS, strict=False):
        angles = np.degrees(circle.angles) % 360.0
        order = np.argsort(angles) if len(values) else slice(None)
        name = "counter-clockwise" if circle.counter_clockwise else "clockwise"
        trace = {"type": "scatterpolar", "mode": "lines", "theta": angles[order], "r": values[order], "name": name}
        panel.traces.append(trace | {"line": {"color": colour, "width": 1.5}})
    directions = {"tickvals": [0, 90, 180, 270], "ticktext": [f"+{first}", f"+{second}", f"-{first}", f"-{second}"]}
    radius = {"range": [-3.0 * largest, 1.2 * largest], "nticks": 6, "angle": 45, "tickangle": 45}
    panel.axes["polar"] = {"angularaxis": directions, "radialaxis": radius}
    return panel
