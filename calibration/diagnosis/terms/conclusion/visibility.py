"""What the data do not show: causes of typical size whose expected log odds are too small, and error motions."""

from __future__ import annotations

from collections.abc import Hashable, Iterator

import numpy as np

from calibration.diagnosis.terms.candidates import Candidates
from calibration.diagnosis.terms.conclusion.verdict import CLEAR
from calibration.gaussian_terms.posterior import Posterior
from calibration.gaussian_terms.structure import Structure

SEEN = 0.5
"""Share of a coefficient that the data determine, the prior the rest, below which they do not show it."""


def not_visible(candidates: Candidates) -> list[str]:
    """Names of error motions and of causes that these data do not show."""
    structure = candidates.structure
    present = {term.family for term in structure.terms}
    found = dict(_expected(candidates, present))
    causes = [name for name, odds in found.values() if odds < CLEAR]
    return list(dict.fromkeys([*_unseen_motions(structure), *causes]))


def _expected(candidates: Candidates, present: set[Hashable]) -> Iterator[tuple[Hashable, tuple[str, float]]]:
    """Of each family of causes: its name, and the log odds that are expected of a cause of typical size.

    Of its members the one that these data show best counts, with the prior odds of the family.
    """
    factor = candidates.structure.noise.factor
    gains = np.zeros(len(candidates.terms))
    for group in candidates.groups:
        ratio = group.values / factor
        gains[group.numbers] = 0.5 * np.sum(ratio - np.log1p(ratio), axis=1)
    families: dict[Hashable, list[int]] = {}
    for number, term in enumerate(candidates.terms):
        if term.named and term.effects and term.family not in present:
            families.setdefault(term.family, []).append(number)
    for family, numbers in families.items():
        prior = float(np.logaddexp.reduce([candidates.terms[number].log_prior for number in numbers]))
        yield family, (candidates.terms[numbers[0]].effects[0].name, prior + float(gains[numbers].max()))


def _unseen_motions(structure: Structure) -> Iterator[str]:
    """Names of the error motions of which the data show nothing, were they of their expected size."""
    geometry, equations = structure.data.geometry, structure.equations
    count = geometry.width
    expected = structure.sizes.copy()
    expected[:count] = geometry.first_sizes[geometry.bands]
    known = Posterior.of(equations, expected, structure.noise.factor).determined(expected)[:count]
    squares = (geometry.parameters * expected[:count]) ** 2
    seen = (squares @ known) / np.maximum(squares.sum(axis=1), np.finfo(float).tiny)
    ends = np.cumsum([0, *(len(effect.parameters) for effect in geometry.effects)])
    for effect, low, high in zip(geometry.effects, ends, ends[1:], strict=False):
        if effect.OF_ISO_230 and seen[low:high].max() < SEEN:
            yield effect.name
