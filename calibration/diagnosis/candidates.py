"""Log odds of every term that is tried, in closed form, beside the terms of a structure or beside some of them.

For columns C of a candidate, made white, the evidence that they add depends on C'C and C'y less what is present
explains of both. What the geometry explains is removed once, for all candidates; what the terms of the structure
explain is removed for each question, so that "in the place of this term" costs no second pass over the columns.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy import linalg

from calibration.diagnosis.dictionary import Dictionary, single
from calibration.diagnosis.forms import displacements
from calibration.gaussian_terms.gains import log_gains
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Term
from kinematics.error_model.priors import SIZES
from kinematics.transforms import Array

LEAST = 1e-3
"""Variance that the geometry gives a direction of the observations, in that of the noise, above which it counts."""


@dataclass(frozen=True)
class Beyond:
    """What the geometry of a structure leaves of whitened columns: with its prior sizes, a part of each direction.

    The root of this part is taken, so that products of what is left are those that the evidence needs. A difference of
    large products would lose the digits of causes that the geometry explains nearly.
    """

    directions: Array
    """`(N, r)`, orthonormal; those of the registration first."""
    taken: Array
    """Share `(r,)` of each direction that is taken."""
    residual: Array
    """What is left of the observations `(N,)`."""

    @classmethod
    def of(cls, structure: Structure) -> Beyond:
        """What the geometry of a structure leaves."""
        equations = structure.of_geometry
        size = structure.sizes[: structure.data.geometry.width] / np.sqrt(structure.noise.factor)
        values, vectors = np.linalg.eigh(equations.gram * size[:, None] * size)
        used = values > LEAST
        turned = vectors[:, used] * size[:, None] / np.sqrt(values[used])
        spanned = structure.whitener.spanned
        directions = np.concatenate([spanned, equations.design @ turned], axis=1)
        taken = np.concatenate([np.ones(spanned.shape[1]), 1.0 - 1.0 / np.sqrt(1.0 + values[used])])
        bare = cls(directions, taken, equations.residual)
        return replace(bare, residual=bare.left(equations.residual))

    def left(self, table: Array) -> Array:
        """What is left of whitened columns `(N, ...)`, in their precision."""
        directions, taken = self._single if table.dtype == np.float32 else (self.directions, self.taken)
        return np.asarray(table - directions @ (taken.reshape(-1, *[1] * (table.ndim - 1)) * (directions.T @ table)))

    @cached_property
    def _single(self) -> tuple[Array, Array]:
        """The directions and their shares in single precision."""
        return self.directions.astype(np.float32), self.taken.astype(np.float32)


class Present(NamedTuple):
    """The terms of a structure beyond its geometry."""

    beyond: Beyond
    columns: Array
    """What the geometry leaves of their columns `(N, a)`."""
    gram: Array
    """Products `(a, a)` of these."""
    along: Array
    """Products `(a,)` of these with what is left of the observations."""
    starts: np.ndarray
    """First column of each term, and the number of columns at the end."""

    @classmethod
    def of(cls, structure: Structure, beyond: Beyond) -> Present:
        """The terms of a structure."""
        left = beyond.left(structure.of_terms)
        starts = np.cumsum([0, *(term.width for term in structure.terms)])
        return cls(beyond, left, left.T @ left, left.T @ beyond.residual, starts)


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
            each = [_by_update(self.values, less, along, size**2 / factor) for size in SIZES]
            quadratic, determinant = np.moveaxis(np.array(each), 1, 0)
            evidence = 0.5 * (quadratic / factor - determinant)
            return np.asarray(np.logaddexp.reduce(evidence, axis=0) - np.log(len(SIZES)))
        blocks = np.einsum("mw,wv->mwv", self.values, np.eye(width)) - np.swapaxes(less, 1, 2) @ less
        return log_gains(blocks, along, SIZES, factor)


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


@dataclass(frozen=True)
class Candidates:
    """All terms that are tried beside a structure."""

    structure: Structure
    terms: Sequence[Term]
    present: Present
    groups: Sequence[Columns]

    @classmethod
    def of(cls, structure: Structure, dictionary: Dictionary, further: Sequence[Term] = ()) -> Candidates:
        """Those of a dictionary, and some further ones."""
        present = Present.of(structure, Beyond.of(structure))
        terms = [*dictionary.terms, *further]
        numbers = np.arange(len(dictionary.terms), len(terms))
        made = ((numbers, single(further)) for _ in numbers[:1])
        return cls(
            structure, terms, present, list(_grouped(structure, present, terms, chain(dictionary.blocks(), made)))
        )

    def beside(self, terms: Sequence[Term]) -> Candidates:
        """No candidates, beside other terms with the same geometry and noise; for `exact`."""
        structure = self.structure.with_terms(terms)
        return Candidates(structure, (), Present.of(structure, self.present.beyond), ())

    def with_every_row(self) -> Candidates:
        """No candidates, with outliers among the rows, but for gross errors; for `own` and `exact`.

        A jump at a wrong moment makes outliers of the rows between: without them no other moment is likelier.
        """
        structure = self.structure
        if np.array_equal(structure.noise.left_out, structure.data.gross):
            return self
        whole = replace(structure, noise=replace(structure.noise, left_out=structure.data.gross))
        return Candidates(whole, (), Present.of(whole, Beyond.of(whole)), ())

    def odds(self, without: Collection[int] = ()) -> Array:
        """Log odds `(terms,)` of each candidate against none, beside the structure's terms but for some numbers."""
        return self._odds(self.groups, self.terms, without)

    def exact(self, terms: Sequence[Term], without: Collection[int] = ()) -> Array:
        """The same of any terms `(len(terms),)`, in double precision."""
        if not terms:
            return np.zeros(0)
        block = np.arange(len(terms)), np.concatenate([term.columns for term in terms], axis=2)
        return self._odds(list(_grouped(self.structure, self.present, terms, [block])), terms, without)

    @cached_property
    def displacements(self) -> list[Term]:
        """Whole displacements whose components are candidates."""
        return list(displacements(self.terms))

    def whole(self, without: Collection[int]) -> list[Term]:
        """Those of which no component is present, but for terms of some numbers."""
        present = {term.family for number, term in enumerate(self.structure.terms) if number not in without}
        return [each for each in self.displacements if not any(part.family in present for part in each.parts)]

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


def _grouped(
    structure: Structure, present: Present, terms: Sequence[Term], blocks: Iterable[tuple[np.ndarray, Array]]
) -> Iterator[Columns]:
    """The terms of blocks by their width, conditional on the geometry of a structure."""
    found: dict[int, list[Columns]] = {}
    for numbers, raw in blocks:
        for group in _block(structure, present, [terms[i].width for i in numbers.tolist()], raw):
            found.setdefault(group.values.shape[1], []).append(group._replace(numbers=numbers[group.numbers]))
    for groups in found.values():
        yield Columns(*(np.concatenate(parts) for parts in zip(*groups, strict=True)))


def _block(structure: Structure, present: Present, widths: Sequence[int], raw: Array) -> Iterator[Columns]:
    """The terms of one block, with columns `(n, d, sum of widths)`; numbers are those within the block."""
    left = present.beyond.left(structure.whitener.with_stated(raw))
    along = present.beyond.residual.astype(left.dtype) @ left
    across = present.columns.astype(left.dtype).T @ left
    starts = np.cumsum([0, *widths])
    for width in sorted(set(widths)):
        numbers = np.flatnonzero(np.array(widths) == width)
        index = starts[numbers][:, None] + np.arange(width)
        products = _products(left, index)
        values, vectors = np.linalg.eigh(products.astype(float))
        yield Columns(
            numbers,
            np.maximum(values, 0.0),
            np.einsum("mwv,mw->mv", vectors, along[index].astype(float)),
            np.moveaxis(across[:, index], 0, 1).astype(float) @ vectors,
        )


def _products(table: Array, index: np.ndarray) -> Array:
    """Products `(m, w, w)` of groups of columns of a table `(N, c)`, by their numbers `(m, w)`."""
    own = np.moveaxis(table[:, index], 1, 0)
    return np.asarray(np.swapaxes(own, 1, 2) @ own)


Families = Mapping[Hashable, tuple[float, int]]
