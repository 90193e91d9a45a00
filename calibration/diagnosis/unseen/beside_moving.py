"""The model beside a function that moves with time, with the noise that this function leaves.

The fit without the function takes it for noise, of the instrument or of an axis, and for waves of the error motions.
Beside a swing, or a course that is the same at all positions, noise and bases are therefore found again. A function of
time and positions has parts that are finer than its terms: there the noise of the fit without it stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from calibration.diagnosis.residual.absorber import Absorbing, absorbing
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.unnamed import may_depend_on
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.recent_fits import RecentFits
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Accepted, Stage, chosen_of
from calibration.diagnosis.unseen.beside_function import BesideFunction
from calibration.diagnosis.unseen.swing import FoundSwing, Swing, Swinging, searched_swing
from calibration.diagnosis.verdict import CLEAR
from kinematics.state import TIME
from kinematics.transforms import Array

ROUNDS = 5
"""Most fits with the noise that the function leaves."""
SETTLED = 0.1
"""Change of the variance of the noise, as a share, up to which it is not estimated again."""


class BesideMoving(NamedTuple):
    """A model beside a function that moves with time."""

    solution: BesideFunction
    swinging: Swinging | None
    """The swing that the function is; None for a course."""

    @property
    def swing(self) -> FoundSwing | None:
        """The swing as it is reported."""
        return None if self.swinging is None else self.swinging.found(self.solution.plain)

    def in_its_direction(self, dependence: Unexplained) -> BesideFunction:
        """The solution with a swing in its clearest direction only, and a smooth function for the others."""
        assert self.swinging is not None
        plain = self.solution.plain
        return BesideFunction(plain, self.swinging.with_rest(plain, dependence, (self.swinging.component,)))


def beside_moving(selector: Selector, stage: Stage, dependence: Unexplained) -> BesideMoving | None:
    """The model of a stage beside a swing, or beside a course in time alone; None where there is neither."""
    linearised = stage.linearised
    if TIME not in dependence.variables or not all(may_depend_on(linearised, name) for name in dependence.variables):
        return None
    swing = searched_swing(linearised, dependence)
    if swing is None and dependence.variables != (TIME,):
        return None
    return settled_beside(selector, stage, dependence, swing)


def settled_beside(
    selector: Selector, stage: Stage, dependence: Unexplained, swing: Swinging | None
) -> BesideMoving | None:
    """The model of a stage beside a swing, or a course, with the noise that this leaves; None where it is unlikely."""
    noise = math.inf
    for _ in range(ROUNDS):
        swing = None if swing is None else swing.tuned(stage.linearised)
        solution = BesideFunction(stage.linearised, _beside(stage.linearised, dependence, swing))
        if min(abs(solution.noise - 1.0), abs(solution.noise / noise - 1.0)) < SETTLED:
            break
        noise, stage = solution.noise, _with_noise_beside(selector, stage.accepted, solution.values)
    return BesideMoving(solution, swing) if solution.function.log_odds > 0.0 else None


def without_swing(
    selector: Selector, stage: Stage, dependence: Unexplained, moving: BesideMoving | None
) -> Selector | None:
    """The selector for the observations less the swing beside which a stage was fitted; None without one."""
    if moving is None or moving.swinging is None:
        return None
    # without causes, a further direction of the swing may be a part of one
    solution = moving.solution if stage.accepted else moving.in_its_direction(dependence)
    effects = solution.function.effects
    return _less(selector, solution.values_of(sum(len(each.terms) for each in effects if isinstance(each, Swing))))


def without_evidence(selector: Selector, stage: Stage, dependence: Unexplained) -> list[Accepted]:
    """Accepted causes of a stage without evidence beside a swing: they are a part of it. None without a swing.

    Beside a course in time nearly every cause would have little support.
    """
    moving = beside_moving(selector, stage, dependence) if stage.accepted else None
    if moving is None or moving.swinging is None:
        return []
    swinging, values = moving.swinging, moving.solution.values
    return _unneeded(selector, stage, values, lambda without: _beside(without, dependence, swinging), 0.0)


def parts_of_swing(selector: Selector, stage: Stage, moving: BesideMoving) -> list[Accepted]:
    """Accepted causes of a stage without clear evidence beside its swing alone, fitted together with each.

    The form of a swing is unknown, and its remainder may look like a small cause.
    """
    if moving.swinging is None:
        return []
    return _unneeded(selector, stage, moving.solution.values, moving.swinging.beside, CLEAR * WORTH)


def _unneeded(
    selector: Selector, stage: Stage, values: Array, beside: Callable[[LinearisedFit], Absorbing], most: float
) -> list[Accepted]:
    """Accepted causes with a delta-BIC above `most` beside a function.

    With the noise of observations less its values `(n, d)`.
    """
    found = []
    for each in stage.accepted:
        others = [other for other in stage.accepted if other is not each]
        without = _with_noise_beside(selector, others, values)
        score = evaluate(beside(without.linearised).linearised, [each.candidate])[0].score
        if score.delta_bic > most:
            found.append(each)
    return found


def _beside(linearised: LinearisedFit, dependence: Unexplained, swing: Swinging | None) -> Absorbing:
    if swing is None:
        return absorbing(linearised, dependence, whole=True)
    return swing.with_rest(linearised, dependence)


def _with_noise_beside(selector: Selector, accepted: Sequence[Accepted], values: Array) -> Stage:
    """The fit of some causes to all observations, as observations less values show it best.

    Its noise, its weights and its bases are those of a fit to the observations less values `(n, d)`, mm and rad.
    """
    other = _less(selector, values)
    chosen = chosen_of(accepted)
    again = other.on(other.chosen_again(other.stage(chosen)))
    found = again.cautious(again.stage(chosen))
    measurement = replace(found.fit.measurement, observed=selector.measurement.observed)
    fit = replace(found.fit, measurement=measurement, residual=found.fit.residual + values)
    return found._replace(fit=fit, linearised=replace(found.linearised, fit=fit).less(-values))


def _less(selector: Selector, values: Array) -> Selector:
    """The selector for the observations less values `(n, d)`, mm and rad."""
    given = selector.measurement
    base, less = replace(selector.base, known={}), replace(given, observed=given.observed - values)
    return replace(selector, base=base, measurement=less, recent=RecentFits(), bare_stages={})
