"""The changes of a quantity: their odds, their sizes, their dates, and what else may explain them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import logsumexp

from calibration.diagnosis.search import PRESENT
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS
from history.trends.forecast import forecast
from history.trends.model import Candidate, Kind, Structure
from history.trends.series import day_of
from kinematics.transforms import Array

CHANGE_PROBABILITY = 0.95
"""Probability that a change lies between its two dates."""
KINDS: tuple[Kind, ...] = ("change", "drift", "method")
Form = Literal["change", "drift", "method", "walk"]


@dataclass(frozen=True)
class Found:
    """A change, a slow change (a drift, or a walk), or the offset of a method, in a series."""

    kind: Kind
    """`change`, `drift` or `method`."""
    name: str
    """Event, or method; empty where there is none."""
    size: float
    """In the unit of the quantity; of a drift a year."""
    u: float
    """Standard uncertainty."""
    log_odds: float
    """Against a machine that stays as it is."""
    between: tuple[float, float]
    """First and last date, years since 1970; of a drift and a method those of the series."""
    tied_with: tuple[Form, ...]
    """Other kinds that explain it about as well."""

    @property
    def verdict(self) -> Literal["announced", "tied", "likely"]:
        """Announced from odds of 150 to 1 on against none, and against the other of machine and method.

        Whether the machine has changed at once, drifts, or wanders may be open.
        """
        of_machine = self.kind != "method"
        open_one = any((form != "method") != of_machine for form in self.tied_with)
        return "tied" if open_one else "announced" if self.log_odds >= CLEAR_LOG_ODDS else "likely"

    @property
    def probability(self) -> float:
        """Probability that it is there."""
        return float(1.0 / (1.0 + np.exp(-self.log_odds)))

    def json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "kind": self.kind, "name": self.name, "size": self.size, "U": 2.0 * self.u, "verdict": self.verdict,
            "log10_odds": self.log_odds / float(np.log(10.0)), "probability": self.probability,
            "between": [day_of(time).isoformat() for time in self.between], "tied_with": list(self.tied_with),
        }  # fmt: skip


def found_in(structure: Structure) -> list[Found]:
    """The changes in a series, by their dates; a slow one is the last."""
    own = [(place, number) for place, number in enumerate(structure.present) if number != structure.drift]
    found = sorted((_found(structure, *each) for each in own), key=lambda each: each.between)
    slow = _slow(structure)
    return [*found, slow] if slow.log_odds > PRESENT else found


def _slow(structure: Structure) -> Found:
    """The slow change: its odds are those of a drift or a walk, against a machine that stays as it is between steps."""
    base, times = structure.without_drift, structure.series.times
    stays, walks = _by_walk(base)
    drifts = float(logsumexp([log_prior + each.log_evidence for each, log_prior in structure.drifting()]))
    whole, both = float(logsumexp(base.log_evidences)), float(np.logaddexp(walks, drifts))
    steps: dict[Form, float] = {kind: whole + base.of_kind(kind) for kind in KINDS if kind != "drift"}
    rivals = tuple(form for form, weight in steps.items() if weight > max(both - CLEAR_LOG_ODDS, stays))
    walk: tuple[Form, ...] = ("walk",) if drifts - walks < CLEAR_LOG_ODDS else ()
    ends = forecast(structure, times[[0, -1]])
    span = float(times[-1] - times[0])
    rate, u = float(np.diff(ends.mean)[0]) / span, float(np.hypot(*ends.u)) / span
    return Found("drift", "", rate, u, both - stays, (float(times[0]), float(times[-1])), walk + rivals)


def _found(structure: Structure, place: int, number: int) -> Found:
    """A change or an offset: against a machine that stays as it is, and against all else that may be in its place."""
    own, base = structure.candidates[number], structure.without(place)
    stays, walks = _by_walk(base)
    whole = float(logsumexp(base.log_evidences))
    weights: dict[Form, float] = {kind: whole + base.of_kind(kind) for kind in KINDS}
    log_odds = weights[own.kind] - stays
    rivals: dict[Form, float] = {form: weight for form, weight in weights.items() if form != own.kind}
    rivals["walk"] = walks
    tied = tuple(form for form, weight in rivals.items() if weight > max(weights[own.kind] - CLEAR_LOG_ODDS, stays))
    first, last, name = _place(structure.candidates, base.log_odds, own, structure.series.times)
    size, u = _size(structure, 1 + place)
    return Found(own.kind, name, size, u, log_odds, (first, last), tied)


def _by_walk(structure: Structure) -> tuple[float, float]:
    """Log evidence of a machine that stays as it is, and of one that wanders, beside the terms of a structure."""
    wanders = np.array([noise.walk > 0.0 for noise in structure.noises])
    return tuple(float(logsumexp(structure.log_evidences[rows])) for rows in (~wanders, wanders))  # type: ignore[return-value]


def _place(candidates: Sequence[Candidate], log_odds: Array, own: Candidate, times: Array) -> tuple[float, float, str]:
    """First and last date of a change, between which it lies with a probability of 95 %, and the event there."""
    if own.kind == "method":
        return float(times[0]), float(times[-1]), own.name
    changes = [(each, odds) for each, odds in zip(candidates, log_odds, strict=True) if each.kind == "change"]
    share = np.exp([odds for _, odds in changes] - logsumexp([odds for _, odds in changes]))
    order = np.argsort(-share)
    count = 1 + int(np.searchsorted(np.cumsum(share[order]), CHANGE_PROBABILITY))
    chosen = sorted(changes[k][0].first for k in order[:count].tolist())
    likeliest = changes[int(order[0])][0]
    return float(times[chosen[0] - 1]), float(times[chosen[-1]]), likeliest.name


def _size(structure: Structure, column: int) -> tuple[float, float]:
    """Mean and standard deviation of a coefficient, over all noises."""
    means = np.array([each.mean[column] for each in structure.posteriors])
    variances = np.array([each.covariance[column, column] for each in structure.posteriors])
    mean = float(structure.weights @ means)
    return mean, float(np.sqrt(structure.weights @ (variances + (means - mean) ** 2)))
