"""A fit with some causes: its accuracy, and each cause on the fit without it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search.candidates import RARE, Candidate
from calibration.diagnosis.search.evaluation import (
    SIGNS,
    SURE_OF_RARE,
    WORTH,
    Sibling,
    complexity,
    predicts,
    standard_error,
)
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import Score
from calibration.diagnosis.search.start_model import Base
from calibration.fit.fit import Fit
from kinematics.transforms import Array

WORSE = 1.02
"""Ratio by which the held-out RMS may rise by chance with a cause, or with finer bases, that are there."""

IRREPLACEABLE = 100.0
"""Growth of the BIC without a cause, but with all others at once, above which none is searched for in its place."""


@dataclass(frozen=True)
class Accepted:
    """An accepted cause, evaluated on the linearised fit without it."""

    candidate: Candidate
    """The candidate with the shapes that the fit found."""
    size: Array
    """Linear parameters in units of their typical sizes."""
    score: Score
    visible: float
    held_out: Callable[[], Array]
    """Calculates `held_out_gains`, which few causes need."""
    siblings: tuple[Sibling, ...] = ()

    @cached_property
    def held_out_gains(self) -> Array:
        """Reduction of the squares of each held-out block."""
        return self.held_out()

    @property
    def sureness(self) -> float:
        """Mean gain on held-out blocks, in units of its standard error."""
        return float(self.held_out_gains.mean()) / max(standard_error(self.held_out_gains), 1e-300)


class Stage(NamedTuple):
    """The fit with some causes."""

    base: Base
    fit: Fit
    linearised: LinearisedFit
    accepted: tuple[Accepted, ...]

    @property
    def numbers(self) -> list[int]:
        """Indices of the accepted causes among the effects of the fit."""
        return self.base.numbers(chosen_of(self.accepted))

    @property
    def at_rest(self) -> Stage:
        """The stage without the results that can be calculated again."""
        return self._replace(linearised=replace(self.linearised))

    def less(self, values: Array | None) -> Stage:
        """The stage with the linearised fit of observations less values, as `LinearisedFit.less`; None for none."""
        return self if values is None else self._replace(linearised=self.linearised.less(values))

    def without(self, *indices: int) -> LinearisedFit:
        """The linearised fit without some of the accepted causes."""
        numbers = self.numbers
        return self.base.lacking(self.linearised, *((self.accepted[i].candidate, numbers[i]) for i in indices))

    @property
    def cost(self) -> float:
        """BIC, up to a constant of the data: squares, log determinant of the noise, cost of the causes' parameters."""
        return self._cost_of(sum(each.score.effective_parameters for each in self.accepted))

    @property
    def cost_of_choices(self) -> float:
        """The same by the free choices of the causes: a vector of the instrument is one."""
        return self._cost_of(sum(complexity(each.candidate) for each in self.accepted))

    def _cost_of(self, parameters: float) -> float:
        fitted = self.linearised.squares + self.linearised.spread
        return fitted + parameters * float(np.log(self.linearised.scalars))

    @property
    def rarity(self) -> float:
        """Log odds of as many common causes against its own, before any data; directions of one drift come together."""
        directions = sum(each.candidate.shifts_tool for each in self.accepted)
        return sum(each.candidate.rarity for each in self.accepted) - RARE * max(directions - 1, 0)

    @property
    def held_out_um(self) -> float:
        """RMS of the cross-validation residuals, um per scalar (rotary axes: urad)."""
        return self.linearised.cross_validation.rms_um

    def judged_by(self, others: Sequence[Accepted]) -> Stage:
        """The stage with the evidence for its causes from another fit of the same causes, in the same order."""
        both = zip(self.accepted, others, strict=True)
        return self._replace(
            accepted=tuple(replace(other, candidate=own.candidate, size=own.size) for own, other in both)
        )

    def with_siblings_of(self, other: Stage) -> Stage:
        """The stage with the siblings that another fit of the same causes, in the same order, has found."""
        both = zip(self.accepted, other.accepted, strict=True)
        return self._replace(accepted=tuple(replace(own, siblings=each.siblings) for own, each in both))

    def needs(self, own: Accepted, explained: float = 0.0) -> bool:
        """True where the BIC grows by more than `IRREPLACEABLE` without a cause of which others explain a share."""
        missing = own.score.gain * max(1.0 - explained, 0.0)
        # noise of one axis from stop to stop may take the place of the cause
        count = len(np.unique(self.linearised.measurement.stops[self.linearised.rows]))
        spared = 2.0 * own.candidate.rarity + own.score.effective_parameters * float(np.log(self.linearised.scalars))
        return count * float(np.log1p(missing / count)) > spared + IRREPLACEABLE

    def predicts_worse_than(self, other: Stage, ratio: float = WORSE) -> bool:
        """True where the RMS of held-out rows, of those that both keep, is larger by this ratio."""
        _, own, others = np.intersect1d(self.linearised.rows, other.linearised.rows, return_indices=True)
        held, before = self.linearised.cross_validation, other.linearised.cross_validation
        both = held.counted[own] & before.counted[others]
        squares, before_squares = (
            float(np.sum(each.residual_um[rows[both]] ** 2)) for each, rows in ((held, own), (before, others))
        )
        return squares > ratio**2 * before_squares


def unconfirmed(stage: Stage) -> list[Accepted]:
    """The least likely of the rare causes of little evidence that held-out blocks no longer confirm; empty for none.

    Bases that were selected again beside a cause may hold its signal.
    """
    rare = [each for each in stage.accepted if each.candidate.rarity and each.score.delta_bic > 2.0 * WORTH]
    missed = [each for each in rare if not predicts(each.held_out_gains, SURE_OF_RARE, SIGNS)]
    return [max(missed, key=lambda each: each.score.delta_bic)] if missed else []


def chosen_of(accepted: Sequence[Accepted]) -> list[tuple[Candidate, Array]]:
    """Candidates of accepted causes with their sizes, the input of a fit."""
    return [(each.candidate, each.size) for each in accepted]
