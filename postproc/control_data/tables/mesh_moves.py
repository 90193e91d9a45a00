"""How far the moves of a firmware are from its mesh: it follows the mesh at the ends of moves and of their parts.

Klipper looks at the mesh along a move in steps of `move_check_distance`, and splits the move where the height has
changed by `split_delta_z` since the last split (`klippy/extras/bed_mesh.py`, class MoveSplitter). RepRapFirmware
divides a move into equal parts, about as many as there are meshes along it (`Grid.cpp`, GetMinimumSegments). Marlin
divides it where it crosses the lines of the mesh (`bbl.cpp`, line_to_destination). Each part is straight.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kinematics.transforms import Array
from postproc.control_data.tables.target import spread_out
from postproc.control_data.tables.terms import Surface

RANDOM_MOVES, LINES_OF_AXIS, STARTS_OF_LINE = 600, 21, 4
"""Moves between points all over the bed; lines along X and along Y; moves from different starts on each line."""
COMPARED_EVERY_MM = 0.5
"""Distance at which a move is compared with the mesh."""


class Parts(Protocol):
    """The rule by which a firmware divides a move."""

    def ends(self, mesh: Surface, start: Array, end: Array) -> Array:
        """Distances `(k,)`, mm, from the start of a move to its end, at which the firmware is on the mesh."""


@dataclass(frozen=True)
class Splitting:
    """Klipper's rule, by its settings under `[bed_mesh]`."""

    split_delta_z: float
    """mm."""
    move_check_distance: float
    """mm."""

    def ends(self, mesh: Surface, start: Array, end: Array) -> Array:
        """See `Parts.ends`."""
        length = float(np.linalg.norm(end - start))
        checked = np.arange(1, int(np.ceil(length / self.move_check_distance))) * self.move_check_distance
        heights = _heights(mesh, start, end, np.concatenate([[0.0], checked]) / length).tolist()
        found, last = [0.0], heights[0]
        for distance, height in zip(checked.tolist(), heights[1:], strict=True):
            if abs(height - last) >= self.split_delta_z:
                found.append(distance)
                last = height
        return np.array([*found, length])


@dataclass(frozen=True)
class Segments:
    """RepRapFirmware's rule."""

    def ends(self, mesh: Surface, start: Array, end: Array) -> Array:
        """See `Parts.ends`."""
        nodes = dict(zip(mesh.axes, mesh.nodes, strict=True))
        meshes = [abs(end[k] - start[k]) / (nodes[axis][1] - nodes[axis][0]) for k, axis in enumerate("XY")]
        count = max(1, *(int(number + 0.4) for number in meshes))
        return np.linspace(0.0, float(np.linalg.norm(end - start)), count + 1)


@dataclass(frozen=True)
class Cells:
    """Marlin's rule."""

    def ends(self, mesh: Surface, start: Array, end: Array) -> Array:
        """See `Parts.ends`."""
        shares = [0.0, 1.0]
        for axis, nodes in zip(mesh.axes, mesh.nodes, strict=True):
            k = "XY".index(axis)
            if end[k] != start[k]:
                shares += ((nodes - start[k]) / (end[k] - start[k])).tolist()
        return np.unique(np.clip(shares, 0.0, 1.0)) * float(np.linalg.norm(end - start))


DEFAULT = Splitting(0.025, 5.0)
"""Klipper's defaults (`bed_mesh.py`)."""
KLIPPER_FINEST = Splitting(0.01, 3.0)
"""The least values that Klipper accepts (`bed_mesh.py`)."""


def largest_departure(mesh: Surface, parts: Parts) -> float:
    """Largest difference, mm, of a straight move over the bed from the mesh; of the moves that are tried."""
    return max(departure(mesh, start, end, parts) for start, end in _moves(mesh))


def departure(mesh: Surface, start: Array, end: Array, parts: Parts) -> float:
    """Largest difference, mm, of one move from `start` to `end` `(2,)`, mm in X and Y, from the mesh."""
    length = float(np.linalg.norm(end - start))
    if not length:
        return 0.0
    ends = parts.ends(mesh, start, end)
    at = np.linspace(0.0, length, int(length / COMPARED_EVERY_MM) + 2)
    followed = np.interp(at, ends, _heights(mesh, start, end, ends / length))
    return float(np.abs(followed - _heights(mesh, start, end, at / length)).max())


def _heights(mesh: Surface, start: Array, end: Array, shares: Array) -> Array:
    """Heights `(n,)`, mm, at shares `(n,)` of the way."""
    points = start + shares[:, None] * (end - start)
    return mesh.at(lambda axis: points[:, "XY".index(axis)])


def _moves(mesh: Surface) -> Iterator[tuple[Array, Array]]:
    """Starts and ends of moves: in all directions, and along X and Y, there and back."""
    nodes = dict(zip(mesh.axes, mesh.nodes, strict=True))
    low, high = (np.array([nodes[axis][end] for axis in "XY"]) for end in (0, -1))
    for pair in spread_out(RANDOM_MOVES, 4):
        yield low + pair[:2] * (high - low), low + pair[2:] * (high - low)
    for along in (0, 1):
        for across in np.linspace(0.0, 1.0, LINES_OF_AXIS):
            for first in np.arange(STARTS_OF_LINE) / STARTS_OF_LINE:
                for ends in ((first, 1.0), (1.0 - first, 0.0)):
                    shares = np.full((2, 2), across)
                    shares[:, along] = ends
                    yield low + shares[0] * (high - low), low + shares[1] * (high - low)
