"""The columns of all terms that are tried, made in blocks: in single precision, kept as far as memory allows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.gaussian_terms.term import Term
from kinematics.transforms import Array

BLOCK = 200
"""Columns that are worked on together: the products of a block stay in the cache of the processor."""
KEPT_BYTES = 100_000_000
"""Columns that are kept; the others are made again for each pass."""


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Terms that may explain the observations."""

    terms: Sequence[Term]
    _kept: dict[int, Array] = field(default_factory=dict)
    """Columns by number of the block."""

    def blocks(self) -> Iterator[tuple[np.ndarray, Array]]:
        """Numbers of some terms `(k,)`, and their columns side by side `(n, d, sum of widths)`; all terms in turn."""
        number, members, width = 0, [], 0
        for i, term in enumerate(self.terms):
            members.append(i)
            width += term.width
            if width >= BLOCK or i == len(self.terms) - 1:
                yield np.array(members), self._columns(number, members)
                number, members, width = number + 1, [], 0

    def _columns(self, number: int, members: Sequence[int]) -> Array:
        if number in self._kept:
            return self._kept[number]
        made = single([self.terms[i] for i in members])
        if sum(each.nbytes for each in self._kept.values()) + made.nbytes <= KEPT_BYTES:
            self._kept[number] = made
        return made


def single(terms: Sequence[Term]) -> Array:
    """Columns of terms side by side `(n, d, sum of widths)`, in single precision."""
    return np.concatenate([term.make().astype(np.float32) for term in terms], axis=2)
