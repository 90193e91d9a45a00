"""The chain of a machine as an SVG: its links, its axes in space, and a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.commands.show.chain import Shape, moved, shapes, travel_of
from postproc.commands.show.labels import BASE, leader, placed

CHAIN_PX, CHAIN_SCENE_PX = 900, 520
"""Sizes, px."""
MARGIN_PX, ROW_PX = 70, 22
AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(25.0)
"""Direction to the viewer."""
COLOURS = {"X": "#3b7dd8", "Y": "#d9700a", "Z": "#4e9a06", "A": "#1d4f9c", "B": "#a1440d", "C": "#2f6b3c"}
OTHER = "#8b5fbf"
STYLE = (
    "svg{background:#fff;font:13px sans-serif;fill:#222}.link{fill:#f3f4f6;stroke:#888}.head{font-size:20px}"
    ".part{fill:none;stroke:#888;stroke-width:2}.leader{stroke:#aaa}.small{font-size:12px;fill:#555}"
)
HEAD = ("axis", "for a positive command", "direction of the tool", "point, mm", "travel", "home")
COLUMNS = (20, 70, 345, 495, 660, 810)


def chain_svg(machine: Machine) -> bytes:
    """The drawing of a machine."""
    height = 110 + CHAIN_SCENE_PX + ROW_PX * (len(machine.axes) + 4)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{CHAIN_PX}" height="{height}" '
        f'viewBox="0 0 {CHAIN_PX} {height}">',
        f"<style>{STYLE}</style>",
        _text(20, 32, machine.name, "head"),
        _text(20, 54, machine.description, "small"),
        *_links(machine),
        *_scene(list(shapes(machine))),
        *_table(machine, 110 + CHAIN_SCENE_PX),
        "</svg>\n",
    ]
    return "\n".join(parts).encode()


def _text(x: float, y: float, text: str, kind: str = "", anchor: str = "start") -> str:
    named = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{named}>{escape(text)}</text>'


def colour_of(name: str) -> str:
    """Colour of an axis."""
    return COLOURS.get(name[:1], OTHER)


def _links(machine: Machine) -> Iterator[str]:
    """The chain as boxes, from the workpiece to the tool."""
    names = {"w": "workpiece", "b": "bed", "t": "tool"}
    x = 20.0
    for link in machine.chain.split():
        label = names.get(link, link)
        width = 26.0 + 8.0 * len(label)
        colour = "#888" if link in names else colour_of(link)
        yield f'<rect class="link" x="{x}" y="68" width="{width}" height="28" rx="5" style="stroke:{colour}"/>'
        yield _text(x + width / 2, 87, label, "", "middle")
        x += width + 12
        if link != "t":
            yield f'<path d="M{x - 12} 82h12" class="part"/>'


def _scene(found: Sequence[Shape]) -> Iterator[str]:
    """The lines in space, seen from the front on the right."""
    flat = [_projected(shape.points) for shape in found]
    every = np.concatenate(flat)
    low, high = every.min(axis=0), every.max(axis=0)
    scale = float(np.min([CHAIN_PX - 2 * MARGIN_PX, CHAIN_SCENE_PX - MARGIN_PX] / np.maximum(high - low, 1e-9)))
    middle = (low + high) / 2.0
    lines = [(points - middle) * [scale, -scale] + [CHAIN_PX / 2, 110 + CHAIN_SCENE_PX / 2] for points in flat]
    for shape, line in zip(found, lines, strict=True):
        yield from _drawn(shape, line)
    named = [(shape, line[-1]) for shape, line in zip(found, lines, strict=True) if shape.label]
    boxes = placed([(shape.label, at) for shape, at in named], lines, CHAIN_PX)
    for (shape, at), box in zip(named, boxes, strict=True):
        ends = leader(box, at)
        if ends is not None:
            yield f'<path class="leader" d="M{ends[0, 0]:.1f} {ends[0, 1]:.1f}L{ends[1, 0]:.1f} {ends[1, 1]:.1f}"/>'
        yield _text(box[0], box[1] + BASE, shape.label, "" if shape.kind in ("axis", "turn") else "small")


def _projected(points: Array) -> Array:
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    up = np.array([-np.cos(AZIMUTH) * np.sin(ELEVATION), -np.sin(AZIMUTH) * np.sin(ELEVATION), np.cos(ELEVATION)])
    return np.asarray(points @ np.column_stack([right, up]))


def _drawn(shape: Shape, at: Array) -> Iterator[str]:
    """A shape at its points on the page."""
    colour = colour_of(shape.axis)
    x, y = at[-1]
    if shape.kind == "pivot":
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" style="fill:{colour}"/>'
        return
    path = "M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in at)
    dashes = {"line": ";stroke-dasharray:8 4", "opposite": ";stroke-dasharray:2 3"}.get(shape.kind, "")
    width = 2.5 if shape.kind in ("axis", "turn") else 1.2
    style = "" if shape.kind == "part" else f' style="fill:none;stroke:{colour};stroke-width:{width}{dashes}"'
    yield f'<path class="part" d="{path}"{style}/>'
    if shape.kind in ("axis", "turn", "opposite"):
        yield _arrow(at[-2], at[-1], colour)


def _arrow(before: Array, tip: Array, colour: str) -> str:
    """The head of an arrow."""
    along = (tip - before) / max(float(np.linalg.norm(tip - before)), 1e-9)
    across = np.array([-along[1], along[0]])
    corners = (tip + 3 * along, tip - 10 * along + 5 * across, tip - 10 * along - 5 * across)
    return f'<polygon points="{" ".join(f"{u:.1f},{v:.1f}" for u, v in corners)}" style="fill:{colour}"/>'


def _table(machine: Machine, top: float) -> Iterator[str]:
    """One row for each axis."""
    yield _text(
        20,
        top,
        "The arrows show the motion of the tool relative to the workpiece for a positive command (ISO 841).",
        "small",
    )
    rows = [HEAD, *axis_rows(machine)]
    for number, row in enumerate(rows, start=1):
        for x, cell in zip(COLUMNS, row, strict=True):
            yield _text(x, top + ROW_PX * number + 6, cell, "small" if number == 1 else "")


def axis_rows(machine: Machine) -> list[tuple[str, ...]]:
    """Cells of HEAD for each axis."""
    return [
        (
            axis.name,
            moved(axis),
            f"({', '.join(f'{v:g}' for v in axis.direction)})",
            f"({', '.join(f'{v:g}' for v in axis.point)})",
            travel_of(axis),
            f"{axis.home:g} {axis.unit}",
        )
        for axis in machine.axes
    ]
