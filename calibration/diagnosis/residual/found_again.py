"""Searched shapes, searched again without each held-out block, which the shape found there must predict.

The gain on a held-out block is biased where all rows have chosen the shape: of thousands of periods one also suits the
rows of the block. A period that is there is found again in the other blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from scipy import special

from calibration.diagnosis.search.evaluation import standard_error
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes import proposed_shapes as scans
from calibration.diagnosis.search.shapes.sawtooth import refined
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from calibration.diagnosis.search.shapes.spectra import Waves
from kinematics.effects import Cyclic, Effect, QuantisedCompensation
from kinematics.effects.base import own_component
from kinematics.transforms import Array

SURE = 2.0
"""Standard errors by which the gain on held-out blocks must exceed zero."""
FALSE = 0.01
"""Or the chance that as many blocks are predicted better by nothing."""
THIRD, FEW = 3, 4
"""One in so many blocks is tried first, if that makes at least FEW."""


def found_again(linearised: LinearisedFit, effect: Effect) -> bool:
    """True where the blocks are predicted better, each with the shape that the same search finds in the others.

    Better by `SURE` standard errors, or so many of them that chance reaches it in `FALSE` of all cases. False where a
    third of many blocks is on the whole predicted worse, and most of these are. Also true of an effect whose period is
    not searched for, and of runs along one axis, whose positions recur or follow closely.
    """
    if not isinstance(effect, (Cyclic, QuantisedCompensation)) or linearised.measurement.axis is not None:
        return True
    count, search = len(linearised.blocks), _search(linearised, effect)
    if search is None:
        return False
    order = [*range(0, count, THIRD), *(number for number in range(count) if number % THIRD)]
    shapes: list[Effect] = []
    for place, number in enumerate(order):
        if place == len(order[::THIRD]) >= FEW and _worse(_gains(linearised, shapes, order[:place])):
            return False
        shapes.append(search(number))
    gains = _gains(linearised, shapes, order)
    better = special.bdtrc(np.count_nonzero(gains > 0) - 1, len(gains), 0.5) < FALSE
    return bool(gains.mean() > SURE * standard_error(gains) or (gains.sum() > 0 and better))


def _gains(linearised: LinearisedFit, shapes: Sequence[Effect], numbers: Sequence[int]) -> Array:
    """Reduction of the squares of some blocks, given by number, each by the shape found in the others."""
    return linearised.gains_of_each(linearised.responses(shapes), numbers)


def _worse(gains: Array) -> bool:
    """True where blocks are predicted worse, on the whole and most of them."""
    return bool(gains.sum() <= 0.0 and 2 * np.count_nonzero(gains > 0.0) < len(gains))


def _search(
    linearised: LinearisedFit, effect: Cyclic | QuantisedCompensation
) -> Callable[[int], Cyclic | QuantisedCompensation] | None:
    """Search for the strongest shape of the kind of an effect along its axis, without a block given by its number.

    A wave has the harmonics of the effect. None where no period can be searched for.
    """
    of_steps, axis = isinstance(effect, QuantisedCompensation), effect.axis
    frequencies = (scans.frequencies_of_steps if of_steps else scans.frequencies_of)(linearised, axis)
    if len(frequencies) < scans.OVERSAMPLING:
        return None
    component = effect.component if isinstance(effect, Cyclic) else own_component(axis)
    some = linearised.thinned(scans.SCANNED)
    whole = Sensitivity.of(some if len(some.blocks) == len(linearised.blocks) else linearised, axis, component)
    waves, without = Waves.of(whole.x, frequencies), whole.without_each()

    def found(number: int) -> Cyclic | QuantisedCompensation:
        others = without(number)
        if isinstance(effect, QuantisedCompensation):
            return refined(others, scans.strongest_steps(others, axis, waves))
        ((best, gains),) = scans.strongest_of([others], [component], waves)
        return msgspec.structs.replace(effect, period=1.0 / float(best[int(np.argmax(gains))]))

    return found
