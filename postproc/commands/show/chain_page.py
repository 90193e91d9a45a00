"""The chain of a machine as a page: its axes in a figure that turns in space, and their table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kinematics.machine import Machine
from postproc.commands.show.chain import Shape, shapes, size_of
from postproc.commands.show.chain_svg import HEAD, axis_rows, colour_of
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from rendering.figures import Figure

SIGNS = (
    "The arrows show the motion of the tool relative to the workpiece for a positive command (ISO 841), short dotted "
    "ones the motion of a table. The tool is drawn lifted, at the end of its travel, and the workpiece where the "
    "lowered tool would be, in the middle of the other travels. Lengths are in mm, in the workpiece frame."
)
PLACES = {"part": "middle left", "turn": "top left"}
"""Positions of the labels of shapes beside their points."""
NEAR_DRAWING_SHARE = 0.06
"""Share of the size of the drawing."""
DASHES = {"line": "dash", "opposite": "dot"}


def chain_report(machine: Machine) -> Report:
    """The page of a machine."""
    sections = [
        Section("Axes in space", SIGNS, figure=lambda: _figure(machine)),
        Section("Axes", table=Table(HEAD, axis_rows(machine))),
    ]
    lead = f"{machine.description} · {machine.chain} (ISO 10791-6, workpiece to tool)"
    return Report(f"Machine {machine.name}", lead, sections, head=machine.report.filled(machine=machine.name))


def _figure(machine: Machine) -> Figure:
    from rendering.figures import SCENE_HEIGHT_PX, Figure, Panel

    room = NEAR_DRAWING_SHARE * size_of(
        machine
    )  # labels of dots within it would lie upon one another: the first one has all names
    panel, found = Panel("x, mm", "y, mm", z="z, mm", kind="scene", traces=[]), list(shapes(machine))
    for shape in found:
        near = [each for each in found if each.kind == shape.kind == "pivot" and _distance(each, shape) < room]
        panel.traces += list(_traces(shape, ", ".join(each.axis for each in near if near[0] is shape)))
    return Figure([panel], height=SCENE_HEIGHT_PX)


def _distance(one: Shape, other: Shape) -> float:
    """Distance of the first points of two shapes, mm."""
    return float(sum((one.points[0] - other.points[0]) ** 2) ** 0.5)


def _traces(shape: Shape, axes: str) -> list[dict[str, Any]]:
    """A shape as a line, with its label, and the head of its arrow at the last point; axes: names at a pivot."""
    colour = colour_of(shape.axis) if shape.axis else "#8a8f98"
    x, y, z = shape.points.T
    trace = {"type": "scatter3d", "x": x, "y": y, "z": z, "showlegend": False, "hoverinfo": "text", "name": shape.label}
    at = len(x) // 2 if shape.kind == "turn" else len(x) - 1  # the ends of several turns and axes may be close together
    labelled = shape.kind != "opposite"  # of several tables they would lie upon one another
    text = [shape.label if i == at and labelled else "" for i in range(len(x))]
    hover = [shape.label or shape.axis] * len(x)
    if shape.kind == "pivot":
        marker = {"color": colour, "size": 6}
        form = {"mode": "markers+text", "marker": marker, "textposition": "bottom right"}
        return [trace | form | {"text": [axes], "hovertext": [shape.label]}]
    line = {
        "color": colour,
        "width": 6 if shape.kind in ("axis", "turn") else 3,
        "dash": DASHES.get(shape.kind, "solid"),
    }
    form = {"mode": "lines+text", "line": line, "textposition": PLACES.get(shape.kind, "top center")}
    found = [trace | form | {"text": text, "hovertext": hover}]
    if shape.kind in ("axis", "turn", "opposite"):
        found.append(_cone(shape, colour))
    return found


def _cone(shape: Shape, colour: str) -> dict[str, Any]:
    """The head of an arrow at the last point."""
    import numpy as np

    tip, along = shape.points[-1], shape.points[-1] - shape.points[-2]
    size = 0.12 * float(np.linalg.norm(np.ptp(shape.points, axis=0)))
    u, v, w = (along / max(float(np.linalg.norm(along)), 1e-9)).tolist()
    place = {name: [value] for name, value in zip("xyzuvw", (*tip.tolist(), u, v, w), strict=True)}
    scale = {"colorscale": [[0, colour], [1, colour]], "showscale": False, "sizemode": "absolute", "sizeref": size}
    return {"type": "cone", "anchor": "tip", "hoverinfo": "skip", "showlegend": False} | place | scale
