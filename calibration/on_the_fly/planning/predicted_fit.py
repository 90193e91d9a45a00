"""Prediction for data along a path before they are taken: noise gain, blind mode, unidentifiable parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import fit
from calibration.fit.identifiability import Unidentifiable, identifiability
from calibration.measurement.instruments import LaserTracker
from calibration.measurement.measurement import AcrossPath, Measurement, Target, with_moves
from calibration.observation.full_model import priors
from calibration.on_the_fly.along_path import CELL_MM, CORNER_MM, across_path
from calibration.on_the_fly.nominal_path import NominalPath, target_path
from calibration.on_the_fly.planning.blind_mode import common_odd_mode
from calibration.on_the_fly.planning.noise_gain import PRIOR, Gain, Volume
from kinematics.effects.geometric import TYPICAL
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

AWAY_MM = 2000.0
"""Distance of the assumed tracker from the path in each coordinate, mm."""


class Judged(NamedTuple):
    """Evaluation of one path."""

    gain: Gain
    feed_mm: float
    """Length of the feed moves, as the feed counts it, mm."""
    blind_mode: str | None
    not_visible: tuple[Unidentifiable, ...]


def judged(path: NominalPath, targets: Mapping[str, Target]) -> Judged:
    """Evaluation of a path that is run once for each target, in the volume between the path's own ends.

    UserError for a path without a feed move that is long enough.
    """
    volume = Volume(path.machine, path.ends, targets, CELL_MM, CORNER_MM)
    moves = np.flatnonzero(path.counts[1:])
    total = np.zeros((6 + volume.size, 6 + volume.size))
    for k in moves.tolist():
        total += volume.information(path.positions[k], path.positions[k + 1])
    if not total.any():
        raise UserError(f"{path.source}: no feed move is longer than the {2 * CORNER_MM:g} mm left out at its corners")
    ideal = _ideal(path, targets)
    found = fit(ideal, volume.model, prior=priors(volume.model) * (PRIOR / TYPICAL))
    length = float(np.diff(path.way)[moves].sum())
    return Judged(
        volume.gain(total), length, common_odd_mode(ideal, found.registration), identifiability(found).unidentifiable
    )


def _ideal(path: NominalPath, targets: Mapping[str, Target]) -> Measurement:
    """The observations by a tracker of the machine without errors, one row per cell."""
    parts: list[tuple[Array, Array, Array, Array, np.ndarray]] = []
    for name, target in targets.items():
        way = target_path(path, target)
        s = np.arange(0.5 * CELL_MM, way.length, CELL_MM)
        stretch = way.stretch(s)
        distance = np.minimum(s - way.corners[stretch], way.corners[stretch + 1] - s)
        s = s[(distance >= CORNER_MM) & way.usable[stretch]]
        place = way.at(s)
        parts.append((way.positions_at(s), place.points, place.tangents, s, np.full(len(s), name)))
    positions, points, tangents, s, names = (np.concatenate(column) for column in zip(*parts, strict=True))
    observed = points - points.min(axis=0) + AWAY_MM
    across = AcrossPath(across_path(tangents, observed), np.ones(len(s)), path.ends, s)
    state = with_moves(State(positions, target=names, observed=observed))
    tracker = LaserTracker(u_range_um=1.0, u_angle_um=1.0)
    return Measurement(path.machine, tracker, state, observed, targets, source=path.source, across=across)
