"""Questions that the data leave open, and the log odds with which a design is expected to answer them.

A cause is compared at its fitted size with a rival of any size, or with none. The log odds after a design are those of
the data, and what the evidence of both is expected to gain by it; the same with the rival as the cause.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from scipy import linalg

from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.conclusion.mixture import InPlace
from calibration.diagnosis.conclusion.verdict import Judged, Rival, sensors_of
from calibration.gaussian_terms.gains import expected_gain
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Structure
from calibration.gaussian_terms.term import Term
from kinematics.transforms import Array

SIGMA_OF_99 = 2.33
"""Standard deviations of a normal distribution for a probability of 99 %."""
ENOUGH_LOG_ODDS = (SIGMA_OF_99 / 2.0**0.5 + (SIGMA_OF_99**2 / 2.0 + CLEAR_LOG_ODDS) ** 0.5) ** 2
"""Expected log odds L that are clear with this probability, since they have a variance of 2 L; more do not count."""
Kind = Literal["function", "tie", "period", "weak"]


class Signal(NamedTuple):
    """A term of some size."""

    columns: np.ndarray
    """Numbers of its columns."""
    size: Array | None
    """Its coefficients `(width,)`; None for one that is tried, and is not thought to be there."""


@dataclass(frozen=True, eq=False)
class Question:
    """Whether a signal is there, and not another one."""

    kind: Kind
    name: str
    one: Signal
    others: tuple[tuple[Signal, float], ...]
    """Rivals, with the log odds of the signal against each by the data."""
    without: tuple[int, ...]
    """Terms of the structure in whose place the signals are."""
    log_odds: float = 0.0
    """Of the signal against none, by the data."""
    other: str = ""
    """Name of the rivals."""
    term: Term | None = None
    rival: Term | None = None

    def answer(self, now: Known, after: Known) -> float:
        """Least of the log odds that are expected from the data with a design, whichever of the signals is there."""
        now, after = now.without(self.without), after.without(self.without)
        if not self.others:
            return self.log_odds + after.gain(self.one, self.one) - now.gain(self.one, self.one)
        found = []
        for other, odds in self.others:
            for true, wrong, before in ((self.one, other, odds), (other, self.one, -odds)):
                if true.size is not None:
                    found.append(before + after.lead(true, wrong) - now.lead(true, wrong))
        return min(found)


@dataclass(frozen=True)
class Known:
    """Products of the columns of a structure's geometry, of its terms, and of others."""

    products: Array
    structure: Structure
    _without: dict[tuple[int, ...], Known] = field(default_factory=dict, init=False, repr=False, compare=False)

    def without(self, numbers: tuple[int, ...]) -> Known:
        """Products less what the geometry and the terms explain at their sizes, but for the terms of some numbers."""
        if numbers not in self._without:
            self._without[numbers] = self._less(numbers)
        return self._without[numbers]

    def _less(self, numbers: tuple[int, ...]) -> Known:
        left_out = [self.structure.columns_of(number) for number in numbers]
        kept = np.setdiff1d(np.arange(len(self.structure.sizes)), np.concatenate([np.zeros(0, int), *left_out]))
        size = self.structure.sizes[kept]
        low = np.linalg.cholesky(self.products[np.ix_(kept, kept)] * size[:, None] * size + np.eye(len(kept)))
        through = linalg.solve_triangular(low, self.products[kept] * size[:, None], lower=True)
        return Known(self.products - through.T @ through, self.structure)

    def gain(self, tried: Signal, true: Signal) -> float:
        """Log evidence that a signal is expected to gain where a true one is there."""
        block = self.products[np.ix_(tried.columns, tried.columns)]
        size = np.zeros(len(true.columns)) if true.size is None else true.size
        return expected_gain(block, self.products[np.ix_(tried.columns, true.columns)] @ size)

    def lead(self, true: Signal, wrong: Signal) -> float:
        """Expected log odds of a true signal against a wrong one."""
        return self.gain(true, true) - self.gain(wrong, true)


class Asked(NamedTuple):
    """Questions, and the rivals in them."""

    rivals: list[Term]
    """Their columns follow those of the structure's terms."""
    questions: list[Question]


def questions(
    candidates: Candidates, judged: Sequence[Judged], places: Sequence[InPlace], functions: Sequence[Judged]
) -> Asked:
    """All questions on the terms of a structure.

    functions: those without a name, in question together; their two columns are behind the rivals.
    """
    structure, asked = candidates.structure, Asked([], [])
    for each in judged:
        if each.term.named:
            asked.questions.extend(_of_term(_Place(candidates, each, places[each.number]), asked.rivals))
    if functions:
        first = structure.data.geometry.width + sum(term.width for term in (*structure.terms, *asked.rivals))
        one, other = (Signal(np.array([first + i]), np.ones(1)) for i in range(2))
        names = dict.fromkeys(variable for each in functions for variable in each.term.variables)
        numbers = tuple(each.number for each in functions)
        name = f"the dependence on {', '.join(names)}"
        asked.questions.insert(0, Question("function", name, one, ((other, 0.0),), numbers))
    return asked


class _Place(NamedTuple):
    """A term of a structure, with what may be in its place."""

    candidates: Candidates
    judged: Judged
    place: InPlace

    @property
    def sizes(self) -> dict[Term, Array]:
        """The coefficients of the term and of its rivals."""
        parts = zip(self.place.terms, self.place.parts, self.place.sizes, strict=True)
        return {term: part.posterior(size)[1] for term, part, size in parts}

    def near(self, rival: Rival) -> Iterator[tuple[Term, float]]:
        """A rival, and the members of its family that the data with a design may prefer, with their log odds.

        A rival may have another time constant, length or moment when it is fitted to more rows. One in the family of
        the term is the same cause by another sensor, which its members keep.
        """
        yield rival.term, rival.log_odds
        family, sensors = self.candidates.members(rival.term.family), sensors_of(rival.term)
        if rival.term.family == self.judged.term.family:
            family = [each for each in family if sensors_of(each) == sensors]
        members = [*family, *([] if rival.term.finer is None else rival.term.finer())]
        odds = self.candidates.own(self.judged.number) - self.candidates.exact(members, {self.judged.number})
        yield from ((term, own) for term, own in zip(members, odds.tolist(), strict=True) if own < ENOUGH_LOG_ODDS)


def _of_term(place: _Place, rivals: list[Term]) -> Iterator[Question]:
    """Questions on a cause; rivals that they need are added to the others."""
    each, structure, sizes = place.judged, place.candidates.structure, place.sizes
    one = Signal(structure.columns_of(each.number), sizes[each.term])
    name, without = _name(each.term), (each.number,)

    def against(some: Iterable[tuple[Term, float]]) -> Iterator[tuple[Signal, float]]:
        for term, odds in some:
            rivals.append(term)
            together = structure.with_terms((*structure.terms, *rivals))
            yield Signal(together.columns_of(len(together.terms) - 1), sizes.get(term)), odds

    if each.periods:
        periods = [rival for rival in each.rivals if rival.term.family == each.term.family]
        yield Question("period", name, one, tuple(against(periods)), without, term=each.term)
        return
    for rival in each.alternatives:
        others = tuple(against(place.near(rival)))
        yield Question("tie", name, one, others, without, 0.0, _name(rival.term), each.term, rival.term)
    if each.log_odds < CLEAR_LOG_ODDS:
        yield Question("weak", name, one, (), without, each.log_odds, term=each.term)


def _name(term: Term) -> str:
    return term.effects[0].name if term.effects else term.name
