"""What firmware holds of a correction: slopes of one axis by the position of another or its own, and a mesh of Z."""

from __future__ import annotations

from typing import NamedTuple

from kinematics.transforms import Array
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, curves_by_letters
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.mesh_moves import Parts, largest_departure
from postproc.control_data.tables.terms import Surface

SKEWS = ("XY", "XZ", "YZ")
"""Output and source of each shear of the firmware."""
SKEW_LIMITS = Limits(points=2, resolution=1e-7, degree=1, through_zero=True)
"""A shear is one slope."""


class Mesh(NamedTuple):
    """Heights over the bed."""

    x: Array
    y: Array
    rows: Array
    """`(y, x)`, mm."""


def capabilities(pairs: tuple[str, ...] = SKEWS, surfaces: str = "XY") -> Capabilities:
    """Shears, and heights over the bed."""
    return Capabilities(outputs="XYZ", own=False, cross=True, pairs=pairs, surfaces=surfaces, surface_outputs="Z")


def slopes(content: Content) -> dict[str, float]:
    """mm per mm that is added to an axis by the position of an axis, by the letters of both; those that are not 0."""
    found = curves_by_letters(content)
    return {
        letters: float((curve.values[-1] - curve.values[0]) / (curve.nodes[-1] - curve.nodes[0]))
        for letters, curve in found.items()
    }


def tangents(content: Content) -> dict[str, float]:
    """The slopes of the shears, 0 for those that there are not."""
    return dict.fromkeys(SKEWS, 0.0) | slopes(content)


def surface_of(content: Content) -> Surface | None:
    """The function of Z over the bed."""
    return next((term.factors[0] for term in content.terms if isinstance(term.factors[0], Surface)), None)


def mesh_of(content: Content) -> Mesh | None:
    """The same as rows of heights."""
    surface = surface_of(content)
    if surface is None:
        return None
    nodes = dict(zip(surface.axes, surface.nodes, strict=True))
    return Mesh(nodes["X"], nodes["Y"], surface.values if surface.axes[0] == "Y" else surface.values.T)


def departure_um(content: Content, parts: Parts) -> float | None:
    """Largest difference, um, of straight moves from the mesh; None without a mesh."""
    surface = surface_of(content)
    return None if surface is None else 1e3 * largest_departure(surface, parts)
