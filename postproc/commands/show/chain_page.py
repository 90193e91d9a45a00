"""The chain of a machine as a page: its axes in a figure that turns in space, and their table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kinematics.machine import Machine
from postproc.commands.show.chain import Shape, shapes
from postproc.commands.show.chain_svg import HEAD, axis_rows, colour_of
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from rendering.figures import Figure

SIGNS = (
    "The arrows show the motion of the tool relative to the workpiece for a positive command (ISO 841). Lengths are in "
    "mm, in the machine frame."
)
PLACES = {"part": "middle left", "turn": "top left"}
"""Positions of the labels of shapes beside their points."""
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
    from rendering.figures import Figure, Panel

    panel, found = Panel("x, mm", "y, mm", z="z, mm", kind="scene", traces=[]), list(shapes(machine))
    for shape in found:
        same = [each.axis for each in found if each.kind == "pivot" and each.points.tolist() == shape.points.tolist()]
        if shape.axis in same[1:]:
            continue  # the dot of the first of these axes has the names of all
        panel.traces += list(_traces(shape, ", ".join(same)))
    return Figure([panel], height=480)


def _traces(shape: Shape, axes: str) -> list[dict[str, Any]]:
    """A shape as a line, with its label, and the head of its arrow at the last point; axes: names at a pivot."""
    colour = colour_of(shape.axis) if shape.axis else "#8a8f98"
    x, y, z = shape.points.T
    trace = {"type": "scatter3d", "x": x, "y": y, "z": z, "showlegend": False, "hoverinfo": "text", "name": shape.label}
    at = len(x) // 2 if shape.kind == "turn" else len(x) - 1  # the ends of several turns and axes may be close together
    text = [shape.label if i == at else "" for i in range(len(x))]
    hover = [shape.label or shape.axis] * len(x)
    if shape.kind == "pivot":
        marker = {"color": colour, "size": 6}
        form = {"mode": "markers+text", "marker": marker, "textposition": "bottom right"}
        return [trace | form | {"text": [axes], "hovertext": [f"{axes} {shape.label.partition(' ')[2]}"]}]
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
