"""The report of a plan: its positions in the volume, in the order of measuring."""

from __future__ import annotations

from functools import partial

import numpy as np

from calibration.measurement.plan import Plan
from kinematics.forward import tool_point
from rendering.figures import SCENE_HEIGHT_PX, Figure, Panel, colour_axis, some
from rendering.report import Report, Section, facts

MOST_DRAWN_POSITIONS = 2000
"""Most positions that are drawn."""


def plan_report(plan: Plan) -> Report:
    """The plan for people: its summary, on the page also its ranges and positions."""
    machine = plan.machine
    ends = zip(machine.axes, plan.positions.min(axis=0), plan.positions.max(axis=0), machine.scale, strict=True)
    rows = [(axis.name, f"{low / scale:g} to {high / scale:g} {axis.unit}") for axis, low, high, scale in ends]
    text = "The points are the planned positions of the targets, workpiece frame, joined in the order of measuring."
    sections = [
        Section("Positions", text, figure=partial(_positions, plan)),
        Section("Ranges", table=facts("", rows).table, detail=True),
    ]
    return Report("Measuring plan", plan.strategy, sections, str(plan.summary))


def _positions(plan: Plan) -> Figure:
    """Positions of the targets, mm, in the workpiece frame."""
    rows, names = some(np.arange(len(plan)), MOST_DRAWN_POSITIONS), plan.state.target
    target = (
        [(0.0, 0.0, 0.0)] * len(rows) if names is None else [plan.targets[n].position for n in names[rows].tolist()]
    )
    x, y, z = tool_point(plan.machine, plan.positions[rows], np.array(target)).T
    panel = Panel("x, mm", "y, mm", z="z, mm", kind="scene")
    trace = {
        "type": "scatter3d",
        "mode": "markers+lines",
        "x": x,
        "y": y,
        "z": z,
        "line": {"width": 1, "color": "#8a8f98"},
    }
    marker = {"size": 3, "color": rows + 1, "coloraxis": "coloraxis"}
    hover = "observation %{marker.color}: %{x:.4g}, %{y:.4g}, %{z:.4g} mm<extra></extra>"
    panel.traces.append(trace | {"marker": marker, "hovertemplate": hover})
    colours = colour_axis(1.0, float(len(plan)), "number of the observation, in the order of measuring")
    return Figure([panel], height=SCENE_HEIGHT_PX, colours=colours)
