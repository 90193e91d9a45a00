"""A height map: heights over a grid of positions, as a sender or a firmware has probed them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import refusal

MAP_NODES = 1001
"""Largest number of nodes along an axis of a map whose file states the number: a mm apart over a bed of a metre."""
SAME_NODE_SHARE = 0.1
"""Distance of two positions that count as one node, as a share of the longest step of the grid: the rule of bCNC."""


class HeightMap(NamedTuple):
    """Heights over the positions of two axes, in the unit of the file."""

    x: Array
    """Nodes `(nx,)`, ascending."""
    y: Array
    """Nodes `(ny,)`, ascending."""
    heights: Array
    """`(nx, ny)`."""
    title: str
    """The program that has probed it."""
    interpolation: Literal["linear", "cubic"] = "linear"
    """Between the nodes, as this program does it."""
    of_machine: bool = False
    """True for positions in machine coordinates, false for those of a work offset."""
    unit: str = ""
    """Unit of all lengths, where the file states it."""
    axes: tuple[str, str] = ("X", "Y")
    """The axes over whose positions the heights are."""


class Point(NamedTuple):
    """One height of a file."""

    line: int
    text: str
    x: float
    y: float
    z: float


def grid(name: str, points: Sequence[Point]) -> tuple[Array, Array, Array]:
    """Nodes of X and Y and heights of points that lie on a grid; UserError where a node has no height, or two."""
    if not points:
        raise UserError(f"height map {name}: it has no heights: probe the workpiece again")
    x, columns = _nodes([point.x for point in points])
    y, rows = _nodes([point.y for point in points])
    if len(x) < 2 or len(y) < 2:
        raise UserError(
            f"height map {name}: {len(x)} positions in X and {len(y)} in Y: a map has at least two of each; probe a "
            "grid over the workpiece"
        )
    heights = np.full((len(x), len(y)), np.nan)
    for point, i, j in zip(points, columns.tolist(), rows.tolist(), strict=True):
        if not math.isnan(heights[i, j]):
            why = f"X {x[i]:g} Y {y[j]:g} has a height already: delete one of them"
            raise refusal(f"height map {name}", point.line, point.text, why)
        heights[i, j] = point.z
    refuse_holes(name, x, y, heights)
    return x, y, heights


def refuse_holes(name: str, x: Array, y: Array, heights: Array) -> None:
    """UserError for the first node without a height."""
    missing = np.argwhere(np.isnan(heights))
    if len(missing):
        i, j = missing[0]
        number = f"{len(missing)} of its {heights.size} points have" if len(missing) > 1 else "one point has"
        raise UserError(
            f"height map {name}: the map has a hole: {number} no height, the first at X {x[i]:g} Y {y[j]:g}: probe "
            "again, or over a smaller area"
        )


def _nodes(positions: Iterable[float]) -> tuple[Array, np.ndarray]:
    """Nodes, ascending, and the node of each position."""
    given = np.array(list(positions))
    distinct, which = np.unique(given, return_inverse=True)
    steps = np.diff(distinct)
    begins = np.append(0, np.cumsum(steps > SAME_NODE_SHARE * steps.max(initial=0.0)))
    nodes = np.array([distinct[begins == k].mean() for k in range(begins[-1] + 1)])
    return nodes, begins[which]


def even(low: float, high: float, count: int) -> Array:
    """Evenly spaced nodes."""
    return np.linspace(low, high, count)
