"""Searched shapes, searched again without each held-out block, which the shape found there must predict.

The gain on a held-out block is biased where all rows have chosen the shape: of thousands of periods one also suits the
rows of the block. A period that is there is found again in the other blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from scipy import special

from calibration.diagnosis.search.evaluation import standard_error
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes import proposed_shapes as scans
from kinematics.effects import Cyclic, Effect, QuantisedCompensation
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
    count = len(linearised.blocks)
    order = [*range(0, count, THIRD), *(number for number in range(count) if number % THIRD)]
    shapes: list[Effect] = []
    for place, number in enumerate(order):
        if place == len(order[::THIRD]) >= FEW and _worse(_gains(linearised, shapes, order[:place])):
            return False
        found = _searched(_without(linearised, number), effect)
        if not found:
            return False
        shapes += found
    gains = _gains(linearised, shapes, order)
    better = special.bdtrc(np.count_nonzero(gains > 0) - 1, len(gains), 0.5) < FALSE
    return bool(gains.mean() > SURE * standard_error(gains) or (gains.sum() > 0 and better))


def _gains(linearised: LinearisedFit, shapes: Sequence[Effect], numbers: Sequence[int]) -> Array:
    """Reduction of the squares of some blocks, given by number, each by the shape found in the others."""
    return linearised.gains_of_each(linearised.responses(shapes), numbers)


def _worse(gains: Array) -> bool:
    """True where blocks are predicted worse, on the whole and most of them."""
    return bool(gains.sum() <= 0.0 and 2 * np.count_nonzero(gains > 0.0) < len(gains))


def _without(linearised: LinearisedFit, number: int) -> LinearisedFit:
    """The linearised fit of the rows that are not in a block."""
    inside = linearised.blocks[number].rows.reshape(len(linearised.rows), -1)[:, 0]
    return linearised.of_rows(np.flatnonzero(~inside)).thinned(scans.SCANNED)


def _searched(linearised: LinearisedFit, effect: Cyclic | QuantisedCompensation) -> list[Effect]:
    """The strongest shape of the kind of an effect along its axis, if there is one; of a wave, with its harmonics."""
    if isinstance(effect, QuantisedCompensation):
        return [candidate.effect for candidate in scans.steps_along(linearised, effect.axis)]
    frequencies = scans.frequencies_of(linearised, effect.axis)
    if len(frequencies) < scans.OVERSAMPLING:
        return []
    ((_, best, gains),) = scans.strongest_waves(linearised, effect.axis, [effect.component], frequencies)
    return [msgspec.structs.replace(effect, period=1.0 / float(best[int(np.argmax(gains))]))]
