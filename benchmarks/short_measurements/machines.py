"""A C-frame and a gantry with their errors: kinematics that share nothing with ncomp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AXES = "XYZ"


@dataclass(frozen=True)
class Machine:
    """A chain from the workpiece to the tool, each axis with the side that it carries, and its travels, mm."""

    chain: tuple[tuple[str, str], ...]
    travel: dict[str, tuple[float, float]]
    feed: float
    """mm/s"""
    size: float
    """Size of its errors, relative to a gantry."""

    def positions(self, shares: Array) -> Array:
        """Positions `(n, 3)` by shares of the travels."""
        low, high = np.array(list(self.travel.values())).T
        return low + np.atleast_2d(shares) * (high - low)

    def points(self, q: Array, errors: Array, arm: Array) -> Array:
        """Points `(n, 3)` of a target in the frame of the workpiece; errors: `(n, 3, 6)` of the axes, mm and rad."""
        point = arm
        for axis, carries in reversed(self.chain):
            k = AXES.index(axis)
            step, error = np.outer(q[:, k], np.eye(3)[k]), errors[:, k]
            if carries == "tool":
                point = turned(error[:, 3:], point) + error[:, :3] + step
            else:
                point = turned(error[:, 3:], point + step) + error[:, :3]
        return point


MACHINES = {
    "cframe": Machine(
        (("X", "workpiece"), ("Y", "workpiece"), ("Z", "tool")),
        {"X": (0.0, 600.0), "Y": (0.0, 450.0), "Z": (0.0, 500.0)},
        120.0,
        0.6,
    ),
    "gantry": Machine(
        (("X", "tool"), ("Y", "tool"), ("Z", "tool")),
        {"X": (0.0, 5000.0), "Y": (0.0, 3000.0), "Z": (0.0, 1500.0)},
        300.0,
        1.0,
    ),
}


def turned(angles: Array, points: Array) -> Array:
    """Points turned by small angles, to the third order."""
    first = np.cross(angles, points)
    second = np.cross(angles, first)
    return points + first + second / 2 + np.cross(angles, second) / 6


def unit(rng: np.random.Generator) -> Array:
    """A random direction."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


class Geometry:
    """Errors of the axes: a slope and three humps in each of six directions, 5 to 40 um and urad from end to end."""

    def __init__(self, machine: Machine, rng: np.random.Generator) -> None:
        self.travel = np.array(list(machine.travel.values()))
        self.centres, self.widths = rng.uniform(-0.2, 1.2, (3, 6, 3)), rng.uniform(0.2, 0.6, (3, 6, 3))
        self.heights, slope = rng.normal(size=(3, 6, 3)), rng.normal(size=(3, 6))
        self.slopes = slope * np.where(np.arange(6) < 3, 1.5, 0.7)
        size = rng.uniform(5.0, 40.0, (3, 6)) * machine.size * np.where(np.arange(6) < 3, 1e-3, 1e-6)
        self.scale = np.ones((3, 6))
        course = self.of_shares(np.tile(np.linspace(0.0, 1.0, 101)[:, None], 3))
        self.scale = size / np.maximum(np.ptp(course, axis=0), 1e-9)

    def of_shares(self, u: Array) -> Array:
        """Errors `(n, 3, 6)` at shares `(n, 3)` of the travels, zero in the middle."""
        return self.scale * (self.course(u) - self.course(np.full((1, 3), 0.5)))

    def course(self, u: Array) -> Array:
        """Slope and humps `(n, 3, 6)` without their scale."""
        away = (u[:, :, None, None] - self.centres) / self.widths
        return self.slopes * u[:, :, None] + np.sum(self.heights * np.exp(-0.5 * away**2), axis=3)

    def errors(self, q: Array) -> Array:
        """Errors `(n, 3, 6)` of the axes at positions `(n, 3)`, mm and rad."""
        return self.of_shares((q - self.travel[:, 0]) / np.ptp(self.travel, axis=1))
