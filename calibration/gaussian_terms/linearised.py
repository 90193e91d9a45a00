"""Observations that are linearised about the errors that a structure finds: a few steps of Gauss and Newton.

They matter for errors of millimetres, for chains of rotary axes, and for instruments that see lengths only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np

from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from kinematics.error_model.model import ErrorModel, no_errors

MOST_LINEARISATIONS = 5
"""Most times that the observations are linearised again."""
SETTLED_OBSERVATIONS = 0.05
"""RMS change of the observations in such a pass, in standard deviations of the noise, below which they stay."""


def linearised(structure: Structure, fitted: Callable[[Structure], Structure] = Structure.fitted) -> Structure:
    """The structure of the geometry alone, fitted to observations that are linearised about its own errors."""
    for _ in range(MOST_LINEARISATIONS):
        observations = structure.data.observations.about(mean_errors(structure))
        if change_of(structure, observations) < SETTLED_OBSERVATIONS:
            break
        structure = fitted(replace(structure, data=Data.of(observations, asked=structure.data.asked)))
    return structure


def mean_errors(structure: Structure) -> ErrorModel:
    """The errors of the geometry of a structure, without a datum: their posterior mean."""
    geometry = structure.data.geometry
    values = geometry.values(structure.posterior.mean[: geometry.width])
    ends = np.cumsum([len(effect.parameters) for effect in geometry.effects])[:-1]
    effects = [
        effect.with_parameters(own.tolist())
        for effect, own in zip(geometry.effects, np.split(values, ends), strict=True)
    ]
    machine = structure.data.observations.measurement.machine
    return msgspec.structs.replace(no_errors(machine), effects=tuple(effects))


def change_of(structure: Structure, observations: Observations) -> float:
    """RMS difference of other observations, in standard deviations of the noise, whatever the registration."""
    white = structure.whitener
    change = replace(white, observations=observations).residual - white.residual
    return float(np.sqrt(np.mean(change**2) / structure.noise.factor))
