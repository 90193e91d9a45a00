"""Location errors out of error motions: the mean lines of the axes, by ISO 230-1.

The mean of the error motions of a rotary axis across its line is the location error of its axis average line, the slope
of a straightness is the orientation of a linear axis: moved, with their covariance, into effects of their own.
"""

from __future__ import annotations

from typing import get_args

import msgspec
import numpy as np

from calibration.datum import DATUM_SLOPES, error_motions, mean_line
from kinematics.effects import Component, Effect, ErrorMotion, LocationError
from kinematics.effects.base import own_component
from kinematics.machine import Machine
from kinematics.model import ErrorModel
from kinematics.transforms import Array

SLOPES = {"YX": ("C", 1.0), "ZX": ("B", -1.0), "XY": ("C", -1.0), "ZY": ("A", 1.0), "XZ": ("B", 1.0), "YZ": ("A", -1.0)}
"""By straightness: component of the location error whose slope it is, and sign: E_XY = -E_C0Y y, ..."""
IN_SPAN = 1e-9
"""Relative misfit up to which a basis holds a line."""


def split_locations(machine: Machine, model: ErrorModel) -> tuple[tuple[Effect, ...], Array]:
    """Effects with the location errors in front, all parameters zero; and the matrix `(q, p)` from the old parameters.

    Axes that stand at their letter's direction only (a slanting rotary axis included); others keep their constants.
    """
    matrix = np.eye(len(model.parameters))
    found: list[LocationError] = []
    rows: list[Array] = []
    for effect, part in error_motions(model):
        location, own = _location(machine, effect)
        function = None if location is None or effect.name in DATUM_SLOPES else _coefficients(effect)
        if location is None or function is None:
            continue
        row = np.zeros(len(model.parameters))
        row[part] = own
        matrix[part] -= np.outer(function, row)
        found.append(location)
        rows.append(row)
    zero = tuple(effect.with_parameters([0.0] * len(effect.parameters), effect.u) for effect in model.effects)
    return (*found, *zero), np.concatenate([np.array(rows).reshape(-1, matrix.shape[1]), matrix])


def transformed(model: ErrorModel, effects: tuple[Effect, ...], matrix: Array) -> ErrorModel:
    """The model with these effects, whose parameters are `matrix` times its own; covariance with them."""
    from calibration.fit import with_covariance

    values = (matrix @ model.parameters).tolist()
    filled = []
    for effect in effects:
        size = len(effect.parameters)
        filled.append(effect.with_parameters(values[:size], [0.0] * size))
        values = values[size:]
    moved = msgspec.structs.replace(model, effects=tuple(filled), covariance=None)
    return with_covariance(moved, matrix @ np.array(model.covariance) @ matrix.T)


def _location(machine: Machine, effect: ErrorMotion) -> tuple[LocationError | None, Array]:
    """The location error that an error motion holds, and its value as a function of the motion's parameters."""
    axis, line = machine.axes[machine.index(effect.axis)], mean_line(effect.basis)
    if axis.rotary:
        own = own_component(effect.axis)
        along = own + "XYZ"["ABC".index(own)]
        return (None if effect.component in along else LocationError(effect.component, effect.axis, 0.0)), line.mean
    plain = np.allclose(np.abs(axis.unit_direction), np.eye(3)["XYZ".index(own_component(effect.axis))])
    component, sign = SLOPES.get(f"{effect.component}{own_component(effect.axis)}", ("", 0.0))
    if not component or not plain or len(effect.axis) > 1:
        return None, line.slope
    named = next(letter for letter in get_args(Component) if letter == component)
    return LocationError(named, effect.axis, 0.0), sign * line.slope * 1e3


def _coefficients(effect: ErrorMotion) -> Array | None:
    """Parameters `(size,)` that do what one unit of the location error does; None when the basis can't hold that."""
    x = np.linspace(*effect.basis.interval, 801)
    columns = effect.basis.columns(x)
    turn = effect.axis[0] in "ABC"
    wanted = np.ones_like(x) if turn else SLOPES[f"{effect.component}{own_component(effect.axis)}"][1] * x * 1e-3
    coefficients, *_ = np.linalg.lstsq(columns, wanted, rcond=None)
    misfit = np.abs(columns @ coefficients - wanted).max()
    return np.asarray(coefficients) if misfit < IN_SPAN * np.abs(wanted).max() else None
