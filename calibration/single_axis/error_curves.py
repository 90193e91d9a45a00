"""Curves through the six error motions of an axis, and the separation of its location errors from them.

The curves are fitted to all six at once, weighted by the joint covariance of the points. Degrees of polynomials are
given, or weighted by Akaike's information criterion (AIC): the Bayesian criterion neglects errors smaller than the
noise of a point, and u would not contain them. The curve is the weighted mean of the curves of all degrees, and its u
contains their spread (Buckland, Burnham and Augustin, Biometrics 53, 1997, 603-618).

The gauge of the points (`rigid_motions`) removes from a rotary axis the first harmonic that rotates with the component.
A polynomial does not contain this harmonic. Polynomials of a rotary axis therefore have an additional wobble, and both
are written as one polynomial of sufficient degree. A rotary axis that turns fully and was measured over the whole turn
has harmonics of the turn instead of polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, cast

import numpy as np
from scipy import special

from calibration.single_axis.rigid_motions import RigidMotions
from kinematics.basis import Basis, BSpline, Harmonics, Interval, Legendre
from kinematics.effects import COMPONENTS, Component, Effect, ErrorMotion, LocationError, Wobble
from kinematics.machine import TURN, Axis
from kinematics.transforms import Array
from kinematics.turn import columns_of, gap_of, measured_arc

MISFIT = 1e-3
"""Probability of a chi2 below which a curve deviates significantly from its points."""
NO_SCATTER = 1e-6
"""Share of the largest variance below which the variance of a combination of residuals counts as zero."""
LARGEST_WOBBLE = 100.0
"""Largest wobble of a rotary axis in use, um and urad. Without a bound, a wobble that the polynomials nearly represent
grows against them."""
HOLDS = (1e3, 300.0, 100.0, 30.0, 10.0, 3.0, 1.0)
"""Prior standard deviations of the wobble, um and urad, tried in order until it is within LARGEST_WOBBLE."""
HOLDS_A_WOBBLE = 20
"""Degree of a polynomial that represents one period of a turn within 1e-9 of its amplitude."""


@dataclass(frozen=True)
class Shape:
    """Functions of the six curves of one axis."""

    axis: Axis
    bases: tuple[Basis, ...]
    """Basis of each component X Y Z A B C."""

    @property
    def parts(self) -> list[slice]:
        """Range of the parameters of each curve."""
        ends = np.cumsum([0, *(basis.size for basis in self.bases)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    @property
    def degrees(self) -> tuple[int | None, ...]:
        """Degree of each polynomial, or number of harmonics; None for a table."""
        return tuple(_degree(basis) for basis in self.bases)

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


@dataclass(frozen=True)
class Curves:
    """Six curves over one axis' position, mm or degrees; values in um and urad."""

    shape: Shape
    parameters: Array
    """Parameters `(p,)`: curve by curve, then the wobble."""
    estimator: Array
    """Matrix `(p, 6n)` from the error motions at the positions, um and urad, to the parameters."""
    best: Curves | None = None
    """Curves of the degrees with the lowest AIC, if these curves are a mean over degrees."""
    spread: Array = field(default_factory=lambda: np.zeros((0, 1, 1)))
    """Matrices `(m, p, 6n)` from the error motions at the positions to each curve minus the mean, times the square root
    of its weight."""
    unresolved: tuple[int, ...] = ()
    """Components whose curves contain wavelengths near the resolution of the positions, and probably shorter ones."""

    @property
    def degrees(self) -> tuple[int | None, ...]:
        """Degree of each polynomial, or number of harmonics: given or of the lowest AIC; None for a table."""
        return (self.best or self).shape.degrees

    def choice_covariance(self, errors: Array, covariance: Array) -> Array:
        """Covariance `(p, p)` from the choice of degrees; errors `(n, 6)` and their covariance `(6n, 6n)`."""
        away = self.spread @ errors.reshape(-1) if len(self.spread) else np.zeros((0, len(self.parameters)))
        spread = np.einsum("mpi,ij,mqj->pq", self.spread, covariance, self.spread, optimize=True)
        return np.asarray(spread + away.T @ away)

    def design(self, positions: Array) -> Array:
        """Matrix `(6n, p)` from the parameters to the error motions at positions `(n,)`."""
        return self.shape.design(positions)


@dataclass(frozen=True)
class Candidates:
    """Shapes of different degrees, and their weights by AIC."""

    best: Shape
    others: tuple[tuple[tuple[Shape, float], ...], ...] = ()
    """For each curve without a given degree: shapes of its degrees with their weights, other curves as in `best`."""
    unresolved: tuple[int, ...] = ()
    """See `Curves.unresolved`: curves for which only the two highest degrees have weight."""


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


def tables(axis: Axis, positions: Array, arc: Interval) -> Shape:
    """Interpolated tables with the measured positions as nodes; periodic if the whole turn was measured."""
    nodes = np.unique(positions)
    if axis.turns_fully:
        nodes = arc[0] + np.unique(np.round(np.mod(positions - arc[0], TURN), 6) % TURN)
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


def fit(shape: Shape, positions: Array, motions: RigidMotions) -> Curves:
    """Least-squares curves through the error motions at positions `(n,)`, mm or degrees, with the gauge fixed."""
    weights, wobble = motions.whitening, slice(shape.parts[-1].stop, None)
    for hold in HOLDS:
        rows = weighted_design(shape, positions, weights, hold)
        estimator = np.linalg.lstsq(rows, np.eye(len(rows))[:, : len(weights)], rcond=1e-14)[0] @ weights
        found = Curves(shape, np.asarray(estimator @ motions.errors.reshape(-1)), estimator)
        if np.abs(found.parameters[wobble]).max(initial=0.0) <= LARGEST_WOBBLE:
            break
    return found


def averaged(candidates: Candidates, positions: Array, motions: RigidMotions) -> Curves:
    """The mean over degrees of the curves through the error motions at positions `(n,)`, mm or degrees."""
    best = fit(candidates.best, positions, motions)
    if not candidates.others:
        return best
    shape = _widest(candidates)
    own = _extended(best, shape)
    estimator, spread = own, []
    for others in candidates.others:
        away = [(_extended(fit(other, positions, motions), shape) - own, weight) for other, weight in others]
        mean = np.sum([weight * each for each, weight in away], axis=0)
        estimator = estimator + mean
        spread += [np.sqrt(weight) * (each - mean) for each, weight in away]
    parameters = np.asarray(estimator @ motions.errors.reshape(-1))
    return Curves(shape, parameters, estimator, best, np.array(spread), candidates.unresolved)


def _widest(candidates: Candidates) -> Shape:
    """The shape with the highest degree of each curve."""
    shapes = [candidates.best, *(shape for others in candidates.others for shape, _ in others)]
    bases = tuple(max((shape.bases[j] for shape in shapes), key=lambda basis: basis.size) for j in range(6))
    return Shape(candidates.best.axis, bases)


def _extended(curves: Curves, shape: Shape) -> Array:
    """The estimator `(p, 6n)` of curves, extended to a shape whose bases begin with theirs."""
    extended = np.zeros((shape.size, curves.estimator.shape[1]))
    for part, own in zip(shape.parts, curves.shape.parts, strict=True):
        extended[part.start : part.start + own.stop - own.start] = curves.estimator[own]
    extended[shape.parts[-1].stop :] = curves.estimator[curves.shape.parts[-1].stop :]
    return extended


def misfits(curves: Curves, positions: Array, motions: RigidMotions, covariance: Array) -> tuple[Misfit, ...]:
    """Misfit of each curve at positions `(n,)`, mm or degrees; covariance `(6n, 6n)` of the error motions there."""
    curves, n = curves.best or curves, len(positions)
    missing = np.eye(6 * n) - curves.design(positions) @ curves.estimator
    residuals, scatter = missing @ motions.errors.reshape(-1), missing @ covariance @ missing.T
    found = []
    for component, basis in enumerate(curves.shape.bases):
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


def weighted_design(shape: Shape, positions: Array, weights: Array, hold: float) -> Array:
    """Whitened design, and below it the prior rows of the wobble with standard deviation `hold`, um and urad."""
    function_parameters = np.eye(shape.size)[shape.parts[-1].stop :] / hold
    return np.concatenate([weights @ shape.design(positions), function_parameters])


def axis_model(axis: Axis, positions: Array, curves: Curves, motions: RigidMotions) -> AxisModel:
    """Location errors and error motions of an axis, with zero parameters, and the matrix that gives their parameters.

    The orientation of a linear axis is that of the least-squares reference lines of its straightness curves; the
    location of a rotary axis is its axis average line. Both refer to the measured positions.
    """
    values = curves.design(positions)
    rows, names, left = _linear(axis, positions, values) if not axis.rotary else _rotary(axis, values, motions)
    taken = np.zeros((6, len(curves.parameters), len(curves.parameters)))
    for component, (function, amount) in left.items():
        basis, part = curves.shape.bases[component], curves.shape.parts[component]
        function_parameters = np.linalg.lstsq(columns_of(axis, basis, positions), function, rcond=None)[0]
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
        Legendre((low, high), max(_degree(basis) or 0, HOLDS_A_WOBBLE)) if across(shape.axis, j) else basis
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


def _linear(
    axis: Axis, positions: Array, values: Array
) -> tuple[Array, list[Component], dict[int, tuple[Array, Array]]]:
    """Rows from the curves to the location errors, their names, and the parts to remove from each curve for them."""
    centred = positions - positions.mean()
    slope_of = centred / (centred @ centred)
    along = axis.error_frame.T @ axis.unit_direction
    slopes = np.einsum("n,njp->jp", slope_of, values.reshape(len(positions), 6, -1)[:, :3])
    # the line deviates from direction d by angle x d per mm, so angle = d x slope; 1 um/mm is 1000 urad
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


def sideways(axis: Axis) -> str:
    """Components of the straightness of a linear axis."""
    along = axis.error_frame.T @ axis.unit_direction
    return "".join(letter for letter, share in zip("XYZ", along, strict=True) if abs(share) < 0.5)
