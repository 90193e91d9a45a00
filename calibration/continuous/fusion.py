"""Continuous curves and quasi-static readings as one linear model: the errors of both directions with covariances.

A continuous curve is known up to a straight line (two constants per direction, without prior). A reading at a target is
the sum of that curve, an offset and a slope of its run (drift), and noise. A direction without a continuous run is the
other one plus a reversal: a constant, a slope, and a random function between targets. Targets outside the continuous
segment each have their own error, so that they carry no information on the lines. A target on a jump may lie on either
side of it, and its readings are weighted accordingly.

The standard deviations of noise, drift and reversal are those of restricted likelihood, found as those of a diagnosis
(`calibration.gaussian_terms.noise`). The noise is never less than the instrument specification, and is increased for
its degrees of freedom (GUM Supplement 1, 6.4.9.4). Estimates are generalised least squares with best linear unbiased
prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, null_space

from calibration.continuous.records import QuasiStatic
from calibration.continuous.shape import Shape
from calibration.gaussian_terms.noise import Moments, likeliest_variances
from kinematics.error_model.priors import PRIORS
from kinematics.transforms import Array

MOST_VARIANCE_STEPS = 30
"""Most Fisher steps of the variances."""
LEAST_READING_U_UM = 1e-3
"""Standard deviation of a reading, and of a drift, um, that is assumed in any case: the last digit of a reading."""
LEAST_FREE = 3
"""Least number of degrees of freedom for an estimate of the standard deviations."""
REVERSAL_CORRELATION = 0.25
"""Correlation length of the random part of a reversal, as a share of the travel."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the quasi-static data, um."""

    noise: float
    """Noise of a reading, increased for its degrees of freedom."""
    specified: float
    """Noise of a reading by the instrument specification; 0 without one."""
    offset: float
    """Offset of a run against the others."""
    slope: float
    """Slope of a run, over half the travel."""
    reversal: float
    """Random part of the reversal, for a direction without a continuous run."""
    free: int
    """Degrees of freedom of the readings."""


@dataclass(frozen=True)
class Drift:
    """Offset and slope of one quasi-static run against the mean of all, with standard uncertainties."""

    run: str
    offset_um: float
    u_offset_um: float
    slope_um_per_m: float
    u_slope_um_per_m: float


@dataclass(frozen=True)
class Fused:
    """Errors at `positions` `(n,)`, mm, in each direction, stacked by direction, um."""

    positions: Array
    signs: tuple[int, ...]
    values: Array
    """Errors `(directions, n)`, um."""
    covariance: Array
    """Covariance `(directions n, directions n)`, um2."""
    outside: Mapping[int, tuple[Array, Array, Array]]
    """Targets outside the segment, mm, errors there and their standard uncertainties, um; by direction."""
    spread: Spread
    drift: tuple[Drift, ...]
    lines: Mapping[int, tuple[float, float]]
    """Fitted line of each curve, by direction: um, and um per mm from position 0."""
    residual: Array
    """Reading minus estimate `(m,)`, um, of the readings inside the segment."""
    inside: np.ndarray
    """Rows `(m,)` of these readings in the quasi-static data."""

    def mixed(self, shares: Sequence[Sequence[float]]) -> tuple[Array, Array]:
        """Sums `(k n,)` of the directions by shares `(k, directions)`, um, and their covariance `(k n, k n)`, um2."""
        own, (signs, n) = np.array(shares), self.values.shape
        blocks = self.covariance.reshape(signs, n, signs, n).transpose(0, 2, 1, 3)
        half = np.tensordot(own, blocks, axes=(1, 0))
        whole = np.tensordot(own, half, axes=(1, 1))
        return (own @ self.values).ravel(), whole.transpose(1, 2, 0, 3).reshape(len(own) * n, len(own) * n)


@dataclass(frozen=True)
class _Points:
    """Positions `(n,)`, mm, of estimates or readings, each with its direction."""

    x: Array
    sign: np.ndarray

    def __len__(self) -> int:
        return len(self.x)


def fused(
    shapes: Mapping[int, Shape], quasi: QuasiStatic, inside: np.ndarray, positions: Array, signs: tuple[int, ...]
) -> Fused:
    """The joint estimate at positions `(n,)`, mm, in these directions.

    `inside`: mask `(m,)` of the readings within the segment, where each direction with a continuous run needs two
    targets.
    """
    read = _Points(quasi.target, quasi.direction)
    requested = _Points(np.tile(positions, len(signs)), np.repeat(signs, len(positions)))
    centre, half = _scale(shapes)
    fixed = _fixed(shapes, read, signs, centre, half)
    beyond, cells = _outside_columns(read, inside)
    design = np.concatenate([np.where(inside[:, None], fixed, 0.0), beyond], axis=1)
    known = inside.astype(float)
    both = _Points(np.concatenate([requested.x, read.x]), np.concatenate([requested.sign, read.sign]))
    mean, covariance = _curves(shapes, both)
    n = len(requested)
    observed = quasi.deviation - mean[n:] * known
    own = covariance[n:, n:] * np.outer(known, known) + _beside_jumps(shapes, read, known)
    groups = _groups(quasi, shapes, read, inside, centre, half)
    specified = quasi.u or 0.0
    spread, variance = _spread(observed, design, own, groups, specified)
    solved = _Solved(observed, design, variance)
    requested_design = np.concatenate(
        [_fixed(shapes, requested, signs, centre, half), np.zeros((n, beyond.shape[1]))], axis=1
    )
    cross = covariance[:n, n:] * known
    prior = covariance[:n, :n]
    reversal = _reversal_kernel(shapes, requested, half)
    if reversal is not None:
        other = _reversal_kernel(shapes, requested, half, read)
        assert other is not None
        cross = cross + spread.reversal**2 * other * known
        prior = prior + spread.reversal**2 * reversal
    values, joint = solved.predicted(requested_design, cross, prior)
    residual = solved.residual[inside]
    return Fused(
        positions,
        signs,
        (mean[:n] + values).reshape(len(signs), -1),
        joint,
        solved.outside(cells, fixed.shape[1]),
        spread,
        _drifts(quasi, solved, spread, centre, half),
        _lines(shapes, solved.fixed, centre, half),
        residual,
        np.flatnonzero(inside),
    )


def _scale(shapes: Mapping[int, Shape]) -> tuple[float, float]:
    """Middle and half length of the range that the curves cover together, mm."""
    low = min(shape.interval[0] for shape in shapes.values())
    high = max(shape.interval[1] for shape in shapes.values())
    return (low + high) / 2.0, (high - low) / 2.0


def _fixed(shapes: Mapping[int, Shape], points: _Points, signs: tuple[int, ...], centre: float, half: float) -> Array:
    """Columns of a line for each curve, and of one for the reversal of a direction without a curve."""
    line = np.stack([np.ones(len(points)), (points.x - centre) / half], axis=1)
    own = [line * (_owner(shapes, points) == sign)[:, None] for sign in shapes]
    missing = [sign for sign in (1, -1) if sign not in shapes and (sign in signs or np.any(points.sign == sign))]
    return np.concatenate([*own, *(line * (points.sign == sign)[:, None] for sign in missing)], axis=1)


def _owner(shapes: Mapping[int, Shape], points: _Points) -> np.ndarray:
    """Direction `(n,)` of the curve that applies at each position."""
    only = next(iter(shapes))
    return points.sign if len(shapes) == 2 else np.full(len(points), only)


def _curves(shapes: Mapping[int, Shape], points: _Points) -> tuple[Array, Array]:
    """Mean `(n,)`, um, and covariance `(n, n)`, um2, of the curves; equal positions on a curve share one value."""
    mean, covariance = np.zeros(len(points)), np.zeros((len(points), len(points)))
    owner = _owner(shapes, points)
    for sign, shape in shapes.items():
        rows = np.flatnonzero(owner == sign)
        where, which = np.unique(points.x[rows], return_inverse=True)
        mean[rows] = shape.at(where)[which]
        covariance[np.ix_(rows, rows)] = shape.covariance(where)[np.ix_(which, which)]
    return mean, covariance


def _beside_jumps(shapes: Mapping[int, Shape], read: _Points, known: Array) -> Array:
    """Covariance `(m, m)`, um2, at targets on a jump: all readings of a target lie on one side of it."""
    u_near_jumps, owner = np.zeros(len(read)), _owner(shapes, read)
    for sign, shape in shapes.items():
        rows = np.flatnonzero(owner == sign)
        u_near_jumps[rows] = shape.u_near_jumps(read.x[rows])
    same = (read.x[:, None] == read.x) & (read.sign[:, None] == read.sign)
    return np.asarray(same * np.outer(u_near_jumps * known, u_near_jumps * known))


def _lines(shapes: Mapping[int, Shape], fixed: Array, centre: float, half: float) -> dict[int, tuple[float, float]]:
    slopes = {sign: float(fixed[2 * i + 1]) / half for i, sign in enumerate(shapes)}
    return {sign: (float(fixed[2 * i]) - slopes[sign] * centre, slopes[sign]) for i, sign in enumerate(shapes)}


def _outside_columns(read: _Points, inside: np.ndarray) -> tuple[Array, list[tuple[float, int]]]:
    """A column for every target outside the segment in every direction; the target, mm, and direction of each."""
    cells = sorted({(float(x), int(sign)) for x, sign in zip(read.x[~inside], read.sign[~inside], strict=True)})
    columns = [(~inside & (read.x == x) & (read.sign == sign)).astype(float) for x, sign in cells]
    return np.array(columns).reshape(len(cells), len(read)).T, cells


def _groups(
    quasi: QuasiStatic, shapes: Mapping[int, Shape], read: _Points, inside: np.ndarray, centre: float, half: float
) -> dict[str, Array]:
    """Correlations `(n, n)` of the readings, by the name of the standard deviation that scales them."""
    found = {}
    if len(quasi.runs) > 1:
        same = (quasi.run[:, None] == quasi.run).astype(float)
        along = (quasi.target - centre) / half
        found = {"offset": same, "slope": same * np.outer(along, along)}
    kernel = _reversal_kernel(shapes, read, half)
    if kernel is not None and np.any(kernel):
        found["reversal"] = kernel * np.outer(inside, inside)
    return found


def _reversal_kernel(
    shapes: Mapping[int, Shape], points: _Points, half: float, other: _Points | None = None
) -> Array | None:
    """Correlation of the random part of the reversal; None if both directions have their own curve."""
    if len(shapes) == 2:
        return None
    other = points if other is None else other
    only = next(iter(shapes))
    apart = np.abs(points.x[:, None] - other.x) / (2.0 * half * REVERSAL_CORRELATION)
    return np.asarray(np.exp(-apart) * np.outer(points.sign != only, other.sign != only))


def _spread(
    observed: Array, design: Array, own: Array, groups: Mapping[str, Array], specified: float
) -> tuple[Spread, Array]:
    """Standard deviations by restricted likelihood, and the resulting covariance of the readings, um2."""
    apart = null_space(design.T)  # combinations of the readings without what is fitted in any case
    free, m = apart.shape[1], len(observed)
    names, parts = list(groups), [np.eye(m), *groups.values()]
    known = own + specified**2 * np.eye(m)
    variances = np.zeros(len(parts))
    if free >= LEAST_FREE:
        rest = apart.T @ observed
        moments = Moments(
            np.outer(rest, rest)[None],
            [(apart.T @ part @ apart)[None] for part in parts],
            (apart.T @ known @ apart)[None],
        )
        start = np.full(len(parts), max(float(np.mean(rest**2)), LEAST_READING_U_UM**2))
        variances = likeliest_variances([moments], start, PRIORS.non_repeatability_um, MOST_VARIANCE_STEPS)
        variances[0] *= free / max(free - 2.0, 1.0)
        variances[1:] = np.maximum(variances[1:], LEAST_READING_U_UM**2)
    noise, *sizes = np.sqrt(variances).tolist()
    by_name = dict(zip(names, sizes, strict=True))
    spread = Spread(
        float(np.hypot(specified, noise)),
        specified,
        by_name.get("offset", 0.0),
        by_name.get("slope", 0.0),
        by_name.get("reversal", 0.0),
        free,
    )
    covariance = known + sum(variance * part for variance, part in zip(variances, parts, strict=True))
    return spread, np.asarray(covariance + LEAST_READING_U_UM**2 * np.eye(m))


class _Solved:
    """Generalised least squares of observations with a covariance."""

    def __init__(self, observed: Array, design: Array, covariance: Array) -> None:
        self.factor = cho_factor(covariance, lower=True)
        self.design = design
        whole = cho_solve(self.factor, np.column_stack([design, observed]))
        self.weighted = whole[:, :-1]
        self.information = design.T @ self.weighted
        self.own = np.linalg.pinv(self.information, hermitian=True)
        self.fixed = self.own @ (design.T @ whole[:, -1])
        self.residual = observed - design @ self.fixed
        self.solved = whole[:, -1] - self.weighted @ self.fixed

    def predicted(self, design: Array, cross: Array, prior: Array) -> tuple[Array, Array]:
        """Values `(k,)` and covariance of quantities with this fixed part, covariance with observations, and prior."""
        values = design @ self.fixed + cross @ self.solved
        sensitivity = design - cross @ self.weighted
        return values, prior - cross @ cho_solve(self.factor, cross.T) + sensitivity @ self.own @ sensitivity.T

    def outside(self, cells: list[tuple[float, int]], first: int) -> dict[int, tuple[Array, Array, Array]]:
        """Targets, errors and standard uncertainties outside the segment, by direction; fixed effects from `first`."""
        found = {}
        for sign in {sign for _, sign in cells}:
            rows = [i for i, cell in enumerate(cells) if cell[1] == sign]
            at = np.array(rows) + first
            found[sign] = (np.array([cells[i][0] for i in rows]), self.fixed[at], np.sqrt(np.diag(self.own)[at]))
        return found


def _drifts(quasi: QuasiStatic, solved: _Solved, spread: Spread, centre: float, half: float) -> tuple[Drift, ...]:
    """Offsets and slopes of the runs, predicted from the readings."""
    if len(quasi.runs) < 2:
        return ()
    runs = quasi.runs
    member = (np.array(runs)[:, None] == quasi.run).astype(float)
    along = member * (quasi.target - centre) / half
    cross = np.concatenate([spread.offset**2 * member, spread.slope**2 * along])
    prior = np.diag(np.repeat([spread.offset**2, spread.slope**2], len(runs)))
    values, covariance = solved.predicted(np.zeros((2 * len(runs), solved.design.shape[1])), cross, prior)
    u, k, per_m = np.sqrt(np.maximum(np.diag(covariance), 0.0)), len(runs), 1e3 / half
    return tuple(
        Drift(run, float(values[i]), float(u[i]), float(values[k + i] * per_m), float(u[k + i] * per_m))
        for i, run in enumerate(runs)
    )
