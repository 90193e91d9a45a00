"""Volumetric error: what a machine's errors are in its volume, once a rigid alignment has taken its share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.deviation import exact_deviation
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, by_turn


class VolumetricError(NamedTuple):
    """Lengths of deviations over a volume, um; virtual calibration paper (9), (10)."""

    rms: float
    p95: float
    largest: float


def aligned(deviation: Array, points: Array) -> Array:
    """What a rigid alignment leaves `(n, 3)` of deviations `(n, 3)` at points `(n, 3)`, all mm.

    The three shifts and three small turns that fit the deviations best, in exact least squares, are taken off. Points
    on one line, which some turn leaves where they are, are no special case.
    """
    columns = rigid_columns(points)
    fitted = np.linalg.lstsq(columns, deviation.reshape(-1), rcond=1e-12)[0]
    return np.asarray(deviation - (columns @ fitted).reshape(-1, 3))


def rigid_columns(points: Array) -> Array:
    """What three shifts and three small turns do to points `(n, 3)`: columns `(3 n, 6)`, all of one order of size."""
    centred = points - points.mean(axis=0)
    size = max(float(np.abs(centred).max()), np.finfo(float).tiny)
    motions = np.empty((len(points), 3, 6))
    motions[:, :, :3] = np.eye(3)
    # a turn w moves p by w x p; in units of the volume's size, so that turns and shifts are of one order
    motions[:, :, 3:] = by_turn(centred / size)
    return motions.reshape(-1, 6)


def volumetric_error_um(deviation: Array, points: Array | None = None) -> VolumetricError:
    """RMS, 95 % quantile and largest length, um, of deviations `(n, 3)`, mm; aligned first where points are given."""
    left = deviation if points is None else aligned(deviation, points)
    length = np.linalg.norm(left, axis=1) * 1e3
    return VolumetricError(
        float(np.sqrt(np.mean(length**2))), float(np.quantile(length, 0.95)), float(length.max(initial=0.0))
    )


def deviation_on(
    machine: Machine, model: ErrorModel, positions: Array, tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Deviations and nominal tool points, both `(n, 3)` mm, at axis positions `(n, axes)`; exact."""
    errors = model.errors(machine, State(positions))
    return exact_deviation(machine, positions, errors, tool).position, tool_point(machine, positions, tool)
