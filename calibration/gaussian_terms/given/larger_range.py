"""A calibration for data that reach beyond the ranges over which it was measured.

Outside its range an error motion keeps its value at the nearer end, as the table of a control does, and a rotary axis
goes in a line from one end of its arc to the other: the calibration knows nothing there. Without a parameter for it,
the error of the machine there would look like a cause.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import numpy as np
from scipy.linalg import block_diag

from calibration.measurement.measurement import Measurement
from kinematics.basis import Basis, BSpline, Interval
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import TURN_DEG, Axis, Machine
from kinematics.transforms import Array
from kinematics.turn import beyond, columns_of, gap_of, measured_arc

SHARE_BEYOND_RANGE = 0.02
"""Share of a range by which data must reach beyond it."""
COMPARED_POSITIONS = 400
"""Number of positions over the range, and over the larger one, at which functions are compared."""
SAME_SHARE_OF_SIZE = 0.01
"""Standard deviation within the range of the error motion that takes the place of another, as a share of its size."""
NARROW_NODE_SHARE = 0.25
"""Share of the distance of nodes up to which the larger range gets none: the error motion keeps its end value there."""
OUTER_SIZE_FACTOR, LEAST_OUTER_SIZE_UM = 3.0, 1.0
"""Prior of an error motion outside its range, as a multiple of its size within it, and the least size, um or urad."""


class Larger(NamedTuple):
    """The range of an axis in a calibration, and the larger one of the calibration and the data together."""

    known: Interval
    whole: Interval


def larger_ranges(calibration: ErrorModel, measurement: Measurement) -> Mapping[str, Larger]:
    """The axes that the data move beyond the range of their error motions."""
    found = {}
    for name, moved in measurement.moving.items():
        axis = measurement.machine.axes[measurement.machine.index(name)]
        ranges = [each.basis.interval for each in _motions(calibration) if each.axis == name]
        if not ranges:
            continue
        known = max(ranges, key=lambda each: each[1] - each[0])
        x = np.concatenate([measurement.state.position(measurement.machine, name), moved])
        if np.max(_outside(axis, known, x)) > SHARE_BEYOND_RANGE * (known[1] - known[0]):
            both = np.concatenate([np.linspace(*known, COMPARED_POSITIONS), x])
            ends = float(both.min()), float(both.max())
            found[name] = Larger(known, _arc(known, both) if axis.turns_fully else ends)
    return found


def _arc(known: Interval, x: Array) -> Interval:
    """The arc of the turn that positions `(n,)`, degrees, cover, counted such that it contains the known one."""
    low, high = measured_arc(x)
    before = (known[0] - low) % TURN_DEG if gap_of((low, high)) else 0.0
    return known[0] - before, known[0] - before + (high - low)


def extended(calibration: ErrorModel, machine: Machine, ranges: Mapping[str, Larger]) -> ErrorModel:
    """The calibration with error motions over larger ranges: the same within their own, with wide priors outside."""
    if not ranges:
        return calibration
    effects, values, roots = list(calibration.effects), [], []
    matrix = np.zeros((0, len(calibration.parameters)))
    for i, (effect, part) in enumerate(zip(calibration.effects, calibration.slices, strict=True)):
        own = np.eye(len(calibration.parameters))[part]
        root = np.zeros((len(own), 0))
        if isinstance(effect, ErrorMotion) and effect.axis in ranges:
            axis = machine.axes[machine.index(effect.axis)]
            basis = _over(effect.basis, ranges[effect.axis].whole)
            into, root = _taking_place(axis, effect, basis)
            own = into @ own
            effects[i] = ErrorMotion(effect.component, effect.axis, basis, (0.0,) * basis.size, u=(0.0,) * basis.size)
        matrix = np.concatenate([matrix, own])
        values.append(own @ calibration.parameters)
        roots.append(root)
    given = calibration.covariance
    u = np.array([value for effect in calibration.effects for value in effect.uncertainties])
    covariance = np.diag(u**2) if given is None else np.array(given)
    more = block_diag(*roots)
    model = msgspec.structs.replace(calibration, effects=tuple(effects), covariance=None)
    return model.with_parameters(np.concatenate(values), matrix @ covariance @ matrix.T + more @ more.T)


def within(calibration: ErrorModel, measurement: Measurement) -> np.ndarray:
    """Mask `(n,)` of the rows at which every axis is in the range of its error motions."""
    inside = np.ones(len(measurement), bool)
    for name, ranges in larger_ranges(calibration, measurement).items():
        axis = measurement.machine.axes[measurement.machine.index(name)]
        x = measurement.state.position(measurement.machine, name)
        inside &= _outside(axis, ranges.known, x) <= SHARE_BEYOND_RANGE * (ranges.known[1] - ranges.known[0])
    return inside


def _motions(calibration: ErrorModel) -> list[ErrorMotion]:
    return [motion for motion, _ in calibration.error_motions]


def _outside(axis: Axis, known: Interval, x: Array) -> Array:
    """Distances `(n,)` of positions from the range in which an axis is known, mm or degrees."""
    if axis.turns_fully:
        return beyond(known, x)
    return np.asarray(np.maximum(np.maximum(known[0] - x, x - known[1]), 0.0))


def _over(basis: Basis, whole: Interval) -> BSpline:
    """A spline over a larger range, as fine as another basis: it is free outside, where waves would only go on."""
    if isinstance(basis, BSpline):
        nodes, degree = np.array(basis.nodes), basis.degree
    else:
        nodes, degree = np.linspace(*basis.interval, basis.size + 1), 3
    distance = float(np.median(np.diff(nodes)))
    before = _nodes(whole[0], nodes[0], distance)
    after = -_nodes(-whole[1], -nodes[-1], distance)[::-1]
    return BSpline(tuple(np.concatenate([before, nodes, after]).tolist()), degree)


def _nodes(end: float, start: float, distance: float) -> Array:
    """Ascending positions from `end` up to `start`, without this, at about this distance; none for a narrow part."""
    if start - end < NARROW_NODE_SHARE * distance:
        return np.zeros(0)
    return np.linspace(end, start, max(round((start - end) / distance), 1) + 1)[:-1]


def _taking_place(axis: Axis, effect: ErrorMotion, basis: Basis) -> tuple[Array, Array]:
    """Matrix `(q, p)` to the parameters of an error motion in another basis, and a root `(q, q)` of their covariance.

    The same error within the range; outside it as far from what the calibration says there as a wide prior lets it be.
    """
    whole = np.linspace(*basis.interval, COMPARED_POSITIONS)
    inside = np.linspace(*effect.basis.interval, COMPARED_POSITIONS)
    old, new = (columns_of(axis, each, inside) for each in (effect.basis, basis))
    said, *_ = np.linalg.lstsq(columns_of(axis, basis, whole), columns_of(axis, effect.basis, whole), rcond=None)
    size = max(
        float(np.sqrt(np.mean((old @ effect.parameters) ** 2 + (old**2) @ np.square(effect.uncertainties)))),
        LEAST_OUTER_SIZE_UM,
    )
    longer = (basis.interval[1] - basis.interval[0]) / (effect.basis.interval[1] - effect.basis.interval[0])
    precision = (
        new.T @ new / (SAME_SHARE_OF_SIZE * size) ** 2 + np.eye(basis.size) / (OUTER_SIZE_FACTOR * longer * size) ** 2
    )
    into = said + np.linalg.solve(precision, new.T @ (old - new @ said)) / (SAME_SHARE_OF_SIZE * size) ** 2
    return into, np.linalg.inv(np.linalg.cholesky(precision)).T
