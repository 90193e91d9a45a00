"""A quantity over time as a sum of Gaussian terms, and the odds of its changes.

    result = level + changes + drift + offsets of methods + walk + scatter + uncertainty of the result

The level is free. A change is a step between two results, a drift a constant rate, an offset the difference of one
method of measurement from the others, the walk a random walk from year to year: each is a term that may be there, with
prior odds and a size, as the causes of a diagnosis are (`calibration.gaussian_terms`). The restricted likelihood is
averaged over the machine's own scatter from result to result and over its walk: with few results they are hardly known,
and a change must then be larger to be found. A term is in the structure if it brings odds of 20 to 1, and is announced
from 150 to 1 on, as a cause is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby, pairwise
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from calibration.diagnosis.search import PRESENT
from calibration.gaussian_terms.gains import log_gains_by_squares
from calibration.gaussian_terms.posterior import Equations, Posterior
from history.trends.series import Series
from kinematics.error_model.priors import SIZES_IN_TYPICAL, Priors
from kinematics.transforms import Array

Kind = Literal["change", "drift", "method"]
LIFE_YEARS = 10.0
"""Years of use, in which a drift of typical rate gives an error of typical size, and a walk what axes repeat to."""
UNKNOWN_LEVEL_SIZES = 1e3
"""Prior size of the level, in typical sizes: nothing is known of it."""
WALKS = 0.5
"""Probability that a machine wanders: by seasons, its foundation, guides that run in; as likely as not."""
LOG_VARIANCE_STEP = 2.0
"""Step of the logarithm of the variance of a result, by 1 / sqrt(n): n results tell it to sqrt(2 / n)."""
LEAST_PROBABILITY_OF_NEIGHBOUR = 1e-2
"""Probability, against the structure that is found, below which a neighbour of it does not count: a band of 95 % leaves
2.5 % on each side."""
OF_STEPS: tuple[Kind, ...] = ("change", "method")
"""Kinds of terms that are steps in the results."""
MOST_TERMS = 12
"""Most terms of a series."""


class Candidate(NamedTuple):
    """A term that may be there."""

    kind: Kind
    column: Array
    """Its values `(n,)` at the results."""
    size: float
    """Its typical size."""
    log_prior: float
    """Log odds before the data."""
    first: int = 0
    """Of a change: the first result after it."""
    name: str = ""
    """Of a change: the event; of an offset: the method."""

    def at(self, time: float) -> float:
        """Its value in a forecast of the machine, which no method measures."""
        return {"change": 1.0, "drift": time, "method": 0.0}[self.kind]


def candidates_of(series: Series, priors: Priors) -> list[Candidate]:
    """All terms that a series may have."""
    n, typical = len(series.times), priors.error_motion_um * priors.typical
    common = float(np.log(priors.common / (1.0 - priors.common)))
    rate = typical / LIFE_YEARS
    found = [Candidate("drift", series.times - series.times[-1], rate, common)]
    for first in range(1, n):
        between = series.times[first - 1], series.times[first]
        event = next((e.kind for e in series.events if between[0] <= e.time <= between[1]), "")
        column = (np.arange(n) >= first).astype(float)
        log_prior = 0.0 if event else common - float(np.log(n - 1))  # after an event as likely as not
        found.append(Candidate("change", column, typical, log_prior, first, event))
    methods = sorted(set(series.methods), key=series.methods.count)[:-1]
    for name in methods:
        own = np.array([each == name for each in series.methods], float)
        found.append(Candidate("method", own, typical, common - float(np.log(len(methods))), name=name))
    return found


class White(NamedTuple):
    """What is made white by a scatter and a walk of the machine."""

    scatter: float
    walk: float
    """Per square root of a year."""
    columns: Array
    """White columns of the level and of all candidates `(n, 1 + c)`."""
    values: Array
    """White values `(n,)`."""
    low: Array
    """Lower triangle of the covariance `(n, n)`."""
    log_volume: float
    """Log determinant of the covariance."""


class Noise(NamedTuple):
    """Scatter and walk of the machine, whose covariance is a factor times one that has been made white."""

    white: White
    factor: float
    """1 up to the next larger scatter that has been made white."""
    scatter: float
    log_prior: float
    """Logarithm of its probability before the data."""

    @property
    def walk(self) -> float:
        """Per square root of a year."""
        return float(self.white.walk * np.sqrt(self.factor))

    @property
    def log_volume(self) -> float:
        """Log determinant of the covariance."""
        return float(self.white.log_volume + len(self.white.values) * np.log(self.factor))


@dataclass(frozen=True)
class Structure:
    """The terms that are present, with their sizes."""

    series: Series
    candidates: tuple[Candidate, ...]
    noises: tuple[Noise, ...]
    priors: Priors
    present: tuple[int, ...] = ()
    """Numbers of the candidates that are present."""
    sizes: tuple[float, ...] = ()
    """Their sizes, in typical sizes."""

    @classmethod
    def of(cls, series: Series, priors: Priors) -> Structure:
        """The level alone."""
        candidates = tuple(candidates_of(series, priors))
        noises = tuple(_noises(series, candidates, priors))
        return cls(series, candidates, noises, priors)

    @cached_property
    def posteriors(self) -> list[Posterior]:
        """The posterior of the level and of the present terms, for each noise."""
        own = [0, *(1 + number for number in self.present)]
        sizes = np.array([UNKNOWN_LEVEL_SIZES * self.priors.error_motion_um, *self._absolute])
        found = []
        for white, noises in groupby(self.noises, key=lambda each: each.white):
            equations = Equations.of(white.columns[:, own], white.values)
            found += [Posterior.of(equations, sizes, noise.factor) for noise in noises]
        return found

    @property
    def _absolute(self) -> list[float]:
        return [size * self.candidates[k].size for k, size in zip(self.present, self.sizes, strict=True)]

    @cached_property
    def log_evidences(self) -> Array:
        """Log density of the results for each noise, with the probability of this."""
        pairs = zip(self.posteriors, self.noises, strict=True)
        return np.array([n.log_prior - 0.5 * (p.misfit + p.log_determinant + n.log_volume) for p, n in pairs])

    @property
    def log_evidence(self) -> float:
        """Log density of the results."""
        return float(logsumexp(self.log_evidences))

    @cached_property
    def weights(self) -> Array:
        """Probability of each noise."""
        return np.asarray(np.exp(self.log_evidences - logsumexp(self.log_evidences)))

    @property
    def scatter(self) -> float:
        """Mean variance of the machine's scatter from result to result."""
        return float(self.weights @ np.array([noise.scatter**2 for noise in self.noises]))

    @cached_property
    def log_odds(self) -> Array:
        """Log odds of each candidate against none, beside the present terms; minus infinity for these."""
        each = zip(self.noises, self.posteriors, strict=True)
        gains = [
            self._gains(white, *zip(*own, strict=True)) for white, own in groupby(each, lambda pair: pair[0].white)
        ]
        gained = np.concatenate(gains)
        total = logsumexp(self.log_evidences[:, None] + gained, axis=0) - logsumexp(self.log_evidences)
        odds = total + np.array([each.log_prior for each in self.candidates])
        odds[list(self.present)] = -np.inf
        return np.asarray(odds)

    def _gains(self, white: White, noises: Sequence[Noise], posteriors: Sequence[Posterior]) -> Array:
        """Log evidence `(f, c)` that each candidate adds, for noises with the same white columns."""
        own = white.columns[:, [0, *(1 + number for number in self.present)]]
        typical = np.array([each.size for each in self.candidates])
        columns = white.columns[:, 1:] * typical
        across, squares = own.T @ columns, np.sum(columns**2, axis=0)
        factors = np.array([each.factor for each in noises])[:, None]
        explained = np.array([np.sum(across * (each.covariance @ across), axis=0) for each in posteriors]) / factors
        along = columns.T @ white.values - np.array([each.mean for each in posteriors]) @ across
        left = np.maximum(squares - explained, 0.0)
        return log_gains_by_squares(left[:, :, None], along[:, :, None] ** 2, SIZES_IN_TYPICAL, factors[:, :, None])

    @property
    def drift(self) -> int:
        """Number of the drift among the candidates."""
        return next(k for k, each in enumerate(self.candidates) if each.kind == "drift")

    @property
    def without_drift(self) -> Structure:
        """The structure without its drift, if it has one."""
        return self.without(self.present.index(self.drift)) if self.drift in self.present else self

    def drifting(self) -> Iterator[tuple[Structure, float]]:
        """The structure with a drift of each size, with the logarithms of their prior odds."""
        log_prior = self.candidates[self.drift].log_prior - float(np.log(len(SIZES_IN_TYPICAL)))
        for size in SIZES_IN_TYPICAL.tolist():
            yield self.without_drift.with_size(self.drift, size), log_prior

    def alternatives(self) -> Iterator[tuple[Structure, float]]:
        """The structure and its neighbours, with the logarithms of their weights before the evidence of each.

        A neighbour has one change or offset more, less, or one of the other kind in the place of another.
        """
        yield self, 0.0
        bases: list[tuple[Structure, float, Kind | None]] = [(self, 0.0, None)]
        for place, number in enumerate(self.present):
            own = self.candidates[number].kind
            if own in OF_STEPS:
                base = self.without(place)
                bases.append((base, -base.of_kind(own), own))
        for base, weight, left_out in bases:
            forms = [(base, weight)] if left_out else []
            for kind in OF_STEPS:
                odds = weight + base.of_kind(kind)
                if kind != left_out and odds > np.log(LEAST_PROBABILITY_OF_NEIGHBOUR):
                    forms.append((base.with_term(base.best(kind)), odds))
            yield from ((each, odds + self.log_evidence - each.log_evidence) for each, odds in forms)

    def best(self, kind: Kind) -> int:
        """The likeliest candidate of a kind, beside the present terms."""
        own = [number for number, each in enumerate(self.candidates) if each.kind == kind]
        return max(own, key=self.log_odds.__getitem__)

    def with_term(self, number: int) -> Structure:
        """The structure with another term, in its likeliest size."""
        return max(
            (self.with_size(number, size) for size in SIZES_IN_TYPICAL.tolist()), key=lambda each: each.log_evidence
        )

    def with_size(self, number: int, size: float) -> Structure:
        """The structure with another term of a size."""
        return replace(self, present=(*self.present, number), sizes=(*self.sizes, size))

    def without(self, place: int) -> Structure:
        """The structure without the term at a place among those that are present."""
        present, sizes = list(self.present), list(self.sizes)
        del present[place], sizes[place]
        return replace(self, present=tuple(present), sizes=tuple(sizes))

    def of_kind(self, kind: Kind) -> float:
        """Log odds that any candidate of a kind is there, beside the present terms."""
        own = [odds for odds, each in zip(self.log_odds, self.candidates, strict=True) if each.kind == kind]
        return float(logsumexp(own)) if own else -np.inf


def _noises(series: Series, candidates: Sequence[Candidate], priors: Priors) -> Iterator[Noise]:
    """All scatters and walks, about what axes repeat to; a walk is a term that may be there.

    The scatter is log-uniform, in steps that the results do not resolve: many results know their standard deviation far
    better than sizes of one to three, and would take the difference for a walk. Between two scatters that are made
    white, one times a factor stands for those of about the same variance.
    """
    walks = [0.0, *(priors.non_repeatability_um / np.sqrt(LIFE_YEARS) * SIZES_IN_TYPICAL).tolist()]
    of_walks = np.log([1.0 - WALKS, *[WALKS / len(SIZES_IN_TYPICAL)] * len(SIZES_IN_TYPICAL)]).tolist()
    scatters, variance = (priors.non_repeatability_um * SIZES_IN_TYPICAL).tolist(), float(np.mean(series.u**2))
    for lower, upper in pairwise(scatters):
        ratio = float(np.log((variance + upper**2) / (variance + lower**2)))
        count = int(np.ceil(ratio * np.sqrt(len(series.times)) / LOG_VARIANCE_STEP))
        between = np.geomspace(lower, upper, count, endpoint=False)
        log_prior = -float(np.log(count * (len(SIZES_IN_TYPICAL) - 1)))
        for walk, of_walk in zip(walks, of_walks, strict=True):
            white = _white(series, candidates, lower, walk)
            for scatter in between.tolist():
                factor = (variance + scatter**2) / (variance + lower**2)
                yield Noise(white, factor, scatter, log_prior + of_walk)


def _white(series: Series, candidates: Sequence[Candidate], scatter: float, walk: float) -> White:
    """The level, all candidates and the results, made white."""
    times, n = series.times - series.times[0], len(series.times)
    table = [np.ones(n), *(each.column for each in candidates), series.values - np.median(series.values)]
    covariance = np.diag(series.u**2 + scatter**2) + walk**2 * np.minimum(times[:, None], times)
    low = np.linalg.cholesky(covariance)
    white = solve_triangular(low, np.column_stack(table), lower=True)
    return White(scatter, walk, white[:, :-1], white[:, -1], low, 2.0 * float(np.log(np.diag(low)).sum()))


def likeliest(series: Series, priors: Priors) -> Structure:
    """The structure that the search finds: terms are added while one brings odds of 20 to 1, and dropped without."""
    found = Structure.of(series, priors)
    while len(found.present) < MOST_TERMS:
        kinds = [kind for kind in ("change", "drift", "method") if found.of_kind(kind) > PRESENT]
        worth = [k for k, each in enumerate(found.candidates) if each.kind in kinds and np.isfinite(found.log_odds[k])]
        if not worth:
            break
        found = _pruned(found.with_term(max(worth, key=found.log_odds.__getitem__)))
    return found


def _pruned(found: Structure) -> Structure:
    """The structure without the terms that the others explain."""
    while found.present:
        odds = [found.without(place).of_kind(found.candidates[k].kind) for place, k in enumerate(found.present)]
        if min(odds) > PRESENT:
            break
        found = found.without(int(np.argmin(odds)))
    return found
