"""Results of a study: measured positions, remaining error, and the improvement by more points or hours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from calibration.study.definition import StudyEntry
from calibration.study.results import standard_errors
from calibration.study.run import Draws, Result
from calibration.study.stopping import LEVEL, estimates
from kinematics.files.report_head import ReportHead
from kinematics.forward import tool_point
from kinematics.transforms import Array
from rendering.figures import AFTER, BEFORE, RED, Figure, Panel, area, dots, grid, line, rgba, some
from rendering.report import Report, Section, Table

MOST_DRAWN_DRAWS = 2000
"""Most points, and most draws, that are drawn of one case."""
METRES_FROM_MM = 2000.0
"""Extent of positions, mm, above which they are shown in m."""
SCENES = 6
"""Most cases whose positions are drawn: a browser draws few 3-D figures."""
SHOWN_UM = 1e-3
"""Least shown difference of exact fits, um."""
CURVE = 4
"""Least number of cases with different numbers of points for which a curve is drawn."""
DOUBTFUL_SHARE = 0.1
"""Largest difference between linear and exact fits without a warning, as a share of the error."""


def study_report(results: Sequence[Result], study: StudyEntry, draws: Draws, command: str) -> Report:
    """The result for people; `command`: the command that made it."""
    instruments = sorted({result.case.instrument.kind().replace("-", " ") for result in results})
    head = ReportHead(machine=study.machine, instrument=f"virtual {', '.join(instruments)}", command=command)
    return Report(
        f"Virtual calibration of {study.machine}",
        "",
        list(_sections(results, study, draws)),
        _verdict(results),
        head=head,
    )


def _verdict(results: Sequence[Result]) -> str:
    """The case with the least error."""
    best = min(results, key=lambda result: float(result.after[0].mean()))
    before, after = estimates(best.before[0]), estimates(best.after[0])
    of = f" of {len(results)} cases" if len(results) > 1 else ""
    useless = "No case reduces the error.\n" if after.mean >= before.mean else ""
    return (
        f"{useless}Least error{of}: case {best.case.name}, {best.points} points in {best.minutes:.0f} min, RMS "
        f"volumetric error {before.mean:.2f} -> {after.mean:.2f} um (mean), {before.quantile:.2f} -> "
        f"{after.quantile:.2f} um (95 % quantile)."
    )


def _sections(results: Sequence[Result], study: StudyEntry, draws: Draws) -> Iterator[Section]:
    yield Section(
        "Error before and after",
        "The shapes show the distribution of the RMS volumetric error over the draws, before (above) and after (below) "
        "the calibration, with its mean (line) and 95 % quantile (dots).",
        figure=partial(_distributions, results),
    )
    yield Section("Results", _lead(study, results), _table(results))
    if len({result.points for result in results}) >= CURVE:
        text = "Dots are means over the draws, and the band is the 95 % quantile."
        yield Section("Points and time", text, figure=partial(_curve, results))
    text = "The figures show the positions of the target, and of a tracker, in the workpiece frame."
    if len(results) > SCENES:
        text += f" The first {SCENES} of {len(results)} cases are drawn."
    yield Section("Measured positions", text, figure=partial(_position_figure, results))
    if notes := list(_notes(results, draws)):
        yield Section("Notes", "\n".join(notes))


def _lead(study: StudyEntry, results: Sequence[Result]) -> str:
    checked = [result.check for result in results if result.check is not None]
    text = (
        f"{study.description} The seed is {study.seed}. The table has the mean and the 95 % quantile over the "
        "draws of the RMS error over the volume after rigid alignment."
    )
    if checked:
        largest = max(check.difference for check in checked)
        text += (
            f"\nExact fits of {len(checked[0].exact)} draws a case differ by at most {max(largest, SHOWN_UM):.2g} um."
        )
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
    return Table(("case", "points", "time, min", "draws", *columns, "u (k=1) of the mean, um"), rows)


def _notes(results: Sequence[Result], draws: Draws) -> Iterator[str]:
    for each in results:
        yield from (f"case {each.case.name}: {note}" for note in each.notes)
        if not each.converged:
            yield f"case {each.case.name}: {draws.most} draws are too few for a tolerance of {draws.tolerance_um:g} um"
    checks = [each.check for each in results if each.check is not None]
    if any(check.difference > DOUBTFUL_SHARE * float(check.exact.mean()) for check in checks):
        yield (
            f"DOUBTFUL: results differ from exact fits by more than {DOUBTFUL_SHARE:.0%}: errors of this size are "
            "not linear"
        )


def _distributions(results: Sequence[Result]) -> Figure:
    """Distribution of the errors over the draws of each case, before above after, with its mean and 95 % quantile."""
    names = [result.case.name for result in results]
    panel = Panel("RMS volumetric error, um", axes={"bare": True, "xaxis": {"rangemode": "tozero"}})
    panel.axes["yaxis"] = {"visible": False, "range": [len(results) - 0.55, -0.65]}
    for k, result in enumerate(results):
        for values, colour, side, name in (
            (result.before[0], BEFORE, "negative", "before"),
            (result.after[0], AFTER, "positive", "after"),
        ):
            _half(panel, k, values, colour, side, name)
        panel.notes.append(
            {"xref": "domain", "x": 0, "y": k - 0.5, "text": f"<b>case {names[k]}</b>", "xanchor": "left"}
        )
    return Figure([panel], height=70 + 78 * len(results))


def _half(panel: Panel, row: int, values: Array, colour: str, side: str, name: str) -> None:
    """One side of a row: the distribution, its mean and its quantile."""
    form = {"type": "violin", "orientation": "h", "side": side, "points": False, "spanmode": "hard", "width": 0.7}
    look = {"line": {"color": colour, "width": 1}, "fillcolor": rgba(colour, 0.4), "hoverinfo": "skip"}
    drawn = some(np.sort(values), MOST_DRAWN_DRAWS)
    panel.traces.append(form | look | {"x": drawn, "y": np.full(len(drawn), float(row)), "name": name})
    end = row + (-0.33 if side == "negative" else 0.33)
    for value, dash, title in ((values.mean(), "solid", "mean"), (np.quantile(values, LEVEL), "dot", "95 % quantile")):
        line(panel, np.full(2, value), np.array([row, end]), colour, width=2, dash=dash)
        panel.traces[-1]["hovertemplate"] = f"{name}, {title}: %{{x:.2f}} um<extra></extra>"


def _curve(results: Sequence[Result]) -> Figure:
    ordered = sorted(results, key=lambda result: result.points)
    points = np.array([float(result.points) for result in ordered])
    hours = np.array([result.minutes for result in ordered]) / 60.0
    panels = []
    for x, label in ((points, "points"), (hours, "measuring time, h")):
        panel = Panel(label, "RMS volumetric error, um", axes={"yaxis": {"rangemode": "tozero"}})
        before, after = [r.before[0] for r in ordered], [r.after[0] for r in ordered]
        for values, colour, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
            found = [estimates(each) for each in values]
            mean, quantile = (np.array([each[k] for each in ((e.mean, e.quantile) for e in found)]) for k in (0, 1))
            area(panel, x, mean, quantile, colour)
            line(panel, x, mean, colour, name)
            dots(panel, x, mean, colour, size=6, opacity=1)
        panels.append(panel)
    return grid(panels, 2, same_y=True, height=300)


def _position_figure(results: Sequence[Result]) -> Figure:
    return grid([_positions(result) for result in results[:SCENES]], 3, height=330)


def _positions(result: Result) -> Panel:
    """Positions of the target, and the trackers, of one case."""
    targets, trackers = _targets(result), np.array(result.case.trackers, float).reshape(-1, 3)
    unit, length = ("m", 1e3) if np.ptp(np.vstack([targets, trackers]), axis=0).max() > METRES_FROM_MM else ("mm", 1.0)
    panel = Panel(f"x, {unit}", f"y, {unit}", result.case.name, f"z, {unit}", kind="scene")
    for points, colour, size, symbol, name in (
        (targets, BEFORE, 2, "circle", "target"),
        (trackers, RED, 5, "diamond", "tracker"),
    ):
        x, y, z = points.T / length
        trace = {"type": "scatter3d", "mode": "markers", "x": x, "y": y, "z": z, "name": name}
        panel.traces.append(trace | {"marker": {"size": size, "color": colour, "symbol": symbol}})
    return panel


def _targets(result: Result) -> Array:
    """Positions `(n, 3)` of the target, mm, workpiece frame."""
    plan = result.case.plan
    assert plan.state.target is not None
    rows = some(np.arange(len(plan)), MOST_DRAWN_DRAWS)
    tools = np.array([plan.targets[name].position for name in plan.state.target[rows].tolist()])
    return tool_point(plan.machine, plan.positions[rows], tools)
