"""The figure of a cause: readings of single rows, their means, and the fitted cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.reports.causes.text import Told, title
from calibration.reports.causes.view import View
from kinematics.transforms import Array
from rendering.figures import (
    COLOURS,
    INK,
    INSTRUMENT,
    MACHINE,
    RED,
    UNEXPLAINED,
    Figure,
    Panel,
    bars_of_error,
    colour_axis,
    dots,
    grid,
    heat,
    line,
    ranked,
    some,
)

MEANS = COLOURS[:2]
CAUSE_MEANS = 24
SHARE = "% of the squared residuals of the model without these causes, in units of the noise"
PER_CELL, FEWEST_CELLS, MOST_CELLS = 12, 4, 10
"""Mean number of rows in a cell of a map; least and most cells along each of its axes."""
CAUSE_ROWS_OF_MEAN = 4
"""Least number of rows of a mean."""
CAUSE_OUTSIDE_PERCENT = 1.0
"""Share of the points, per cent, that may lie outside of a panel on each side."""


def share_chart(causes: Sequence[Told], unexplained: float) -> Figure:
    """Share of the squares without any cause, by cause, and the share that no cause explains."""
    ordered = sorted(causes, key=lambda cause: -cause.share)
    rows = [(title(c), c.share, INSTRUMENT if c.where == "instrument" else MACHINE) for c in ordered]
    return ranked([*rows, ("noise and unexplained residual", unexplained, UNEXPLAINED)], SHARE)


def cause_figure(views: Sequence[View]) -> Figure:
    """The panels of one cause; maps of one cause have one colour scale."""
    maps = [view for view in views if view.over is not None]
    most = 1.5 * max((float(np.abs(view.fitted[np.isfinite(view.u)]).max(initial=1e-9)) for view in maps), default=0.0)
    panels = [panel for view in views for panel in ([_panel(view)] if view.over is None else _maps(view, most))]
    colours = colour_axis(-most, most, maps[0].y_label, signed=True) if maps else None
    return grid(panels, 3, height=300, colours=colours)


def _panel(view: View) -> Panel:
    panel, certain = Panel(view.x_label, view.y_label, view.title), np.isfinite(view.u)
    groups = view.groups or (("", np.ones(len(certain), bool)),)
    for number, (name, group) in enumerate(groups):
        rows = some(np.flatnonzero(group & certain))
        dots(panel, view.x[rows], view.y[rows], MEANS[number], opacity=0.3)
        label = f"{name or 'rows'}, mean and U (k=2)"
        if not view.means:
            dots(panel, view.x[rows], view.y[rows], MEANS[number], name, size=5, opacity=1)
            continue
        x, mean, u = np.array(list(_means(view, group & certain))).reshape(-1, 3).T
        bars_of_error(panel, x, mean, 2 * u, MEANS[number], label)
    if view.curves:
        for curve in view.curves:
            colour, of = (MEANS[curve.group], groups[curve.group][0]) if len(view.curves) > 1 else (INK, "")
            line(panel, curve.x, curve.y, colour, f"fitted {of}".strip(), width=2)
    elif view.means:
        rows = some(np.flatnonzero(certain))
        dots(panel, view.x[rows], view.fitted[rows], INK, "fitted", opacity=1)
    if view.moment is not None:
        moment = {"color": RED, "width": 1.5, "dash": "dash"}
        at = {"x0": view.moment, "x1": view.moment, "y0": 0, "y1": 1, "yref": "domain"}
        panel.shapes.append({"type": "line", "line": moment} | at)
        panel.notes.append({"x": view.moment, "xanchor": "left", "y": _limits(view, certain)[1], "yanchor": "top",
                            "text": "moment found"})  # fmt: skip
    panel.axes["yaxis"] = {"range": _limits(view, certain)}
    if view.ticks:
        panel.axes["xaxis"] = {"tickvals": list(range(len(view.ticks))), "ticktext": list(view.ticks)}
    return panel


def _limits(view: View, certain: np.ndarray) -> tuple[float, float]:
    """Limits of the y axis: nearly all points, and all of the fitted cause."""
    inner = (
        np.percentile(view.y[certain], (CAUSE_OUTSIDE_PERCENT, 100.0 - CAUSE_OUTSIDE_PERCENT))
        if certain.any()
        else np.zeros(1)
    )
    drawn = np.concatenate([inner, view.fitted[certain], *(curve.y for curve in view.curves)])
    low, high = float(drawn.min()), float(drawn.max())
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin


def _means(view: View, rows: np.ndarray) -> Iterator[tuple[float, float, float]]:
    """Weighted means of adjacent rows: x, y, standard uncertainty."""
    if not rows.any():
        return
    numbers = np.flatnonzero(rows)
    distinct = np.unique(np.round(view.x[numbers], 9))
    if len(distinct) <= CAUSE_MEANS:
        cells = np.searchsorted(distinct, np.round(view.x[numbers], 9))
    else:
        count = min(CAUSE_MEANS, max(len(numbers) // CAUSE_ROWS_OF_MEAN, 1))
        edges = np.quantile(view.x[numbers], np.linspace(0, 1, count + 1)[1:-1])
        cells = np.searchsorted(edges, view.x[numbers], side="right")
    for cell in np.unique(cells):
        own = numbers[cells == cell]
        weights = view.u[own] ** -2
        whole = weights.sum()
        yield float(view.x[own] @ weights / whole), float(view.y[own] @ weights / whole), float(whole**-0.5)


def _maps(view: View, most: float) -> Iterator[Panel]:
    """Means of readings in cells of two variables beside those of the fitted cause, in the same colours."""
    assert view.over is not None
    certain = np.isfinite(view.u)
    count = int(np.clip(np.sqrt(certain.sum() / PER_CELL), FEWEST_CELLS, MOST_CELLS))
    edges = [np.linspace(v[certain].min(), v[certain].max(), count + 1) for v in (view.x, view.over)]
    (read, u), (fitted, _) = (_cells(view, values, edges, certain) for values in (view.y, view.fitted))
    read = np.where(2 * u < most, read, np.nan)
    for values, origin in ((read, "from the data"), (fitted, "fitted")):
        panel = Panel(view.x_label, view.over_label, f"{view.title}, {origin}")
        heat(panel, edges[0], edges[1], values)
        yield panel


def _cells(view: View, values: Array, edges: Sequence[Array], certain: np.ndarray) -> tuple[Array, Array]:
    """Weighted means in cells of both variables, and their standard uncertainties; NaN and infinite without rows."""
    assert view.over is not None
    weights = view.u[certain] ** -2
    pair = view.x[certain], view.over[certain]
    sums = np.histogram2d(*pair, bins=list(edges), weights=weights * values[certain])[0]
    whole = np.histogram2d(*pair, bins=list(edges), weights=weights)[0]
    known = np.where(whole > 0, whole, 1.0)
    return np.where(whole > 0, sums / known, np.nan), np.where(whole > 0, known**-0.5, np.inf)
