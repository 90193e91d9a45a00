"""Prediction for data along a path before they are taken: noise gain, blind mode, unidentifiable parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import fit
from calibration.fit.identifiability import Unidentifiable, identifiability
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import AcrossPath, Measurement, Target, with_moves
from calibration.observation.full_model import priors
from calibration.on_the_fly.along_path import CELL_MM, CORNER_MM, across_path
from calibration.on_the_fly.nominal_path import NominalPath, target_path
from calibration.on_the_fly.planning.noise_gain import PRIOR, NoiseGain, Volume
from calibration.on_the_fly.planning.unidentifiable_mode import common_odd_mode
from kinematics.effects.geometric import TYPICAL_MOTION_UM
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

ASSUMED_TRACKER_MM = 2000.0
"""Distance of the assumed tracker from the path in each coordinate, mm."""


class PathEvaluation(NamedTuple):
    """Evaluation of one path."""

    noise_gain: NoiseGain
    feed_mm: float
    """Length of the feed moves, as the feed counts it, mm."""
    unidentifiable_mode: str | None
    unidentifiable: tuple[Unidentifiable, ...]


def evaluated_path(path: NominalPath, targets: Mapping[str, Target]) -> PathEvaluation:
    """Evaluation of a path that is run once for each target, in the volume between the path's own ends.

    UserError for a path without a feed move that is long enough.
    """
    volume = Volume(path.machine, path.ends, targets, CELL_MM, CORNER_MM)
    moves = np.flatnonzero(path.feed_move[1:])
    total = np.zeros((6 + volume.size, 6 + volume.size))
    for k in moves.tolist():
        total += volume.information(path.positions[k], path.positions[k + 1])
    if not total.any():
        raise UserError(f"{path.source}: no feed move is longer than the {2 * CORNER_MM:g} mm left out at its corners")
    ideal = _ideal(path, targets)
    found = fit(ideal, volume.model, prior=priors(volume.model) * (PRIOR / TYPICAL_MOTION_UM))
    length = float(np.diff(path.feed_distance)[moves].sum())
    return PathEvaluation(
        volume.noise_gain(total),
        length,
        common_odd_mode(ideal, found.registration),
        identifiability(found).unidentifiable,
    )


def _ideal(path: NominalPath, targets: Mapping[str, Target]) -> Measurement:
    """The observations by a tracker of the machine without errors, one row per cell."""
    parts: list[tuple[Array, Array, Array, Array, np.ndarray]] = []
    for name, target in targets.items():
        target_course = target_path(path, target)
        s = np.arange(0.5 * CELL_MM, target_course.length, CELL_MM)
        segment = target_course.segment_at(s)
        distance = np.minimum(s - target_course.corners[segment], target_course.corners[segment + 1] - s)
        s = s[(distance >= CORNER_MM) & target_course.usable[segment]]
        located = target_course.at(s)
        parts.append((target_course.positions_at(s), located.points, located.tangents, s, np.full(len(s), name)))
    positions, points, tangents, s, names = (np.concatenate(column) for column in zip(*parts, strict=True))
    observed = points - points.min(axis=0) + ASSUMED_TRACKER_MM
    across = AcrossPath(across_path(tangents, observed), np.ones(len(s)), path.ends, s)
    state = with_moves(State(positions, target=names, observed=observed))
    tracker = LaserTracker(u_range_um=1.0, u_angle_um=1.0)
    return Measurement(path.machine, tracker, state, observed, targets, source=path.source, across=across)
