"""The search for the likeliest structure: which causes and functions are there.

From a structure six moves lead to others: *add* a term, *drop* one, *exchange* one for a member of another family,
*refine* one (another time constant, period, moment), *split* one into several, *merge* two into one. The likeliest move
by closed-form odds is made, sizes and noise are found again, and the structure stays if its log posterior has risen.
Where no move is likely, the few likeliest causes are *retried*: added, or put in the place of another one, with sizes
and noise found again, since sizes that were found without a cause speak against it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.candidates import COARSE_SHARE_OF_ODDS, Candidates, Families
from calibration.diagnosis.dictionary import Dictionary
from calibration.diagnosis.followed import followed
from calibration.diagnosis.named import named
from calibration.diagnosis.nameless import nameless
from calibration.diagnosis.prior_odds import with_prior_odds
from calibration.diagnosis.waves import beside_waves, waves, waves_of_motions
from calibration.gaussian_terms.linearised import linearised
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.gaussian_terms.term import Term
from kinematics.error_model.priors import SIZES_IN_TYPICAL
from kinematics.running.progress import Progress, silent
from kinematics.transforms import Array

PRESENT = 3.0
"""Log odds from which a term is present: 20 to 1, one false cause in twenty doubtful ones."""
LEAST_POSTERIOR_RISE = 1.0
"""Least rise of the log posterior by a move between terms: less is decided by rounding and by the sizes."""
MOST_RETRIED, LEAST_RETRIED_LOG_ODDS = 6, -9.0
"""Number of causes that are retried, and the least log odds of these; they explain something of the data already."""
REFINED_AT_ONCE = 2
"""Of all that are tried at once: rivals of a term that are refined, and structures whose noise is found again."""
FIRST_FINE_SHARE = 0.1
"""Share of their sizes at which finer error motions are begun beside a wave; at most their prior size."""
FOLLOWED = 2
"""Most times that errors are sought again where the axes were behind their commands."""
MOST_SPLIT_TERMS = 3
"""Most terms into which one is split; one with fewer columns is not split."""
SPLIT_FAMILIES = 12
"""Families among which the parts of a split are looked for."""


@dataclass(frozen=True)
class Found:
    """The likeliest structure, and all candidates beside it."""

    structure: Structure
    candidates: Candidates


class Move(NamedTuple):
    """A step to another structure, with its expected rise of the log posterior."""

    rise: float
    name: str
    terms: tuple[Term, ...]


def search(observations: Observations, progress: Progress = silent) -> Found:
    """The likeliest structure of observations, which are linearised again about the errors of the machine.

    Where axes are so far behind their commands that other errors change, these are sought again where the axes were.
    """
    structure = linearised(Structure.first(Data.of(observations)).fitted())
    commanded = structure.data.observations
    found = _searched(structure, progress)
    for _ in range(FOLLOWED):
        again = followed(found.structure, commanded)
        if again is None:
            break
        progress("axes behind their commands")
        found = _searched(Structure.first(Data.of(again)).fitted(), progress)
    return found


def _searched(structure: Structure, progress: Progress) -> Found:
    """The likeliest structure that a search from one without terms finds."""
    own = structure.data.observations
    dictionary = Dictionary(with_prior_odds([*named(own), *nameless(own)], own.priors))
    return Search(dictionary, progress).from_structure(structure)


class Search:
    """A search: what it has tried, and the way from structure to structure."""

    def __init__(self, dictionary: Dictionary, progress: Progress = silent) -> None:
        self._dictionary, self._progress = dictionary, progress
        self._tried: set[frozenset[Hashable]] = set()

    def from_structure(self, structure: Structure) -> Found:
        """The likeliest structure that the moves reach."""
        self._tried.add(_key(structure.terms))
        candidates = self._candidates(structure)
        while better := self._moved(candidates) or self._retried(candidates) or self._out_of_motions(candidates):
            candidates = self._candidates(better)
        return Found(candidates.structure, candidates)

    def _candidates(self, structure: Structure) -> Candidates:
        return Candidates.of(structure, self._dictionary, waves(structure))

    def _moved(self, candidates: Candidates) -> Structure | None:
        """The structure by the likeliest move that raises the log posterior; None where none does."""
        structure = candidates.structure
        moves = [*additions(candidates), *_changes(candidates)]
        for move in sorted(moves, key=lambda each: -each.rise):
            if _key(move.terms) in self._tried:
                continue
            self._tried.add(_key(move.terms))
            self._progress(f"{move.name} ({move.rise:.1f})")
            found = structure.with_terms(parts_of(move.terms)).fitted()
            if worth(found) > worth(structure):
                return found
        return None

    def _retried(self, candidates: Candidates) -> Structure | None:
        """The structure with another cause, or another one in the place of one, sizes and noise found again.

        None where none is likelier. A few of the likeliest are tried.
        """
        found = []
        for terms in map(parts_of, (*_doubtful_causes(candidates), *_doubtful_exchanges(candidates))):
            if _key(terms) not in self._tried:
                self._tried.add(_key(terms))
                found.append(candidates.structure.with_terms(terms).with_sizes())
        return self._better(found, candidates.structure)

    def _better(self, sized: Sequence[Structure], structure: Structure) -> Structure | None:
        """The likeliest of some structures with noise and outliers found again, if it is likelier than a structure.

        Only the likeliest ones by their sizes alone are looked at, which the noise may make likelier than it.
        """
        likely = sorted(sized, key=worth, reverse=True)[:REFINED_AT_ONCE]
        doubtful = (each.fitted() for each in likely if worth(each) > worth(structure) + LEAST_RETRIED_LOG_ODDS)
        best = max(doubtful, key=worth, default=structure)
        return best if worth(best) > worth(structure) else None

    def _out_of_motions(self, candidates: Candidates) -> Structure | None:
        """The structure with a wave in the place of finer error motions, of the likeliest number of harmonics.

        None without one. The error motions are begun smoother than they are: sizes that were found without the wave
        explain it.
        """
        structure = candidates.structure
        left = beside_waves(structure)
        started: dict[Hashable, _Started] = {}
        for term in waves_of_motions(structure):
            each = _Started.of(term, structure, left)
            before = started[term.family].explained if term.family in started else 0.0
            if each.explained > before:
                started[term.family] = each
        smooth = smoothed(structure)
        sized = [each.beside(smooth).with_sizes() for each in started.values() if self._is_new(structure, each)]
        if sized:
            best = max(sized, key=worth).terms[-1]
            finer = [] if best.finer is None else [term for term in best.finer() if term.width > best.width]
            more = (_Started.of(term, structure, left) for term in finer)
            sized += [each.beside(smooth).with_sizes() for each in more]
        return self._better(sized, structure)

    def _is_new(self, structure: Structure, started: _Started) -> bool:
        """True if a term has not been tried beside a structure; it counts as tried then."""
        key = _key((*structure.terms, started.term))
        known = key in self._tried
        self._tried.add(key)
        return not known


class _Started(NamedTuple):
    """A term by itself, of any size."""

    term: Term
    size: float
    """RMS of its coefficients."""
    explained: float
    """Squares that it explains of a whitened residual."""

    @classmethod
    def of(cls, term: Term, structure: Structure, left: Array) -> _Started:
        """A term beside nothing else, with the largest prior size, in a whitened residual `(N,)` of a structure."""
        columns = structure.whitener.columns(term.columns)
        precision = structure.noise.factor / SIZES_IN_TYPICAL[-1] ** 2 * np.eye(term.width)
        coefficients = np.linalg.solve(columns.T @ columns + precision, columns.T @ left)
        size = float(np.sqrt(np.mean(coefficients**2)))
        return cls(term, max(size, float(SIZES_IN_TYPICAL[0])), float(left @ columns @ coefficients))

    def beside(self, structure: Structure) -> Structure:
        """The structure with the term, of this size."""
        found = structure.with_terms((*structure.terms, self.term))
        return found.resized(np.concatenate([found.band_sizes, structure.term_sizes, [self.size]]))


def smoothed(structure: Structure) -> Structure:
    """The structure with smaller sizes of the error motions that may contain a wave."""
    geometry = structure.data.geometry
    smoother = np.minimum(FIRST_FINE_SHARE * structure.band_sizes, geometry.first_sizes)
    bands = np.where(geometry.wavy, smoother, structure.band_sizes)
    return structure.resized(np.concatenate([bands, structure.term_sizes]))


def worth(structure: Structure) -> float:
    """The log posterior of a structure, less the odds that each term must have to be reported."""
    return structure.total - PRESENT * len(structure.terms)


def additions(candidates: Candidates) -> Iterator[Move]:
    """The likeliest causes that may be added."""
    structure = candidates.structure
    for odds, term in _likeliest(candidates, (), REFINED_AT_ONCE + 1):
        if odds > PRESENT:
            yield Move(odds - PRESENT, f"add {term.name}", (*structure.terms, term))


def _doubtful_causes(candidates: Candidates) -> Iterator[tuple[Term, ...]]:
    """Terms with one of a few causes that already explain something of the data."""
    families = candidates.by_family(candidates.odds())
    gains = [
        (odds - candidates.terms[best].log_prior, best)
        for odds, best in families.values()
        if odds > LEAST_RETRIED_LOG_ODDS
    ]
    for _, best in sorted((each for each in gains if each[0] > LEAST_POSTERIOR_RISE), reverse=True)[:MOST_RETRIED]:
        yield (*candidates.structure.terms, candidates.terms[best])


def _doubtful_exchanges(candidates: Candidates) -> Iterator[tuple[Term, ...]]:
    """Terms with a rival in the place of a cause, which sizes found beside the cause speak for."""
    for number, term in enumerate(candidates.structure.terms):
        least = candidates.own(number) + LEAST_RETRIED_LOG_ODDS
        rest = tuple(other for other in candidates.structure.terms if other is not term)
        for odds, rival in _likeliest(candidates, (number,), REFINED_AT_ONCE) if term.named else ():
            if odds > least:
                yield (*rest, rival)


def _changes(candidates: Candidates) -> Iterator[Move]:
    """What may happen to the terms that are present."""
    structure, every_row = candidates.structure, candidates.with_every_row()
    for number, term in enumerate(structure.terms):
        own = candidates.own(number)
        margin = LEAST_POSTERIOR_RISE + COARSE_SHARE_OF_ODDS * abs(own)
        rest = tuple(other for other in structure.terms if other is not term)
        if own < PRESENT:
            yield Move(PRESENT - own, f"drop {term.name}", rest)
        better, odds, first = every_row.refined(
            term, (number,), candidates.members(term.family), LEAST_POSTERIOR_RISE / 2.0
        )
        if better is not term:
            yield Move(odds - first, f"refine {term.name}", (*rest, better))
        for odds, rival in _likeliest(candidates, (number,), REFINED_AT_ONCE):
            if odds > max(own, PRESENT) + margin:
                yield Move(odds - own, f"exchange {term.name} for {rival.name}", (*rest, rival))
        for odds, rival in _periodic(candidates, (number,)):
            if odds > max(own, PRESENT) + margin:
                yield Move(odds - own, f"exchange {term.name} for {rival.name}", (*rest, rival))
        if term.width >= MOST_SPLIT_TERMS and term.named:
            parts, joint = _parts(candidates, number)
            if len(parts) > 1 and joint > own + margin + PRESENT * (len(parts) - 1):
                split = joint - own - PRESENT * (len(parts) - 1)
                yield Move(split, f"split {term.name}", (*rest, *parts))
    yield from _merged(candidates)


def _merged(candidates: Candidates) -> Iterator[Move]:
    """One term in the place of two."""
    terms = candidates.structure.terms
    for one in range(len(terms)):
        for other in range(one):
            joint = candidates.own(one) + candidates.own(other, (one,)) - PRESENT
            rest = tuple(term for number, term in enumerate(terms) if number not in (one, other))
            rivals = [*_likeliest(candidates, (one, other), 1), *_periodic(candidates, (one, other))]
            for odds, rival in rivals:
                if odds > joint + LEAST_POSTERIOR_RISE + COARSE_SHARE_OF_ODDS * abs(joint):
                    name = f"merge {terms[one].name} and {terms[other].name} to {rival.name}"
                    yield Move(odds - joint, name, (*rest, rival))


def _periodic(candidates: Candidates, without: Sequence[int]) -> Iterator[tuple[float, Term]]:
    """Log odds and best member of the likeliest periodic error in the place of periodic errors of one axis.

    They are sought in what would be left without these: what these leave has no period of theirs.
    """
    structure = candidates.structure
    terms = [structure.terms[number] for number in without]
    if len({term.where for term in terms}) > 1 or not all(map(_repeats, terms)):
        return
    proposed = [term for term in waves(structure, without) if term.where == terms[0].where]
    if proposed:
        odds = candidates.exact(proposed, without)
        best = int(np.argmax(odds))
        term, own, _ = candidates.refined(proposed[best], without, least=LEAST_POSTERIOR_RISE / 2.0)
        yield own, term


def _repeats(term: Term) -> bool:
    """True for a periodic error."""
    return bool(term.effects) and all(effect.PERIODIC for effect in term.effects)


def _likeliest(candidates: Candidates, without: Sequence[int], count: int) -> Iterator[tuple[float, Term]]:
    """Log odds and best member of the likeliest families that are not present, but for some terms left out."""
    families: Families = candidates.by_family(candidates.odds(without))
    for odds, best in sorted(families.values(), key=lambda each: -each[0])[:count]:
        better, own, _ = candidates.refined(candidates.terms[best], without, least=LEAST_POSTERIOR_RISE / 2.0)
        yield max(odds, own), better
    if (whole := candidates.whole(without)) is not None:
        better, own, _ = candidates.refined(whole, without, least=LEAST_POSTERIOR_RISE / 2.0)
        yield own - PRESENT * (len(better.parts) - 1), better


def parts_of(terms: Sequence[Term]) -> tuple[Term, ...]:
    """The terms, with the parts of causes in several places in the place of these."""
    return tuple(part for term in terms for part in term.parts or (term,))


def _parts(candidates: Candidates, number: int) -> tuple[list[Term], float]:
    """Several terms, one after the other, in the place of one; and their log odds together."""
    structure = candidates.structure
    families: Families = candidates.by_family(candidates.odds((number,)))
    short = [
        candidates.terms[best] for _, best in sorted(families.values(), key=lambda each: -each[0])[:SPLIT_FAMILIES]
    ]
    rest = tuple(term for i, term in enumerate(structure.terms) if i != number)
    parts: list[Term] = []
    joint = 0.0
    while len(parts) < MOST_SPLIT_TERMS:
        odds: Array = candidates.beside((*rest, *parts)).exact(short)
        best = int(np.argmax(odds))
        if odds[best] < PRESENT:
            break
        joint += float(odds[best])
        parts.append(short.pop(best))
    return parts, joint


def _key(terms: Sequence[Term]) -> frozenset[Hashable]:
    return frozenset((term.name, term.effects) for term in terms)
