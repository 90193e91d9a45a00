"""What is known of all parameters: their mean and covariance over everything that the data leave undecided.

- Rivals and other forms in the places of terms: the structures that they make, each with its probability.
- Terms that the data neither name nor exclude, each with the probability that it is there.
- Time constants, lags, lengths and periods, by the derivatives of the columns.

A function without a name is not what a calibration corrects, unless this is asked for: it is written as a displacement
of the tool whose mean is zero, and whose covariance is that of its second moments.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.conclusion.verdict import Judged
from calibration.diagnosis.nameless import second_moment
from calibration.diagnosis.search import PRESENT
from calibration.gaussian_terms.gains import log_gains
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Term
from kinematics.effects import Effect
from kinematics.error_model.priors import SIZES_IN_TYPICAL
from kinematics.transforms import Array

UNDECIDED = -PRESENT
"""Log odds from which a term counts, with its probability: below 1 to 20 it changes no uncertainty."""
RELATIVE_SHAPE_PRIOR = 0.4
"""Prior standard deviation of a relative change of a time constant, lag, length or period: members of a family differ
by a factor of about 2."""
MOST_STRUCTURES, COMPLETE_PROBABILITY = 12, 0.98
"""Most structures that are averaged, and their probability together from which the others do not count."""


class Parameters(NamedTuple):
    """Parameters of effects, in their units."""

    effects: tuple[Effect, ...]
    """Without their sizes; nonlinear parameters as they are."""
    values: Array
    """`(P,)`"""
    covariance: Array
    """`(P, P)`"""

    def sized(self) -> tuple[Effect, ...]:
        """The effects with their parameters and standard uncertainties."""
        u = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return tuple(
            effect.with_parameters(self.values[own].tolist(), u[own].tolist())
            for effect, own in zip(self.effects, _slices(self.effects), strict=True)
        )


class Likely(NamedTuple):
    """A structure with its probability."""

    structure: Structure
    probability: float


class InPlace(NamedTuple):
    """Terms that may be there in one place of a structure, each by itself beside the other terms."""

    terms: tuple[Term, ...]
    """That of the structure first."""
    parts: tuple[Added, ...]
    """The columns of each term."""
    sizes: tuple[float, ...]
    """The likeliest size of each, in prior sizes."""
    cosines: tuple[float, ...]
    """Cosine of what each would contribute to the observations, and what the first one does."""

    @classmethod
    def of(cls, structure: Structure, each: Judged) -> InPlace:
        """A term of a structure, its rivals and other forms."""
        terms = (each.term, *(other.term for other in (*each.rivals, *each.forms)))
        rest = structure.with_terms([term for i, term in enumerate(structure.terms) if i != each.number])
        together = Added.of(rest, np.concatenate([term.columns for term in terms], axis=2))
        slices = [slice(*own) for own in pairwise(np.cumsum([0, *(term.width for term in terms)]).tolist())]
        parts = [Added(together.block[own, own], together.along[own], together.moved[:, own]) for own in slices]
        sizes = (structure.term_sizes[each.number], *(part.likeliest_size for part in parts[1:]))
        means = [part.posterior(size)[1] for part, size in zip(parts, sizes, strict=True)]
        products = [
            float(means[0] @ together.block[slices[0], own] @ mean) for own, mean in zip(slices, means, strict=True)
        ]
        squares = [float(mean @ part.block @ mean) for part, mean in zip(parts, means, strict=True)]
        norms = np.sqrt(np.maximum(squares, np.finfo(float).tiny))
        return cls(terms, tuple(parts), sizes, tuple((np.abs(products) / (norms * norms[0])).tolist()))


class _Chosen(NamedTuple):
    """Terms that are chosen, one for each place."""

    lost: float
    """Log odds of the terms of the structure against these."""
    terms: tuple[Term, ...]
    sizes: tuple[float, ...]


def likely_structures(structure: Structure, judged: Sequence[Judged], places: Sequence[InPlace]) -> list[Likely]:
    """The likeliest structures by the rivals and other forms of the terms of one, with their probabilities."""
    chosen = [_Chosen(0.0, (), ())]
    for each, place in zip(judged, places, strict=True):
        lost = [0.0, *(other.log_odds for other in (*each.rivals, *each.forms))]
        longer = [
            _Chosen(before.lost + own, (*before.terms, term), (*before.sizes, size))
            for before in chosen
            for own, term, size in zip(lost, place.terms, place.sizes, strict=True)
            if all(term.family != other.family for other in before.terms)
        ]
        chosen = sorted(longer, key=lambda one: one.lost)[:MOST_STRUCTURES]
    weights = np.exp([-each.lost for each in chosen])
    count = min(int(np.searchsorted(np.cumsum(weights) / weights.sum(), COMPLETE_PROBABILITY)) + 1, len(chosen))
    shares = (weights[:count] / weights[:count].sum()).tolist()
    return [Likely(_with(structure, each), share) for each, share in zip(chosen, shares, strict=False)]


def _with(structure: Structure, chosen: _Chosen) -> Structure:
    """The structure with other terms, of some sizes."""
    grown = structure.with_terms(chosen.terms)
    return grown.resized(np.concatenate([structure.band_sizes, chosen.sizes]))


def averaged(
    structures: Sequence[Likely], undecided: Sequence[tuple[Term, float]], corrected: Collection[Term] = ()
) -> Parameters:
    """Parameters of the geometry, then of the effects of all terms, over some structures.

    undecided: terms that may be there beside each of them, with their log odds. corrected: functions without a name
    that the calibration corrects; of the others it has the uncertainty only.
    """
    each = [(Mixture.of(one.structure).with_undecided(undecided), one.probability) for one in structures]
    terms = list(dict.fromkeys(term for mixture, _ in each for term in mixture.terms if term.effects))
    effects = (*each[0][0].structure.data.geometry.effects, *(effect for term in terms for effect in term.effects))
    size = sum(len(effect.parameters) for effect in effects)
    mean, second = np.zeros(size), np.zeros((size, size))
    for mixture, probability in each:
        values, covariance = mixture.parameters(terms, corrected)
        mean += probability * values
        second += probability * (covariance + np.outer(values, values))
    return Parameters(effects, mean, second - np.outer(mean, mean))


class Change(NamedTuple):
    """A column that is the relative change of a nonlinear parameter of a term."""

    term: Term
    name: str
    """Field of its effects."""
    column: int


@dataclass(frozen=True)
class Mixture:
    """Mean and covariance of coefficients: of the geometry, of terms, and of changes of nonlinear parameters."""

    structure: Structure
    columns: dict[Term, np.ndarray]
    """Numbers of the columns of each term: of those of the structure, and further ones."""
    mean: Array
    """`(q,)`"""
    covariance: Array
    """`(q, q)`"""
    changes: tuple[Change, ...] = ()

    @classmethod
    def of(cls, structure: Structure) -> Mixture:
        """The posterior of a structure, its nonlinear parameters included."""
        columns = {term: structure.columns_of(number) for number, term in enumerate(structure.terms)}
        posterior = structure.over_sizes
        return cls(structure, columns, posterior.mean, posterior.covariance)._with_changes()

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms of the structure, and further ones."""
        return tuple(self.columns)

    def with_undecided(self, terms: Sequence[tuple[Term, float]]) -> Mixture:
        """With terms that may be there, each with its log odds, beside everything that is present."""
        found = self
        for term, odds in terms:
            found = found._with_possible(term, 1.0 / (1.0 + math.exp(-odds)))
        return found

    def _with_possible(self, term: Term, probability: float) -> Mixture:
        """With a term that is there with a probability."""
        added = Added.of(self.structure, term.columns)
        own, mean = added.posterior(added.likeliest_size)
        spread = probability * own + probability * (1.0 - probability) * np.outer(mean, mean)
        start = len(self.mean)
        found = self._with_columns(added, probability * mean, spread)
        return replace(found, columns={**self.columns, term: np.arange(start, start + term.width)})

    def _with_changes(self) -> Mixture:
        """With the relative changes of the nonlinear parameters of the terms of a structure."""
        changes: list[Change] = []
        tables: list[Array] = []
        for term, own in self.columns.items():
            for name, table in _derivatives(self.structure, term, self.mean[own]):
                changes.append(Change(term, name, len(self.mean) + len(changes)))
                tables.append(table)
        if not changes:
            return self
        added = Added.of(self.structure, np.stack(tables, axis=2))
        spread, _ = added.posterior(RELATIVE_SHAPE_PRIOR)
        return replace(self._with_columns(added, np.zeros(len(changes)), spread), changes=tuple(changes))

    def _with_columns(self, added: Added, mean: Array, spread: Array) -> Mixture:
        """With further columns, whose coefficients have a mean `(c,)` and a covariance `(c, c)`.

        The coefficients of the structure follow them as far as the data do not tell both apart.
        """
        moved = np.zeros((len(self.mean), len(mean)))
        moved[: len(added.moved)] = added.moved
        whole = np.concatenate([moved, np.eye(len(mean))])
        covariance = np.pad(self.covariance, (0, len(mean))) + whole @ spread @ whole.T
        return replace(self, mean=np.concatenate([self.mean + moved @ mean, mean]), covariance=covariance)

    def effect_of(self, term: Term) -> Parameters:
        """The effect of a term, with its size and covariance.

        Two effects that are fixed at different positions are one, fixed at a third one.
        """
        rows = self._rows(term)
        values, covariance = term.values(np.zeros(term.width)) + rows @ self.mean, rows @ self.covariance @ rows.T
        first, *others = term.effects
        if others:
            k, linear = len(first.parameters), np.array(first.linear)
            points = np.array([float(getattr(effect, "fixed_point", 0.0)) for effect in term.effects])
            each = values.reshape(len(points), k)[:, np.flatnonzero(linear)[0]]
            fixed = points[0] + float((points - points[0]) @ each) / (float(each.sum()) or 1.0)
            sums = np.concatenate([np.eye(k), *(np.diag(linear.astype(float)) for _ in others)], axis=1)
            values, covariance = sums @ values, sums @ covariance @ sums.T
            first = msgspec.structs.replace(first, fixed_point=round(fixed, 3))
        return Parameters((first,), values, covariance)

    def _rows(self, term: Term) -> Array:
        """The matrix `(P, q)` from all coefficients to the parameters of a term's effects, changes in units."""
        linear = np.concatenate([effect.linear for effect in term.effects])
        rows = np.zeros((len(linear), len(self.mean)))
        if term not in self.columns:
            return rows
        rows[np.ix_(linear, self.columns[term])] = term.parameters
        values, names = term.values(np.zeros(term.width)), np.array(list(_fields(term.effects)))
        for change in self.changes:
            if change.term is term:
                rows[names == change.name, change.column] = values[names == change.name]
        return rows

    def parameters(self, terms: Sequence[Term], corrected: Collection[Term] = ()) -> tuple[Array, Array]:
        """Mean `(P,)` and covariance `(P, P)` of the parameters of the geometry, then of the effects of some terms.

        Those of terms that are not there are zero. The mean of a function without a name is zero, and its covariance
        that of its second moments, unless it is one of `corrected`.
        """
        geometry = self.structure.data.geometry
        always = np.pad(geometry.parameters, ((0, 0), (0, len(self.mean) - geometry.width)))
        parts = [always, *(self._rows(term) for term in terms)]
        matrix = np.concatenate(parts)
        bare = [geometry.before, *(term.values(np.zeros(term.width)) for term in terms)]
        values, covariance = np.concatenate(bare) + matrix @ self.mean, matrix @ self.covariance @ matrix.T
        ends = np.cumsum([len(part) for part in parts]).tolist()
        for term, (low, high) in zip(terms, pairwise(ends), strict=True):
            if term in self.columns and not term.named and term not in corrected:
                own, columns = slice(low, high), self.columns[term]
                values[own], covariance[own, :], covariance[:, own] = 0.0, 0.0, 0.0
                within = self.covariance[np.ix_(columns, columns)]
                covariance[own, own] = second_moment(term, self.mean[columns], within)
        return values, covariance


class Added(NamedTuple):
    """Columns that are added to what is present in a structure."""

    block: Array
    """Their products `(c, c)`, less what is present explains of them, in the variance of the noise."""
    along: Array
    """Their products with the residual `(c,)`, likewise."""
    moved: Array
    """Change `(p, c)` of the coefficients that are present by each of theirs."""

    @classmethod
    def of(cls, structure: Structure, columns: Array) -> Added:
        """Columns `(n, d, c)` beside a structure."""
        equations, posterior, factor = structure.equations, structure.posterior, structure.noise.factor
        white = structure.whitener.columns(columns)
        through = structure.through(white)
        sizes = posterior.sizes[:, None]
        moved = -sizes * (posterior.root.T @ (posterior.root @ (sizes * through))) / factor
        block = (white.T @ white + through.T @ moved) / factor
        along = (white.T @ equations.residual - through.T @ posterior.mean) / factor
        return cls(block, along, moved)

    @property
    def likeliest_size(self) -> float:
        """The likeliest prior size of their coefficients."""
        gains = [log_gains(self.block[None], self.along[None], np.array([size]), 1.0)[0] for size in SIZES_IN_TYPICAL]
        return float(SIZES_IN_TYPICAL[int(np.argmax(gains))])

    def posterior(self, size: float) -> tuple[Array, Array]:
        """Covariance `(c, c)` and mean `(c,)` of their coefficients, for a prior size."""
        covariance = np.asarray(np.linalg.inv(self.block + np.eye(len(self.block)) / size**2), float)
        return covariance, covariance @ self.along


def _derivatives(structure: Structure, term: Term, coefficients: Array) -> Iterator[tuple[str, Array]]:
    """Name of each nonlinear parameter of a term's effects, and the change `(n, d)` by a relative change of it."""
    if term.parameters is None or all(all(effect.linear) for effect in term.effects):
        return
    values, linear = term.values(coefficients), np.concatenate([effect.linear for effect in term.effects])
    sized = Parameters(term.effects, values, np.zeros((len(values), len(values)))).sized()
    columns = structure.data.observations.columns(sized)
    names = np.array(list(_fields(term.effects)))
    for name in dict.fromkeys(names[~linear].tolist()):
        own = names == name
        yield name, columns[:, :, own] @ values[own]


def _slices(effects: Sequence[Effect]) -> list[slice]:
    """The slice of each effect in the parameters of all."""
    ends = np.cumsum([0, *(len(effect.parameters) for effect in effects)]).tolist()
    return [slice(low, high) for low, high in pairwise(ends)]


def _fields(effects: Sequence[Effect]) -> Iterator[str]:
    """The field of each parameter of effects, one after the other."""
    for effect in effects:
        for quantity in effect.quantities():
            value = getattr(effect, quantity.name)
            yield from [quantity.name] * (len(value) if isinstance(value, tuple) else 1)
