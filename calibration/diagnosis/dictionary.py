"""All terms that are tried: the products of their columns, whitened, with each other and with what is present.

A noise whitens the columns once: other sizes of the geometry, and of the terms that are present, change no product.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Along, Term
from calibration.gaussian_terms.whitened import Piece
from kinematics.transforms import Array

COLUMNS_OF_BLOCK = 200
"""Columns that are worked on together: the products of a block stay in the cache of the processor."""
KEPT_BYTES = 60_000_000
"""Columns, in single precision, that are kept; the others are made again for each pass."""


class Block(NamedTuple):
    """Products of the whitened columns of some terms, free of the registration."""

    numbers: np.ndarray
    """Of the terms `(k,)`."""
    of_width: dict[int, tuple[np.ndarray, np.ndarray, Array]]
    """By the width w of the terms: which of the k, their columns `(m, w)`, and the products of these `(m, w, w)`."""
    through: Array
    """Products with the geometry `(p, c)`."""
    along: Array
    """Products with the observations `(c,)`."""
    across: dict[Term, Array]
    """Products with other terms `(width, c)`, by these."""

    @classmethod
    def of(cls, structure: Structure, terms: Sequence[Term], numbers: np.ndarray, raw: Array) -> Block:
        """The products of columns `(n, d, c)` for a structure, and with its terms."""
        white = structure.whitener.columns(raw)
        groups = _by_width(terms)
        of_width = {width: (*group, products(white, group[1])) for width, group in groups.items()}
        across = structure.by_term(structure.of_terms.T @ white)
        always = structure.whitener.through(structure.data.geometry.columns, white)
        return cls(numbers, of_width, always, structure.of_geometry.residual @ white, across)

    @classmethod
    def of_sides(
        cls, structure: Structure, sides: Sides, terms: Sequence[Term], numbers: np.ndarray, table: Array
    ) -> Block:
        """The same of functions along an arm `(k, c)`, or of columns, by the sides of the structure."""
        groups = _by_width(terms)
        of_width = {width: (*each, np.zeros((*each[1].shape, width))) for width, each in groups.items()}
        through, beside = (np.zeros((side.shape[1], table.shape[1])) for side in (sides.always, sides.beside))
        for rows, precision in zip(sides.rows, sides.precisions, strict=True):
            own = table[rows].astype(float)
            through += sides.always[rows].T @ own
            beside += sides.beside[rows].T @ own
            weighted = (precision @ own.reshape(*precision.shape[:2], -1)).reshape(own.shape)
            for _, index, whole in of_width.values():
                np.add(whole, products(own, index, weighted), out=whole)
        count = structure.whitener.spanned.shape[1]
        spanned, along, across = np.split(beside, [count, count + 1])
        through -= structure.registers.T @ spanned
        for _, index, whole in of_width.values():
            np.subtract(whole, products(spanned, index), out=whole)
        return cls(numbers, of_width, through, along[0], structure.by_term(across))


def _by_width(terms: Sequence[Term]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """By the width of terms: their numbers `(m,)`, and those of their columns `(m, w)`."""
    widths = np.array([term.width for term in terms])
    starts, found = np.cumsum(widths) - widths, {}
    for width in sorted(set(widths.tolist())):
        own = np.flatnonzero(widths == width)
        found[width] = own, starts[own][:, None] + np.arange(width)
    return found


class Sides(NamedTuple):
    """What is present, as products with any columns need it, or with functions along one arm."""

    always: Array
    """Of the geometry `(k, p)`: at each scalar, or for functions at each row."""
    beside: Array
    """Of the registration, of the observations, and of the terms, likewise."""
    precisions: Sequence[Array]
    """Precision `(stops, m, m)` of the columns, or functions, at each stop, in pieces of the stops."""
    rows: Sequence[np.ndarray | slice]
    """Those of each piece."""

    @classmethod
    def of(cls, structure: Structure) -> Sides:
        """The sides for any columns `(n d, c)`."""
        white, table = structure.whitener, structure.data.geometry.columns
        always = np.empty((len(table) * table.shape[1], table.shape[2]))
        for piece in white.pieces:
            always[piece.scalars] = piece.back(piece.white(table[piece.rows]))
        precisions, rows = zip(*((piece.precision, piece.scalars) for piece in white.pieces), strict=True)
        return cls(always, np.zeros((0, 0)), precisions, rows).with_terms_of(structure)

    def with_terms_of(self, structure: Structure) -> Sides:
        """The sides of another structure with the same whitening."""
        white = structure.whitener
        wide = [white.spanned, structure.of_geometry.residual[:, None], structure.of_terms]
        return self._replace(beside=white.back(np.concatenate(wide, axis=1)))

    def along(self, arm: Array, pieces: Iterable[Piece]) -> Sides:
        """The sides for functions `(n, c)` along an arm `(n, d)`."""
        always, beside = (
            np.einsum("nd,ndc->nc", arm, each.reshape(*arm.shape, -1)) for each in (self.always, self.beside)
        )
        precisions, rows = [], [piece.rows for piece in pieces]
        for some, precision in zip(rows, self.precisions, strict=True):
            own = arm[some].reshape(len(precision), -1, arm.shape[1])
            shape = (*own.shape, *own.shape[1:])
            precisions.append(np.einsum("smd,smdte,ste->smt", own, precision.reshape(shape), own))
        return Sides(always, beside, precisions, rows)


class Dictionary:
    """Terms that may explain the observations of structures with one geometry."""

    def __init__(self, terms: Sequence[Term], first: int = 0, known: Mapping[Term, Array] | None = None) -> None:
        """known: columns `(n d, width)`, or functions `(n, width)`, of some terms in single precision."""
        self.terms = terms
        self._first, self._kept = first, dict[int, Array]()
        self._known = known or {}
        self._sides: Sides | None = None
        self._whitening: Hashable = None
        self._blocks: list[Block] = []

    def part(self, terms: Sequence[Term]) -> Dictionary:
        """Some of the terms, whose columns are not made again as far as they are kept."""
        known: dict[Term, Array] = {}
        for _, numbers in self._members:
            if (made := self._kept.get(int(numbers[0]))) is not None:
                own = [self.terms[i] for i in numbers.tolist()]
                ends = np.cumsum([term.width for term in own])
                known.update(zip(own, np.split(made, ends[:-1], axis=1), strict=True))
        return Dictionary(terms, known=known)

    def blocks(self, structure: Structure, further: Sequence[Term] = ()) -> list[Block]:
        """All terms, then further ones, with their products for a structure; those of the last whitening are kept."""
        if self._whitening != structure.noise.whitening:
            self._sides, self._blocks = None, []
            self._sides = Sides.of(structure)
            self._blocks = list(self._new_blocks(structure, self._sides))
            self._whitening = structure.noise.whitening
        blocks = self._with_terms_of(structure)
        if not further:
            self._sides = None
            return blocks
        self._sides = self._sides or Sides.of(structure)
        more = Dictionary(further, len(self.terms))
        return [*blocks, *more._new_blocks(structure, self._sides.with_terms_of(structure))]

    def _with_terms_of(self, structure: Structure) -> list[Block]:
        """The blocks with their products with the terms of a structure."""
        if not self._blocks:
            return []
        new = [term for term in structure.terms if term not in self._blocks[0].across]
        for some in _batches([term.width for term in new]):
            self._beside(structure, [new[i] for i in some])
        return self._blocks

    def _beside(self, structure: Structure, terms: Sequence[Term]) -> None:
        """Adds the products with some terms of a structure to the blocks."""
        own = np.repeat([term in terms for term in structure.terms], [term.width for term in structure.terms])
        back, beside = structure.whitener.back(structure.of_terms[:, own]), structure.with_terms(terms)
        for block, (arm, numbers) in zip(self._blocks, self._members, strict=True):
            side = back if arm is None else np.einsum("kd,kdc->kc", arm, back.reshape(*arm.shape, -1))
            block.across.update(beside.by_term(side.T @ self._made(numbers)))

    def _new_blocks(self, structure: Structure, whole: Sides) -> Iterator[Block]:
        before, sides = None, whole
        for arm, numbers in self._members:
            if arm is not before:
                sides = whole if arm is None else whole.along(arm, structure.whitener.pieces)
            before, own = arm, [self.terms[i] for i in numbers]
            yield Block.of_sides(structure, sides, own, self._first + numbers, self._made(numbers))

    @cached_property
    def _members(self) -> list[tuple[Array | None, np.ndarray]]:
        """Numbers of some terms that act along one arm, or along none in common; all terms, arm by arm."""
        arms: dict[Hashable, tuple[Array | None, list[int]]] = {}
        for i, term in enumerate(self.terms):
            name, arm = (term.make.name, term.make.arm) if isinstance(term.make, Along) else (None, None)
            arms.setdefault(name, (arm, []))[1].append(i)
        found = []
        for arm, numbers in arms.values():
            found += [(arm, np.array(numbers)[some]) for some in _batches([self.terms[i].width for i in numbers])]
        return found

    def _made(self, numbers: np.ndarray) -> Array:
        """Columns of some terms side by side `(n d, c)`, or their functions `(n, c)`."""
        first = int(numbers[0])
        if first in self._kept:
            return self._kept[first]
        own = (self.terms[i] for i in numbers.tolist())
        made = np.concatenate(
            [known if (known := self._known.get(term)) is not None else _single(term) for term in own], axis=1
        )
        if sum(each.nbytes for each in self._kept.values()) + made.nbytes <= KEPT_BYTES:
            self._kept[first] = made
        return made


def _single(term: Term) -> Array:
    """Columns of a term `(n d, width)`, or its functions `(n, width)`, in single precision."""
    make = term.make
    own = make.functions() if isinstance(make, Along) else make().reshape(-1, term.width)
    return np.asarray(own.astype(np.float32))


def _batches(widths: Sequence[int]) -> list[np.ndarray]:
    """Numbers of terms of these widths that are worked on together."""
    ends = np.cumsum(np.array(widths, int)) // COLUMNS_OF_BLOCK
    return [np.flatnonzero(ends == end) for end in np.unique(ends)]


def products(table: Array, index: np.ndarray, other: Array | None = None) -> Array:
    """Products `(m, w, w)` of groups of columns of a table `(N, c)`, by their numbers `(m, w)`; of those of another."""
    own = np.moveaxis(table[:, index], 1, 0)
    second = own if other is None else np.moveaxis(other[:, index], 1, 0)
    return np.asarray(np.swapaxes(own, 1, 2) @ second)
