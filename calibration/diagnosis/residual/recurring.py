"""Jumps that only imitate errors of an axis at its positions.

Where an axis has few positions, each with lines of its own, a jump shifts whole lines as independent errors at the
positions do: an error motion that no basis holds, such as a wave finer than the spacing of the positions.
"""

from __future__ import annotations

from itertools import product
from typing import get_args

import numpy as np

from calibration.diagnosis.residual.dependence import EVIDENCE
from calibration.diagnosis.residual.unexplained import by_evidence
from calibration.diagnosis.residual.unnamed import evidence
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from calibration.diagnosis.search.stage import Accepted, Stage
from kinematics.effects import Component, LocationJump, StationShift
from kinematics.effects.base import unit_of

MANY = 60
"""Number of positions of an axis from which errors at them are no alternative to a cause."""
SIZE = 10.0
"""Size, um or urad, in units of which their standard deviation is chosen."""


def recurring(stage: Stage) -> list[Accepted]:
    """Accepted jumps that errors of an axis at its positions explain nearly as well."""
    # estimated noise of an axis would hold much of these errors
    even, found = stage._replace(linearised=stage.linearised.evenly_noisy), []
    for i, each in enumerate(stage.accepted):
        if not isinstance(each.candidate.effect, LocationJump | StationShift):
            continue
        without = even.without(i)
        own = by_evidence(without, each.candidate)
        motions = product(stage.fit.measurement.moving, get_args(Component))
        if any(own - _added(without, even.linearised, *motion) < EVIDENCE for motion in motions):
            found.append(each)
    return found


def _added(without: LinearisedFit, with_cause: LinearisedFit, axis: str, component: Component) -> float:
    """Log odds of errors at the positions without a cause, less those with it; 0 where none are needed without it."""
    alone = _log_odds(without, axis, component)
    return alone - _log_odds(with_cause, axis, component) if alone > 0.0 else 0.0


def _log_odds(linearised: LinearisedFit, axis: str, component: Component) -> float:
    """Log odds of independent errors of an axis at its positions, of one standard deviation, against none."""
    sensitivity = Sensitivity.of(linearised, axis, component)
    _, number = np.unique(np.round(sensitivity.x, 3), return_inverse=True)
    if (count := int(number.max()) + 1) > MANY:
        return 0.0
    errors = SIZE * unit_of(component)[1] * np.eye(count)[number.reshape(-1)]
    return evidence(sensitivity.schur(errors), sensitivity.along @ errors)[0]
