"""Figures of a correction: errors and corrections along the program, and the tool path coloured by its error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.evaluation.trace import Bins, DrawnPaths

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = "#3465a4", "#cc5500"
FINE = 200
"""dpi of paths, which are drawn as bitmaps: there can be too many segments for vector lines."""


def error_figure(bins: Bins, canvas: Figure) -> None:
    """RMS and largest error of each stretch, before above after, each with its own scale."""
    canvas.set_size_inches(9.0, 4.0)
    grid = canvas.subplots(2, 1, sharex=True)
    for k, (axes, stage, colour) in enumerate(zip(grid, ("before", "after"), (BEFORE, AFTER), strict=True)):
        if bins.width > 1:
            _area(axes, bins, np.zeros(len(bins)), bins.largest[:, k], colour)
        axes.stairs(bins.rms[:, k], bins.edges, baseline=None, color=colour, linewidth=1)
        axes.set_ylabel(f"{stage}, um")
        axes.set_ylim(bottom=0.0)
    grid[-1].set_xlabel("moves of the program")


def correction_figure(bins: Bins, machine: Machine, canvas: Figure) -> None:
    """Corrections of the linear axes that position the tool, and of each other corrected axis."""
    low, high = bins.corrections
    changed = np.nan_to_num(np.maximum(np.abs(low), np.abs(high))).max(axis=0) > 0.0
    shown = [i for i in range(len(machine.axes)) if changed[i] or i in machine.translators]
    canvas.set_size_inches(9.0, 1.3 * len(shown) + 0.3)
    grid = canvas.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axes, i in zip(grid, shown, strict=True):
        _area(axes, bins, low[:, i], high[:, i], BEFORE)
        for values in (low, high) if bins.width > 1 else (high,):
            axes.stairs(values[:, i], bins.edges, baseline=None, color=BEFORE, linewidth=1)
        axes.set_ylabel(f"{machine.names[i]}, {'urad' if machine.rotary[i] else 'um'}")
    grid[-1].set_xlabel("moves of the program")


def _area(axes: Axes, bins: Bins, low: Array, high: Array, colour: str) -> None:
    axes.stairs(high, bins.edges, baseline=low, fill=True, color=colour, alpha=0.25, linewidth=0)


def plan_figure(paths: DrawnPaths, canvas: Figure) -> None:
    """X-Y and X-Z views of the tool path, to one scale, coloured by the error before correction."""
    from matplotlib.collections import LineCollection

    segments = np.stack([paths.points[:, :-1], paths.points[:, 1:]], axis=2).reshape(-1, 2, 3)
    width = 2.5 if paths.stride > 1 else 1.0  # dots, where only some moves are drawn
    colours = ((paths.errors[:, :-1] + paths.errors[:, 1:]) / 2.0).reshape(-1)
    canvas.set_size_inches(9.0, 4.2)
    canvas.set_dpi(FINE)
    both_axes = canvas.subplots(1, 2)
    for axes, (i, j) in zip(both_axes, ((0, 1), (0, 2)), strict=True):
        lines = LineCollection(
            list(segments[:, :, [i, j]]),
            array=colours,
            cmap="viridis",
            linewidths=width,
            capstyle="round",
            rasterized=True,
        )
        axes.add_collection(lines)
        axes.autoscale()
        axes.set_aspect("equal", "datalim")
        axes.set_xlabel(f"{'xyz'[i]}, mm")
        axes.set_ylabel(f"{'xyz'[j]}, mm")
    canvas.colorbar(lines, ax=both_axes, label="error before, um", shrink=0.8)
