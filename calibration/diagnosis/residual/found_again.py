"""Searched shapes, searched again without each held-out block, which the shape found there must predict.

The gain on a held-out block is biased where all rows have chosen the shape: of thousands of periods one also suits the
rows of the block. A period that is there is found again in the other blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.evaluation import standard_error
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes import proposed_shapes as scans
from kinematics.effects import Cyclic, Effect, QuantisedCompensation

SURE = 2.0
"""Standard errors by which the gain on held-out blocks must exceed zero."""
FALSE = 0.01
"""Or the chance that as many blocks are predicted better by nothing."""


def found_again(linearised: LinearisedFit, effect: Effect) -> bool:
    """True where the blocks are predicted better, each with the shape that the same search finds in the others.

    Better by `SURE` standard errors, or so many of them that chance reaches it in `FALSE` of all cases. Also true of an
    effect whose period is not searched for, and of runs along one axis, whose positions recur or follow closely.
    """
    if not isinstance(effect, (Cyclic, QuantisedCompensation)) or linearised.measurement.axis is not None:
        return True
    shapes: list[Effect] = []
    for block in linearised.blocks:
        inside = block.rows.reshape(len(linearised.rows), -1)[:, 0]
        others = linearised.of_rows(np.flatnonzero(~inside)).thinned(scans.SCANNED)
        shapes += [candidate.effect for candidate in _searched(others, effect)]
    if len(shapes) < len(linearised.blocks):
        return False
    gains = linearised.gains_of_each(linearised.responses(shapes))
    better = special.bdtrc(np.count_nonzero(gains > 0) - 1, len(gains), 0.5) < FALSE
    return bool(gains.mean() > SURE * standard_error(gains) or (gains.sum() > 0 and better))


def _searched(linearised: LinearisedFit, effect: Cyclic | QuantisedCompensation) -> Sequence[Candidate]:
    """The strongest shape of the kind of an effect along its axis, if there is one."""
    if isinstance(effect, Cyclic):
        return scans.waves_of(linearised, effect.axis, (effect.component,))
    return scans.steps_along(linearised, effect.axis)
