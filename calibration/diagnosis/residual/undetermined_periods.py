"""Waves and steps of compensation tables whose period the positions of their axis do not determine.

At few positions waves of many periods pass through the same errors, even through errors that are independent of each
other. Such errors at the positions, of any size, are therefore the alternative to a wave: noise is none, since a strong
wave is clear against noise however few the positions are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.diagnosis.residual.dependence import LENGTHS, Unexplained
from calibration.diagnosis.residual.unexplained import of_machine
from calibration.diagnosis.search.evaluation import EVEN, FALSE
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import squares_of_all
from calibration.diagnosis.search.shapes.proposed_shapes import OVERSAMPLING, SAME, SCANNED, frequencies_of
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from calibration.diagnosis.search.shapes.spectra import Waves, finest, peaks, strengths
from calibration.diagnosis.search.stage import Accepted, Stage
from calibration.fit.linear import pseudo_inverse
from kinematics.effects import Cyclic, QuantisedCompensation
from kinematics.effects.base import own_component, unit_of
from kinematics.transforms import Array

MANY = 60
"""Number of positions from which a wave that explains most of their errors is none of many that do."""
UNSEEN = 1e-6
"""Share of the largest eigenvalue below which the rows do not show a combination of errors at the positions."""
TRIED = 120
"""Most frequencies whose waves are compared with the one found."""
Repeating = Cyclic | QuantisedCompensation


class Undetermined(NamedTuple):
    """An accepted cause with a period that the positions do not determine."""

    accepted: Accepted
    effect: Repeating
    periods: tuple[float, ...]
    """Periods with which it explains nearly as much, its own first, mm or degrees."""


class _AtPositions(NamedTuple):
    """Independent errors at the positions of an axis, in a linearised fit without the cause."""

    sensitivity: Sensitivity
    squares: float
    """Reduction of the sum of squares by errors of any size at the positions."""
    dimensions: float
    """Number of directions in which they show, each by its share of the signal (participation ratio)."""
    explained: Array
    """Part of the residual `(N,)` that they explain, white."""

    @classmethod
    def of(cls, linearised: LinearisedFit, effect: Repeating) -> _AtPositions | None:
        """The errors in the direction of a cause; None for many positions."""
        component = effect.component if isinstance(effect, Cyclic) else own_component(effect.axis)
        sensitivity = Sensitivity.of(linearised, effect.axis, component)
        _, number = np.unique(np.round(sensitivity.x, 3), return_inverse=True)
        if (count := int(number.max()) + 1) > MANY:
            return None
        errors = unit_of(component)[1] * np.eye(count)[number.reshape(-1)]
        schur, along = sensitivity.schur(errors), sensitivity.along @ errors
        root = pseudo_inverse(schur, UNSEEN).root
        signal = sensitivity.signal(errors @ (root @ (root.T @ along)))
        explained = signal - linearised.spanned @ (linearised.spanned.T @ signal)
        dimensions = float(np.trace(schur) ** 2 / np.sum(schur**2))
        return cls(sensitivity, float(np.sum((root.T @ along) ** 2)), dimensions, explained)

    def left(self, squares: Array | float) -> Array:
        """Share of their squares that a wave leaves which explains `squares`; at least that of noise."""
        return np.maximum(self.squares - squares, min(self.dimensions, self.squares)) / max(self.squares, 1e-300)

    def other_periods(self, effect: Cyclic, left: float) -> list[float]:
        """Periods of waves that leave nearly as little as the one found does, the least first."""
        frequencies = frequencies_of(self.sensitivity.linearised, effect.axis)
        if len(frequencies) < OVERSAMPLING:
            return []
        waves = Waves.of(self.sensitivity.x, frequencies)
        (power,) = strengths([self.sensitivity], waves)
        best, gains = finest(self.sensitivity, waves, peaks(power, TRIED), unit_of(effect.component)[1])
        odds = 0.5 * (self.dimensions - 2.0) * np.log(self.left(gains) / left)
        likely = [float(1.0 / best[i]) for i in np.argsort(odds).tolist() if odds[i] < EVEN]
        return [period for period in likely if abs(period / effect.period - 1.0) > SAME]


def undetermined(stage: Stage) -> list[Undetermined]:
    """Accepted waves and steps that explain no more than one of so many would explain of independent errors."""
    found = []
    for i, each in enumerate(stage.accepted):
        effect = each.candidate.effect
        if not isinstance(effect, Repeating):
            continue
        without = stage.without(i).evenly_noisy.thinned(SCANNED)
        at_positions = _AtPositions.of(without, effect)
        if at_positions is None:
            continue
        columns = without.projected(without.columns(effect))
        left = float(at_positions.left(squares_of_all([columns], without.residual)))
        free = sum(quantity.linear for quantity in effect.parameter_table)
        chance = each.candidate.trials / OVERSAMPLING * left ** max(0.5 * (at_positions.dimensions - free), 0.0)
        if chance > FALSE:
            others = at_positions.other_periods(effect, left) if isinstance(effect, Cyclic) else []
            period = effect.period if isinstance(effect, Cyclic) else effect.pitch
            found.append(Undetermined(each, effect, (period, *others)))
    return found


def at_positions(linearised: LinearisedFit, found: Undetermined) -> Unexplained | None:
    """The error at the positions that such a cause imitates, in the residual of a fit without it."""
    errors = _AtPositions.of(linearised, found.effect)
    if errors is None:
        return None
    shape = of_machine(linearised, errors.explained)
    rms = float(np.sqrt(np.mean(shape**2)))
    return Unexplained((found.effect.axis,), LENGTHS[:1], found.accepted.score.p_value, rms, shape, found.periods)
