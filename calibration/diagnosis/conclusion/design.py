"""Causes that the design of a measurement can show and separate, by its rows alone: no reading enters.

A cause of typical size is compared with none, and with each other family of causes in its place, by the log odds that
are expected of the readings. Error motions have their sizes before any data, and the noise is as specified.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.conclusion.visibility import typical_gains
from calibration.diagnosis.dictionary import Dictionary
from calibration.gaussian_terms.gains import log_gains_by_squares
from calibration.gaussian_terms.posterior import ROUNDING
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Data, Structure
from calibration.gaussian_terms.term import Term
from kinematics.error_model.priors import SIZES_IN_TYPICAL
from kinematics.transforms import Array

PARALLEL = 1e-6
"""Share of the largest eigenvalue of the products of some columns below which it is rounding: about eight times that of
single precision."""
COSINE_DECIMALS = -round(math.log10(PARALLEL))
"""Decimals of a cosine beyond which causes with equal signals differ by rounding only."""
SAME_LOG_ODDS = 1e-4
"""Difference of log odds below which forms are shown equally well; their products have single precision."""


class Designed(NamedTuple):
    """A cause in the design of a measurement."""

    kind: str
    name: str
    verdict: Literal["visible", "tied", "not visible"]
    share: float
    """Share of its signal that neither error motions nor the registration explain."""
    log_odds: float
    """Expected of the cause against none."""
    tied_with: tuple[tuple[str, float], ...]
    """Names of the causes from which the rows do not tell it, the most similar first, with the cosines."""
    remedy: str
    """Measurement that would show it."""


def designed(data: Data, dictionary: Dictionary) -> list[Designed]:
    """The causes of a dictionary, in the design of data; the forms of a cause, at all moments, are one."""
    causes = [term for term in dictionary.terms if _is_cause(term)]
    if not causes:
        return []
    names: dict[str, list[int]] = {}
    for number, term in enumerate(causes):
        names.setdefault(term.effects[0].name, []).append(number)
    structures = [Structure.first(data)]
    each = Candidates.of_each(structures, dictionary.part(causes))
    gains = typical_gains(next(each))
    structures.append(structures[0].with_terms([causes[_best(numbers, gains)] for numbers in names.values()]))
    return list(_Table(next(each), names).rows())


def _is_cause(term: Term) -> bool:
    """True for a cause, but for a periodic error, whose period is not of the design."""
    return term.named and bool(term.effects) and not any(effect.PERIODIC for effect in term.effects)


def _best(numbers: Sequence[int], gains: Array) -> int:
    """The first of some forms that is shown as well as any of them, but for rounding."""
    least = gains[list(numbers)].max() - SAME_LOG_ODDS
    return next(number for number in numbers if gains[number] >= least)


class _Tried(NamedTuple):
    """All forms of causes, where the best shown form of one cause is there, of typical size."""

    log_odds: Array
    """Expected of each form against none `(terms, causes)`."""
    explained: Array
    """Squares of the signal that each form explains `(terms, causes)`."""

    def together(self, names: Mapping[str, Sequence[int]]) -> Array:
        """Expected log odds of the forms of each cause together against none `(names, causes)`, where one is there."""
        return np.array([np.logaddexp.reduce(self.log_odds[list(forms)], axis=0) for forms in names.values()])


class _Table(NamedTuple):
    """The best shown form of each cause, as terms of a structure, and all forms as candidates."""

    candidates: Candidates
    names: Mapping[str, Sequence[int]]
    """Numbers of the forms of each cause among the candidates."""

    def rows(self) -> Iterator[Designed]:
        """The causes."""
        present, terms = self.candidates.present, self.candidates.structure.terms
        tried = self._tried()
        together = tried.together(self.names)
        for number, (own, term) in enumerate(zip(self.names, terms, strict=True)):
            columns = np.arange(present.starts[number], present.starts[number + 1])
            signal = max(float(np.trace(present.gram[np.ix_(columns, columns)])), np.finfo(float).tiny)
            whole = float(np.sum(self.candidates.structure.whitener.with_stated(term.columns) ** 2))
            log_odds = float(together[number, number])
            ties = {} if log_odds < CLEAR_LOG_ODDS else dict(self._ties(tried, together[:, number], number, signal))
            yield Designed(
                term.kind,
                own,
                "not visible" if log_odds < CLEAR_LOG_ODDS else "tied" if ties else "visible",
                float(np.sqrt(signal / max(whole, signal, ROUNDING))),
                log_odds,
                tuple(sorted(ties.items(), key=lambda tie: (-round(tie[1], COSINE_DECIMALS), tie[0]))),
                term.effects[0].shown_by(self.candidates.structure.data.observations.measurement.state),
            )

    def _ties(self, tried: _Tried, log_odds: Array, number: int, signal: float) -> Iterator[tuple[str, float]]:
        """Names and cosines of the other causes that are expected to explain the signal of one about as well.

        log_odds `(names,)`: of each cause against none, where the one is there.
        """
        least = log_odds[number] - CLEAR_LOG_ODDS
        for other, (name, forms) in enumerate(self.names.items()):
            if other != number and log_odds[other] > least:
                nearest = forms[int(np.argmax(tried.log_odds[list(forms), number]))]
                yield name, float(np.sqrt(min(tried.explained[nearest, number] / signal, 1.0)))

    def _tried(self) -> _Tried:
        candidates, starts = self.candidates, self.candidates.present.starts
        factor = candidates.structure.noise.factor
        log_odds, explained = np.zeros((2, len(candidates.terms), len(self.names)))
        for group in candidates.groups:
            squares = np.add.reduceat(group.across**2, starts[:-1], axis=1)
            values = np.broadcast_to(group.values[:, None, :], squares.shape)
            log_odds[group.numbers] = log_gains_by_squares(values, squares + factor * values, SIZES_IN_TYPICAL, factor)
            least = PARALLEL * group.values.max(axis=1)[:, None, None]
            seen = values > np.maximum(least, np.finfo(np.float32).tiny)
            explained[group.numbers] = np.sum(np.where(seen, squares, 0.0) / np.where(seen, values, 1.0), axis=2)
        return _Tried(log_odds + np.array([[term.log_prior] for term in candidates.terms]), explained)
