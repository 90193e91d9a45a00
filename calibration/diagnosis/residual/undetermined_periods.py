"""Waves and steps of compensation tables whose period the positions of their axis do not determine.

At few positions waves of many periods pass through the same errors, even through errors that are independent of each
other. Such errors at the positions, of any size, are therefore the alternative to a wave: noise is none, since a strong
wave is clear against noise however few the positions are. At many positions the alternatives to a wave are other waves:
noise may make one of them explain as much as a weak one that is there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.diagnosis.residual.dependence import LENGTHS, Unexplained
from calibration.diagnosis.residual.unexplained import of_machine
from calibration.diagnosis.search.evaluation import EVEN, FALSE, WORTH
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import squares_of_all
from calibration.diagnosis.search.shapes.proposed_shapes import (
    OVERSAMPLING,
    SAME,
    SCANNED,
    frequencies_of,
    steps_along,
    strongest_waves,
)
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from calibration.diagnosis.search.stage import Accepted, Stage
from calibration.fit.linear import pseudo_inverse
from kinematics.effects import Component, Cyclic, QuantisedCompensation
from kinematics.effects.base import own_component, unit_of
from kinematics.transforms import Array

MANY = 60
"""Number of positions from which a wave that explains most of their errors is none of many that do."""
UNSEEN = 1e-6
"""Share of the largest eigenvalue below which the rows do not show a combination of errors at the positions."""
MULTIPLES = range(1, 9)
"""Harmonics that a wave and a table's steps may have in common."""
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
        component = _component(effect)
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
        ((_, best, gains),) = strongest_waves(self.sensitivity.linearised, effect.axis, [effect.component], frequencies)
        odds = 0.5 * (self.dimensions - 2.0) * np.log(self.left(gains) / left)
        likely = [float(1.0 / best[i]) for i in np.argsort(odds).tolist() if odds[i] < EVEN]
        return [period for period in likely if abs(period / effect.period - 1.0) > SAME]


def undetermined(stage: Stage) -> list[Undetermined]:
    """Accepted waves and steps that explain no more than one of so many would explain of independent errors.

    At many positions: those without which waves or steps of another period are nearly as likely, but not beside them.
    """
    found = []
    for i, each in enumerate(stage.accepted):
        effect = each.candidate.effect
        if not isinstance(effect, Repeating):
            continue
        lacking = stage.without(i)
        without = lacking.evenly_noisy.thinned(SCANNED)
        at_positions = _AtPositions.of(without, effect)
        if at_positions is None:
            if rivals := _rivals(lacking.thinned(SCANNED), stage.linearised.thinned(SCANNED), effect):
                found.append(Undetermined(each, effect, (_period(effect), *rivals)))
            continue
        columns = without.projected(without.columns(effect))
        left = float(at_positions.left(squares_of_all([columns], without.residual)))
        free = sum(quantity.linear for quantity in effect.parameter_table)
        chance = each.candidate.trials / OVERSAMPLING * left ** max(0.5 * (at_positions.dimensions - free), 0.0)
        if chance > FALSE:
            others = at_positions.other_periods(effect, left) if isinstance(effect, Cyclic) else []
            found.append(Undetermined(each, effect, (_period(effect), *others)))
    return found


def _rivals(without: LinearisedFit, beside: LinearisedFit, effect: Repeating) -> list[float]:
    """Periods of other waves and steps that are nearly as likely as a cause without it, the likeliest first.

    without, beside: the linearised fits without the cause and with it. A wave that is worth naming beside the cause is
    another error.
    """
    component, frequencies = _component(effect), frequencies_of(without, effect.axis)
    if len(frequencies) < OVERSAMPLING:
        return []
    ((sensitivity, best, _),) = strongest_waves(without, effect.axis, [component], frequencies)
    left, limit = Sensitivity.of(beside, effect.axis, component), _delta_bic(sensitivity, effect) + 2.0 * EVEN
    waves = [Cyclic(component, effect.axis, float(1.0 / each), (0.0,), (0.0,)) for each in best]
    tried = {_period(each): each for each in (*waves, *_steps(without, effect.axis, component))}
    likely = {period: _delta_bic(sensitivity, each) for period, each in tried.items()}
    travel = float(np.ptp(without.measurement.moving[effect.axis]))
    return [
        period
        for period in sorted(likely, key=lambda period: likely[period])
        if likely[period] < limit
        and not _indistinct(travel / period, travel / _period(effect))
        and _delta_bic(left, tried[period]) > WORTH
    ]


def _steps(linearised: LinearisedFit, axis: str, component: Component) -> list[Repeating]:
    """The strongest steps of a table along an axis; empty for other components than its own."""
    if axis[0] in "ABC" or component != own_component(axis):
        return []
    found = (each.effect for each in steps_along(linearised, axis))
    return [effect for effect in found if isinstance(effect, QuantisedCompensation)]


def _delta_bic(sensitivity: Sensitivity, effect: Repeating) -> float:
    """delta-BIC of the best wave, or steps, of these periods."""
    shapes = 1 if isinstance(effect, Cyclic) else 2
    return sensitivity.score(sensitivity.sizes(effect), shapes).delta_bic


def _indistinct(one: float, other: float) -> bool:
    """True for numbers of waves over the travel, of which one is nearly a multiple of the other."""
    return any(abs(one - k * other) < 1.0 or abs(k * one - other) < 1.0 for k in MULTIPLES)


def _explained(linearised: LinearisedFit, effect: Repeating) -> Array:
    """Part of the residual `(N,)` that an effect explains, white."""
    projected = linearised.projected(linearised.columns(effect))
    signal = projected.columns @ linearised.score(projected).size
    return np.asarray(signal - linearised.spanned @ (linearised.spanned.T @ signal))


def _component(effect: Repeating) -> Component:
    return effect.component if isinstance(effect, Cyclic) else own_component(effect.axis)


def _period(effect: Repeating) -> float:
    return effect.period if isinstance(effect, Cyclic) else effect.pitch


def at_positions(linearised: LinearisedFit, found: Undetermined) -> Unexplained:
    """The error at the positions that such a cause imitates, in the residual of a fit without it; at many, its own."""
    errors = _AtPositions.of(linearised, found.effect)
    shape = of_machine(linearised, errors.explained if errors else _explained(linearised, found.effect))
    rms = float(np.sqrt(np.mean(shape**2)))
    return Unexplained((found.effect.axis,), LENGTHS[:1], found.accepted.score.p_value, rms, shape, found.periods)
