"""The shares of the causes of the deviations of circles: the likeliest terms by the search of a diagnosis.

Centre and length are the registration. All else is a term with prior odds and a size that the data decide. A cause is
in the list if it is clear against none (150 to 1), and tied with those from which the data do not tell it as clearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from calibration.circles.circles import Circle
from calibration.circles.result import Limit, Share, Shares
from calibration.circles.spikes import spikes_by_feed
from calibration.circles.terms import OTHER, named_sizes, shape_of, terms_of
from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.conclusion.verdict import Judged, judged, period_of
from calibration.diagnosis.dictionary import Dictionary
from calibration.diagnosis.forms import plain
from calibration.diagnosis.search import Search
from calibration.diagnosis.waves import FEWEST_TURNS, shortest_period, waves
from calibration.gaussian_terms.geometry import Geometry
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Data, Structure
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from calibration.plausibility.misfit import misfit
from kinematics.effects import Cyclic
from kinematics.effects.base import own_component
from kinematics.error_model.priors import SIZES_IN_TYPICAL
from kinematics.transforms import Array

FREE_MM = 10.0
"""Prior size of changes of centre and length, mm: a centre is within 20 mm (`plausibility`)."""
LEAST_DISTANCE_CHANGE = 0.1
"""Change of the distance by a shift of the table ball, RMS, below which circles do not show its direction."""
DETECTION_PERIODS = 8
"""Number of periods of a cyclic error for which detection limits are worked out."""


def shares(measurement: Measurement, circles: Sequence[Circle]) -> Shares:
    """The shares of the causes in the deviations of the circles."""
    observations = Observations.of(measurement)
    data = Data.of(observations, Geometry.none(observations))
    gross = np.ones(len(observations), bool)
    gross[np.concatenate([each.rows for each in circles])] = False
    start = Structure.first(replace(data, gross=data.gross | gross, least_factor=1.0)).fitted()
    dictionary = Dictionary(terms_of(observations, circles))
    return _Result(_clear(Search(dictionary).from_structure(start).candidates, dictionary)).shares()


def _clear(candidates: Candidates, dictionary: Dictionary) -> Candidates:
    """The likeliest terms without those that are not clear against none, one after the other."""
    while candidates.structure.terms:
        least = min(judged(candidates), key=lambda each: each.log_odds)
        if least.log_odds >= CLEAR_LOG_ODDS:
            break
        rest = [term for term in candidates.structure.terms if term is not least.term]
        structure = candidates.structure.with_terms(rest).fitted()
        candidates = Candidates.of(structure, dictionary, waves(structure))
    return candidates


@dataclass(frozen=True)
class _Result:
    """The likeliest terms, and what follows from them."""

    candidates: Candidates

    @property
    def _structure(self) -> Structure:
        return self.candidates.structure

    @property
    def _observations(self) -> Observations:
        return self._structure.data.observations

    @cached_property
    def _rows(self) -> np.ndarray:
        """Numbers of the rows used."""
        return np.flatnonzero(~self._structure.noise.left_out)

    @cached_property
    def _posterior(self) -> Posterior:
        """Of changes of centre and length, mm, then of the coefficients of the terms."""
        structure, white, own = self._structure, self._structure.whitener, self._observations
        registration = np.concatenate([white.rows(own.registration), own.stated])
        observed = np.concatenate([white.rows(own.residual[:, :, None])[:, 0], own.stated_residual])
        columns = [white.with_stated(term.columns) for term in structure.terms]
        sizes = np.concatenate([np.full(registration.shape[1], FREE_MM), structure.sizes])
        equations = Equations.of(np.concatenate([registration, *columns], axis=1), observed)
        return Posterior.of(equations, sizes, structure.noise.factor)

    @cached_property
    def _coefficients(self) -> list[slice]:
        """Those of each term in `_posterior`."""
        ends = self._observations.registration.shape[2] + np.cumsum([0, *(t.width for t in self._structure.terms)])
        return [slice(low, high) for low, high in pairwise(ends.tolist())]

    def shares(self) -> Shares:
        """The causes with their sizes, uncertainties, shares and ties."""
        structure, own = self._structure, self._observations
        deviation = self._about_circle(1e3 * own.residual[:, 0])
        signals = [
            self._about_circle(1e3 * term.columns[:, 0] @ self._posterior.mean[part])
            for term, part in zip(structure.terms, self._coefficients, strict=True)
        ]
        fitted = np.sum(signals, axis=0) if signals else np.zeros(len(deviation))
        left = deviation - fitted
        total = float(np.sum(np.square(signals)) + left @ left)
        causes: dict[str, list[Judged]] = {}
        for each in judged(self.candidates):
            causes.setdefault(_name(each.term), []).append(each)
        together = [np.sum([signals[each.number] for each in parts], axis=0) for parts in causes.values()]
        found = [self._share(*each, total) for each in zip(causes.values(), together, strict=True)]
        limits, hidden = self._limits()
        return Shares(
            tuple(sorted(found, key=lambda cause: -cause.share)), *self._offset(), _rms(deviation), _rms(left),
            1e3 * float(np.sqrt(own.specified[0, 0, 0])),
            int(np.count_nonzero(structure.noise.left_out & ~structure.data.gross)), hidden, limits, fitted, self._rows,
        )  # fmt: skip

    def _about_circle(self, values: Array) -> Array:
        """Values `(n,)` of all rows at the rows used, less the centre and the length that they look like."""
        base = self._observations.registration[self._rows, 0]
        return np.asarray(values[self._rows] - base @ np.linalg.lstsq(base, values[self._rows])[0])

    def _share(self, parts: Sequence[Judged], signal: Array, total: float) -> Share:
        """The share of a cause; parts: its terms, several of the other error motions and of waves of one axis."""
        parameters: dict[str, float] = {}
        U: dict[str, float] = {}
        tied: dict[str, None] = {}
        for count, each in enumerate(parts):
            term, own = each.term, self._coefficients[each.number]
            names, by_coefficients = named_sizes(term)
            sizes = by_coefficients @ self._posterior.mean[own]
            variances = np.diag(by_coefficients @ self._posterior.covariance[own, own] @ by_coefficients.T)
            tail = f"_{count + 1}" if count and term.kind != OTHER else ""
            shape = {f"{name}{tail}": value for name, value in shape_of(term).items()}
            names = tuple(f"{name}{tail}" for name in names)
            parameters |= dict(zip(names, sizes.tolist(), strict=True)) | shape
            U |= dict(zip(names, (2.0 * np.sqrt(variances)).tolist(), strict=True))
            tied |= dict.fromkeys(_name(other.term) for other in each.alternatives)
        first = parts[0]
        others = tuple(name for name in tied if name != _name(first.term))
        odds = sum(each.log_odds for each in parts) / float(np.log(10.0))
        by_feed = spikes_by_feed(self.candidates, first.number) if first.term.kind == "reversal-spike" else ()
        mean_square, width, where = float(signal @ signal) / total, float(np.ptp(signal)), str(first.term.where)
        return Share(first.term.kind, where, parameters, U, width, mean_square, odds, others, by_feed)

    def _limits(self) -> tuple[tuple[Limit, ...], tuple[str, ...]]:
        """Detection limits of the causes that are not there, beside those that are; and names of the hidden ones."""
        present = {_name(term) for term in self._structure.terms}
        causes: dict[str, list[Term]] = {}
        for term in self.candidates.terms:
            if _name(term) not in present and term.kind not in (OTHER, "quantised-compensation"):
                causes.setdefault(_name(term), []).append(term)
        found, hidden = [], []
        for name, members in causes.items():
            sizes = [self._limit(term) for term in (self._waves(members[0]) or members)]
            unit = named_sizes(members[0])[0][0].partition("_")[2].removeprefix("plus_").replace("_per_", "/")
            if max(sizes) < np.inf:
                found.append(Limit(name, min(sizes), max(sizes), unit))
            else:
                hidden.append(name)
        return tuple(found), tuple(hidden)

    def _waves(self, term: Term) -> list[Term]:
        """Waves of all periods with the prior odds of one; empty for other terms."""
        axis = term.where
        if period_of(term) is None or axis is None:
            return []
        low, high = self._observations.measurement.moving[axis]
        shortest = shortest_period(self._observations.measurement, axis)
        periods = np.geomspace(shortest, max((high - low) / FEWEST_TURNS, shortest), DETECTION_PERIODS).tolist()
        waves = [
            plain(self._observations, Cyclic(own_component(axis), axis, period, (0.0,), (0.0,))) for period in periods
        ]
        return [replace(wave, log_prior=term.log_prior) for wave in waves]

    def _limit(self, term: Term) -> float:
        """The size from which a cause, alike at both ends, is expected to be clear; infinite beyond likely sizes."""
        structure, factor = self._structure, self._structure.noise.factor
        names, by_coefficients = named_sizes(term)
        one = np.eye(len(names))[0] if period_of(term) else np.ones(len(names))
        alike = np.linalg.lstsq(by_coefficients, one)[0]
        signal = structure.whitener.columns(term.columns) @ alike
        along = structure.through(signal[:, None])[:, 0]
        seen = float(signal @ signal - along @ structure.posterior.covariance @ along / factor) / factor
        typical = 1.0 / float(np.sqrt(np.mean(alike**2)))
        needed = 2.0 * (CLEAR_LOG_ODDS - term.log_prior) + float(np.log1p(seen * typical**2))
        return float(np.sqrt(needed / seen)) if needed < seen * (SIZES_IN_TYPICAL[-1] * typical) ** 2 else np.inf

    def _offset(self) -> tuple[dict[str, float], dict[str, float]]:
        """Shift of the first table ball from its stated centre, um, and its standard uncertainty."""
        own = self._observations
        name, centre = next(iter(misfit(own.measurement)[1].sphere_centres.items()))
        shift = 1e3 * (centre - np.array(own.measurement.spheres[name]))
        mean, covariance = self._posterior.mean, self._posterior.covariance
        seen = [k for k in range(3) if _rms(own.registration[self._rows, 0, k]) > LEAST_DISTANCE_CHANGE]
        offset = {"xyz"[k]: float(shift[k] - 1e3 * mean[k]) for k in seen}
        return offset, {"xyz"[k]: float(1e3 * np.sqrt(covariance[k, k])) for k in seen}


def _name(term: Term) -> str:
    return f"{term.kind} {term.where}"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
