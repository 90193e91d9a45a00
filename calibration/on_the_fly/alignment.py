"""Fine alignment of points with the path, repeated until the pose of a station converges (on-the-fly paper, 1.2.3).

Each step takes every point to the nearest position on the path and changes the pose by least squares of the residuals
*across* the path, with Huber weights. Residuals along the path carry no information and would slow the convergence.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.nominal_path import TargetPath
from kinematics.transforms import Array, Pose, by_turn, rotation_vector_matrix, turn
from kinematics.user_error import UserError

MOST_POINTS = 20_000
"""Largest number of points that determine the pose of a station."""
ALIGNMENT_ROUNDS = 30
CONVERGED_MM = 1e-6
"""Step of the points, mm, below which the pose has converged."""
ASIDE = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""Start values of the search for the nearest position, in widths from the expected position."""
TIE = 1e-8
"""Weight of the squared distance from the expected position: it decides between two equally near positions."""
NEWTON = 3
NOT_FOLLOWED_MM = 2.0
"""Median distance from the path, mm, above which the points did not follow it."""
HUBER_SIGMA = 1.5
READINGS_AT_A_TIME = 65_536


class Pass(NamedTuple):
    """Points `n` of one pass along the path."""

    path: TargetPath
    points: Array
    """Points `(n, 3)`, mm, in the instrument's frame."""
    distances: Array
    """Distance along the path `(n,)`, mm, as estimated so far."""
    width: float
    """Uncertainty of these distances, mm."""

    def rows(self, index: np.ndarray) -> Pass:
        """Some of the points."""
        return self._replace(points=self.points[index], distances=self.distances[index])


def nearest(path: TargetPath, points: Array, expected: Array, width: float) -> Array:
    """Distances along the path `(n,)`, mm, of the positions nearest to points `(n, 3)` in the path's frame.

    The search covers 2 widths to both sides of the expected distances `(n,)`, mm.
    """
    found = np.empty(len(points))
    for start in range(0, len(points), READINGS_AT_A_TIME):
        rows = slice(start, start + READINGS_AT_A_TIME)
        found[rows] = _nearest(path, points[rows], expected[rows], width)
    return found


def _nearest(path: TargetPath, points: Array, expected: Array, width: float) -> Array:
    best, least = expected, np.full(len(points), np.inf)
    for aside in ASIDE:
        s = np.clip(expected + aside * width, 0.0, path.length)
        for _ in range(NEWTON):
            located = path.at(s)
            s = np.clip(s + np.sum(located.tangents * (points - located.points), axis=1), 0.0, path.length)
        away = np.sum((points - path.at(s).points) ** 2, axis=1) + TIE * (s - expected) ** 2
        nearer = away < least
        best, least = np.where(nearer, s, best), np.where(nearer, away, least)
    return best


def aligned_pose(pose: Pose, passes: Sequence[Pass], where: str) -> Pose:
    """The pose of a station, from all its passes; UserError, naming `where`, if they did not follow the path."""
    share = min(1.0, MOST_POINTS / sum(len(each.distances) for each in passes))
    some = []
    for each in passes:
        count = max(int(share * len(each.distances)), min(len(each.distances), 10))
        some.append(each.rows(np.unique(np.linspace(0, len(each.distances) - 1, count).astype(int))))
    for _ in range(ALIGNMENT_ROUNDS):
        parts = []
        for i, each in enumerate(some):
            on_path = pose.inverse().apply(each.points)
            some[i] = each._replace(distances=nearest(each.path, on_path, each.distances, each.width))
            parts.append(_across(each.path, on_path, some[i].distances))
        design, left = (np.concatenate(column) for column in zip(*parts, strict=True))
        away = np.linalg.norm(left, axis=1)
        scale = max(float(np.median(away)), 1e-9)
        root = np.sqrt(np.minimum(HUBER_SIGMA * scale / np.maximum(away, 1e-12), 1.0))
        centre = np.concatenate([pose.inverse().apply(each.points) for each in some]).mean(axis=0)
        columns = np.concatenate([design, _turned(design, some, pose, centre)], axis=2) * root[:, None, None]
        step = np.linalg.lstsq(columns.reshape(-1, 6), (left * root[:, None]).reshape(-1), rcond=1e-9)[0]
        rotation = rotation_vector_matrix(step[3:])
        # a point p of the path moves to centre + R (p - centre) + shift
        pose = pose @ Pose(rotation, centre - turn(rotation, centre) + step[:3])
        size = max(each.path.length for each in some)
        if np.abs(step[:3]).max() + np.abs(step[3:]).max() * size < CONVERGED_MM:
            break
    if scale > NOT_FOLLOWED_MM:
        raise UserError(
            f"{where}: half of the points are more than {scale:.1f} mm away from the path of the program: check the "
            "program, its work offsets, and the position of the target in the header"
        )
    return pose


def _across(path: TargetPath, points: Array, distances: Array) -> tuple[Array, Array]:
    """Projections `(n, 3, 3)` across the path, and the residuals across it `(n, 3)`, mm."""
    located = path.at(distances)
    across = np.eye(3) - located.tangents[:, :, None] * located.tangents[:, None, :]
    return across, turn(across, points - located.points)


def _turned(across: Array, passes: Sequence[Pass], pose: Pose, centre: Array) -> Array:
    """Derivatives `(n, 3, 3)` of the residuals with respect to a rotation of the path about the centre."""
    points = np.concatenate([pose.inverse().apply(each.points) for each in passes])
    return np.asarray(across @ by_turn(points - centre))
