"""Verdicts: of each term of a structure, its log odds against none, and against each rival in its place.

Against none, sizes and noise are found again without the term: they may explain a part of it.

A rival is another family of terms that explains the data about as well in the place of a term. A term and its rivals
are compared in double precision, each with the likeliest of its finer members; a rival with a moment is compared at the
moment of the term. The rivals of a wave are waves of other periods too: between few positions many are equally likely.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calibration.diagnosis.candidates import COARSE_SHARE_OF_ODDS, REFINED, Candidates, by_family
from calibration.diagnosis.search import LEAST_RETRIED_LOG_ODDS
from calibration.diagnosis.waves import waves
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Structure
from calibration.gaussian_terms.term import Term
from kinematics.transforms import Array

LASTING_LOG_ODDS = 100.0
"""Log odds that stay clear when sizes and noise are found again: these take up to nine tenths of them."""
RESOLVED = 1.0
"""Least difference of two waves, periods over the travel, that positions all over it resolve (Rayleigh)."""

Verdict = Literal["strong", "tied", "weak", "open period"]


class Rival(NamedTuple):
    """A term that may be there in the place of another one."""

    term: Term
    log_odds: float
    """Of the term of the structure against this one."""


@dataclass(frozen=True)
class Judged:
    """A term of a structure with the evidence for it."""

    number: int
    """Its number among the terms of the structure."""
    term: Term
    log_odds: float
    """Against none, beside the other terms."""
    rivals: tuple[Rival, ...]
    """Those from which the data do not tell it clearly, the likeliest first; other periods of a wave too."""
    forms: tuple[Rival, ...] = ()
    """Other forms of the same cause, likewise: with another course in time, or with a temperature, ..."""

    @property
    def alternatives(self) -> tuple[Rival, ...]:
        """Rivals that are other causes: of another kind, elsewhere, or, one for each, by the temperature of others."""
        own, sensors = _cause_of(self.term), sensors_of(self.term)
        others = [each for each in self.rivals if each.term.named and _cause_of(each.term) != own]
        likeliest = {sensors_of(each.term): each for each in reversed(self.forms)}
        others += [each for named, each in likeliest.items() if sensors and named and named != sensors]
        return tuple(sorted(others, key=lambda each: each.log_odds))

    @property
    def variables(self) -> tuple[str, ...]:
        """Variables of a function; of a wave its axis."""
        return self.term.variables or ((self.term.where,) if self.term.where else ())

    @property
    def periods(self) -> tuple[float, ...]:
        """The likely periods of a wave whose period the data leave open, its own one first; else empty."""
        own = period_of(self.term)
        others = [period_of(each.term) for each in self.rivals if each.term.family == self.term.family]
        found = tuple(each for each in others if each is not None)
        return (own, *found) if own is not None and found else ()

    @property
    def verdict(self) -> Verdict:
        """How sure the term is."""
        if self.periods:
            return "open period"
        if self.alternatives:
            return "tied"
        return "strong" if self.log_odds >= CLEAR_LOG_ODDS else "weak"


def judged(candidates: Candidates) -> list[Judged]:
    """The terms of a structure, in its order, with the evidence for each."""
    return [_judged(candidates, number) for number in range(len(candidates.structure.terms))]


def _judged(candidates: Candidates, number: int) -> Judged:
    """A term with the evidence for it."""
    place = _Place.of(candidates, number)
    term = candidates.structure.terms[number]
    own = alone = candidates.own(number)
    if term.family in place.families:
        # the members of its family may be likelier together than the one that was chosen
        own = max(own, place.of_members(term.family)[1])
    rivals = [*_of_other_families(place, term, own), *_waves(place, term, own)]
    against_none = own if own > LASTING_LOG_ODDS else min(own, _fitted_again(candidates.structure, number))
    return Judged(number, term, against_none, _close(rivals), _close(_forms(place, term, alone)))


def _fitted_again(structure: Structure, number: int) -> float:
    """Log odds of a term against none, where sizes and noise are found again without it."""
    rest = structure.with_terms([term for i, term in enumerate(structure.terms) if i != number])
    return structure.total - rest.fitted().total


def _close(rivals: Iterable[Rival]) -> tuple[Rival, ...]:
    """The rivals from which the data do not tell a term clearly, the likeliest first."""
    return tuple(sorted((each for each in rivals if each.log_odds < CLEAR_LOG_ODDS), key=lambda each: each.log_odds))


def _forms(place: _Place, term: Term, own: float) -> Iterator[Rival]:
    """The likeliest member of each other form of a cause; members of one form differ in a time constant or a moment."""
    terms = place.candidates.terms
    members = [
        number
        for number, each in enumerate(terms)
        if each.named
        and each.family == term.family
        and each.name != term.name
        and place.near(own, place.members[number])
    ]
    best = {terms[number].name: number for number in sorted(members, key=place.members.__getitem__)}
    for number in best.values():
        other, odds, _ = place.candidates.refined(terms[number], {place.number})
        yield Rival(other, own - odds)


def _of_other_families(place: _Place, term: Term, own: float) -> Iterator[Rival]:
    """The likeliest member of each family of candidates that may explain the data about as well, or at its moment."""
    moment = moment_of(term)
    for family, (together, _) in place.families.items():
        if family == term.family:
            continue
        found = list(place.at_moment(family, moment))
        if place.near(own, together - LEAST_RETRIED_LOG_ODDS):
            found.append(place.of_members(family))
        if found:
            likeliest, odds = max(found, key=lambda each: each[1])
            yield Rival(likeliest, place.found_again(likeliest, own - odds))


class _Place(NamedTuple):
    """The place of a term of a structure, in which others are tried."""

    candidates: Candidates
    number: int
    members: Array
    """Log odds of all candidates in this place."""
    families: Mapping[Hashable, tuple[float, int]]
    """Of each family that may be there: log odds of its members together, and the number of its best member."""

    @classmethod
    def of(cls, candidates: Candidates, number: int) -> _Place:
        """The place of a term, by its number."""
        others = {each.family for i, each in enumerate(candidates.structure.terms) if i != number}
        members = candidates.odds({number})
        return cls(candidates, number, members, by_family(candidates.terms, members, others))

    def odds(self, terms: Sequence[Term]) -> Array:
        """Log odds `(len(terms),)` of terms in this place, against none."""
        return self.candidates.exact(terms, {self.number})

    def found_again(self, rival: Term, log_odds: float) -> float:
        """Log odds against a rival; where these are doubtful, with sizes found again beside it."""
        if not (rival.named and CLEAR_LOG_ODDS <= log_odds < CLEAR_LOG_ODDS - LEAST_RETRIED_LOG_ODDS):
            return log_odds
        structure = self.candidates.structure
        terms = [rival if i == self.number else term for i, term in enumerate(structure.terms)]
        return min(log_odds, structure.total - structure.with_terms(terms).with_sizes().total)

    def near(self, own: float, odds: float) -> bool:
        """True where a term with such log odds, once it is refined, may be a rival of one with its own log odds."""
        return own - odds < CLEAR_LOG_ODDS + COARSE_SHARE_OF_ODDS * abs(own)

    def of_members(self, family: Hashable) -> tuple[Term, float]:
        """The likeliest member of a family, refined, and the log odds of the family."""
        together, best = self.families[family]
        term, odds, first = self.candidates.refined(self.candidates.terms[best], {self.number})
        return term, max(odds, first + together - float(self.members[best]))

    def at_moment(self, family: Hashable, moment: float | None) -> Iterator[tuple[Term, float]]:
        """The member of a family nearest to a moment, and its log odds; nothing where it has none with a moment."""
        members: Sequence[Term] = [each for each in self.candidates.terms if each.family == family]
        apart: dict[Term, float] = {}
        for _ in range(REFINED if moment is not None else 0):
            known = ((each, moment_of(each)) for each in members)
            apart |= {each: abs(own - moment) for each, own in known if own is not None and moment is not None}
            if not apart:
                return
            finer = min(apart, key=apart.__getitem__).finer
            members = [] if finer is None else finer()
        if apart:
            nearest = min(apart, key=apart.__getitem__)
            yield nearest, float(self.odds([nearest])[0])


def _waves(place: _Place, term: Term, own: float) -> Iterator[Rival]:
    """Rivals of a wave that are no candidates: waves of other periods, one for each, of other forms and other axes."""
    period = period_of(term)
    if period is None or term.where is None:
        return
    moving = place.candidates.structure.data.observations.measurement.moving
    proposed = waves(place.candidates.structure, (place.number,))
    odds = place.odds(proposed)
    known = {term.family: [period]}
    for i in np.argsort(-odds).tolist():
        other, found = proposed[i], period_of(proposed[i])
        if own - odds[i] >= CLEAR_LOG_ODDS or found is None or other.where is None:
            continue
        low, high = moving[other.where]
        others = known.setdefault(other.family, [])
        if all(abs((high - low) * (1.0 / found - 1.0 / each)) > RESOLVED for each in others):
            others.append(found)
            likeliest, refined, _ = place.candidates.refined(other, {place.number})
            yield Rival(likeliest, own - refined)


def _cause_of(term: Term) -> Hashable:
    """What distinguishes a cause from others: its kind, place and direction; of two axes either may be the first."""
    axes = {axis for effect in term.effects for axis in effect.axes}
    components = {getattr(effect, "component", None) for effect in term.effects}
    return term.kind, frozenset(axes) if len(axes) > 1 else term.where, frozenset(components)


def sensors_of(term: Term) -> frozenset[str]:
    """Names of the sensors whose temperatures a term follows."""
    return frozenset(sensor for effect in term.effects for sensor in effect.sensors)


def moment_of(term: Term) -> float | None:
    """The moment, s, of a jump; None for other terms."""
    return next((each.moment for each in term.effects if each.moment is not None), None)


def period_of(term: Term) -> float | None:
    """The period of a wave along an axis, mm or degrees; None for other terms."""
    return next((each.shortest_wave[1] for each in term.effects if each.PERIODIC and each.shortest_wave), None)
