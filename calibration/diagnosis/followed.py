"""Positions at which errors act: those that the axes had, behind their commands, or other than were read back.

The errors of a machine depend on where its axes are. While one is behind its command by more than a small part of a
wave, columns at the commands are no good columns: half of a wave of a moving axis would be left.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from calibration.gaussian_terms.linearised import SETTLED_OBSERVATIONS
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Structure
from kinematics.effects import Effect
from kinematics.effects.base import own_motion
from kinematics.error_model.model import no_errors
from kinematics.transforms import Array

OF_MOTION = "velocity"
"""Column of the state that effects of the motion itself need."""


def followed(structure: Structure, commanded: Observations) -> Observations | None:
    """The observations with the axes where the motion has put them; None where no error changes by it.

    commanded: the observations with the axes at their commands.
    """
    moved = commanded.measurement.state.positions + _ahead(structure)
    measurement = structure.data.observations.measurement
    if np.array_equal(moved, measurement.state.positions):
        return None
    again = replace(commanded, measurement=replace(measurement, state=replace(measurement.state, positions=moved)))
    return again if _changed(structure, again) else None


def _ahead(structure: Structure) -> Array:
    """How far the axes are ahead of their commands `(n, axes)`, mm and rad, by the effects of the motion."""
    state, machine = structure.data.observations.measurement.state, structure.data.observations.measurement.machine
    of_motion: list[Effect] = []
    for number, term in enumerate(structure.terms):
        if all(OF_MOTION in effect.needs for effect in term.effects):
            values = term.values(structure.posterior.mean[structure.columns_of(number)])
            ends = np.cumsum([len(effect.parameters) for effect in term.effects])[:-1]
            each = zip(term.effects, np.split(values, ends), strict=False)
            of_motion += [effect.with_parameters(own.tolist()) for effect, own in each]
    model = msgspec.structs.replace(no_errors(machine), effects=tuple(of_motion))
    errors, found = model.observation(machine, state).errors, np.zeros(state.positions.shape)
    for i, component, forward in (own_motion(machine, axis) for axis in machine.names):
        found[:, i] = forward * errors[:, i, component]
    return found


def _changed(structure: Structure, again: Observations) -> bool:
    """True where the columns of a structure at other positions change its residual by more than rounding."""
    geometry, mean = structure.data.geometry, structure.posterior.mean
    effects = [*geometry.effects, *(effect for term in structure.terms for effect in term.effects)]
    own = (term.values(mean[structure.columns_of(number)]) for number, term in enumerate(structure.terms))
    values = np.concatenate([geometry.parameters @ mean[: geometry.width], *own])
    change = (again.columns(effects) - structure.data.observations.columns(effects)) @ values
    white = structure.whitener.columns(change[:, :, None])
    return float(np.sqrt(np.mean(white**2) / structure.noise.factor)) > SETTLED_OBSERVATIONS
