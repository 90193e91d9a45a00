"""The error curve of continuous runs of one direction, up to a straight line: a Gaussian process on a band of nodes.

The curve is linear between nodes. Its prior is an integrated Wiener process (of order 2, a cubic smoothing spline, or
of order 1, a random walk), with the amplitude and order of the largest evidence. Its precision at the nodes is a band
matrix, and so is the contribution of whitened samples, so that the cost for a run of any length depends on its nodes.
Jumps, waves, and the straight lines of further runs are columns beside the band (Schur complement).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_matrix, diags

from calibration.continuous.error_curve import Course
from calibration.continuous.noise import Noise
from kinematics.transforms import Array

NODES = 4096
PER_NODE = 4
"""Least number of blocks between two nodes."""
LEAST_NODES = 64
WIDEST = {1: (-8.0, 16.0), 2: (-8.0, 28.0)}
"""Range of the natural logarithm of the prior's precision in units of the noise's, by order of the prior."""
TRIED = 13
RIDGE = 1e-13


@dataclass(frozen=True)
class Extra:
    """Functions of position in the curve in addition to the process: jumps and waves."""

    jumps: tuple[float, ...] = ()
    """Positions of the jumps, mm."""
    periods: tuple[float, ...] = ()
    """Periods of the waves, mm."""

    def columns(self, x: Array) -> Array:
        """Columns `(n, jumps + 2 waves)`: a step of 1 at each jump, then sine and cosine of each wave."""
        steps = (x[:, None] >= np.array(self.jumps)).astype(float)
        phase = 2.0 * np.pi * x[:, None] / np.array(self.periods)
        return np.concatenate([steps, np.stack([np.sin(phase), np.cos(phase)], axis=2).reshape(len(x), -1)], axis=1)

    @property
    def size(self) -> int:
        """Number of columns in `columns`."""
        return len(self.jumps) + 2 * len(self.periods)


@dataclass(frozen=True)
class Shape:
    """The curve of one direction, up to a straight line, with its covariance."""

    nodes: Array
    """Positions of the nodes `(m,)`, mm."""
    extra: Extra
    factor: Array
    """Cholesky factor of the band, lower form."""
    beside: Array
    """Solution of the band for the columns beside it `(m, k)`."""
    left: Array
    """Inverse of the Schur complement of these columns `(k, k)`."""
    values: Array
    """Values of the process at the nodes `(m,)`, um."""
    amounts: Array
    """Coefficients of the columns beside it `(k,)`: jumps, waves, then lines of further runs, um."""
    order: int
    finest_mm: float
    """Wavelength, mm, at which process and noise have equal power: finer detail cannot be separated from noise."""
    grain: float
    """Distance of the blocks, mm: the uncertainty range of a jump's position."""
    noise_scale: float
    """Ratio of the estimated noise to that of its spectrum."""

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the range in which the curve is known, mm."""
        return float(self.nodes[0]), float(self.nodes[-1])

    def at(self, x: Array) -> Array:
        """The curve at positions `(n,)`, um."""
        own = self.extra.size
        return np.asarray(_hats(self.nodes, x) @ self.values + self.extra.columns(x) @ self.amounts[:own])

    def covariance(self, x: Array) -> Array:
        """Covariance of the curve `(n, n)`, um2, at positions `(n,)`, mm."""
        hats = _hats(self.nodes, x).toarray()
        inner = hats @ cho_solve_banded((self.factor, True), hats.T)
        sensitivity = self.extra.columns(x) @ np.eye(self.extra.size, self.left.shape[0]) - hats @ self.beside
        return np.asarray(inner + sensitivity @ self.left @ sensitivity.T)

    @property
    def steepest(self) -> float:
        """Largest slope of the curve between its jumps, um per mm."""
        x = np.linspace(*self.interval, 4 * len(self.nodes))
        rows = np.array([0] * len(self.extra.jumps) + [1] * (self.extra.size - len(self.extra.jumps)))
        smooth = _hats(self.nodes, x) @ self.values
        smooth = smooth + self.extra.columns(x) @ (rows * self.amounts[: self.extra.size])
        return float(np.abs(np.diff(smooth)).max() / (x[1] - x[0]))

    def u_near_jumps(self, x: Array) -> Array:
        """Standard uncertainty `(n,)`, um, close to jumps, because the side on which a position lies is unknown."""
        if not self.extra.jumps:
            return np.zeros(len(x))
        near = np.abs(x[:, None] - np.array(self.extra.jumps)) <= self.grain
        return np.asarray(np.max(near * np.abs(self.amounts[: len(self.extra.jumps)]) / 2.0, axis=1))

    def amount_covariance(self) -> Array:
        """Covariance of jumps and waves `(k, k)`, um2."""
        own = self.extra.size
        return self.left[:own, :own]


def shape_of(courses: Sequence[Course], noises: Sequence[Noise], extra: Extra) -> Shape:
    """The curve of the courses of one direction."""
    equations = _equations(courses, noises, extra)
    tried = [_most_likely(equations, order) for order in (1, 2)]
    order = 1 + int(tried[1].evidence > tried[0].evidence)
    best = tried[order - 1]
    speed, low = courses[0].speed, noises[0].low
    # wavelength at which the spectrum of the process, s2 / (2 pi f)^(2 order), falls below that of the noise
    strength = best.scale**2 * np.exp(-best.logarithm)
    finest = 2.0 * np.pi * (0.5 * low * speed / strength) ** (0.5 / order)
    k = equations.beside.shape[1]
    return Shape(
        equations.nodes,
        extra,
        best.factor / best.scale,
        best.columns[:, :k],
        best.left * best.scale**2,
        best.values,
        best.amounts,
        order,
        float(finest),
        float(np.median(np.abs(np.diff(courses[0].x)))),
        best.scale,
    )


@dataclass(frozen=True)
class _Equations:
    """Normal equations of all courses: the band of the nodes, and the columns beside it."""

    nodes: Array
    band: Array
    """Band `(bandwidth, m)`, lower form."""
    right: Array
    beside: Array
    """Products of nodes and columns `(m, k)`."""
    own: Array
    """Products of columns `(k, k)`."""
    own_right: Array
    squares: float
    count: int


@dataclass(frozen=True)
class _Solved:
    """Solution for one amplitude of the prior, in units of the noise."""

    evidence: float
    logarithm: float
    """Logarithm of the prior's precision in units of the noise's, ln(1 / (um2 per mm^(2 order - 1)))."""
    scale: float
    """Ratio of the estimated noise to the given noise."""
    factor: Array
    columns: Array
    left: Array
    values: Array
    amounts: Array


def _equations(courses: Sequence[Course], noises: Sequence[Noise], extra: Extra) -> _Equations:
    low = min(float(course.x.min()) for course in courses)
    high = max(float(course.x.max()) for course in courses)
    count = int(min(max(max(map(len, courses)) // PER_NODE, LEAST_NODES), NODES))
    nodes = np.linspace(low, high, count)
    k = extra.size + 2 * (len(courses) - 1)
    sums = csr_matrix((count, count))
    right, beside, own, own_right = np.zeros(count), np.zeros((count, k)), np.zeros((k, k)), np.zeros(k)
    squares, rows = 0.0, 0
    for i, (course, noise) in enumerate(zip(courses, noises, strict=True)):
        white = _whitener(course, noise)
        hats = white @ _hats(nodes, course.x)
        columns = np.zeros((len(course), k))
        columns[:, : extra.size] = extra.columns(course.x)
        if i:  # the first course defines the straight line that all others are compared to
            line = extra.size + 2 * (i - 1)
            columns[:, line] = 1.0
            columns[:, line + 1] = (course.x - course.x.mean()) / (high - low)
        columns, observed = white @ columns, white @ course.error
        sums = sums + hats.T @ hats
        right += hats.T @ observed
        beside += hats.T @ columns
        own += columns.T @ columns
        own_right += columns.T @ observed
        squares += float(observed @ observed)
        rows += len(course)
    width = int(np.max(np.abs(np.subtract(*sums.nonzero())), initial=2)) + 1
    band = np.zeros((max(width, 3), count))
    for offset in range(width):
        band[offset, : count - offset] = sums.diagonal(-offset)
    return _Equations(nodes, band, right, beside, own, own_right, squares, rows)


def _most_likely(equations: _Equations, order: int) -> _Solved:
    """The solution with the largest evidence for a prior of this order."""
    from scipy.optimize import minimize_scalar

    prior = _prior(equations, order)
    grid = np.linspace(*WIDEST[order], TRIED)
    evidence = [_solved(equations, prior, order, each).evidence for each in grid.tolist()]
    best, step = float(grid[int(np.argmax(evidence))]), float(grid[1] - grid[0])
    found = minimize_scalar(
        lambda each: -_solved(equations, prior, order, float(each)).evidence,
        bounds=(best - step, best + step),
        method="bounded",
        options={"xatol": 0.02},
    )
    return _solved(equations, prior, order, float(found.x))


def _prior(equations: _Equations, order: int) -> Array:
    """Precision of the process of amplitude 1 at the nodes, as a band in lower form."""
    m, apart = len(equations.nodes), float(equations.nodes[1] - equations.nodes[0])
    kernel = np.array([-1.0, 1.0] if order == 1 else [1.0, -2.0, 1.0])
    band = np.zeros_like(equations.band)
    for i, left in enumerate(kernel.tolist()):
        for j, other in enumerate(kernel.tolist()[: i + 1]):
            offset = i - j
            band[offset, j : j + m - order] += left * other
    return band / apart ** (2 * order - 1)


def _solved(equations: _Equations, prior: Array, order: int, logarithm: float) -> _Solved:
    """The solution for a prior precision of exp(logarithm) times `prior`, with its log evidence."""
    m, k = equations.beside.shape
    whole = equations.band + np.exp(logarithm) * prior
    whole[0] += RIDGE * whole[0].max()  # only the prior determines nodes without a block
    factor = cholesky_banded(whole, lower=True)
    columns = cho_solve_banded((factor, True), np.column_stack([equations.beside, equations.right]))
    schur = equations.own - equations.beside.T @ columns[:, :k]
    left = np.asarray(np.linalg.pinv(schur, rcond=1e-12, hermitian=True), float) if k else np.zeros((0, 0))
    amounts = left @ (equations.own_right - equations.beside.T @ columns[:, k])
    values = columns[:, k] - columns[:, :k] @ amounts
    free = equations.count - order - k
    unexplained = max(float(equations.squares - equations.right @ values - equations.own_right @ amounts), 1e-300)
    determinant = 2.0 * float(np.log(factor[0]).sum()) + (float(np.linalg.slogdet(schur)[1]) if k else 0.0)
    apart = float(equations.nodes[1] - equations.nodes[0])
    pseudo = math.log(m) if order == 1 else math.log(m**2 * (m**2 - 1.0) / 12.0)
    of_prior = (m - order) * (logarithm - (2 * order - 1) * math.log(apart)) + pseudo
    evidence = 0.5 * (of_prior - determinant - free * math.log(unexplained))
    return _Solved(
        float(evidence), logarithm, float(np.sqrt(unexplained / free)), factor, columns, left, values, amounts
    )


def _whitener(course: Course, noise: Noise) -> csr_matrix:
    """The filter that makes the noise of a course white, of variance 1; a block behind a gap is only scaled."""
    n, order = len(course), noise.order
    follows = np.ones(n, bool)
    follows[:order] = False
    follows[order:] &= (course.slot[order:] - course.slot[: n - order]) == order
    parts: list[Any] = [np.where(follows, noise.filter[0] / noise.innovation, 1.0 / noise.total)]
    parts += [np.where(follows, a / noise.innovation, 0.0)[j:] for j, a in enumerate(noise.filter[1:], start=1)]
    return csr_matrix(diags(parts, [-j for j in range(order + 1)]))


def _hats(nodes: Array, x: Array) -> csr_matrix:
    """Linear interpolation `(n, m)` between nodes; constant beyond the ends."""
    number = np.clip((x - nodes[0]) / (nodes[1] - nodes[0]), 0.0, len(nodes) - 1.0)
    below = np.minimum(number.astype(int), len(nodes) - 2)
    share = number - below
    rows = np.repeat(np.arange(len(x)), 2)
    columns = np.stack([below, below + 1], axis=1).ravel()
    return csr_matrix((np.stack([1.0 - share, share], axis=1).ravel(), (rows, columns)), (len(x), len(nodes)))
