"""Touches of one sphere in one orientation: along normals of its surface, clear of its stem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.probing.bodies import Bodies, least_clearance
from kinematics.forward import forward
from kinematics.inverse import linear_positions
from kinematics.machine import TRAVEL_ROUNDING
from kinematics.transforms import Array

TOUCHES = 5
"""Touches of each centre: the pole in the direction of the spindle, and four around it."""
ELEVATIONS = (20.0, 10.0, 35.0, 0.0)
"""Elevations of the four touches above the equator of the spindle axis, degrees; the first that is clear is taken.

Above the equator they show the height of the centre as well, so that a wrong touch of the pole is found."""
AZIMUTHS = (45.0, 0.0, 22.5, 67.5)
"""Azimuths of the first of the four touches from the stem as the spindle sees it, degrees."""


@dataclass(frozen=True)
class Approach:
    """Distances of the moves around a sphere, mm."""

    clearance: float = 5.0
    """Gap between tip and sphere at which the approach to a touch begins."""
    overtravel: float = 3.0
    """Distance behind the expected contact at which a touch ends without contact."""
    margin: float = 1.5
    """Least clearance of all other surfaces."""


@dataclass(frozen=True)
class Centre:
    """The touches of one sphere in one orientation, as axis positions, mm and rad."""

    sphere: int
    raised: Array
    """Position `(axes,)` above the sphere from which all touches begin."""
    above: Array
    """Positions `(TOUCHES, axes)` at the height of `raised`, over each touch."""
    starts: Array
    """Positions `(TOUCHES, axes)` of the tip before each touch, `clearance` from the sphere."""
    ends: Array
    """Positions `(TOUCHES, axes)` at which a touch ends without contact."""
    directions: Array
    """Outward normals `(TOUCHES, 3)` of the sphere, workpiece frame."""

    @property
    def positions(self) -> Array:
        """All positions `(m, axes)`."""
        return np.concatenate([self.raised[None], self.above, self.starts, self.ends])


def centre_of(bodies: Bodies, rotary: Array, sphere: int, approach: Approach) -> Centre | None:
    """The touches of a sphere with the rotary axes of `rotary` `(axes,)`, mm and rad; None where no choice is clear.

    All positions are within the travel of the linear axes, and every move is clear of spheres and stems by the margin.
    """
    for elevation in ELEVATIONS:
        for azimuth in AZIMUTHS:
            directions = _directions(bodies, rotary, np.radians(elevation), np.radians(azimuth))
            found = _laid(bodies, rotary, sphere, approach, directions)
            if _within(bodies, found.positions) and _clear(bodies, found, approach):
                return found
    return None


def within_travel(bodies: Bodies, positions: Array) -> bool:
    """True if all axis positions `(n, axes)` are within the travel."""
    return _within(bodies, positions)


def _directions(bodies: Bodies, rotary: Array, elevation: float, azimuth: float) -> Array:
    """Outward normals `(TOUCHES, 3)`, workpiece frame: the pole of the spindle axis, then four around it."""
    rotation = forward(bodies.machine, rotary[None]).rotation[0]
    pole = rotation[:, 2]
    stem = np.array([0.0, 0.0, -1.0])
    across = stem - pole * (stem @ pole)
    # a stem along the spindle leaves the azimuth free: the directions of the tool, along axes of a machine with tables
    first = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-6 else _turned(rotation, azimuth)
    second = np.cross(pole, first)
    angles = azimuth + np.pi / 2.0 * np.arange(4)
    around = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)
    return np.concatenate([pole[None], np.cos(elevation) * around + np.sin(elevation) * pole])


def _turned(rotation: Array, azimuth: float) -> Array:
    """The direction from which an azimuth leads to the x of the tool."""
    return np.asarray(np.cos(azimuth) * rotation[:, 0] - np.sin(azimuth) * rotation[:, 1])


def _laid(bodies: Bodies, rotary: Array, sphere: int, approach: Approach, directions: Array) -> Centre:
    machine = bodies.machine
    centre = np.array(list(bodies.artefact.centres.values())[sphere])
    pole = directions[0]
    near, height = bodies.contact + approach.clearance, 2.0 * approach.clearance + bodies.contact

    def positions(tips: Array) -> Array:
        return linear_positions(machine, np.tile(rotary, (len(tips), 1)), tips, bodies.probe.tip)

    starts = centre + near * directions
    over = starts + pole * (height - (starts - centre) @ pole)[:, None]
    ends = centre + (bodies.contact - approach.overtravel) * directions
    raised = centre + height * pole
    return Centre(sphere, positions(raised[None])[0], positions(over), positions(starts), positions(ends), directions)


def _within(bodies: Bodies, positions: Array) -> bool:
    low, high = bodies.machine.travel
    return bool(np.all(positions >= low - TRAVEL_ROUNDING) and np.all(positions <= high + TRAVEL_ROUNDING))


def _clear(bodies: Bodies, found: Centre, approach: Approach) -> bool:
    """True if all moves of a centre are clear: to and fro above the sphere, down, and the touches themselves."""
    raised = np.tile(found.raised, (TOUCHES, 1))
    starts = np.concatenate([raised, found.above, found.starts])
    ends = np.concatenate([found.above, found.starts, found.ends])
    touched = np.repeat([-1, -1, found.sphere], TOUCHES)
    least = least_clearance(bodies, starts, ends, touched, approach.margin)
    return bool(np.all(least >= approach.margin))
