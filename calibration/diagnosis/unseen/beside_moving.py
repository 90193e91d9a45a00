"""The model beside a function that moves with time, with the noise that this function leaves.

The fit without the function takes it for noise, of the instrument or of an axis, and for waves of the error motions.
Beside a swing, or a course that is the same at all positions, noise and bases are therefore found again. A function of
time and positions has parts that are finer than its terms: there the noise of the fit without it stays.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from calibration.diagnosis.residual.absorber import absorbing
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.unnamed import may_depend_on
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.recent_fits import RecentFits
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Stage, chosen_of
from calibration.diagnosis.unseen.beside_function import BesideFunction
from calibration.diagnosis.unseen.swing import FoundSwing, searched_swing
from kinematics.state import TIME
from kinematics.transforms import Array

ROUNDS = 5
"""Most fits with the noise that the function leaves."""
SETTLED = 0.1
"""Change of the variance of the noise, as a share, up to which it is not estimated again."""


class BesideMoving(NamedTuple):
    """A model beside a function that moves with time."""

    solution: BesideFunction
    swing: FoundSwing | None
    """The swing that the function is; None for a course."""


def beside_moving(selector: Selector, stage: Stage, dependence: Unexplained) -> BesideMoving | None:
    """The model of a stage beside a swing, or beside a course in time alone; None where there is neither."""
    linearised, noise = stage.linearised, math.inf
    if TIME not in dependence.variables or not all(may_depend_on(linearised, name) for name in dependence.variables):
        return None
    swing = searched_swing(linearised, dependence)
    if swing is None and dependence.variables != (TIME,):
        return None
    for _ in range(ROUNDS):
        if swing is None:
            function = absorbing(linearised, dependence, whole=True)
        else:
            swing = swing.tuned(linearised)
            function = swing.with_rest(linearised, dependence)
        solution = BesideFunction(linearised, function)
        if min(abs(solution.noise - 1.0), abs(solution.noise / noise - 1.0)) < SETTLED:
            break
        noise, linearised = solution.noise, _with_noise_beside(selector, stage, solution.values)
    if solution.function.log_odds <= 0.0:
        return None
    return BesideMoving(solution, None if swing is None else swing.found(linearised))


def _with_noise_beside(selector: Selector, stage: Stage, values: Array) -> LinearisedFit:
    """The fit of the causes of a stage to all observations, linearised, as observations less values show it best.

    Its noise, its weights and its bases are those of a fit to the observations less values `(n, d)`, mm and rad.
    """
    given = selector.measurement
    base, less = replace(selector.base, known={}), replace(given, observed=given.observed - values)
    other = replace(selector, base=base, measurement=less, recent=RecentFits(), bare_stages={})
    chosen = chosen_of(stage.accepted)
    again = other.on(other.chosen_again(other.stage(chosen)))
    linearised = again.cautious(again.stage(chosen)).linearised
    fit = linearised.fit
    measurement = replace(fit.measurement, observed=given.observed)
    return replace(linearised, fit=replace(fit, measurement=measurement, residual=fit.residual + values)).less(-values)
