"""Figures of a correction: errors and corrections along the program, and the tool path coloured by its error."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from kinematics.effects import WorkpieceSurface
from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.evaluation.trace import SEGMENTS, Bins, DrawnPaths
from rendering.figures import AFTER, BEFORE, Figure, Panel, area, colour_axis, grid, heat, line, steps
from rendering.report import Section

LABEL = "line of the program, in the order of execution"
TICKS = 40
"""Most lines that are named along the program; the page leaves out those for which it has no room."""
DRAWN_PATH_POINTS = 12_000
"""Most points of a 3-D path."""
JOINED_SEGMENTS = (1, 2, 4, 8, 16)
"""Segments of a drawn move that may be joined."""


def error_figure(bins: Bins) -> Figure:
    """RMS and largest error of each stretch, before and after on one scale, and after on its own."""
    panels = []
    for title, stages in (("before and after", (0, 1)), ("after, enlarged", (1,))):
        panel = Panel(LABEL, "error, um", title, axes={"yaxis": {"rangemode": "tozero"}, "xaxis": _ticks(bins)})
        for k in stages:
            name, colour = ("before", "after")[k], (BEFORE, AFTER)[k]
            if bins.width > 1:
                x, largest = steps(bins.edges, bins.largest[:, k])
                area(panel, x, np.zeros(len(x)), largest, colour)
            line(panel, *steps(bins.edges, bins.rms[:, k]), colour, name)
            _named(panel, bins, "um")
        panels.append(panel)
    return grid(panels, 1, height=270, same_x=True)


def correction_figure(bins: Bins, machine: Machine) -> Figure:
    """Corrections of the linear axes that position the tool, and of each other corrected axis."""
    low, high = bins.corrections
    changed = np.nan_to_num(np.maximum(np.abs(low), np.abs(high))).max(axis=0) > 0.0
    shown = [i for i in range(len(machine.axes)) if changed[i] or i in machine.translators]
    panels = []
    for i in shown:
        unit = "urad" if machine.rotary[i] else "um"
        panel = Panel(LABEL, f"correction, {unit}", f"Axis {machine.names[i]}", axes={"xaxis": _ticks(bins)})
        x, upper = steps(bins.edges, high[:, i])
        if bins.width > 1:
            lower = steps(bins.edges, low[:, i])[1]
            area(panel, x, lower, upper, BEFORE)
            line(panel, x, lower, BEFORE, width=1)
            _named(panel, bins, unit)
        line(panel, x, upper, BEFORE, width=1)
        _named(panel, bins, unit)
        panels.append(panel)
    return grid(panels, 1, height=190, same_x=True)


def _ticks(bins: Bins) -> dict[str, object]:
    """An axis over the moves whose ticks are the lines of the program; loops repeat their lines."""
    some = np.unique(np.linspace(0, len(bins) - 1, min(len(bins), TICKS)).astype(int))
    return {"tickvals": bins.edges[some], "ticktext": [str(number) for number in bins.lines[some].tolist()]}


def _named(panel: Panel, bins: Bins, unit: str) -> None:
    """The line of the program, for the pointer on the last curve of a panel."""
    hover = f"line %{{customdata}}: %{{y:.2f}} {unit}<extra>%{{fullData.name}}</extra>"
    panel.traces[-1] |= {"customdata": np.repeat(bins.lines, 2), "hovertemplate": hover}


def path_sections(paths: DrawnPaths, error: str) -> Iterator[Section]:
    """The tool path in 3-D, unless it has no feed move; `error`: name of the error."""
    if len(paths.points):
        some = f" One feed move of {paths.stride} is drawn." if paths.stride > 1 else ""
        text = f"The lines are the nominal paths of feed moves in the workpiece frame; their colour is the {error}, on "
        text += f"one scale.{some}"
        yield Section("Errors on the part", text, figure=partial(_path_figure, paths))


def surface_section(surface: WorkpieceSurface, paths: DrawnPaths) -> Section:
    """The map of a surface with the feed moves that follow it."""
    text = "The colour is the height of the surface, in machine coordinates; the lines are the feed moves."
    return Section("Height map", text, figure=partial(_surface_figure, surface, paths))


def _surface_figure(surface: WorkpieceSurface, paths: DrawnPaths) -> Figure:
    heights = np.reshape(surface.values, [len(nodes) for nodes in surface.nodes])
    first, second = surface.of
    panel = Panel(f"{first}, mm", f"{second}, mm", surface.note, axes={"yaxis": {"scaleanchor": "x"}})
    heat(panel, np.array(surface.nodes[0]), np.array(surface.nodes[1]), heights)
    panel.traces[-1] |= {"zsmooth": "best"}  # between the nodes
    gap = np.full((len(paths.points), 1), np.nan)
    x, y = (np.hstack([paths.points[:, :, "XYZ".index(axis)], gap]).ravel() for axis in surface.of)
    line(panel, x, y, "black", width=1)
    return Figure([panel], height=430, colours=colour_axis(heights.min(), heights.max(), "height, um"))


def _path_figure(paths: DrawnPaths) -> Figure:
    """Tool paths in 3-D before and after correction, coloured by the error on one scale."""
    most = float(np.nanmax(paths.errors, initial=0.0))
    return Figure(
        [_path(paths.points, paths.errors[:, :, k], name) for k, name in enumerate(("before", "after"))],
        across=2,
        height=480,
        colours=colour_axis(0.0, most or 1.0, "tool point error, um"),
    )


def _path(points: Array, errors: Array, title: str) -> Panel:
    """Moves `(n, points, 3)`, mm, each as one line, with the errors `(n, points)`, um."""
    joined = next(
        (n for n in JOINED_SEGMENTS if len(points) * (SEGMENTS // n + 2) <= DRAWN_PATH_POINTS), JOINED_SEGMENTS[-1]
    )
    gap = np.full((len(points), 1), np.nan)
    x, y, z = (np.hstack([points[:, ::joined, k], gap]).ravel() for k in range(3))
    values = np.hstack([errors[:, ::joined], gap]).ravel()
    panel = Panel("x, mm", "y, mm", title, "z, mm", kind="scene")
    trace = {"type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, "connectgaps": False, "customdata": values}
    form = {"line": {"color": np.nan_to_num(values), "coloraxis": "coloraxis", "width": 5}}
    hover = {"hovertemplate": "x %{x:.3f}, y %{y:.3f}, z %{z:.3f} mm<br>error %{customdata:.2f} um<extra></extra>"}
    panel.traces.append(trace | form | hover)
    return panel
