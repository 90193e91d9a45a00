"""Continuous curves and quasi-static readings as one linear model: the errors of both directions with covariances.

A continuous curve is known up to a straight line (two constants per direction, without prior). A reading at a target is
the sum of that curve, an offset and a slope of its run (drift), and noise. A direction without a continuous run is the
other one plus a reversal: a constant, a slope, and a random function between targets. Targets outside the continuous
segment each have their own error, so that they carry no information on the lines. A target on a jump may lie on either
side of it, and its readings are weighted accordingly.

The standard deviations of noise, drift and reversal are those of restricted maximum likelihood (REML). The noise is
never less than the instrument specification, and is increased for its degrees of freedom (GUM Supplement 1, 6.4.9.4).
Estimates are generalised least squares with best linear unbiased prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from calibration.continuous.records import QuasiStatic
from calibration.continuous.shape import Shape
from kinematics.transforms import Array

SMALLEST, LARGEST, START = 1e-3, 1e4, 0.3
"""Range of the standard deviations in the search, um, and its start value."""
MOST_TRIES = 200
LEAST_FREE = 3
"""Least number of degrees of freedom for an estimate of the standard deviations."""
REACH = 0.25
"""Correlation length of the random part of a reversal, as a share of the travel."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the quasi-static data, um."""

    noise: float
    """Noise of a reading, increased for its degrees of freedom."""
    sheet: float
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
    ways: tuple[int, ...]
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
        own, (ways, n) = np.array(shares), self.values.shape
        blocks = self.covariance.reshape(ways, n, ways, n).transpose(0, 2, 1, 3)
        half = np.tensordot(own, blocks, axes=(1, 0))
        whole = np.tensordot(own, half, axes=(1, 1))
        return (own @ self.values).ravel(), whole.transpose(1, 2, 0, 3).reshape(len(own) * n, len(own) * n)


@dataclass(frozen=True)
class _Places:
    """Positions `(n,)`, mm, of estimates or readings, each with its direction."""

    x: Array
    way: np.ndarray

    def __len__(self) -> int:
        return len(self.x)


def fused(
    shapes: Mapping[int, Shape], quasi: QuasiStatic, inside: np.ndarray, positions: Array, ways: tuple[int, ...]
) -> Fused:
    """The joint estimate at positions `(n,)`, mm, in these directions.

    `inside`: mask `(m,)` of the readings within the segment, where each direction with a continuous run needs two
    targets.
    """
    read = _Places(quasi.target, quasi.direction)
    asked = _Places(np.tile(positions, len(ways)), np.repeat(ways, len(positions)))
    centre, half = _scale(shapes)
    fixed = _fixed(shapes, read, ways, centre, half)
    beyond, cells = _outside_columns(read, inside)
    design = np.concatenate([np.where(inside[:, None], fixed, 0.0), beyond], axis=1)
    known = inside.astype(float)
    both = _Places(np.concatenate([asked.x, read.x]), np.concatenate([asked.way, read.way]))
    mean, covariance = _curves(shapes, both)
    n = len(asked)
    observed = quasi.deviation - mean[n:] * known
    own = covariance[n:, n:] * np.outer(known, known) + _beside_jumps(shapes, read, known)
    groups = _groups(quasi, shapes, read, inside, centre, half)
    sheet = quasi.u or 0.0
    spread, variance = _spread(observed, design, own, groups, sheet)
    solved = _Solved(observed, design, variance)
    asked_design = np.concatenate([_fixed(shapes, asked, ways, centre, half), np.zeros((n, beyond.shape[1]))], axis=1)
    cross = covariance[:n, n:] * known
    prior = covariance[:n, :n]
    reversal = _reversal_kernel(shapes, asked, half)
    if reversal is not None:
        other = _reversal_kernel(shapes, asked, half, read)
        assert other is not None
        cross = cross + spread.reversal**2 * other * known
        prior = prior + spread.reversal**2 * reversal
    values, joint = solved.predicted(asked_design, cross, prior)
    residual = solved.residual[inside]
    return Fused(
        positions,
        ways,
        (mean[:n] + values).reshape(len(ways), -1),
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


def _fixed(shapes: Mapping[int, Shape], places: _Places, ways: tuple[int, ...], centre: float, half: float) -> Array:
    """Columns of a line for each curve, and of one for the reversal of a direction without a curve."""
    line = np.stack([np.ones(len(places)), (places.x - centre) / half], axis=1)
    own = [line * (_owner(shapes, places) == way)[:, None] for way in shapes]
    missing = [way for way in (1, -1) if way not in shapes and (way in ways or np.any(places.way == way))]
    return np.concatenate([*own, *(line * (places.way == way)[:, None] for way in missing)], axis=1)


def _owner(shapes: Mapping[int, Shape], places: _Places) -> np.ndarray:
    """Direction `(n,)` of the curve that applies at each position."""
    only = next(iter(shapes))
    return places.way if len(shapes) == 2 else np.full(len(places), only)


def _curves(shapes: Mapping[int, Shape], places: _Places) -> tuple[Array, Array]:
    """Mean `(n,)`, um, and covariance `(n, n)`, um2, of the curves; equal positions on a curve share one value."""
    mean, covariance = np.zeros(len(places)), np.zeros((len(places), len(places)))
    owner = _owner(shapes, places)
    for way, shape in shapes.items():
        rows = np.flatnonzero(owner == way)
        where, which = np.unique(places.x[rows], return_inverse=True)
        mean[rows] = shape.at(where)[which]
        covariance[np.ix_(rows, rows)] = shape.covariance(where)[np.ix_(which, which)]
    return mean, covariance


def _beside_jumps(shapes: Mapping[int, Shape], read: _Places, known: Array) -> Array:
    """Covariance `(m, m)`, um2, at targets on a jump: all readings of a target lie on one side of it."""
    doubt, owner = np.zeros(len(read)), _owner(shapes, read)
    for way, shape in shapes.items():
        rows = np.flatnonzero(owner == way)
        doubt[rows] = shape.doubt(read.x[rows])
    same = (read.x[:, None] == read.x) & (read.way[:, None] == read.way)
    return np.asarray(same * np.outer(doubt * known, doubt * known))


def _lines(shapes: Mapping[int, Shape], fixed: Array, centre: float, half: float) -> dict[int, tuple[float, float]]:
    slopes = {way: float(fixed[2 * i + 1]) / half for i, way in enumerate(shapes)}
    return {way: (float(fixed[2 * i]) - slopes[way] * centre, slopes[way]) for i, way in enumerate(shapes)}


def _outside_columns(read: _Places, inside: np.ndarray) -> tuple[Array, list[tuple[float, int]]]:
    """A column for every target outside the segment in every direction; the target, mm, and direction of each."""
    cells = sorted({(float(x), int(way)) for x, way in zip(read.x[~inside], read.way[~inside], strict=True)})
    columns = [(~inside & (read.x == x) & (read.way == way)).astype(float) for x, way in cells]
    return np.array(columns).reshape(len(cells), len(read)).T, cells


def _groups(
    quasi: QuasiStatic, shapes: Mapping[int, Shape], read: _Places, inside: np.ndarray, centre: float, half: float
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
    shapes: Mapping[int, Shape], places: _Places, half: float, other: _Places | None = None
) -> Array | None:
    """Correlation of the random part of the reversal; None if both directions have their own curve."""
    if len(shapes) == 2:
        return None
    other = places if other is None else other
    only = next(iter(shapes))
    apart = np.abs(places.x[:, None] - other.x) / (2.0 * half * REACH)
    return np.asarray(np.exp(-apart) * np.outer(places.way != only, other.way != only))


def _spread(
    observed: Array, design: Array, own: Array, groups: Mapping[str, Array], sheet: float
) -> tuple[Spread, Array]:
    """Standard deviations by REML, and the resulting covariance of the readings, um2."""
    free = len(observed) - int(np.linalg.matrix_rank(design))
    names = list(groups)
    identity = np.eye(len(observed))

    def covariance(sizes: Array, noise: float) -> Array:
        total = own + (sheet**2 + noise**2) * identity
        for name, size in zip(names, sizes, strict=True):
            total = total + size**2 * groups[name]
        return np.asarray(total)

    def cost(logarithms: Array) -> float:
        sizes = np.exp(np.clip(logarithms, np.log(SMALLEST), np.log(LARGEST)))
        return _Solved(observed, design, covariance(sizes[1:], float(sizes[0]))).deviance

    if free < LEAST_FREE:
        noise, sizes = 0.0, np.zeros(len(names))
    else:
        from scipy.optimize import minimize

        begin = np.log(np.full(1 + len(names), START))
        found = minimize(
            cost, begin, method="Nelder-Mead", options={"xatol": 0.02, "fatol": 1e-2, "maxfev": MOST_TRIES}
        )
        best = np.exp(np.clip(found.x, np.log(SMALLEST), np.log(LARGEST)))
        noise, sizes = float(best[0]) * np.sqrt(free / max(free - 2.0, 1.0)), best[1:]
    by_name = dict(zip(names, sizes.tolist(), strict=True))
    spread = Spread(
        float(np.hypot(sheet, noise)),
        sheet,
        by_name.get("offset", 0.0),
        by_name.get("slope", 0.0),
        by_name.get("reversal", 0.0),
        free,
    )
    return spread, covariance(sizes, noise)


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

    @property
    def deviance(self) -> float:
        """-2 ln of the restricted likelihood, up to a constant."""
        own = np.linalg.eigvalsh(self.information)
        own = own[own > own.max(initial=0.0) * 1e-12]
        half = float(np.log(np.diag(self.factor[0])).sum())
        return 2.0 * half + float(np.log(own).sum()) + float(self.residual @ self.solved)

    def predicted(self, design: Array, cross: Array, prior: Array) -> tuple[Array, Array]:
        """Values `(k,)` and covariance of quantities with this fixed part, covariance with observations, and prior."""
        values = design @ self.fixed + cross @ self.solved
        lever = design - cross @ self.weighted
        return values, prior - cross @ cho_solve(self.factor, cross.T) + lever @ self.own @ lever.T

    def outside(self, cells: list[tuple[float, int]], first: int) -> dict[int, tuple[Array, Array, Array]]:
        """Targets, errors and standard uncertainties outside the segment, by direction; fixed effects from `first`."""
        found = {}
        for way in {way for _, way in cells}:
            rows = [i for i, cell in enumerate(cells) if cell[1] == way]
            at = np.array(rows) + first
            found[way] = (np.array([cells[i][0] for i in rows]), self.fixed[at], np.sqrt(np.diag(self.own)[at]))
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
