"""The quantity of a machine at any time after its results, as far as these tell: a mixture of Gaussians.

A forecast holds if nothing happens to the machine: it has no future steps. A drift counts with its probability, whether
it is in the structure or not; so does one change or offset of a method more, less or in the place of the other, because
the results may not tell whether the machine or the method has changed. The walk of the machine goes on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp, ndtr

from history.trends.model import Structure, White
from kinematics.transforms import Array

BAND_PROBABILITY = 0.95
"""Probability of the band."""
LEAST_PROBABILITY_OF_NOISE = 1e-9
"""Probability, against the likeliest, below which a noise does not count."""
BAND_BISECTIONS = 60
"""Steps to the ends of the band, each half as large as the one before."""


@dataclass(frozen=True)
class Forecast:
    """The true value at some times, as a mixture."""

    times: Array
    """Years since 1970 `(t,)`."""
    weights: Array
    """Of the parts `(k,)`."""
    means: Array
    """`(k, t)`"""
    deviations: Array
    """Standard deviations `(k, t)`."""

    @property
    def mean(self) -> Array:
        """`(t,)`"""
        return np.asarray(self.weights @ self.means)

    @property
    def u(self) -> Array:
        """Standard uncertainty `(t,)`."""
        return np.asarray(np.sqrt(self.weights @ (self.deviations**2 + (self.means - self.mean) ** 2)))

    def below(self, value: Array | float) -> Array:
        """Probability `(t,)` of less than a value."""
        return np.asarray(self.weights @ ndtr((value - self.means) / self.deviations))

    def quantile(self, probability: float) -> Array:
        """The value `(t,)` below which the quantity is with a probability."""
        reach = 10.0 * self.deviations.max(axis=0)
        low, high = self.means.min(axis=0) - reach, self.means.max(axis=0) + reach
        for _ in range(BAND_BISECTIONS):
            middle = (low + high) / 2.0
            under = self.below(middle) < probability
            low, high = np.where(under, middle, low), np.where(under, high, middle)
        return np.asarray((low + high) / 2.0)

    @property
    def band(self) -> tuple[Array, Array]:
        """Lower and upper end `(t,)` of the band of 95 %."""
        return self.quantile((1.0 - BAND_PROBABILITY) / 2.0), self.quantile((1.0 + BAND_PROBABILITY) / 2.0)

    def outside(self, limit: float) -> Array:
        """Probability `(t,)` that the size is above a limit."""
        return np.asarray(1.0 - self.below(limit) + self.below(-limit))


class _Part(NamedTuple):
    log_weight: float
    mean: Array
    deviation: Array


def forecast(structure: Structure, times: Array) -> Forecast:
    """The quantity at some times, most of them after the last result; steps count at all times."""
    parts: list[_Part] = []
    for neighbour, weight in structure.alternatives():
        for each, log_prior in ((neighbour.without_drift, 0.0), *neighbour.drifting()):
            parts += _parts(each, weight + log_prior, times)
    log_weights = np.array([part.log_weight for part in parts])
    weights = np.exp(log_weights - logsumexp(log_weights))
    return Forecast(times, weights, np.array([p.mean for p in parts]), np.array([p.deviation for p in parts]))


def _parts(structure: Structure, log_prior: float, times: Array) -> Iterator[_Part]:
    """The forecast for each noise: level and terms by their posterior, the walk by the residuals."""
    series, own = structure.series, [0, *(1 + number for number in structure.present)]
    last = series.times[-1]
    values = [[1.0, *(structure.candidates[k].at(time - last) for k in structure.present)] for time in times.tolist()]
    ahead = np.array(values).T
    middle = float(np.median(series.values))
    log_evidences = structure.log_evidences
    counted = np.flatnonzero(log_evidences > log_evidences.max() + np.log(LEAST_PROBABILITY_OF_NOISE)).tolist()
    shares = {id(white): _shared(white, series.times, times) for white in (structure.noises[k].white for k in counted)}
    for k in counted:
        noise, posterior = structure.noises[k], structure.posteriors[k]
        shared = shares[id(noise.white)]
        design = noise.white.columns[:, own]
        residual = noise.white.values - design @ posterior.mean
        free = ahead - design.T @ shared
        walked = noise.white.walk**2 * (times - series.times[0]) - np.sum(shared**2, axis=0)
        variance = noise.factor * walked + np.sum(free * (posterior.covariance @ free), axis=0)
        mean = middle + posterior.mean @ ahead + residual @ shared
        deviation = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
        yield _Part(float(log_evidences[k]) + log_prior, mean, deviation)


def _shared(noise: White, before: Array, times: Array) -> Array:
    """White covariances `(n, t)` of the results with the walk at later times."""
    covariance = noise.walk**2 * np.minimum((before - before[0])[:, None], times - before[0])
    return np.asarray(solve_triangular(noise.low, covariance, lower=True))
