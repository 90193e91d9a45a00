"""An error model joined with effects that are known exactly."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel


def joined(model: ErrorModel, effects: Sequence[Effect], sign: float) -> ErrorModel:
    """A model and `sign` times further effects, which are known exactly."""
    scaled = [effect.with_parameters([sign * p for p in effect.parameters], effect.u) for effect in effects]
    covariance = model.covariance
    if covariance is not None:
        old, new = len(model.parameters), sum(len(effect.parameters) for effect in effects)
        square = np.zeros((old + new, old + new))
        square[:old, :old] = covariance
        covariance = tuple(map(tuple, square.tolist()))
    return msgspec.structs.replace(model, effects=(*model.effects, *scaled), covariance=covariance)
