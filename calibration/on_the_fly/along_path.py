"""From readings and a path to a measurement that every fit accepts: alignment, exclusion, reduction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import AcrossPath, Measurement, with_moves
from calibration.on_the_fly.alignment import READINGS_AT_A_TIME, Pass, aligned_pose, nearest
from calibration.on_the_fly.coarse_alignment import PATH_POSITIONS, rough
from calibration.on_the_fly.constant_feed import steadiness
from calibration.on_the_fly.nominal_path import NominalPath, TargetPath, target_path
from calibration.on_the_fly.path_cells import Cells, cell_numbers, reduced
from calibration.on_the_fly.readings import Readings
from calibration.on_the_fly.reduction import Reduction
from kinematics.running.progress import Progress, silent
from kinematics.state import State
from kinematics.transforms import Array, Pose, turn
from kinematics.user_error import UserError

CELL_MM, CORNER_MM = 4.0, 5.0
MOST_PATH_CELLS = 20_000
"""Largest number of cells of a measurement; a longer path has longer cells."""


@dataclass(frozen=True)
class OnTheFly:
    """A measurement in motion, and its reduction from the readings."""

    measurement: Measurement
    """The readings, reduced to cells of the path."""
    reduction: Reduction
    """Numbers of readings that were used and left out."""
    paths: Mapping[str, TargetPath]
    """Path of each target, by name."""
    notes: tuple[str, ...] = ()
    """Notes on the readings."""


def _aligned(
    readings: Readings, paths: Mapping[str, TargetPath], passes: Sequence[slice], progress: Progress
) -> tuple[dict[str, Pose], list[Pass]]:
    """The poses of the stations, and the passes as they were aligned for them."""
    poses: dict[str, Pose] = {}
    roughly: list[Pass] = []
    for number, rows in enumerate(passes):
        progress("rough alignment", number / len(passes))
        target, station = paths[str(readings.target[rows.start])], str(readings.station[rows.start])
        found = rough(target, readings.points[rows], readings.where(rows))
        roughly.append(Pass(target, readings.points[rows], found.distances, 1.5 * target.length / PATH_POSITIONS))
        poses.setdefault(station, found.pose)
    for number, (station, roughly_posed) in enumerate(poses.items()):
        progress("fine alignment", number / len(poses))
        own = [each for each, rows in zip(roughly, passes, strict=True) if readings.station[rows.start] == station]
        poses[station] = aligned_pose(roughly_posed, own, f"{readings.source}, station {station}")
    return poses, roughly


def on_path(
    readings: Readings,
    path: NominalPath,
    *,
    cell_mm: float | None = None,
    corner_mm: float = CORNER_MM,
    progress: Progress = silent,
) -> OnTheFly:
    """The readings as a measurement: one row per cell of the path, which counts only across the path.

    `rough` aligns every pass, then `aligned_pose` every station. Readings near corners and at changing speed are left
    out (`steadiness`); the others are reduced to means over cells (`reduced`). A fit then estimates registration and
    errors jointly, as for any measurement. UserError for readings that did not follow the path.
    """
    names = np.unique(readings.target).tolist()
    paths = {name: target_path(path, readings.targets[name], readings.stands_on) for name in names}
    passes = list(readings.passes())
    length = sum(paths[str(readings.target[rows.start])].length for rows in passes)
    cell = cell_mm if cell_mm is not None else max(CELL_MM, round(length / MOST_PATH_CELLS, 1))
    poses, roughly = _aligned(readings, paths, passes, progress)
    parts, feeds, lost, correlated = [], [], np.zeros(3, int), 1.0
    for number, (each, rows) in enumerate(zip(roughly, passes, strict=True)):
        progress("reduction", number / len(passes))
        part, left_out, cells = _reduced_pass(
            readings, rows, each, poses[str(readings.station[rows.start])], cell, corner_mm
        )
        parts.append(part)
        feeds.append(float(np.median(part.feed)) if len(part.feed) else 0.0)
        lost += left_out
        correlated = max(correlated, cells.correlation)
    taken = _Rows(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    if not len(taken.first):
        raise UserError(f"{readings.source}: no reading can be used: all are close to corners or at changing speed")
    corners, unsteady, astray = lost.tolist()
    reduction = Reduction(
        len(readings), corners, unsteady, astray, len(taken.first), cell, corner_mm, len(passes), tuple(feeds),
        max(each.length for each in paths.values()) * 1e-3, correlated,
    )  # fmt: skip
    return OnTheFly(_measurement(taken, readings, path), reduction, paths)


class _Rows(NamedTuple):
    """Columns of the measurement, one row per cell `c`."""

    first: np.ndarray
    """Index of the first reading `(c,)`."""
    positions: Array
    approach: Array
    velocity: Array
    time: Array
    feed: Array
    temperatures: Array
    """Temperatures `(c, sensors)`, K from 20 degC."""
    observed: Array
    directions: Array
    """Unit vectors `(c, 2, 3)` across the path."""
    readings: Array
    distances: Array


def _reduced_pass(
    readings: Readings, rows: slice, each: Pass, pose: Pose, cell_mm: float, corner_mm: float
) -> tuple[_Rows, np.ndarray, Cells]:
    """The cells of one pass; numbers of readings left out near corners, at changing speed, as outliers."""
    distances, deviation = _followed(each, pose)
    steady = steadiness(each.path, readings.time[rows], distances, corner_mm, cell_mm)
    used = np.flatnonzero(~steady.corner & ~steady.unsteady)
    sensors = [column[rows] for column in readings.temperatures.values()]
    columns = np.stack([readings.time[rows], steady.speed, steady.feed, *sensors], axis=1)
    cells = reduced(cell_numbers(each.path, distances[used], cell_mm), distances[used], deviation[used], columns[used])
    located = each.path.at(cells.distances)
    observed = pose.apply(located.points + _perpendicular(cells.deviation, located.tangents))
    taken = _Rows(
        rows.start + used[cells.first],
        each.path.positions_at(cells.distances),
        _approach(each.path, cells.distances),
        each.path.slopes_at(cells.distances) * cells.columns[:, 1:2],
        cells.columns[:, 0],
        cells.columns[:, 2],
        cells.columns[:, 3:],
        observed,
        across_path(turn(pose.rotation, located.tangents), observed),
        cells.count / cells.correlation,
        cells.distances,
    )
    return taken, np.array([steady.corner.sum(), steady.unsteady.sum(), cells.astray]), cells


def _measurement(taken: _Rows, readings: Readings, path: NominalPath) -> Measurement:
    """The rows of all passes, in the order of acquisition."""
    first = taken.first
    run = readings.run[first]
    _, number = np.unique(run, return_inverse=True)
    state = State(
        taken.positions,
        velocity=taken.velocity,
        time=taken.time,
        temperatures={name: taken.temperatures[:, i] for i, name in enumerate(readings.temperatures)},
        cycle=number.astype(float),
        station=readings.station[first],
        target=readings.target[first],
        observed=taken.observed,
    )
    return Measurement(
        path.machine, readings.instrument, with_moves(state, taken.approach), taken.observed, readings.targets,
        readings.stands_on, run=run, feed=taken.feed, lines=readings.lines[first], source=readings.source,
        fingerprint=readings.fingerprint, notes=readings.notes, simulated=readings.simulated,
        across=AcrossPath(taken.directions, taken.readings, path.ends, taken.distances),
    )  # fmt: skip


def across_path(along: Array, observed: Array) -> Array:
    """Directions `(n, 2, 3)` across the path: the component of the beam across it, and the perpendicular to both.

    On-the-fly paper (1) with its errata. `along` `(n, 3)`: unit vectors along the path; `observed` `(n, 3)`: points,
    mm; both in the instrument's frame, whose origin emits the beam. For a beam along the path, any two directions do.
    """
    beam = observed / np.maximum(np.linalg.norm(observed, axis=1, keepdims=True), 1e-12)
    second = _perpendicular(beam, along)
    length = np.linalg.norm(second, axis=1, keepdims=True)
    other = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    other = _perpendicular(other, along)
    second = np.where(
        length > 1e-6, second / np.maximum(length, 1e-12), other / np.linalg.norm(other, axis=1, keepdims=True)
    )
    return np.stack([second, np.cross(along, second)], axis=1)


def _followed(each: Pass, pose: Pose) -> tuple[Array, Array]:
    """Distances along the path `(n,)` and deviations across it `(n, 3)`, mm, of the points of a pass."""
    distances, deviation = np.empty(len(each.distances)), np.empty((len(each.distances), 3))
    back = pose.inverse()
    for start in range(0, len(distances), READINGS_AT_A_TIME):
        rows = slice(start, start + READINGS_AT_A_TIME)
        points = back.apply(each.points[rows])
        distances[rows] = nearest(each.path, points, each.distances[rows], each.width)
        located = each.path.at(distances[rows])
        deviation[rows] = _perpendicular(points - located.points, located.tangents)
    return distances, deviation


def _perpendicular(vectors: Array, along: Array) -> Array:
    return np.asarray(vectors - np.sum(vectors * along, axis=1, keepdims=True) * along)


def _approach(path: TargetPath, distances: Array) -> Array:
    """Direction of the last move of each axis `(n, axes)`; 0 before its first move."""
    moves = np.sign(np.where(np.abs(path.slopes) > 1e-9, path.slopes, 0.0))
    moved = np.where(moves != 0.0, np.arange(len(moves))[:, None], 0)
    last = np.take_along_axis(moves, np.maximum.accumulate(moved, axis=0), axis=0)
    return np.asarray(last[np.minimum((distances / path.step).astype(int), len(last) - 1)])
