"""Rough alignment: pose of the instrument and position of each point along the path, from the points alone.

Points and path are compared at equal shares of their lengths. The on-the-fly paper (1.2.3) aligns by start, end and
centroid; here all positions between contribute. A symmetric or closed path is therefore unambiguous, and the order
distinguishes the passes through a position that the path crosses twice. Dynamic time warping then assigns the points
to the path in order, and both steps are repeated.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from calibration.on_the_fly.nominal_path import TargetPath
from calibration.registration.registration import rigid
from kinematics.transforms import Array, Pose
from kinematics.user_error import UserError

MOST_MEDIANS = 8000
"""Largest number of medians, apart from a last incomplete one, to which the points are reduced."""
PATH_POSITIONS = 3000
"""Number of positions on the path for the assignment in order."""
BAND_OF_PATH = 0.05
"""Largest difference of an assignment from equal shares, and of the two lengths, as a share of the path length."""
COARSE_ROUNDS = 4


class Rough(NamedTuple):
    """Rough alignment of one pass along the path."""

    pose: Pose
    """Pose from the frame to which the instrument is fixed to its own."""
    distances: Array
    """Distance along the path `(n,)`, mm, of each point."""


def rough(path: TargetPath, points: Array, where: str) -> Rough:
    """Alignment of points `(n, 3)`, mm, in the order of time, with the path; UserError, naming `where`, if it fails."""
    if len(points) < 10:
        raise UserError(f"{where}: {len(points)} points are too few to follow a path")
    centre, medians = _medians(points)
    kept = _moved(medians, max(path.length / (4.0 * PATH_POSITIONS), 0.05))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(medians[kept], axis=0), axis=1))])
    length = float(arc[-1])
    if abs(length / path.length - 1.0) > BAND_OF_PATH:
        raise UserError(
            f"{where}: the points cover {length / 1e3:.3f} m, the program {path.length / 1e3:.3f} m: record it from "
            "start to end, once for each value of the columns run, target and station; or is it another program?"
        )
    share = np.linspace(0.0, 1.0, PATH_POSITIONS + 1)
    observed = np.stack([np.interp(share * length, arc, column) for column in medians[kept].T], axis=1)
    nominal = path.at(share * path.length).points
    pose, partner = rigid(nominal, observed), np.arange(PATH_POSITIONS + 1)
    for _ in range(COARSE_ROUNDS):
        before = partner
        partner = in_order(observed, pose.apply(nominal))
        pose = rigid(nominal[partner], observed)
        if np.array_equal(partner, before):
            break
    along = np.interp(centre[kept], centre[kept], arc) / length
    distances = np.interp(along, share, partner / PATH_POSITIONS * path.length)
    return Rough(pose, np.interp(np.arange(len(points)), centre[kept], distances))


def in_order(observed: Array, nominal: Array) -> np.ndarray:
    """Index `(n,)` of the nominal point `(n, 3)` assigned to each observed point `(n, 3)`, by the least sum of squares.

    Indices never decrease, and increase by 2 at most from one point to the next.
    """
    n = len(observed)
    band = int(BAND_OF_PATH * n) + 5
    offsets = np.arange(-band, band + 1)
    best = np.where(np.abs(offsets) <= 5, 0.0, np.inf)
    came = np.zeros((n, len(offsets)), np.int8)
    padded = np.pad(nominal, ((band, band), (0, 0)), constant_values=np.inf)
    before = np.full(len(offsets) + 2, np.inf)
    for i in range(n):
        away = np.sum((padded[i : i + len(offsets)] - observed[i]) ** 2, axis=1)
        if i:
            # offsets count from the diagonal, which advances by one per row
            before[1:-1] = best
            by_two, by_one, by_none = before[:-2], before[1:-1], before[2:]
            forward = np.minimum(by_one, by_two)
            came[i] = np.where(by_none <= forward, 0, np.where(by_one <= by_two, 1, 2))
            best = np.minimum(by_none, forward)
        best = best + away
    partner = np.empty(n, int)
    k = int(np.argmin(best))
    for i in range(n - 1, -1, -1):
        partner[i] = i + offsets[k]
        k += 1 - int(came[i, k])
    return partner


def _medians(points: Array) -> tuple[Array, Array]:
    """Index `(b,)` of the middle row, and median `(b, 3)`, of each block of points."""
    size = -(-len(points) // MOST_MEDIANS)
    whole = len(points) // size * size
    medians = np.median(points[:whole].reshape(-1, size, 3), axis=1)
    centre = np.asarray(np.arange(len(medians)) * size + (size - 1) / 2.0, float)
    if size == 1 or whole == len(points):
        return centre, medians
    last_block = points[whole:]
    return np.append(centre, whole + (len(last_block) - 1) / 2.0), np.append(
        medians, np.median(last_block, axis=0)[None], axis=0
    )


def _moved(points: Array, least: float) -> np.ndarray:
    """Indices of the points at least `least` mm from the last point kept, so that a standstill adds no length."""
    listed = points.tolist()
    kept, last = [0], listed[0]
    for i, point in enumerate(listed):
        if math.dist(point, last) >= least:
            kept.append(i)
            last = point
    return np.array(kept)
