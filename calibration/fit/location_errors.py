"""Location errors from error motions: the mean lines of the axes, by ISO 230-1.

The mean of the error motions of a rotary axis across its line is the location error of its axis average line. The slope
of a straightness at the centre of the measured points is the orientation of a linear axis. Both become separate
effects, with their covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import get_args

import msgspec
import numpy as np

from calibration.fit.datum import DATUM_SLOPES, along_own_line, to_datum
from calibration.measurement.measurement import Measurement
from calibration.observation.mean_lines import AT_ORIGIN, about_own_points, line_at_centre
from kinematics.effects import Component, Effect, ErrorMotion, LocationError
from kinematics.error_model.covariance import propagated
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.transforms import Array

ALIGNED = 1e-9
"""Largest deviation of a unit vector's component from 1 for an axis along a direction of the machine's frame."""
IN_SPAN = 1e-9
"""Largest relative misfit of a line that a basis represents."""


def model_in_datum(model: ErrorModel, measurement: Measurement, prior: Array) -> ErrorModel:
    """A model that was fitted to a measurement, in the datum, with its location errors.

    prior `(p,)`: prior sizes of its parameters, in their units.
    """
    machine, arms = measurement.machine, measurement.arms
    moved = transformed(model, model.effects, to_datum(machine, model, prior, arms))
    moved = transformed(moved, *about_own_points(moved))
    return transformed(moved, *split_locations(machine, moved, arms))


def split_locations(
    machine: Machine, model: ErrorModel, arms: Mapping[str, Array] = AT_ORIGIN
) -> tuple[tuple[Effect, ...], Array]:
    """Effects with the location errors, still zero, in front; and the matrix `(q, p)` from old to new parameters.

    Linear axes that do not lie along x, y or z keep their slopes. arms: those of the measured points, as `arms_of`.
    """
    matrix = np.eye(len(model.parameters))
    found: list[LocationError] = []
    rows: list[Array] = []
    for effect, part in model.error_motions:
        located = None if effect.name in DATUM_SLOPES else _location(machine, model, effect, arms)
        if located is None:
            continue
        location, row, function = located
        matrix[part] -= np.outer(function, row)
        found.append(location)
        rows.append(row)
    return (*found, *model.effects), np.concatenate([np.array(rows).reshape(-1, matrix.shape[1]), matrix])


def transformed(model: ErrorModel, effects: tuple[Effect, ...], matrix: Array) -> ErrorModel:
    """The model with these effects, whose parameters are `matrix` times the old ones, and their covariance."""
    moved = msgspec.structs.replace(model, effects=effects)
    return moved.with_parameters(matrix @ model.parameters, propagated(matrix, np.array(model.covariance)))


def _location(
    machine: Machine, model: ErrorModel, effect: ErrorMotion, arms: Mapping[str, Array]
) -> tuple[LocationError, Array, Array] | None:
    """Location error in an error motion, its value as a function `(p,)` of all parameters, and `(size,)` of one unit.

    None where there is none, or the basis cannot represent it.
    """
    axis, line = machine.axes[machine.index(effect.axis)], line_at_centre(model, effect, arms)
    if axis.rotary:
        if effect.component in along_own_line(effect.axis):
            return None
        component, value, coefficients = effect.component, line.mean, _written(effect, np.ones_like)
    else:
        if effect.angular:
            return None
        # the line deviates from d by angle x d per mm, so that angle = d x slope; 1 um per mm is 1000 urad
        along = axis.error_frame.T @ axis.unit_direction
        turn = np.cross(along, np.eye(3)["XYZ".index(effect.component)])
        k = int(np.argmax(np.abs(turn)))
        if abs(abs(turn[k]) - 1.0) > ALIGNED:
            return None
        component, value = get_args(Component)[3 + k], turn[k] * line.slope * 1e3
        coefficients = _written(effect, lambda x: turn[k] * x * 1e-3)
    return None if coefficients is None else (LocationError(component, effect.axis, 0.0), value, coefficients)


def _written(effect: ErrorMotion, function: Callable[[Array], Array]) -> Array | None:
    """Parameters `(size,)` of a function of position; None when the basis cannot represent it."""
    x = np.linspace(*effect.basis.interval, 801)
    columns, values = effect.basis.columns(x), function(x)
    parameters, *_ = np.linalg.lstsq(columns, values, rcond=None)
    misfit = np.abs(columns @ parameters - values).max()
    return np.asarray(parameters) if misfit < IN_SPAN * np.abs(values).max() else None
