"""Curves through the six error motions of an axis, and its location errors taken out of them.

The curves are fitted to all six at once, weighted by what the points say of them together; along the gauge of the
points (`rigid_motions`) they are free, so a polynomial of a table's radial motion does not suffer from a shift of the
points on the table. Degrees are given, or chosen by the Bayesian information criterion (BIC).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np

from calibration.rigid_motions import RigidMotions
from kinematics.basis import Basis, BSpline, Legendre
from kinematics.effects import COMPONENTS, Component, Effect, ErrorMotion, LocationError
from kinematics.errors import UserError
from kinematics.machine import Axis
from kinematics.transforms import Array

HIGHEST_DEGREE = 8
"""That is tried."""
GAUGE_WEIGHT = 1e-9
"""Of the conditions that close the gauge, relative to the points' information: settles what is open, moves nothing."""


@dataclass(frozen=True)
class Curves:
    """Six curves over one axis' position, mm or degrees; values in um and urad."""

    bases: tuple[Basis, ...]
    """By component X Y Z A B C."""
    parameters: Array
    """`(p,)`, one curve after the other."""
    estimator: Array
    """`(p, 6n)`: from the error motions at the positions, um and urad, to the parameters."""
    chi2: float
    freedom: int

    def design(self, positions: Array) -> Array:
        """Matrix `(6n, p)` from parameters to the error motions at positions `(n,)`."""
        return design(self.bases, positions)


@dataclass(frozen=True)
class AxisModel:
    """Effects of one axis, and how their parameters come from those of its curves."""

    effects: tuple[Effect, ...]
    matrix: Array
    """`(parameters of the effects, p)`."""


def design(bases: tuple[Basis, ...], positions: Array) -> Array:
    """Matrix `(6n, p)` from the parameters of six curves to their values at positions `(n,)`, position by position."""
    rows = np.zeros((len(positions), 6, sum(basis.size for basis in bases)))
    for component, (basis, columns) in enumerate(zip(bases, _parts(bases), strict=True)):
        rows[:, component, columns] = basis.columns(positions)
    return rows.reshape(6 * len(positions), -1)


def table_bases(positions: Array) -> tuple[Basis, ...]:
    """Interpolated tables with the measured positions as nodes."""
    return (BSpline(tuple(np.sort(positions).tolist()), 1),) * 6


def polynomial_bases(
    axis: Axis, positions: Array, motions: RigidMotions, given: Mapping[str, int]
) -> tuple[Basis, ...]:
    """Polynomials of the degrees that are given by name of the component (XY: E_XY), the others by BIC.

    A straightness is a line at least, for its slope is the orientation of the axis.
    """
    n, interval = len(positions), (float(positions.min()), float(positions.max()))
    least = np.array([1 if not axis.rotary and name in _sideways(axis) else 0 for name in COMPONENTS])
    degrees = least.copy()
    open_ = []
    for j, name in enumerate(COMPONENTS):
        degree = given.get(f"{name}{axis.name}")
        if degree is None:
            open_.append(j)
        elif not least[j] <= degree < n:
            raise UserError(f"degree {degree} of E_{name}{axis.name}: {n} positions take {least[j]} to {n - 1}")
        else:
            degrees[j] = degree

    def bic(of: Array) -> float:
        found = fit(_legendre(interval, of), positions, motions)
        return found.chi2 + len(found.parameters) * float(np.log(6 * n))

    best, changed = bic(degrees), True
    while changed:
        changed = False
        for j in open_:
            for other in range(least[j], min(HIGHEST_DEGREE, n - 2) + 1):
                trial = degrees.copy()
                trial[j] = other
                value = bic(trial) if other != degrees[j] else best
                if value < best - 1e-9:
                    best, degrees, changed = value, trial, True
    return _legendre(interval, degrees)


def fit(bases: tuple[Basis, ...], positions: Array, motions: RigidMotions) -> Curves:
    """The curves of least squares through the error motions at positions `(n,)`, mm or degrees."""
    columns = design(bases, positions)
    errors = motions.errors.reshape(-1)
    values, vectors = np.linalg.eigh(motions.information)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    conditions = motions.gauge / np.linalg.norm(motions.gauge, axis=1, keepdims=True)
    rows = np.concatenate([root, np.sqrt(GAUGE_WEIGHT * values[-1]) * conditions])
    estimator = np.linalg.lstsq(rows @ columns, rows, rcond=1e-13)[0]
    parameters = estimator @ errors
    misfit = root @ (errors - columns @ parameters)
    return Curves(bases, parameters, estimator, float(misfit @ misfit), len(errors) - 6 - columns.shape[1])


def axis_model(axis: Axis, positions: Array, curves: Curves, motions: RigidMotions) -> AxisModel:
    """Location errors and error motions of an axis; all parameters zero, they are `matrix` times the curves' own.

    A linear axis' orientation is that of the least squares reference lines of its straightness curves; a rotary axis'
    location that of its axis average line. Both are taken over the measured positions.
    """
    values = curves.design(positions)
    rows, names, left = _linear(axis, positions, values) if not axis.rotary else _rotary(axis, values, motions)
    taken = np.zeros((6, len(curves.parameters), len(curves.parameters)))
    for component, (function, amount) in left.items():
        basis, part = curves.bases[component], _parts(curves.bases)[component]
        held = np.linalg.lstsq(basis.columns(positions), function, rcond=None)[0]
        taken[component, part] = np.outer(held, amount)
    matrix = np.concatenate([rows, np.eye(len(curves.parameters)) - taken.sum(axis=0)])
    effects: list[Effect] = [LocationError(name, axis.name, 0.0) for name in names]
    for name, basis in zip(COMPONENTS, curves.bases, strict=True):
        effects.append(ErrorMotion(cast(Component, name), axis.name, basis, (0.0,) * basis.size))
    return AxisModel(tuple(effects), matrix)


def constants_design(curves: Curves) -> Array:
    """The matrix `(p, 6)` from constants added to the six curves, um and urad, to their parameters."""
    matrix = np.zeros((len(curves.parameters), 6))
    for component, (basis, part) in enumerate(zip(curves.bases, _parts(curves.bases), strict=True)):
        x = np.linspace(*basis.interval, 101)
        matrix[part, component] = np.linalg.lstsq(basis.columns(x), np.ones(101), rcond=None)[0]
    return matrix


def _linear(
    axis: Axis, positions: Array, values: Array
) -> tuple[Array, list[Component], dict[int, tuple[Array, Array]]]:
    """Rows from the curves to the location errors, their names, and what leaves each curve for them."""
    centred = positions - positions.mean()
    slope_of = centred / (centred @ centred)
    along = axis.error_frame.T @ axis.unit_direction
    slopes = np.einsum("n,njp->jp", slope_of, values.reshape(len(positions), 6, -1)[:, :3])
    # the line leaves d by angle x d per mm, so angle = d x slope; um/mm are 1000 urad
    turns = np.cross(along, slopes.T).T * 1e3
    across = [j for j in range(3) if abs(along[j]) < 0.5]
    names = [cast(Component, "ABC"[j]) for j in across]
    return turns[across], names, {j: (positions, slopes[j]) for j in across}


def _rotary(
    axis: Axis, values: Array, motions: RigidMotions
) -> tuple[Array, list[Component], dict[int, tuple[Array, Array]]]:
    rows = motions.location @ values
    across = [j for j in range(6) if j % 3 != "ABC".index(axis.name[0])]
    names = [cast(Component, COMPONENTS[j]) for j in across]
    ones = np.ones(len(values) // 6)
    return rows[across], names, {j: (ones, rows[j]) for j in across}


def _sideways(axis: Axis) -> str:
    """Components of the straightness of a linear axis."""
    along = axis.error_frame.T @ axis.unit_direction
    return "".join(letter for letter, share in zip("XYZ", along, strict=True) if abs(share) < 0.5)


def _legendre(interval: tuple[float, float], degrees: Array) -> tuple[Basis, ...]:
    return tuple(Legendre(interval, int(degree)) for degree in degrees)


def _parts(bases: tuple[Basis, ...]) -> list[slice]:
    """Columns of each curve."""
    ends = np.cumsum([0, *(basis.size for basis in bases)]).tolist()
    return [slice(a, b) for a, b in pairwise(ends)]
