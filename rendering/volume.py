"""Maps of the errors in a machine's volume: cones and slices in 3-D, relative to the centre of the volume."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from kinematics.deviation import exact_deviation
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from rendering.figures import Figure, Panel, Trace, colour_axis, grid
from rendering.report import Section

TOOL_MM = 100.0
"""Length of the tool in the volume, mm."""
CONES = 6
"""Positions along each axis with a cone."""
LARGEST = 0.18
"""Length of the longest cone, as a share of the longest side of the volume."""
CELLS = 15
"""Positions along each side of a slice."""
K = 2.0
"""Coverage factor of uncertainties."""
TEXT = (
    "The maps show the tool point in the workpiece frame with a tool of {tool:g} mm, rotary axes at home, and the mean "
    "of both directions of approach. They leave out effects of time, temperature and feed. Errors are actual minus "
    "nominal, relative to the centre of the volume, as after a touch-off there. A cone points to the side to which the "
    "tool deviates, and grows with the error; the slices go through the centre. All maps have one colour scale, and "
    "turn with the pointer. RMS and largest values are those of {count} positions on a grid."
)


class Field(NamedTuple):
    """A map: its name, and the errors as a difference of models, or the uncertainty of one model."""

    title: str
    plus: ErrorModel
    minus: ErrorModel | None = None
    """Subtracted from `plus`: the correction."""
    uncertain: bool = False
    """True for the expanded uncertainty (k = 2) of the errors of `plus`, instead of the errors."""


class _Values(NamedTuple):
    """Values of a field at points."""

    vectors: Array | None
    """`(n, 3)`, um; None for an uncertainty."""
    size: Array
    """`(n,)`, um."""


def volume_section(machine: Machine, fields: Sequence[Field]) -> Iterator[Section]:
    """The maps of one machine with the largest and the RMS value of each; nothing where no two linear axes move."""
    bounds = _bounds(machine, [model for field in fields for model in (field.plus, field.minus) if model is not None])
    if len(bounds) < 2:
        return
    q = _positions(machine, bounds, [CONES] * len(bounds)).reshape(-1, len(machine.axes))
    values = [_values(machine, field, bounds, q) for field in fields]
    lines = [
        f"{field.title[0].upper()}{field.title[1:]}: {np.sqrt(np.mean(each.size**2)):.2f} um RMS, at most "
        f"{each.size.max():.2f} um, relative to the centre of the volume."
        for field, each in zip(fields, values, strict=True)
    ]
    text = "\n".join([*lines, TEXT.format(tool=TOOL_MM, count=len(q))])
    yield Section("Map of the volume", text, figure=partial(_maps, machine, fields, bounds, q, values))


def positional(effect: Effect) -> bool:
    """True for an effect of the machine that depends on positions and directions alone."""
    others = [need for need in effect.needs if need != "approach"]
    return effect.ACTS_ON != "instrument" and not others and not effect.sensors


def _bounds(machine: Machine, models: Sequence[ErrorModel]) -> dict[int, tuple[float, float]]:
    """Ends of each linear axis, mm, in which all error motions are known, by number of the axis."""
    found = {}
    for i, axis in enumerate(machine.axes):
        if machine.rotary[i]:
            continue
        known = [
            e.intervals[axis.name] for m in models for e in m.effects if positional(e) and axis.name in e.intervals
        ]
        low, high = (f(ends) for f, ends in zip((max, min), zip(*known, axis.travel, strict=True), strict=True))
        if np.isfinite((low, high)).all() and low < high:
            found[i] = (low, high)
    return found


def _positions(machine: Machine, bounds: dict[int, tuple[float, float]], counts: Sequence[int]) -> Array:
    """Axis positions `(..., axes)`, mm and rad, of a grid with these numbers along each axis; one is in the middle."""
    sides = [
        np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2.0])
        for (low, high), count in zip(bounds.values(), counts, strict=True)
    ]
    mesh = np.meshgrid(*sides, indexing="ij")
    q = np.tile(np.array([axis.home for axis in machine.axes]) * machine.scale, (*mesh[0].shape, 1))
    for i, values in zip(bounds, mesh, strict=True):
        q[..., i] = values
    return q


def _values(machine: Machine, field: Field, bounds: dict[int, tuple[float, float]], q: Array) -> _Values:
    """Values of a field at axis positions `(n, axes)`, relative to the centre."""
    centre = _positions(machine, bounds, [1] * len(bounds)).reshape(1, -1)
    whole, tool = np.vstack([centre, q]), (0.0, 0.0, -TOOL_MM)
    state = State(whole, approach=np.zeros(whole.shape))
    if field.uncertain:
        model, transform = field.plus.part(positional), error_transform_with_tool(machine, whole, tool)[:, :3]
        design = model.design(machine, state, transform)
        u = model.propagated(design[1:] - design[0])
        return _Values(None, K * np.linalg.norm(u, axis=1) * 1e3)
    signed = [(1.0, field.plus), *([(-1.0, field.minus)] if field.minus is not None else [])]
    errors = sum(sign * model.part(positional).errors(machine, state) for sign, model in signed)
    vectors = exact_deviation(machine, whole, np.asarray(errors), tool).position * 1e3
    vectors = vectors[1:] - vectors[0]
    return _Values(vectors, np.linalg.norm(vectors, axis=1))


def _maps(
    machine: Machine, fields: Sequence[Field], bounds: dict[int, tuple[float, float]], q: Array, values: list[_Values]
) -> Figure:
    """Cones of the errors, and slices of all fields."""
    points = tool_point(machine, q, (0.0, 0.0, -TOOL_MM))
    slices = [_positions(machine, bounds, counts) for counts in _planes(len(bounds))]
    panels, most = [], max(float(each.size.max()) for each in values)
    for field, each in zip(fields, values, strict=True):
        if each.vectors is not None and each.size.any():
            panels.append(_panel(field.title, [cones(points, each.vectors)]))
        surfaces = [_slice(machine, field, bounds, plane) for plane in slices]
        most = max([most, *(float(np.max(surface["surfacecolor"])) for surface in surfaces)])
        panels.append(_panel(f"{field.title}{'' if each.vectors is None else ', slices'}", surfaces))
    label = "error, or uncertainty U (k=2), um" if any(field.uncertain for field in fields) else "error, um"
    return grid(panels, 2 if len(panels) in (2, 4) else 3, height=400, colours=colour_axis(0.0, most or 1.0, label))


def _planes(axes: int) -> list[list[int]]:
    """Numbers of positions along each axis, for the slices through the centre."""
    if axes == 2:
        return [[CELLS, CELLS]]
    return [[1 if i == k else CELLS for i in range(axes)] for k in range(axes)]


def _panel(title: str, traces: list[Trace]) -> Panel:
    return Panel("x, mm", "y, mm", title, "z, mm", "scene", traces)


def cones(points: Array, vectors: Array) -> Trace:
    """Errors `(n, 3)`, um, at points `(n, 3)`, mm."""
    (x, y, z), (u, v, w) = points.T, vectors.T
    hover = "x %{x:.0f}, y %{y:.0f}, z %{z:.0f} mm<br>%{u:.2f}, %{v:.2f}, %{w:.2f} um<br>%{norm:.2f} um<extra></extra>"
    trace = {"type": "cone", "x": x, "y": y, "z": z, "u": u, "v": v, "w": w, "coloraxis": "coloraxis"}
    most, extent = (
        float(np.linalg.norm(vectors, axis=1).max(initial=0.0)),
        float(np.ptp(points, axis=0).max(initial=0.0)),
    )
    size = LARGEST * extent / most if most and extent else 1.0
    return trace | {"hovertemplate": hover, "anchor": "tail", "sizemode": "raw", "sizeref": size}


def _slice(machine: Machine, field: Field, bounds: dict[int, tuple[float, float]], plane: Array) -> Trace:
    """The values on one plane through the centre."""
    rows = plane.reshape(-1, plane.shape[-1])
    shape = [n for n in plane.shape[:-1] if n > 1]
    x, y, z = (column.reshape(shape) for column in tool_point(machine, rows, (0.0, 0.0, -TOOL_MM)).T)
    size = _values(machine, field, bounds, rows).size.reshape(shape)
    trace = {"type": "surface", "x": x, "y": y, "z": z, "surfacecolor": size, "coloraxis": "coloraxis"}
    return trace | {"hovertemplate": "x %{x:.0f}, y %{y:.0f}, z %{z:.0f} mm<br>%{surfacecolor:.2f} um<extra></extra>"}
