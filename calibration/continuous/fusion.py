"""Continuous curves and quasi-static readings as one linear model: the errors of both directions with covariances.

A continuous curve is right up to a straight line (two unknown constants a direction, without prior); a reading at a
target is that curve, plus what is common to its run (an offset, a slope along the axis: drift), plus noise. A direction
without continuous run is the other one plus a reversal: a constant, a slope, and a random course between targets.
Targets outside the continuous segment each have their own error, so they carry no information on the lines; a target
on a jump may lie on either side of it, and its readings count accordingly. Standard
deviations of noise, drift and reversal are those of restricted maximum likelihood (REML); the noise is never less than
the instrument's sheet, and counts as what its degrees of freedom leave possible (GUM Supplement 1, 6.4.9.4). Estimates
are generalised least squares with best linear unbiased prediction.
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
"""Standard deviations that are looked for, um, and the one that is begun with."""
MOST_TRIES = 200
LEAST_FREE = 3
"""Degrees of freedom below which a spread of readings says nothing."""
REACH = 0.25
"""Share of the travel over which the random course of a reversal forgets itself."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the quasi-static data, um."""

    noise: float
    """Of a reading, with what the degrees of freedom leave possible."""
    sheet: float
    """Of a reading by the instrument's sheet; 0 where none is given."""
    offset: float
    """Of a run as a whole, against the others."""
    slope: float
    """Of a run over half the travel."""
    reversal: float
    """Of the random course of the reversal, where it stands for a direction without continuous run."""
    free: int
    """Degrees of freedom."""


@dataclass(frozen=True)
class Drift:
    """How one quasi-static run lies against the mean of all."""

    run: str
    offset_um: float
    u_offset_um: float
    slope_um_per_m: float
    u_slope_um_per_m: float


@dataclass(frozen=True)
class Fused:
    """Errors at `positions` `(n,)` in each direction, stacked by direction, um."""

    positions: Array
    ways: tuple[int, ...]
    values: Array
    """`(ways, n)`."""
    covariance: Array
    """`(ways n, ways n)`."""
    outside: Mapping[int, tuple[Array, Array, Array]]
    """By direction: targets outside the segment, mm, errors there, um, and their standard uncertainties."""
    spread: Spread
    drift: tuple[Drift, ...]
    lines: Mapping[int, tuple[float, float]]
    """By direction of the curves: what they lacked, um and um per mm from position 0."""
    residual: Array
    """Reading minus estimate `(m,)`, um, of readings inside."""
    inside: np.ndarray
    """Their rows in the quasi-static data."""

    def mixed(self, shares: Sequence[Sequence[float]]) -> tuple[Array, Array]:
        """Sums `(k n,)` of the directions by shares `(k, ways)`, um, and their covariance `(k n, k n)`, um2."""
        own, (ways, n) = np.array(shares), self.values.shape
        blocks = self.covariance.reshape(ways, n, ways, n).transpose(0, 2, 1, 3)
        half = np.tensordot(own, blocks, axes=(1, 0))
        whole = np.tensordot(own, half, axes=(1, 1))
        return (own @ self.values).ravel(), whole.transpose(1, 2, 0, 3).reshape(len(own) * n, len(own) * n)


@dataclass(frozen=True)
class _Places:
    """Where something is asked or read: a position in a direction each."""

    x: Array
    way: np.ndarray

    def __len__(self) -> int:
        return len(self.x)


def fused(
    shapes: Mapping[int, Shape], quasi: QuasiStatic, inside: np.ndarray, positions: Array, ways: tuple[int, ...]
) -> Fused:
    """The joint estimate at positions `(n,)`, mm, in these directions.

    inside: the readings `(m,)` within the segment; at least two targets in every direction that has a continuous run.
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
    """Middle and half length of what the curves cover together, mm."""
    low = min(shape.interval[0] for shape in shapes.values())
    high = max(shape.interval[1] for shape in shapes.values())
    return (low + high) / 2.0, (high - low) / 2.0


def _fixed(shapes: Mapping[int, Shape], places: _Places, ways: tuple[int, ...], centre: float, half: float) -> Array:
    """A line for each curve, and one for the reversal of a direction without."""
    line = np.stack([np.ones(len(places)), (places.x - centre) / half], axis=1)
    own = [line * (_owner(shapes, places) == way)[:, None] for way in shapes]
    missing = [way for way in (1, -1) if way not in shapes and (way in ways or np.any(places.way == way))]
    return np.concatenate([*own, *(line * (places.way == way)[:, None] for way in missing)], axis=1)


def _owner(shapes: Mapping[int, Shape], places: _Places) -> np.ndarray:
    """Direction of the curve that stands for each place."""
    only = next(iter(shapes))
    return places.way if len(shapes) == 2 else np.full(len(places), only)


def _curves(shapes: Mapping[int, Shape], places: _Places) -> tuple[Array, Array]:
    """Mean `(n,)` and covariance `(n, n)` of the curves at places, which are one for places that share them."""
    mean, covariance = np.zeros(len(places)), np.zeros((len(places), len(places)))
    owner = _owner(shapes, places)
    for way, shape in shapes.items():
        rows = np.flatnonzero(owner == way)
        where, which = np.unique(places.x[rows], return_inverse=True)
        mean[rows] = shape.at(where)[which]
        covariance[np.ix_(rows, rows)] = shape.covariance(where)[np.ix_(which, which)]
    return mean, covariance


def _beside_jumps(shapes: Mapping[int, Shape], read: _Places, known: Array) -> Array:
    """Covariance `(m, m)` of readings at targets on a jump: one side of it for all readings of a target."""
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
    """A column for every target outside in every direction, and what they are of."""
    cells = sorted({(float(x), int(way)) for x, way in zip(read.x[~inside], read.way[~inside], strict=True)})
    columns = [(~inside & (read.x == x) & (read.way == way)).astype(float) for x, way in cells]
    return np.array(columns).reshape(len(cells), len(read)).T, cells


def _groups(
    quasi: QuasiStatic, shapes: Mapping[int, Shape], read: _Places, inside: np.ndarray, centre: float, half: float
) -> dict[str, Array]:
    """Correlations `(n, n)` of the readings, by the standard deviation that scales them."""
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
    """Correlation of the random course of the reversal; None where both directions have their own curve."""
    if len(shapes) == 2:
        return None
    other = places if other is None else other
    only = next(iter(shapes))
    apart = np.abs(places.x[:, None] - other.x) / (2.0 * half * REACH)
    return np.asarray(np.exp(-apart) * np.outer(places.way != only, other.way != only))


def _spread(
    observed: Array, design: Array, own: Array, groups: Mapping[str, Array], sheet: float
) -> tuple[Spread, Array]:
    """Standard deviations by REML, and the covariance of the readings with them."""
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
        """Values `(k,)` and covariance of what has this fixed part, covariance with observations, and prior."""
        values = design @ self.fixed + cross @ self.solved
        lever = design - cross @ self.weighted
        return values, prior - cross @ cho_solve(self.factor, cross.T) + lever @ self.own @ lever.T

    def outside(self, cells: list[tuple[float, int]], first: int) -> dict[int, tuple[Array, Array, Array]]:
        """Targets, errors and standard uncertainties of the fixed effects from `first` on, by direction."""
        found = {}
        for way in {way for _, way in cells}:
            rows = [i for i, cell in enumerate(cells) if cell[1] == way]
            at = np.array(rows) + first
            found[way] = (np.array([cells[i][0] for i in rows]), self.fixed[at], np.sqrt(np.diag(self.own)[at]))
        return found


def _drifts(quasi: QuasiStatic, solved: _Solved, spread: Spread, centre: float, half: float) -> tuple[Drift, ...]:
    """Offsets and slopes of the runs, as predicted from the readings."""
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
