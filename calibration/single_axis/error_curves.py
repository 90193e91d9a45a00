"""Curves through the six error motions of an axis, and the separation of its location errors from them.

The curves are fitted to all six at once, weighted by the joint covariance of the points. They are the error motions of
every measurement (`calibration.gaussian_terms.geometry`): polynomials of a high degree, or harmonics of a whole turn,
whose bands share sizes that the data decide. What positions do not show between them has the size of its band, and is
in u. The user may give degrees; nothing limits the coefficients of these, nor those of tables.

The gauge of the points (`rigid_motions`) removes from a rotary axis the first harmonic that rotates with the component.
A polynomial does not contain this harmonic. Polynomials of a rotary axis therefore have an additional wobble, and both
are written as one polynomial of sufficient degree.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, cast

import numpy as np
from scipy import special

from calibration.gaussian_terms.geometry import (
    ERROR_DEGREE,
    TURN_HARMONICS,
    Bands,
    Key,
    degrees_of,
    keys_of,
    prior_sizes,
    summed,
)
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.single_axis.rigid_motions import RigidMotions
from kinematics.basis import Basis, BSpline, Harmonics, Interval, Legendre
from kinematics.effects import COMPONENTS, Component, Effect, ErrorMotion, LocationError, Wobble
from kinematics.error_model.priors import Priors
from kinematics.machine import TURN_DEG, Axis
from kinematics.transforms import Array
from kinematics.turn import columns_of, gap_of, measured_arc
from kinematics.user_error import UserError

MOST_BAND_STEPS = 60
"""Most steps of the sizes of the bands."""
UNLIMITED_UM = 1e5
"""Prior size, um and urad, of coefficients that nothing limits."""
STATED = -3
"""Number of the band of these."""
SHOWN_DEGREE_U = 3.0
"""Size of a coefficient in standard uncertainties from which the data show its degree."""
UNRESOLVED_RATIO = 2.0
"""Ratio of the uncertainty between the positions to that at these from which waves are not resolved."""
MISFIT = 1e-3
"""Probability of a chi2 below which a curve deviates significantly from its points."""
NO_SCATTER = 1e-6
"""Share of the largest variance below which the variance of a combination of residuals counts as zero."""


@dataclass(frozen=True)
class Shape:
    """Functions of the six curves of one axis."""

    axis: Axis
    bases: tuple[Basis, ...]
    """Basis of each component X Y Z A B C."""
    free: tuple[bool, ...] = (True,) * 6
    """True for each component whose coefficients nothing limits."""

    @property
    def parts(self) -> list[slice]:
        """Range of the parameters of each curve."""
        ends = np.cumsum([0, *(basis.size for basis in self.bases)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    @property
    def wobbles(self) -> tuple[Wobble, ...]:
        """Radial and tilt wobble that rotates with the component; none for tables and harmonics, which contain it."""
        if not self.axis.rotary or not isinstance(self.bases[0], Legendre):
            return ()
        letter = self.axis.error_frame[:, "ABC".index(self.axis.name[0])]
        along = (letter @ self.axis.unit_direction > 0) == (self.axis.side == "tool")
        sense: Literal[1, -1] = 1 if along else -1
        return (
            Wobble(self.axis.name, "radial", 1, sense, 0.0, 0.0),
            Wobble(self.axis.name, "tilt", 1, sense, 0.0, 0.0),
        )

    @property
    def size(self) -> int:
        """Number of parameters."""
        return sum(basis.size for basis in self.bases) + 2 * len(self.wobbles)

    def design(self, positions: Array) -> Array:
        """Matrix `(6n, p)` from the parameters to the error motions at positions `(n,)`, position by position."""
        rows = np.zeros((len(positions), 6, self.size))
        for component, (basis, columns) in enumerate(zip(self.bases, self.parts, strict=True)):
            rows[:, component, columns] = columns_of(self.axis, basis, positions)
        start = self.parts[-1].stop
        cos, sin = np.cos(np.deg2rad(positions)), np.sin(np.deg2rad(positions))
        for k, wobble in enumerate(self.wobbles):
            own, columns = "ABC".index(self.axis.name[0]), slice(start + 2 * k, start + 2 * k + 2)
            rows[:, 3 * k + (own + 1) % 3, columns] = np.stack([cos, sin], axis=1)
            rows[:, 3 * k + (own + 2) % 3, columns] = wobble.sense * np.stack([sin, -cos], axis=1)
        return rows.reshape(6 * len(positions), -1)

    def bands(self, priors: Priors) -> tuple[Bands, Array]:
        """The bands of the parameters, and their prior sizes `(p,)`, um and urad."""
        keys: list[Key] = []
        sizes = []
        for name, basis, free in zip(COMPONENTS, self.bases, self.free, strict=True):
            motion = ErrorMotion(cast(Component, name), self.axis.name, basis, (0.0,) * basis.size)
            degrees = degrees_of(basis)
            keys += [(name, "", STATED)] * basis.size if free else keys_of(motion, degrees)
            sizes.append(np.full(basis.size, UNLIMITED_UM) if free else prior_sizes(degrees, priors))
        for wobble in self.wobbles:
            keys += [(wobble.motion, "wobble", 0)] * 2
            sizes.append(np.full(2, UNLIMITED_UM if any(self.free) else priors.error_motion_um))
        return Bands.of(keys, priors), np.concatenate(sizes)


@dataclass(frozen=True)
class Curves:
    """Six curves over one axis' position, mm or degrees; values in um and urad."""

    shape: Shape
    parameters: Array
    """Parameters `(p,)`: curve by curve, then the wobble."""
    estimator: Array
    """Matrix `(p, 6n)` from the error motions at the positions, um and urad, to the parameters."""
    between: Array
    """A root R `(p, p)` of the covariance R R' of what the positions do not show."""
    degrees: tuple[int | None, ...]
    """Degree of each polynomial, or number of harmonics: given, or the largest that the data show; None for a table."""
    unresolved: tuple[int, ...] = ()
    """Components that may have waves which the positions do not resolve, larger than the noise."""

    def design(self, positions: Array) -> Array:
        """Matrix `(6n, p)` from the parameters to the error motions at positions `(n,)`."""
        return self.shape.design(positions)


@dataclass(frozen=True)
class Misfit:
    """Deviation of a curve from its points, evaluated with their covariance."""

    chi2: float
    degrees_of_freedom: int

    @property
    def significant(self) -> bool:
        """True if the deviation exceeds the scatter of the points."""
        return self.degrees_of_freedom > 0 and float(special.chdtrc(self.degrees_of_freedom, self.chi2)) < MISFIT

    @property
    def widening(self) -> float:
        """Factor of the curve's standard uncertainty (Birge); 1 if the deviation is not significant."""
        return float(np.sqrt(max(self.chi2 / self.degrees_of_freedom, 1.0))) if self.significant else 1.0


@dataclass(frozen=True)
class AxisModel:
    """Effects of one axis, and the matrix from the parameters of its curves to theirs."""

    effects: tuple[Effect, ...]
    matrix: Array
    """Matrix `(parameters of the effects, p)`."""


def polynomials(axis: Axis, positions: Array, given: Mapping[str, int], arc: Interval) -> Shape:
    """Polynomials of the degrees given by name of the component (XY: E_XY), else of a high degree.

    A straightness is at least a line, because its slope is the orientation of the axis. An axis that turns fully and
    was measured over the whole turn has harmonics; a degree is their number. UserError for a degree out of range.
    """
    closed = axis.turns_fully and not gap_of(arc)
    most = (len(positions) - 1) // 2 if closed else len(positions) - 1
    degrees = [given.get(f"{name}{axis.name}") for name in COMPONENTS]
    for j, (name, degree) in enumerate(zip(COMPONENTS, degrees, strict=True)):
        least = int(closed and across(axis, j)) if axis.rotary else int(name in sideways(axis))
        if degree is not None and not least <= degree <= most:
            raise UserError(
                f"degree {degree} of E_{name}{axis.name}: {len(positions)} positions allow {least} to {most}"
            )
    kind, high = (Harmonics, TURN_HARMONICS) if closed else (Legendre, ERROR_DEGREE)
    bases = tuple(kind(arc, high if degree is None else degree) for degree in degrees)
    return Shape(axis, bases, tuple(degree is not None for degree in degrees))


def tables(axis: Axis, positions: Array, arc: Interval) -> Shape:
    """Interpolated tables with the measured positions as nodes; periodic if the whole turn was measured."""
    nodes = np.unique(positions)
    if axis.turns_fully:
        nodes = arc[0] + np.unique(np.round(np.mod(positions - arc[0], TURN_DEG), 6) % TURN_DEG)
        nodes = nodes if gap_of(arc) else np.append(nodes, arc[1])
    return Shape(axis, (BSpline(tuple(nodes.tolist()), 1),) * 6)


def arc_of(axis: Axis, positions: Array) -> Interval:
    """Measured interval, mm or degrees; for an axis that turns fully, the measured arc of the turn."""
    return measured_arc(positions) if axis.turns_fully else (float(positions.min()), float(positions.max()))


def across(axis: Axis, component: int) -> bool:
    """True for shifts along, and rotations about, the two directions across a rotary axis."""
    return component % 3 != "ABC".index(axis.name[0])


def _degree(basis: Basis) -> int | None:
    if isinstance(basis, Harmonics):
        return basis.order
    return basis.degree if isinstance(basis, Legendre) else None


def fitted(shape: Shape, positions: Array, motions: RigidMotions, priors: Priors) -> Curves:
    """The curves through the error motions at positions `(n,)`, mm or degrees, with the gauge fixed."""
    bands, prior = shape.bands(priors)
    rows = motions.whitening @ shape.design(positions) * prior
    equations = Equations.of(rows, motions.whitening @ motions.errors.reshape(-1))
    sizes = bands.likeliest_sizes(equations, priors, MOST_BAND_STEPS)
    posterior = Posterior.of(equations, sizes[bands.bands], 1.0)
    own = posterior.covariance * prior[:, None]
    determined = posterior.determined
    wider = sizes * bands.wider(summed(bands.bands, determined, len(sizes)), priors)
    between = own * (wider / sizes**2)[bands.bands]
    estimator = own @ rows.T @ motions.whitening
    parameters, u = prior * posterior.mean, prior * np.sqrt(np.diag(posterior.covariance))
    degrees = tuple(
        _degree(basis) if free else _largest(basis, np.abs(parameters[part]) > SHOWN_DEGREE_U * u[part])
        for basis, free, part in zip(shape.bases, shape.free, shape.parts, strict=True)
    )
    return Curves(shape, parameters, estimator, between, degrees, _unresolved(shape, positions, own * prior))


def _largest(basis: Basis, shown: np.ndarray) -> int:
    """The largest degree, or order of harmonics, of the functions `(size,)` that are shown; 0 of none."""
    degrees = degrees_of(basis)
    return int(degrees[shown].max(initial=0))


def _unresolved(shape: Shape, positions: Array, covariance: Array) -> tuple[int, ...]:
    """The components that are much less certain between the positions than at these, by the covariance `(p, p)`."""
    squares = []
    for x in (positions, (positions[1:] + positions[:-1]) / 2.0):
        rows = shape.design(x).reshape(len(x), 6, -1)
        squares.append(np.einsum("njp,pq,njq->j", rows, covariance, rows) / len(x))
    return tuple(np.flatnonzero(squares[1] > UNRESOLVED_RATIO**2 * squares[0]).tolist())


def misfits(curves: Curves, positions: Array, motions: RigidMotions, covariance: Array) -> tuple[Misfit, ...]:
    """Misfit of each curve that nothing limits; covariance `(6n, 6n)` of the error motions at positions `(n,)`."""
    n = len(positions)
    missing = np.eye(6 * n) - curves.design(positions) @ curves.estimator
    residuals, scatter = missing @ motions.errors.reshape(-1), missing @ covariance @ missing.T
    found = []
    for component, (basis, free) in enumerate(zip(curves.shape.bases, curves.shape.free, strict=True)):
        if not free:
            found.append(Misfit(0.0, 0))  # it follows its points as far as these determine it
            continue
        left, own = residuals[component::6], scatter[component::6, component::6]
        variances, directions = np.linalg.eigh(0.5 * (own + own.T))
        floor = NO_SCATTER * max(variances[-1], covariance[component::6, component::6].max() * NO_SCATTER)
        used = np.flatnonzero(variances > floor)[-max(n - basis.size, 0) :] if basis.size < n else np.array([], int)
        chi2 = float(np.sum((directions[:, used].T @ left) ** 2 / variances[used]))
        found.append(Misfit(chi2, len(used)))
    return tuple(found)


def widening(axis: Axis, effects: tuple[Effect, ...], found: tuple[Misfit, ...]) -> Array:
    """Factors of the standard uncertainties of all parameters of an axis' effects: location errors, and six motions.

    A location error has the largest factor of the curves across the axis. A wobble and its polynomials have one factor
    together, as one error motion: both may be large and cancel.
    """
    located = [across(axis, j) if axis.rotary else name in sideways(axis) for j, name in enumerate(COMPONENTS)]
    worst = max(one.widening for one, across in zip(found, located, strict=True) if across)
    factors = [worst] * (len(effects) - len(found)) + [one.widening for one in found]
    return np.repeat(factors, [len(effect.parameters) for effect in effects])


def axis_model(axis: Axis, positions: Array, curves: Curves, motions: RigidMotions) -> AxisModel:
    """Location errors and error motions of an axis, with zero parameters, and the matrix that gives their parameters.

    The orientation of a linear axis is that of the least-squares reference lines of its straightness curves; the
    location of a rotary axis is its axis average line. Both refer to the measured positions.
    """
    values = curves.design(positions)
    rows, names, left = _linear(axis, positions, values) if not axis.rotary else _rotary(axis, values, motions)
    taken = np.zeros((6, len(curves.parameters), len(curves.parameters)))
    for component, (degree, amount) in left.items():
        basis, part = curves.shape.bases[component], curves.shape.parts[component]
        x = np.linspace(*basis.interval, 101)
        function_parameters = np.linalg.lstsq(columns_of(axis, basis, x), x**degree, rcond=None)[0]
        taken[component, part] = np.outer(function_parameters, amount)
    bases, with_wobble = _with_wobble(curves.shape)
    matrix = np.concatenate([rows, with_wobble @ (np.eye(len(curves.parameters)) - taken.sum(axis=0))])
    effects: list[Effect] = [LocationError(name, axis.name, 0.0) for name in names]
    for name, basis in zip(COMPONENTS, bases, strict=True):
        effects.append(ErrorMotion(cast(Component, name), axis.name, basis, (0.0,) * basis.size))
    return AxisModel(tuple(effects), matrix)


def _with_wobble(shape: Shape) -> tuple[tuple[Basis, ...], Array]:
    """Bases for each curve with its wobble in one function, and the matrix from the curves' parameters to theirs.

    A separate wobble would continue outside the measured positions, where the polynomials are held constant.
    """
    if not shape.wobbles:
        return shape.bases, np.eye(shape.size)
    low, high = shape.bases[0].interval
    bases = tuple(
        Legendre((low, high), max(_degree(basis) or 0, ERROR_DEGREE)) if across(shape.axis, j) else basis
        for j, basis in enumerate(shape.bases)
    )
    x = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(101) + 0.5) / 101)
    values = shape.design(x).reshape(len(x), 6, -1)
    parts = [np.linalg.lstsq(basis.columns(x), values[:, j], rcond=None)[0] for j, basis in enumerate(bases)]
    return bases, np.concatenate(parts)


def constants_design(curves: Curves) -> Array:
    """The matrix `(p, 6)` from constants added to the six curves, um and urad, to their parameters."""
    matrix = np.zeros((len(curves.parameters), 6))
    for component, (basis, part) in enumerate(zip(curves.shape.bases, curves.shape.parts, strict=True)):
        x = np.linspace(*basis.interval, 101)
        matrix[part, component] = np.linalg.lstsq(basis.columns(x), np.ones(101), rcond=None)[0]
    return matrix


def _linear(axis: Axis, positions: Array, values: Array) -> tuple[Array, list[Component], dict[int, tuple[int, Array]]]:
    """Rows from the curves to the location errors, their names, and the power of the position to remove from each."""
    centred = positions - positions.mean()
    slope_of = centred / (centred @ centred)
    along = axis.error_frame.T @ axis.unit_direction
    slopes = np.einsum("n,njp->jp", slope_of, values.reshape(len(positions), 6, -1)[:, :3])
    # the line deviates from direction d by angle x d per mm, so angle = d x slope; 1 um/mm is 1000 urad
    turns = np.cross(along, slopes.T).T * 1e3
    across = [j for j in range(3) if abs(along[j]) < 0.5]
    names = [cast(Component, "ABC"[j]) for j in across]
    return turns[across], names, {j: (1, slopes[j]) for j in across}


def _rotary(
    axis: Axis, values: Array, motions: RigidMotions
) -> tuple[Array, list[Component], dict[int, tuple[int, Array]]]:
    rows = motions.location @ values
    across = [j for j in range(6) if j % 3 != "ABC".index(axis.name[0])]
    names = [cast(Component, COMPONENTS[j]) for j in across]
    return rows[across], names, {j: (0, rows[j]) for j in across}


def sideways(axis: Axis) -> str:
    """Components of the straightness of a linear axis."""
    along = axis.error_frame.T @ axis.unit_direction
    return "".join(letter for letter, share in zip("XYZ", along, strict=True) if abs(share) < 0.5)
