"""Causes of one axis that another axis modulates: their size, or the phase of their wave, depends on its position.

A wave of a screw, a play or a backlash is the same at all positions of the other axes. Where its columns, multiplied by
a polynomial of the position of another axis, explain much more, the cause only imitates an error of both axes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from calibration.diagnosis.residual.dependence import LENGTHS, Unexplained
from calibration.diagnosis.residual.unexplained import of_machine
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Accepted, Stage
from kinematics.effects import Backlash, Cyclic, Hysteresis, LateralPlay, QuantisedCompensation, ReversalSpike
from kinematics.transforms import Array

DEGREE = 4
"""Degree of the polynomial of the other axis' position."""
SHORT = LENGTHS[0], LENGTHS[3]
"""Lengths of the error of both axes, as fractions of their ranges."""
MUCH = 0.25
"""Squares that the modulation explains, as a share of those of the cause, from which these are much."""


OfOneAxis = Backlash | Cyclic | Hysteresis | LateralPlay | QuantisedCompensation | ReversalSpike
"""Effects that are the same at all positions of the other axes."""


class Modulated(NamedTuple):
    """An accepted cause of one axis, and the other axis that modulates it."""

    accepted: Accepted
    effect: OfOneAxis
    axis: str


def modulated(stage: Stage) -> list[Modulated]:
    """Accepted causes of one axis that the position of another axis modulates."""
    even, found = stage._replace(linearised=stage.linearised.evenly_noisy), []
    for i, each in enumerate(stage.accepted):
        effect = each.candidate.effect
        if not isinstance(effect, OfOneAxis):
            continue
        score = each.score
        if even.linearised is not stage.linearised:
            score = evaluate(even.without(i), [each.candidate])[0].score
        columns = even.linearised.columns(effect)
        for axis in even.linearised.measurement.moving:
            if axis == effect.axis:
                continue
            more = even.linearised.projected(_times_polynomial(even.linearised, columns, axis))
            tried = even.linearised.score(more)
            if tried.delta_bic < WORTH and tried.squares > MUCH * score.squares:
                found.append(Modulated(each, effect, axis))
                break
    return found


def modulation(linearised: LinearisedFit, without: Modulated) -> Unexplained | None:
    """The error that a modulated cause imitates, in the residual of a fit without the cause; None below chance."""
    effect = without.effect
    even = linearised.evenly_noisy
    score = even.score(even.projected(_with_modulation(even, without)))
    if score.delta_bic > WORTH:
        return None
    signal = (projected := linearised.projected(_with_modulation(linearised, without))).columns @ score.size
    signal -= linearised.spanned @ (projected.through @ score.size)
    of_position = isinstance(effect, Cyclic | QuantisedCompensation)
    variables = effect.axis if of_position else f"direction of {effect.axis}", without.axis
    shape = of_machine(linearised, signal)
    rms = float(np.sqrt(np.mean(shape**2)))
    return Unexplained(variables, SHORT, score.p_value, rms, shape)


def _with_modulation(linearised: LinearisedFit, found: Modulated) -> Array:
    """White columns `(N, k)` of a modulated cause, and of its modulation."""
    columns = linearised.columns(found.effect)
    return np.concatenate([columns, _times_polynomial(linearised, columns, found.axis)], axis=1)


def _times_polynomial(linearised: LinearisedFit, columns: Array, axis: str) -> Array:
    """White columns `(N, k)` multiplied by polynomials, without the constant, of the position of an axis."""
    low, high = linearised.measurement.moving[axis]
    values = legendre.legvander(2.0 * (linearised.positions(axis) - low) / (high - low) - 1.0, DEGREE)[:, 1:]
    by_row = columns.reshape(len(values), -1, columns.shape[1])
    return np.asarray((by_row[:, :, :, None] * values[:, None, None, :]).reshape(len(columns), -1))
