"""Noise: a factor on the specification, non-repeatability of each axis from stop to stop, and rows that are left out.

The covariance of the rows of one stop is f C + sum t_i^2 a_i a_i', with the arm a_i of the positioning error of axis i,
which all rows of the stop share. f and t^2 are found together with what the terms leave open (restricted likelihood):
the expected second moments of the residuals, and Fisher steps.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import ROUNDING
from kinematics.effects.base import unit_of
from kinematics.transforms import Array

FISHER_STEPS, FISHER_HALVINGS = 6, 12
"""Fisher steps of the variances, and halvings of a step that does not raise the likelihood."""
LAST_LIKELIHOOD_RISE = 0.1
"""Rise of the log likelihood below which the steps end."""
LEAST_FACTOR = 0.1
"""Smallest factor on the variance factor in one step."""
NEGLIGIBLE_REPEATABILITY_UM = 0.1
"""Standard deviation from stop to stop, um or urad, below which an axis counts as repeating."""


@dataclass(frozen=True)
class Noise:
    """The noise of observations."""

    factor: float = 1.0
    """Factor on the variances of the specification, common to all rows."""
    repeats: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of each axis from stop to stop, um or urad; of the axes in which there is any."""
    left_out: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    """True `(n,)` for outliers."""

    @property
    def whitening(self) -> Hashable:
        """What the whitening depends on: noises that differ in the factor alone have the same one."""
        repeats = ((axis, size**2 / self.factor) for axis, size in sorted(self.repeats.items()))
        return self.left_out.tobytes(), *repeats


class Stops(NamedTuple):
    """Stops of equally many rows m."""

    rows: np.ndarray
    """Rows of each stop `(stops, m)`."""
    specified: Array
    """Their covariances by the specification `(stops, m d, m d)`, rows independent."""
    arms: Mapping[str, Array]
    """Change of their observations `(stops, m d)`, mm or rad, by 1 um or urad of each axis."""


def stops_of(observations: Observations) -> list[Stops]:
    """The stops of observations, by their number of rows."""
    d, measurement = observations.components, observations.measurement
    stop = measurement.stops
    starts = np.flatnonzero(np.append(True, np.diff(stop) != 0))
    counts = np.diff(np.append(starts, len(stop)))
    transform = observations.transform
    arms = {axis: transform[:, :, observations.own_arm(axis)] * unit_of(axis)[1] for axis in measurement.moving}
    found = []
    for m in np.unique(counts).tolist():
        rows = starts[counts == m][:, None] + np.arange(m)
        specified = np.zeros((len(rows), m * d, m * d))
        for i in range(m):
            own = slice(i * d, (i + 1) * d)
            specified[:, own, own] = observations.specified[rows[:, i]]
        found.append(Stops(rows, specified, {a: arm[rows].reshape(len(rows), m * d) for a, arm in arms.items()}))
    return found


def whiteners(stops: Sequence[Stops], noise: Noise) -> list[Array]:
    """Matrices `(stops, m d, m d)` that make the noise of each stop white but for the common factor."""
    found = []
    for each in stops:
        covariance = each.specified.copy()
        for axis, size in noise.repeats.items():
            arm = each.arms[axis]
            covariance += (size**2 / noise.factor) * arm[:, :, None] * arm[:, None, :]
        found.append(np.asarray(np.linalg.inv(np.linalg.cholesky(covariance))))
    return found


class Moments(NamedTuple):
    """Second moments of the whitened residuals of stops, and the unit variances that make them up."""

    second: Array
    """`(stops, m d, m d)`"""
    parts: list[Array]
    """Covariance, whitened in the same way, by each variance of 1."""
    known: Array | float = 0.0
    """Covariance `(stops, m d, m d)` that no variance changes, whitened in the same way."""


def variances(
    moments: Sequence[Moments], axes: Sequence[str], noise: Noise, median: float
) -> tuple[float, dict[str, float]]:
    """The factor of the specification, and the standard deviation of each axis, with the greatest likelihood.

    median: of the prior of the standard deviation of an axis, um or urad.
    """
    start = np.array([noise.factor, *(noise.repeats.get(axis, 0.0) ** 2 for axis in axes)])
    theta = likeliest_variances(moments, start, median)
    sizes = zip(axes, np.sqrt(theta[1:]).tolist(), strict=True)
    return float(theta[0]), {axis: size for axis, size in sizes if size > NEGLIGIBLE_REPEATABILITY_UM}


def likeliest_variances(moments: Sequence[Moments], theta: Array, median: float, steps: int = FISHER_STEPS) -> Array:
    """Variances `(k,)` of the parts with the greatest likelihood, from some on; the first one stays above 0.

    median: of the prior of the standard deviations but for the first one.
    """
    now = _likelihood(moments, theta, median)
    for _ in range(steps):
        step, least = _fisher_step(theta, now), LEAST_FACTOR * theta[0]
        for _ in range(FISHER_HALVINGS):
            new = np.maximum(theta + step, 0.0)
            new[0] = max(new[0], least)
            found = _likelihood(moments, new, median)
            if found.value >= now.value:
                break
            step = step / 2.0
        else:
            break
        rise, theta, now = found.value - now.value, new, found
        if rise < LAST_LIKELIHOOD_RISE:
            break
    return theta


class _Likelihood(NamedTuple):
    value: float
    gradient: Array
    information: Array


def _fisher_step(theta: Array, now: _Likelihood) -> Array:
    """Step of the variances; those at zero that would fall stay there."""
    free = np.ones(len(theta), bool)
    while True:
        step = np.zeros(len(theta))
        information = now.information[np.ix_(free, free)]
        # exact data may not tell two variances apart (Levenberg)
        information[np.diag_indices_from(information)] *= 1.0 + ROUNDING
        step[free] = np.linalg.solve(information, now.gradient[free])
        below = free & (theta <= 0.0) & (step < 0.0)
        if not below.any():
            return step
        free &= ~below


def _likelihood(moments: Sequence[Moments], theta: Array, median: float) -> _Likelihood:
    """Log likelihood of variances `(k,)` with the half-Cauchy prior of each standard deviation, and its derivatives.

    The information of the prior is the square of its slope: data of one row a stop may not tell the variances apart.
    """
    k = len(theta)
    value = -float(np.sum(np.log1p(theta[1:] / median**2)))
    gradient, information = -1.0 / (median**2 + theta), np.zeros((k, k))
    gradient[0] = 0.0
    information[np.diag_indices(k)] += gradient**2
    for second, parts, known in moments:
        inverse = np.linalg.inv(known + sum(variance * part for variance, part in zip(theta, parts, strict=True)))
        excess = inverse @ second
        value += 0.5 * float(np.linalg.slogdet(inverse)[1].sum() - np.trace(excess, axis1=1, axis2=2).sum())
        scaled = [inverse @ part for part in parts]
        for i, one in enumerate(scaled):
            gradient[i] += 0.5 * float(np.sum(np.swapaxes(one, 1, 2) * excess) - np.trace(one, axis1=1, axis2=2).sum())
            for j, other in enumerate(scaled[: i + 1]):
                information[i, j] += 0.5 * float(np.sum(np.swapaxes(one, 1, 2) * other))
    information += np.tril(information, -1).T
    return _Likelihood(value, gradient, information)
