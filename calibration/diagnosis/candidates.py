"""Log odds of every term that is tried, in closed form, beside the terms of a structure or beside some of them.

For columns C of a candidate, made white, the evidence that they add depends on C'C and C'y less what is present
explains of both. What the geometry explains is removed once, for all candidates; what the terms of the structure
explain is removed for each question, so that "in the place of this term" costs no second pass over the columns.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.linalg import blas

from calibration.diagnosis.dictionary import KEPT_BYTES, Block, Dictionary, products
from calibration.diagnosis.forms import together
from calibration.gaussian_terms.gains import log_gains
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Term
from kinematics.error_model.priors import SIZES_IN_TYPICAL
from kinematics.transforms import Array

REFINED = 6
"""Most times that a term is refined, each time about eight times as closely."""
COARSE_SHARE_OF_ODDS = 2e-3
"""Share of its log odds by which a term is less likely than one between it and its neighbours."""


class Beyond(NamedTuple):
    """What the geometry of a structure, with its prior sizes, takes of the products of whitened columns."""

    kept: np.ndarray
    """Numbers `(k,)` of the columns of the geometry that take anything."""
    root: Array
    """Triangular root R `(k, k)`: R' R is the inverse of their products, and of the noise in their prior sizes."""
    along: Array
    """What is taken of the observations `(k,)`, in the directions of `taken`."""

    @classmethod
    def of(cls, structure: Structure) -> Beyond:
        """What the geometry of a structure takes."""
        posterior, p = structure.posterior, structure.data.geometry.width
        kept = posterior.kept[posterior.kept < p]
        root = posterior.root_of_kept[: len(kept), : len(kept)] * posterior.sizes[kept] / np.sqrt(posterior.factor)
        bare = cls(kept, root, np.zeros(0))
        return bare._replace(along=bare.taken(structure.of_geometry.along))

    def taken(self, through: Array) -> Array:
        """Roots `(k, ...)` of what is taken of columns, by their products `(p, ...)` with those of the geometry."""
        own = through[self.kept]
        if not own.size:
            return np.asarray(own)
        found = blas.dtrmm(1.0, self.root.T, own.reshape(len(own), -1).T, side=1, lower=0, overwrite_b=1)
        return np.asarray(found.T.reshape(own.shape))


class Present(NamedTuple):
    """The terms of a structure beyond its geometry."""

    beyond: Beyond
    taken: Array
    """Roots `(k, a)` of what the geometry takes of their columns."""
    gram: Array
    """Products `(a, a)` of what it leaves of these."""
    along: Array
    """Products `(a,)` of this with the observations."""
    starts: np.ndarray
    """First column of each term, and the number of columns at the end."""

    @classmethod
    def of(cls, structure: Structure, beyond: Beyond) -> Present:
        """The terms of a structure."""
        equations, p = structure.equations, structure.data.geometry.width
        taken = beyond.taken(equations.gram[:p, p:])
        starts = np.cumsum([0, *(term.width for term in structure.terms)])
        gram = equations.gram[p:, p:] - taken.T @ taken
        return cls(beyond, taken, gram, equations.along[p:] - taken.T @ beyond.along, starts)


class Columns(NamedTuple):
    """Terms of one width, conditional on the geometry, in the eigenvectors of their own products."""

    numbers: np.ndarray
    """`(m,)`"""
    values: Array
    """Eigenvalues of their products `(m, w)`."""
    along: Array
    """Products with the observations `(m, w)`."""
    across: Array
    """Products with the columns of the structure's terms `(m, a, w)`."""

    def gains(self, removed: Array, moved: Array, factor: float) -> Array:
        """Log evidence `(m,)` that each adds; sizes are equally likely.

        removed `(a', a)` and moved `(a',)`: what terms that are present take of products and of the observations.
        """
        less = np.asarray(removed @ self.across)
        along = self.along - np.einsum("maw,a->mw", less, moved)
        present, width = less.shape[1:]
        if 0 < present < width:
            each = [_by_update(self.values, less, along, size**2 / factor) for size in SIZES_IN_TYPICAL]
            quadratic, determinant = np.moveaxis(np.array(each), 1, 0)
            evidence = 0.5 * (quadratic / factor - determinant)
            return np.asarray(np.logaddexp.reduce(evidence, axis=0) - np.log(len(SIZES_IN_TYPICAL)))
        blocks = np.einsum("mw,wv->mwv", self.values, np.eye(width)) - np.swapaxes(less, 1, 2) @ less
        return log_gains(blocks, along, SIZES_IN_TYPICAL, factor)


def _by_update(values: Array, less: Array, along: Array, ratio: float) -> tuple[Array, Array]:
    """h' (1 / ratio + B)^-1 h and log det (1 + ratio B) of each candidate `(m,)`, B = diag(values) - less' less."""
    inverse = 1.0 / (1.0 / ratio + values)
    quadratic = np.sum(along**2 * inverse, axis=1)
    determinant = np.sum(np.log1p(ratio * values), axis=1)
    scaled = less * inverse[:, None, :]
    small = np.eye(less.shape[1]) - scaled @ np.swapaxes(less, 1, 2)
    beyond = np.einsum("maw,mw->ma", scaled, along)
    sign, log = np.linalg.slogdet(small)
    solved = np.linalg.solve(small, beyond[:, :, None])[:, :, 0]
    quadratic = quadratic + np.where(sign > 0, np.sum(beyond * solved, axis=1), 0.0)
    return quadratic, determinant + np.where(sign > 0, log, 0.0)


class Met:
    """Finer members of terms, and terms by their columns, beside one structure: each question about it meets the same.

    All are forgotten when their columns need more than KEPT_BYTES.
    """

    def __init__(self, structure: Structure, present: Present) -> None:
        self._structure, self._present, self._bytes = structure, present, 0
        self._finer: dict[Term, Sequence[Term]] = {}
        self._columns: dict[tuple[Term, ...], list[Columns]] = {}

    def finer(self, term: Term) -> Sequence[Term]:
        """The finer members of the family of a term; none where it has none."""
        if term not in self._finer:
            self._finer[term] = [] if term.finer is None else term.finer()
        return self._finer[term]

    def columns(self, terms: tuple[Term, ...]) -> list[Columns]:
        """Terms, by their width."""
        if terms not in self._columns:
            self._bytes += 8 * self._structure.data.observations.residual.size * sum(term.width for term in terms)
            if self._bytes > KEPT_BYTES:
                self._finer, self._columns, self._bytes = {}, {}, 0
            self._columns[terms] = _grouped(self._structure, self._present, _block(self._structure, terms))
        return self._columns[terms]


class Conditional(NamedTuple):
    """The terms of a block, conditional on the geometry, whatever other terms are present."""

    block: Block
    taken: Array
    """Roots `(k, c)` of what the geometry takes of their columns."""
    along: Array
    """Products `(c,)` of what it leaves with the observations."""
    of_width: dict[int, tuple[Array, Array]]
    """By the width w: eigenvalues `(m, w)` and eigenvectors `(m, w, w)` of the products of the terms."""

    @classmethod
    def of(cls, beyond: Beyond, block: Block) -> Conditional:
        """The terms of a block."""
        taken = beyond.taken(block.through)
        of_width = {}
        for width, (_, index, whole) in block.of_width.items():
            values, vectors = np.linalg.eigh(whole - products(taken, index))
            of_width[width] = np.maximum(values, 0.0), vectors
        return cls(block, taken, block.along - beyond.along @ taken, of_width)

    def beside(self, structure: Structure, present: Present) -> Iterator[tuple[int, Columns]]:
        """The terms by their width, with the terms of a structure."""
        own = [np.zeros((0, len(self.along))), *(self.block.across[term] for term in structure.terms)]
        across = np.concatenate(own) - present.taken.T @ self.taken
        for width, (members, index, _) in self.block.of_width.items():
            values, vectors = self.of_width[width]
            turned = np.einsum("mwv,mw->mv", vectors, self.along[index])
            beside = np.moveaxis(across[:, index], 0, 1) @ vectors
            yield width, Columns(self.block.numbers[members], values, turned, beside)


@dataclass(frozen=True)
class Candidates:
    """All terms that are tried beside a structure."""

    structure: Structure
    dictionary: Dictionary
    terms: Sequence[Term]
    """Those of the dictionary, and some further ones."""
    present: Present
    groups: Sequence[Columns]

    @classmethod
    def of(cls, structure: Structure, dictionary: Dictionary, further: Sequence[Term] = ()) -> Candidates:
        """Those of a dictionary, and some further ones."""
        present = Present.of(structure, Beyond.of(structure))
        terms = [*dictionary.terms, *further]
        groups = _grouped(structure, present, dictionary.blocks(structure, further))
        return cls(structure, dictionary, terms, present, groups)

    @classmethod
    def of_each(cls, structures: Iterable[Structure], dictionary: Dictionary) -> Iterator[Candidates]:
        """Those of a dictionary, beside structures that differ by their terms alone."""
        beyond, own = None, list[Conditional]()
        for structure in structures:
            blocks = dictionary.blocks(structure)
            if beyond is None:
                beyond = Beyond.of(structure)
                own = [Conditional.of(beyond, block) for block in blocks]
            present = Present.of(structure, beyond)
            yield cls(structure, dictionary, dictionary.terms, present, _joined(structure, present, own))

    def beside(self, terms: Sequence[Term]) -> Candidates:
        """No candidates, beside other terms with the same geometry and noise; for `exact`."""
        structure = self.structure.with_terms(terms)
        return Candidates(structure, self.dictionary, (), Present.of(structure, self.present.beyond), ())

    def with_every_row(self) -> Candidates:
        """No candidates, with outliers among the rows, but for gross errors; for `own` and `exact`.

        A jump at a wrong moment makes outliers of the rows between: without them no other moment is likelier.
        """
        structure = self.structure
        if np.array_equal(structure.noise.left_out, structure.data.gross):
            return self
        whole = replace(structure, noise=replace(structure.noise, left_out=structure.data.gross))
        return Candidates(whole, self.dictionary, (), Present.of(whole, Beyond.of(whole)), ())

    def odds(self, without: Collection[int] = ()) -> Array:
        """Log odds `(terms,)` of each candidate against none, beside the structure's terms but for some numbers."""
        return self._odds(self.groups, self.terms, without)

    def exact(self, terms: Sequence[Term], without: Collection[int] = ()) -> Array:
        """The same of any terms `(len(terms),)`, in double precision."""
        return self._odds(self._met.columns(tuple(terms)), terms, without)

    @cached_property
    def _met(self) -> Met:
        return Met(self.structure, self.present)

    @cached_property
    def _wholes(self) -> tuple[list[Term], list[Columns]]:
        """Causes in several places whose parts are candidates."""
        wholes = list(together(self.terms))
        return wholes, _grouped(self.structure, self.present, _block(self.structure, wholes))

    def whole(self, without: Collection[int]) -> Term | None:
        """The likeliest cause in several places, none of whose parts is present but for terms of some numbers."""
        present = {term.family for number, term in enumerate(self.structure.terms) if number not in without}
        wholes, groups = self._wholes
        odds = self._odds(groups, wholes, without).tolist()
        free = [each for each in zip(odds, wholes, strict=True) if present.isdisjoint(p.family for p in each[1].parts)]
        return max(free, key=lambda each: each[0])[1] if free else None

    def refined(
        self, term: Term, without: Collection[int], members: Sequence[Term] = (), least: float = 0.0
    ) -> tuple[Term, float, float]:
        """The likeliest member of the family of a term, its log odds, and those of the term; members: tried first.

        Each time finer members are tried, the log odds must rise by more than `least`.
        """
        first = odds = float(self.exact([term], without)[0])
        for _ in range(REFINED):
            members = [*members, *self._met.finer(term)]
            found = self.exact(members, without)
            if not members or found.max() <= odds + least:
                break
            best = int(np.argmax(found))
            term, odds, members = members[best], float(found[best]), ()
        return term, odds, first

    def members(self, family: Hashable) -> list[Term]:
        """The candidates of a family."""
        return [term for term in self.terms if term.family == family]

    def own(self, number: int, without: Collection[int] = ()) -> float:
        """Log odds of a term of the structure, beside the others but for some numbers."""
        return float(self.exact([self.structure.terms[number]], {number, *without})[0])

    def by_family(self, odds: Array) -> dict[Hashable, tuple[float, int]]:
        """Of each family that is not present: log odds of its members together, and the number of its best member."""
        return by_family(self.terms, odds, {term.family for term in self.structure.terms})

    def _odds(self, groups: Iterable[Columns], terms: Sequence[Term], without: Collection[int]) -> Array:
        present, factor = self.present, self.structure.noise.factor
        kept = [
            np.arange(start, end)
            for number, (start, end) in enumerate(zip(present.starts, present.starts[1:], strict=False))
            if number not in without
        ]
        columns = np.concatenate([np.zeros(0, int), *kept])
        size = self.structure.sizes[len(self.structure.data.geometry.bands) :][columns]
        matrix = present.gram[np.ix_(columns, columns)] * size[:, None] * size + factor * np.eye(len(size))
        removed = np.zeros((len(size), len(present.along)))
        moved = np.zeros(len(size))
        if len(size):
            low = np.linalg.cholesky(matrix)
            removed[:, columns] = linalg.solve_triangular(low, np.diag(size), lower=True)
            moved = removed @ present.along
        found = np.array([term.log_prior for term in terms])
        for group in groups:
            found[group.numbers] += group.gains(removed, moved, factor)
        return found


def by_family(terms: Sequence[Term], odds: Array, present: Collection[Hashable]) -> dict[Hashable, tuple[float, int]]:
    """Of each family of terms that is not present: log odds together, and the number of its best member."""
    found: dict[Hashable, tuple[float, int]] = {}
    for number, (term, own) in enumerate(zip(terms, odds.tolist(), strict=True)):
        if term.family in present:
            continue
        together, best = found.get(term.family, (-np.inf, number))
        found[term.family] = float(np.logaddexp(together, own)), number if own >= odds[best] else best
    return found


def _block(structure: Structure, terms: Sequence[Term]) -> list[Block]:
    """One block of terms; none without terms."""
    columns = [term.make() for term in terms]
    return [Block.of(structure, terms, np.arange(len(terms)), np.concatenate(columns, axis=2))] if columns else []


def _grouped(structure: Structure, present: Present, blocks: Iterable[Block]) -> list[Columns]:
    """The terms of blocks by their width, conditional on the geometry of a structure."""
    return _joined(structure, present, (Conditional.of(present.beyond, block) for block in blocks))


def _joined(structure: Structure, present: Present, parts: Iterable[Conditional]) -> list[Columns]:
    """The terms of all parts by their width, beside the terms of a structure."""
    found: dict[int, list[Columns]] = {}
    for part in parts:
        for width, columns in part.beside(structure, present):
            found.setdefault(width, []).append(columns)
    return [Columns(*(np.concatenate(each) for each in zip(*groups, strict=True))) for groups in found.values()]


Families = Mapping[Hashable, tuple[float, int]]
