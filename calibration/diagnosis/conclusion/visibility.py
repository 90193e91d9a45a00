"""What the data do not show: causes of typical size whose expected log odds are too small, and error motions."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.waves import shortest_period
from calibration.gaussian_terms.gains import log_gains_by_squares
from calibration.gaussian_terms.posterior import Posterior
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Structure
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from kinematics.effects import Effect
from kinematics.transforms import Array

VISIBLE_SHARE = 0.5
"""Share of a coefficient that the data determine, the prior the rest, below which they do not show it."""
ENCODER_MM = 0.02
"""Signal period of a linear encoder: glass scales have 4 to 40 um."""


class Smallest(NamedTuple):
    """The smallest size of a cause of one parameter that is expected to be clear in these data."""

    name: str
    size: float
    unit: str


class Expected(NamedTuple):
    """A cause that is not present, as these data would show it: the best shown one of its family."""

    effect: Effect
    """Without its size."""
    log_odds: float
    """Expected of a cause of typical size."""
    smallest: Smallest | None
    """Of its forms with one parameter; None without any."""

    @property
    def visible(self) -> bool:
        """True where a cause of typical size is expected to be clear."""
        return self.log_odds >= CLEAR_LOG_ODDS


def expected(candidates: Candidates) -> list[Expected]:
    """The causes that were tried and are not present, as these data would show them."""
    present = {term.family for term in candidates.structure.terms}
    gains, ratios = typical_gains(candidates), _ratios(candidates)
    families: dict[Hashable, list[int]] = {}
    for number, term in enumerate(candidates.terms):
        if term.named and term.effects and term.family not in present:
            families.setdefault(term.family, []).append(number)
    return [_expected(candidates.terms, gains, ratios, numbers) for numbers in families.values()]


def typical_gains(candidates: Candidates) -> Array:
    """Log evidence `(terms,)` that each candidate is expected to gain where it is there, of typical size."""
    factor, found = candidates.structure.noise.factor, np.zeros(len(candidates.terms))
    for group in candidates.groups:
        squares = group.values**2 + factor * group.values
        found[group.numbers] = log_gains_by_squares(group.values, squares, np.ones(1), factor)
    return found


def _ratios(candidates: Candidates) -> list[Array]:
    """Eigenvalues `(width,)` of the columns of each candidate beyond the geometry, in the variance of the noise."""
    found: list[Array] = [np.zeros(0)] * len(candidates.terms)
    for group in candidates.groups:
        for number, values in zip(group.numbers.tolist(), group.values, strict=True):
            found[number] = np.maximum(values / candidates.structure.noise.factor, 0.0)
    return found


def _expected(terms: Sequence[Term], gains: Array, ratios: Sequence[Array], numbers: Sequence[int]) -> Expected:
    """The member of a family that the data show best, with the prior odds of the family."""
    prior = float(np.logaddexp.reduce([terms[number].log_prior for number in numbers]))
    found = [each for number in numbers if (each := _smallest(terms[number], ratios[number], prior))]
    smallest = min(found, key=lambda each: each.size, default=None)
    return Expected(terms[numbers[0]].effects[0], prior + float(gains[list(numbers)].max()), smallest)


def _smallest(term: Term, ratios: Array, prior: float) -> Smallest | None:
    """The size of a term of one column at which its expected log odds are clear."""
    if term.width != 1 or term.parameters is None or len(term.parameters) != 1 or not ratios[0]:
        return None
    table = term.effects[0].parameter_table
    quantity = next(each for each in table if each.linear)
    needed = 2.0 * (CLEAR_LOG_ODDS - prior) + float(np.log1p(ratios[0]))
    size = abs(float(term.parameters[0, 0])) * float(np.sqrt(max(needed, 0.0) / ratios[0]))
    return Smallest(term.effects[0].name, size, quantity.unit)


def unseen_motions(structure: Structure) -> Iterator[str]:
    """Names of the error motions of which the data show nothing, were they of their expected size.

    Those of a given calibration are known by it: whether the data show a change of them is a question of a cause.
    """
    given = structure.data.observations.given
    known_before = 0 if given is None else len(given.effects)
    geometry, equations = structure.data.geometry, structure.equations
    count = geometry.width
    expected = structure.sizes.copy()
    expected[:count] = geometry.first_sizes[geometry.bands]
    known = Posterior.of(equations, expected, structure.noise.factor).determined[:count]
    squares = (geometry.parameters * expected[:count]) ** 2
    seen = (squares @ known) / np.maximum(squares.sum(axis=1), np.finfo(float).tiny)
    ends = np.cumsum([0, *(len(effect.parameters) for effect in geometry.effects)])
    for effect, low, high in list(zip(geometry.effects, ends, ends[1:], strict=False))[known_before:]:
        if effect.OF_ISO_230 and seen[low:high].max() < VISIBLE_SHARE:
            yield effect.name


def shortest_periods(measurement: Measurement) -> dict[str, float]:
    """Of each linear axis whose encoder may have errors that are not sought: the shortest period that is, mm."""
    linear = [axis for axis in measurement.moving if axis[0] not in "ABC"]
    periods = {axis: shortest_period(measurement, axis) for axis in linear}
    return {axis: period for axis, period in periods.items() if period > ENCODER_MM}
