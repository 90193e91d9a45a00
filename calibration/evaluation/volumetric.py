"""Volumetric error: the errors of a machine in its volume, optionally after a rigid alignment."""

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
    """Deviations `(n, 3)` at points `(n, 3)` after a rigid alignment, all mm.

    The three shifts and three small rotations of an exact least-squares fit are subtracted. Points on one line, which
    one rotation does not move, are allowed.
    """
    columns = rigid_columns(points)
    fitted = np.linalg.lstsq(columns, deviation.reshape(-1), rcond=1e-12)[0]
    return np.asarray(deviation - (columns @ fitted).reshape(-1, 3))


def rigid_columns(points: Array) -> Array:
    """Displacements of points `(n, 3)` by three shifts and three small rotations, scaled alike: columns `(3 n, 6)`."""
    centred = points - points.mean(axis=0)
    size = max(float(np.abs(centred).max()), np.finfo(float).tiny)
    motions = np.empty((len(points), 3, 6))
    motions[:, :, :3] = np.eye(3)
    # a rotation w moves p by w x p; scaled by the size of the volume, so that rotations and shifts are of similar size
    motions[:, :, 3:] = by_turn(centred / size)
    return motions.reshape(-1, 6)


def volumetric_error_um(deviation: Array, points: Array | None = None) -> VolumetricError:
    """RMS, 95 % quantile and largest length, um, of deviations `(n, 3)`, mm; with `points`, after a rigid alignment."""
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
