"""The error curve of continuous runs of one direction, up to a straight line: the error motion of every measurement.

It is a sum of Legendre polynomials of a high degree whose bands share sizes that the data decide
(`calibration.gaussian_terms.geometry`). Its line, jumps, waves, and the lines of further runs have no limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags

from calibration.continuous.error_curve import Course
from calibration.continuous.noise import Noise
from calibration.gaussian_terms.geometry import Bands, keys_of, prior_sizes, summed
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.single_axis.error_curves import STATED, UNLIMITED_UM
from kinematics.basis import Legendre
from kinematics.effects import ErrorMotion
from kinematics.error_model.priors import PRIORS
from kinematics.transforms import Array

PER_DEGREE = 8
"""Least number of blocks for each degree."""
MOST_DEGREE = 480
"""Largest degree: waves of a 240th of the travel; shorter ones are found as cyclic errors."""
MOST_SIZE_STEPS, NOISE_ROUNDS = 60, 3
"""Most steps of the sizes, and how often the noise is found again."""
DETERMINED_SHARE = 0.5
"""Share of a coefficient that the data determine, the prior the rest, below which they do not show it."""


@dataclass(frozen=True)
class Extra:
    """Functions of position in the curve in addition to the polynomials: jumps and waves."""

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

    basis: Legendre
    extra: Extra
    mean: Array
    """Coefficients `(p,)`, um: of the polynomials, of jumps and waves, of the lines of further runs."""
    spread: Array
    """Their covariance `(p, p)`, um2."""
    finest_mm: float
    """Wavelength, mm, of the largest degree that the data show: finer detail cannot be separated from noise."""
    grain: float
    """Distance of the blocks, mm: the uncertainty range of a jump's position."""
    noise_scale: float
    """Ratio of the estimated noise to that of its spectrum."""

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the range in which the curve is known, mm."""
        return self.basis.interval

    @property
    def amounts(self) -> Array:
        """Sizes of jumps and waves `(k,)`, um."""
        return self.mean[self._extra]

    @property
    def _extra(self) -> slice:
        return slice(self.basis.size, self.basis.size + self.extra.size)

    def _rows(self, x: Array) -> Array:
        """Derivatives of the curve `(n, size + k)` by its coefficients; constant beyond the ends."""
        return np.concatenate([self.basis.columns(np.clip(x, *self.interval)), self.extra.columns(x)], axis=1)

    def at(self, x: Array) -> Array:
        """The curve at positions `(n,)`, um."""
        return np.asarray(self._rows(x) @ self.mean[: self._extra.stop])

    def covariance(self, x: Array) -> Array:
        """Covariance of the curve `(n, n)`, um2, at positions `(n,)`, mm."""
        rows, own = self._rows(x), slice(0, self._extra.stop)
        return np.asarray(rows @ self.spread[own, own] @ rows.T)

    @cached_property
    def steepest(self) -> float:
        """Largest slope of the curve between its jumps, um per mm."""
        x = np.linspace(*self.interval, 8 * self.basis.size)
        smooth = np.array([False] * len(self.extra.jumps) + [True] * (self.extra.size - len(self.extra.jumps)))
        own = np.concatenate([np.ones(self.basis.size, bool), smooth])
        values = self._rows(x) @ np.where(own, self.mean[: self._extra.stop], 0.0)
        return float(np.abs(np.diff(values)).max() / (x[1] - x[0]))

    def u_near_jumps(self, x: Array) -> Array:
        """Standard uncertainty `(n,)`, um, close to jumps, because the side on which a position lies is unknown."""
        if not self.extra.jumps:
            return np.zeros(len(x))
        near = np.abs(x[:, None] - np.array(self.extra.jumps)) <= self.grain
        return np.asarray(np.max(near * np.abs(self.amounts[: len(self.extra.jumps)]) / 2.0, axis=1))

    def amount_covariance(self) -> Array:
        """Covariance of jumps and waves `(k, k)`, um2."""
        return self.spread[self._extra, self._extra]


def shape_of(courses: Sequence[Course], noises: Sequence[Noise], extra: Extra) -> Shape:
    """The curve of the courses of one direction."""
    low = min(float(course.x.min()) for course in courses)
    high = max(float(course.x.max()) for course in courses)
    degree = min(max(map(len, courses)) // PER_DEGREE, MOST_DEGREE)
    basis = Legendre((low, high), degree)
    degrees = np.arange(basis.size)
    others = extra.size + 2 * (len(courses) - 1)
    keys = keys_of(ErrorMotion("X", "X", basis, (0.0,) * basis.size), degrees)
    keys = [*[("", "", STATED)] * 2, *keys[2:], *[("", "", STATED)] * others]
    prior = np.concatenate(
        [np.where(degrees < 2, UNLIMITED_UM, prior_sizes(degrees, PRIORS)), np.full(others, UNLIMITED_UM)]
    )
    bands = Bands.of(keys, PRIORS)
    design, residual = _whitened(courses, noises, extra, basis, prior)
    whole = Equations.of(design, residual)
    rows, factor = len(residual), 1.0
    for _ in range(NOISE_ROUNDS):
        scaled = Equations(residual / factor**0.5, whole.gram / factor, whole.along / factor)
        sizes = bands.likeliest_sizes(scaled, PRIORS, MOST_SIZE_STEPS)
        bands = replace(bands, first_sizes=sizes)
        posterior = Posterior.of(scaled, sizes[bands.bands], 1.0)
        determined = posterior.determined
        left = residual - design @ posterior.mean
        factor = max(float(left @ left), np.finfo(float).tiny) / (rows - float(determined.sum()))
    wider = sizes * bands.wider(summed(bands.bands, determined, len(sizes)), PRIORS)
    spread = Posterior.of(scaled, wider[bands.bands], 1.0).covariance * prior * prior[:, None]
    shown = int(degrees[determined[: basis.size] > DETERMINED_SHARE].max(initial=1))
    grain = float(np.median(np.abs(np.diff(courses[0].x))))
    return Shape(basis, extra, posterior.mean * prior, spread, 2.0 * (high - low) / shown, grain, factor**0.5)


def _whitened(
    courses: Sequence[Course], noises: Sequence[Noise], extra: Extra, basis: Legendre, prior: Array
) -> tuple[Array, Array]:
    """Whitened columns `(N, p)` of all courses, in units of their prior sizes, and the whitened errors `(N,)`."""
    low, high = basis.interval
    rows, observed = [], []
    for i, (course, noise) in enumerate(zip(courses, noises, strict=True)):
        lines = np.zeros((len(course), 2 * (len(courses) - 1)))
        if i:  # the first course defines the straight line that all others are compared to
            lines[:, 2 * i - 2] = 1.0
            lines[:, 2 * i - 1] = (course.x - course.x.mean()) / (high - low)
        white = _whitener(course, noise)
        rows.append(white @ (np.concatenate([basis.columns(course.x), extra.columns(course.x), lines], axis=1) * prior))
        observed.append(white @ course.error)
    return np.concatenate(rows), np.concatenate(observed)


def _whitener(course: Course, noise: Noise) -> csr_matrix:
    """The filter that makes the noise of a course white, of variance 1; a block behind a gap is only scaled."""
    n, order = len(course), noise.order
    follows = np.ones(n, bool)
    follows[:order] = False
    follows[order:] &= (course.slot[order:] - course.slot[: n - order]) == order
    parts: list[Any] = [np.where(follows, noise.filter[0] / noise.innovation, 1.0 / noise.total)]
    parts += [np.where(follows, a / noise.innovation, 0.0)[j:] for j, a in enumerate(noise.filter[1:], start=1)]
    return csr_matrix(diags(parts, [-j for j in range(order + 1)]))
