"""Results of a study: measured positions, remaining error, and the improvement by more points or hours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from calibration.study.definition import StudyEntry
from calibration.study.results import standard_errors
from calibration.study.run import Draws, Result
from calibration.study.stopping import LEVEL, estimates
from kinematics.forward import tool_point
from kinematics.report_head import ReportHead
from kinematics.transforms import Array
from rendering.figures import some
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = "#3465a4", "#888a85"
TRACKER = "#cc0000"
MANY = 2000
"""Most points that are drawn of one case."""
ACROSS = 4
"""Plots in a row."""
CURVE = 4
"""Least number of cases with different numbers of points for which a curve is drawn."""
DOUBTFUL = 0.1
"""Largest difference between linear and exact fits without a warning, as a share of the error."""


def study_report(results: Sequence[Result], study: StudyEntry, draws: Draws, command: str) -> Report:
    """The result for people; `command`: the command that made it."""
    head = ReportHead(machine=study.machine, instrument="virtual laser tracker", command=command)
    return Report(f"Virtual calibration of {study.machine}", "", list(_sections(results, study, draws)), head=head)


def _sections(results: Sequence[Result], study: StudyEntry, draws: Draws) -> Iterator[Section]:
    yield Section("Results", _lead(study, results), _table(results))
    yield Section(
        "Error before and after",
        "RMS volumetric error of every draw; the line is the mean, the dash the 95 % quantile.",
        figure=partial(_distributions, results),
    )
    if len({result.points for result in results}) >= CURVE:
        text = "Mean over draws (dots) and 95 % quantile (band)."
        yield Section("Points and time", text, figure=partial(_curve, results))
    text = "Positions of the target, and the tracker."
    yield Section("Measured positions", text, figure=partial(_position_figure, results))
    if notes := list(_notes(results, draws)):
        yield Section("Notes", "\n".join(notes))


def _lead(study: StudyEntry, results: Sequence[Result]) -> str:
    checked = [result.check for result in results if result.check is not None]
    text = (
        f"{study.description} Seed {study.seed}. RMS error over the volume after rigid alignment: mean and 95 % "
        "quantile over draws."
    )
    if checked:
        largest = max(check.difference for check in checked)
        text += f"\nExact fits of {len(checked[0].exact)} draws a case differ by at most {largest:.2g} um."
    return text.strip()


def _table(results: Sequence[Result]) -> Table:
    rows = []
    for result in results:
        numbers = []
        for before, after in zip(result.before, result.after, strict=True):
            first, last = estimates(before), estimates(after)
            numbers += [f"{first.mean:.2f}", f"{last.mean:.2f}", f"{last.quantile:.2f}"]
        counts = str(result.points), f"{result.minutes:.0f}", str(result.after.shape[1])
        rows.append((result.case.name, *counts, *numbers, f"{standard_errors(result.after[0])[0]:.2f}"))
    regions = ("volume", "program")[: len(results[0].before)]
    columns = [f"{region} {stage}, um" for region in regions for stage in ("before", "after", "95 %")]
    return Table(("case", "points", "min", "draws", *columns, "u (k=1) of the mean, um"), rows)


def _notes(results: Sequence[Result], draws: Draws) -> Iterator[str]:
    for each in results:
        yield from (f"case {each.case.name}: {note}" for note in each.notes)
        if not each.converged:
            yield f"case {each.case.name}: {draws.most} draws are too few for a tolerance of {draws.tolerance_um:g} um"
    checks = [each.check for each in results if each.check is not None]
    if any(check.difference > DOUBTFUL * float(check.exact.mean()) for check in checks):
        yield (
            f"DOUBTFUL: results differ from exact fits by more than {DOUBTFUL:.0%}: errors of this size are not linear"
        )


def _distributions(results: Sequence[Result], canvas: Figure) -> None:
    canvas.set_size_inches(8.0, 0.45 * len(results) + 1.0)
    panel = canvas.subplots()
    for k, result in enumerate(results):
        _half(panel, -k, result.before[0], BEFORE, "high")
        _half(panel, -k, result.after[0], AFTER, "low")
    panel.set_yticks([-k for k in range(len(results))], [result.case.name for result in results])
    panel.set_xlim(left=0)
    panel.set_xlabel("RMS volumetric error, um: before (blue), after (grey)")


def _half(panel: Axes, row: int, values: Array, colour: str, side: Literal["low", "high"]) -> None:
    """One side of a row: the distribution, its mean and its quantile."""
    shape = panel.violinplot([values], [row], orientation="horizontal", side=side, widths=0.8, showextrema=False)
    for body in shape["bodies"]:  # type: ignore[attr-defined]
        body.set_facecolor(colour)
        body.set_alpha(0.6)
    end = row + (0.35 if side == "high" else -0.35)
    panel.plot([values.mean()] * 2, [row, end], color=colour, linewidth=1.5)
    panel.plot([np.quantile(values, LEVEL)] * 2, [row, end], color=colour, linewidth=1, linestyle=":")


def _curve(results: Sequence[Result], canvas: Figure) -> None:
    ranked = sorted(results, key=lambda result: result.points)
    points = np.array([result.points for result in ranked])
    hours = np.array([result.minutes for result in ranked]) / 60.0
    canvas.set_size_inches(8.0, 2.6)
    left, right = canvas.subplots(1, 2)
    for panel, x, label in ((left, points, "points"), (right, hours, "hours")):
        for values, colour in (([r.before[0] for r in ranked], BEFORE), ([r.after[0] for r in ranked], AFTER)):
            found = [estimates(each) for each in values]
            panel.plot(x, [each.mean for each in found], "o-", markersize=3, color=colour, linewidth=1)
            panel.fill_between(x, [e.mean for e in found], [e.quantile for e in found], color=colour, alpha=0.2)
        panel.set_xlabel(label)
        panel.set_ylim(bottom=0)
    left.set_ylabel("RMS volumetric error, um")


def _position_figure(results: Sequence[Result], canvas: Figure) -> None:
    across = min(ACROSS, len(results))
    rows = -(-len(results) // across)
    canvas.set_size_inches(8.0, 2.2 * rows)
    for k, result in enumerate(results, start=1):
        panel: Any = canvas.add_subplot(rows, across, k, projection="3d")
        x, y, z = _targets(result).T / 1e3
        panel.scatter(x, y, z, s=1, color=BEFORE, rasterized=True)
        for tracker in result.case.trackers:
            panel.scatter(*(value / 1e3 for value in tracker), s=20, color=TRACKER, marker="^")
        panel.set_title(result.case.name)
        panel.set_box_aspect([max(float(np.ptp(v)), 0.3) for v in (x, y, z)])
        panel.tick_params(labelsize=5)
        panel.locator_params(nbins=4)


def _targets(result: Result) -> Array:
    """Positions `(n, 3)` of the target, mm, workpiece frame."""
    plan = result.case.plan
    assert plan.state.target is not None
    rows = some(np.arange(len(plan)), MANY)
    tools = np.array([plan.targets[name].position for name in plan.state.target[rows].tolist()])
    return tool_point(plan.machine, plan.positions[rows], tools)
