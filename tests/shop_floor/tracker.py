"""A laser tracker: its poses, how it reads points, its noise.

Points of its own frame, mm: beams leave the origin, azimuth about z from x. It is levelled to 20 mrad and turned
anyhow, and stands so far off that it sees the whole volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shop_floor.chain import Array, rotation

LEVEL = 0.02
"""Largest tilt, rad."""
RANGE_UM_PER_M = 0.25
ANGLE_UM_PER_M = 1.0


@dataclass(frozen=True)
class Pose:
    """A set-up: origin in the workpiece frame at the zero of all axes, mm, and orientation (3, 3) of its frame."""

    origin: Array
    orientation: Array

    def seen(self, points: Array) -> Array:
        """Points `(n, 3)` of the workpiece frame in the frame of the tracker."""
        return np.asarray((points - self.origin) @ self.orientation)


@dataclass(frozen=True)
class Noise:
    """Standard uncertainties of a reading: along the beam um/m, across um and um/m."""

    angle_um: float
    range_um_per_m: float = RANGE_UM_PER_M
    angle_um_per_m: float = ANGLE_UM_PER_M

    def across(self, length: Array) -> Array:
        """Standard uncertainty across the beam, mm, by range, mm."""
        return np.asarray((self.angle_um + self.angle_um_per_m * length * 1e-3) * 1e-3)

    def along(self, length: Array) -> Array:
        """Standard uncertainty along the beam, mm, by range, mm."""
        return np.asarray(self.range_um_per_m * length * 1e-6)


def draw_pose(points: Array, rng: np.random.Generator) -> Pose:
    """A pose beside points `(n, 3)` of the workpiece frame, mm."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    away = rng.uniform(0.15, 0.45) * size + 500.0
    side = int(rng.integers(4))
    origin = rng.uniform(low, high)
    origin[side % 2] = high[side % 2] + away if side < 2 else low[side % 2] - away
    origin[2] = rng.uniform(0.25, 0.75) * (high[2] - low[2]) + low[2]
    turn = rotation(np.array([[0.0, 0.0, rng.uniform(-np.pi, np.pi)]]))[0]
    tilt = rotation(np.array([[*rng.uniform(-LEVEL, LEVEL, 2), 0.0]]))[0]
    return Pose(origin, tilt @ turn)


def polar(points: Array) -> tuple[Array, Array, Array]:
    """Azimuth and elevation, rad, and range, mm, `(n,)` each."""
    x, y, z = points.T
    return np.arctan2(y, x), np.arctan2(z, np.sqrt(x**2 + y**2)), np.sqrt(x**2 + y**2 + z**2)


def cartesian(azimuth: Array, elevation: Array, length: Array) -> Array:
    """Points `(n, 3)`, mm."""
    return np.stack(
        [
            length * np.cos(elevation) * np.cos(azimuth),
            length * np.cos(elevation) * np.sin(azimuth),
            length * np.sin(elevation),
        ],
        axis=1,
    )


def noisy(points: Array, noise: Noise, normal: Array) -> Array:
    """Readings of points `(n, 3)` with standard normal numbers `(n, 3)` as azimuth, elevation and range noise."""
    azimuth, elevation, length = polar(points)
    across = noise.across(length) / length
    return cartesian(
        azimuth + normal[:, 0] * across / np.cos(elevation),
        elevation + normal[:, 1] * across,
        length + normal[:, 2] * noise.along(length),
    )


def whitened(points: Array, displacements: Array, noise: Noise) -> Array:
    """Displacements `(n, 3)` at points of the tracker's frame, across and along the beam, in standard uncertainties."""
    azimuth, _, length = polar(points)
    beam = points / length[:, None]
    sideways = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    upwards = np.cross(beam, sideways)
    parts = [np.sum(displacements * part, axis=1) for part in (sideways, upwards, beam)]
    sizes = (noise.across(length), noise.across(length), noise.along(length))
    return np.stack([part / size for part, size in zip(parts, sizes, strict=True)], axis=1)
