"""Maps of the errors in a machine's volume: planes through its centre, with arrows, relative to the centre."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from kinematics.basis import Interval
from kinematics.deviation import exact_deviation
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from rendering.figures import Figure, Panel, arrows, colour_axis, grid, heat
from rendering.report import Section

DRAWN_TOOL_MM = 100.0
"""Length of the tool in the volume, mm."""
DRAWN_GRID_POSITIONS = 6
"""Positions along each axis of the grid whose RMS and largest values the text states."""
CELLS = 21
"""Positions along each side of a plane."""
EVERY = slice(2, None, 4)
"""Positions along a side that have an arrow; the centre is one of them."""
TEXT = (
    "The maps show the tool point in the workpiece frame with {place}, and the mean "
    "of both directions of approach. They leave out effects of time, temperature and feed. Errors are actual minus "
    "nominal, relative to the centre of the volume, as after a touch-off there. Each plane goes through the centre. "
    "The colour is the length of the whole error. An arrow ends at its position, points to the side to which the tool "
    "deviates in the plane, and grows with that part of the error. All maps have one colour scale."
)
SIZES = "RMS and largest values are those of {count} positions on a grid."
Bounds = dict[int, tuple[float, float]]
"""Ends of axes, mm, by number of the axis."""


class Place(NamedTuple):
    """Where a machine is while the axes of a map move, and what counts of its errors there."""

    text: str
    """Tool, and positions of the axes that do not move, in words."""
    tool: tuple[float, float, float]
    """Tool vector, mm."""
    positions: tuple[float, ...]
    """Of all axes, mm and rad; those of the map move."""
    seen: int = 3
    """Number of the directions x, y, z that count: of a part that was measured in a plane two."""

    @classmethod
    def usual(cls, machine: Machine) -> Place:
        """With a usual tool, and the axes at home."""
        home = tuple((np.array([axis.home for axis in machine.axes]) * machine.scale).tolist())
        return cls(f"a tool of {DRAWN_TOOL_MM:g} mm, rotary axes at home", (0.0, 0.0, -DRAWN_TOOL_MM), home)


class Field(NamedTuple):
    """A map: its name, and the errors as a difference of models, or the uncertainty of one model."""

    title: str
    plus: ErrorModel
    minus: ErrorModel | None = None
    """Subtracted from `plus`: the correction."""
    uncertain: bool = False
    """True for the standard uncertainty (k=1) of the errors of `plus`: the errors expected after a correction."""

    def sentence(self, size: Array) -> str:
        """RMS and largest of the values `(n,)`, um, of the map."""
        least = "Expected to remain" if self.uncertain else f"{self.title[0].upper()}{self.title[1:]}"
        meaning = ", the standard uncertainty (k=1) of these errors" if self.uncertain else ""
        return (
            f"{least}: {np.sqrt(np.mean(size**2)):.2f} um RMS, at most {size.max():.2f} um, relative to the centre of "
            f"the volume{meaning}."
        )


def uncertainty_of(model: ErrorModel) -> Field:
    """The map of the errors that are expected to remain after a correction by a calibration."""
    return Field("expected after a correction, u (k=1)", model, uncertain=True)


class _Values(NamedTuple):
    """Values of a field at points."""

    vectors: Array | None
    """`(n, 3)`, um; None for an uncertainty."""
    size: Array
    """`(n,)`, um."""


def volume_section(
    machine: Machine,
    fields: Sequence[Field],
    *,
    sizes: bool = True,
    measured: Mapping[str, Interval] | None = None,
    place: Place | None = None,
) -> Iterator[Section]:
    """The maps of one machine; nothing where the errors of fewer than two linear axes are known.

    sizes: with the RMS and the largest value of each map. measured: ranges of the axes that were moved, mm; the maps
    do not go beyond them, and do not extend along other axes. place: by default the usual one.
    """
    travels = {axis.name: axis.travel for axis in machine.axes} if measured is None else measured
    models = [model for field in fields for model in (field.plus, field.minus) if model is not None]
    bounds = _bounds(machine, models, travels)
    if len(bounds) < 2:
        return
    place = place or Place.usual(machine)
    lines = [TEXT.format(place=place.text)]
    if sizes:
        q = _positions(place, bounds, [DRAWN_GRID_POSITIONS] * len(bounds)).reshape(-1, len(machine.axes))
        found = [field.sentence(_values(machine, place, field, bounds, q).size) for field in fields]
        lines = [*found, f"{lines[0]} {SIZES.format(count=len(q))}"]
    yield Section("Map of the volume", "\n".join(lines), figure=partial(_maps, machine, place, fields, bounds))


def positional(effect: Effect) -> bool:
    """True for an effect of the machine that depends on positions and directions alone."""
    others = [need for need in effect.needs if need != "approach"]
    return effect.ACTS_ON != "instrument" and not others and not effect.sensors


def _bounds(machine: Machine, models: Sequence[ErrorModel], travels: Mapping[str, Interval]) -> Bounds:
    """Ends of each linear axis in which all error motions are known; of no axis without any, if another one has some.

    travels: largest ranges by axis; axes that are not there have no ends. Where no effect has a range (squareness,
    backlash), the ends are those of these ranges.
    """
    effects = [effect for model in models for effect in model.effects if positional(effect)]
    linear = [i for i in range(len(machine.axes)) if not machine.rotary[i] and machine.names[i] in travels]
    ranges = {i: [e.intervals[name] for e in effects if (name := machine.names[i]) in e.intervals] for i in linear}
    found = {}
    for i in linear:
        if not ranges[i] and any(ranges.values()):
            continue
        known = zip(*ranges[i], travels[machine.names[i]], strict=True)
        low, high = (f(ends) for f, ends in zip((max, min), known, strict=True))
        if np.isfinite((low, high)).all() and low < high:
            found[i] = (low, high)
    return found


def _positions(place: Place, bounds: Bounds, counts: Sequence[int]) -> Array:
    """Axis positions `(..., axes)`, mm and rad, of a grid with these numbers along each axis; one is in the middle."""
    sides = [
        np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2.0])
        for (low, high), count in zip(bounds.values(), counts, strict=True)
    ]
    mesh = np.meshgrid(*sides, indexing="ij")
    q = np.tile(np.array(place.positions), (*mesh[0].shape, 1))
    for i, values in zip(bounds, mesh, strict=True):
        q[..., i] = values
    return q


def _values(machine: Machine, place: Place, field: Field, bounds: Bounds, q: Array) -> _Values:
    """Values of a field at axis positions `(n, axes)`, relative to the centre."""
    centre = _positions(place, bounds, [1] * len(bounds)).reshape(1, -1)
    whole, tool = np.vstack([centre, q]), place.tool
    state = State(whole, approach=np.zeros(whole.shape))
    if field.uncertain:
        model, transform = field.plus.part(positional), error_transform_with_tool(machine, whole, tool)[:, :3]
        design = model.design(machine, state, transform)
        u = model.propagated(design[1:] - design[0])
        return _Values(None, np.linalg.norm(u[:, : place.seen], axis=1) * 1e3)
    signed = [(1.0, field.plus), *([(-1.0, field.minus)] if field.minus is not None else [])]
    errors = sum(sign * model.part(positional).errors(machine, state) for sign, model in signed)
    vectors = exact_deviation(machine, whole, np.asarray(errors), tool).position * 1e3
    vectors = vectors[1:] - vectors[0]
    vectors[:, place.seen :] = 0.0
    return _Values(vectors, np.linalg.norm(vectors, axis=1))


def _maps(machine: Machine, place: Place, fields: Sequence[Field], bounds: Bounds) -> Figure:
    """All planes of each field."""
    planes = list(combinations(bounds, 2))
    found = {}
    for number in range(len(fields)):
        for plane in planes:
            q = _positions(place, bounds, [CELLS if i in plane else 1 for i in bounds])
            found[number, plane] = (
                q.reshape(CELLS, CELLS, -1),
                _values(machine, place, fields[number], bounds, q.reshape(-1, q.shape[-1])),
            )
    drawn = [values.vectors[:, k] for _, values in found.values() if values.vectors is not None for k in range(3)]
    longest = max((float(np.abs(values).max()) for values in drawn), default=0.0)
    panels = [
        _panel(machine, fields[number].title, plane, q, values, longest)
        for (number, plane), (q, values) in found.items()
    ]
    most = max(float(values.size.max()) for _, values in found.values())
    across = len(planes) if len(planes) > 1 else len(fields)
    return grid(panels, min(across, 3), height=270, colours=colour_axis(0.0, most or 1.0, _label(fields)))


def _label(fields: Sequence[Field]) -> str:
    return "error, or its standard uncertainty u (k=1), um" if any(each.uncertain for each in fields) else "error, um"


def _panel(machine: Machine, title: str, plane: tuple[int, int], q: Array, values: _Values, longest: float) -> Panel:
    """One plane; axis positions `q` `(cells, cells, axes)`, mm and rad; longest: length of the longest arrow, um."""
    first, second = plane
    x, y = q[:, 0, first], q[0, :, second]
    names = [machine.names[i] for i in plane]
    panel = Panel(f"{names[0]}, mm", f"{names[1]}, mm", f"{title}: {names[0]} and {names[1]}")
    heat(panel, x, y, values.size.reshape(CELLS, CELLS))
    if values.vectors is not None and longest:
        at = q[EVERY, EVERY].reshape(-1, q.shape[-1])
        vectors = values.vectors.reshape(CELLS, CELLS, 3)[EVERY, EVERY].reshape(-1, 3)
        right, up = (vectors @ _direction(machine, q, i) for i in plane)
        arrows(panel, (at[:, first], at[:, second]), (right, up), vectors, longest)
    return panel


def _direction(machine: Machine, q: Array, i: int) -> Array:
    """Direction `(3,)`, in the workpiece frame, in which the tool moves with a positive command of a linear axis."""
    ends = np.vstack([q[0, 0], q[0, 0]])
    ends[1, i] += 1.0
    start, end = tool_point(machine, ends, (0.0, 0.0, -DRAWN_TOOL_MM))
    return np.asarray(end - start)
