"""The figure of a cause: readings of single rows, their means, and the fitted cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calibration.reports.causes.views import View
from kinematics.transforms import Array
from rendering.figures import dots, some

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = ("#7a9cc6", "#d99a6c")
MEANS = ("#204a87", "#a33c00")
FITTED = "#111111"
MEANS_ALONG = 24
WIDTHS = {1: 6.5, 2: 8.6, 3: 9.6}
"""Width of a figure, inches, by the number of panels in a row."""
PER_CELL, FEWEST_CELLS, MOST_CELLS = 12, 4, 10
"""Mean number of rows in a cell of a map; least and most cells along each of its axes."""
PER_MEAN = 4
"""Least number of rows of a mean."""
OUTER = 1.0
"""Share of the points, per cent, that may lie outside of a panel on each side."""


def cause_figure(views: Sequence[View], canvas: Figure) -> None:
    """The panels of one cause, at most three in a row."""
    widths = [2 if view.over is not None else 1 for view in views]
    across = min(sum(widths), 3)
    down = -(-sum(widths) // across)
    canvas.set_size_inches(WIDTHS[across], 2.8 * down)
    panels = iter(canvas.subplots(down, across, squeeze=False).ravel())
    for view in views:
        if view.over is None:
            _panel(next(panels), view)
        else:
            _maps(canvas, (next(panels), next(panels)), view)
    for panel in panels:
        panel.set_axis_off()


def _panel(panel: Axes, view: View) -> None:
    certain = np.isfinite(view.u)
    groups = view.groups or (("", np.ones(len(certain), bool)),)
    for number, (name, group) in enumerate(groups):
        rows = some(np.flatnonzero(group & certain))
        dots(panel, view.x[rows], view.y[rows], POINTS[number], markersize=2.5, alpha=0.6)
        label = name or "mean of rows, U (k=2)"
        if not view.means:
            panel.plot(view.x[rows], view.y[rows], "o", markersize=3, color=MEANS[number], label=label, rasterized=True)
            continue
        x, mean, u = np.array(list(_means(view, group & certain))).reshape(-1, 3).T
        panel.errorbar(x, mean, 2 * u, fmt="o", markersize=3, color=MEANS[number], linewidth=0.9, label=label)
    if view.curves:
        for curve in view.curves:
            colour = MEANS[curve.group] if len(view.curves) > 1 else FITTED
            panel.plot(curve.x, curve.y, color=colour, linewidth=1.3, label="fitted" if not curve.group else None)
    elif view.means:
        rows = some(np.flatnonzero(certain))
        dots(panel, view.x[rows], view.fitted[rows], FITTED, label="fitted")
    if view.moment is not None:
        panel.axvline(view.moment, color="#cc0000", linewidth=1, linestyle="--", label="moment found")
    if view.ticks:
        panel.set_xticks(range(len(view.ticks)), view.ticks)
    panel.set_ylim(*_limits(view, certain))
    panel.set_xlabel(view.x_label)
    panel.set_ylabel(view.y_label)
    panel.legend(loc="best", fontsize=7, framealpha=0.7, edgecolor="none")


def _limits(view: View, certain: np.ndarray) -> tuple[float, float]:
    """Limits of the y axis: nearly all points, and all of the fitted cause."""
    inner = np.percentile(view.y[certain], (OUTER, 100.0 - OUTER)) if certain.any() else np.zeros(1)
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
    if len(distinct) <= MEANS_ALONG:
        cells = np.searchsorted(distinct, np.round(view.x[numbers], 9))
    else:
        count = min(MEANS_ALONG, max(len(numbers) // PER_MEAN, 1))
        edges = np.quantile(view.x[numbers], np.linspace(0, 1, count + 1)[1:-1])
        cells = np.searchsorted(edges, view.x[numbers], side="right")
    for cell in np.unique(cells):
        own = numbers[cells == cell]
        weights = view.u[own] ** -2
        whole = weights.sum()
        yield float(view.x[own] @ weights / whole), float(view.y[own] @ weights / whole), float(whole**-0.5)


def _maps(canvas: Figure, panels: tuple[Axes, Axes], view: View) -> None:
    """Means of readings in cells of two variables beside those of the fitted cause, in the same colours."""
    assert view.over is not None
    certain = np.isfinite(view.u)
    count = int(np.clip(np.sqrt(certain.sum() / PER_CELL), FEWEST_CELLS, MOST_CELLS))
    edges = [np.linspace(v[certain].min(), v[certain].max(), count + 1) for v in (view.x, view.over)]
    (read, u), (fitted, _) = (_cells(view, values, edges, certain) for values in (view.y, view.fitted))
    most = 1.5 * float(np.nanmax(np.abs(fitted), initial=1e-9))
    read = np.where(2 * u < most, read, np.nan)
    for panel, values, origin in ((panels[0], read, "from the data"), (panels[1], fitted, "fitted")):
        mesh = panel.pcolormesh(*edges, values.T, cmap="RdBu_r", vmin=-most, vmax=most, rasterized=True)
        panel.set_title(f"{view.title}, {origin}")
        panel.set_xlabel(view.x_label)
        panel.set_ylabel(view.over_label)
        panel.grid(visible=False)
    canvas.colorbar(mesh, ax=panels[1], label=view.y_label)


def _cells(view: View, values: Array, edges: Sequence[Array], certain: np.ndarray) -> tuple[Array, Array]:
    """Weighted means in cells of both variables, and their standard uncertainties; NaN and infinite without rows."""
    assert view.over is not None
    weights = view.u[certain] ** -2
    pair = view.x[certain], view.over[certain]
    sums = np.histogram2d(*pair, bins=list(edges), weights=weights * values[certain])[0]
    whole = np.histogram2d(*pair, bins=list(edges), weights=weights)[0]
    known = np.where(whole > 0, whole, 1.0)
    return np.where(whole > 0, sums / known, np.nan), np.where(whole > 0, known**-0.5, np.inf)
