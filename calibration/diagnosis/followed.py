"""Positions at which errors act: those that the axes had, behind their commands, or other than were read back.

The errors of a machine depend on where its axes are. While one is behind its command by more than a small part of a
wave, columns at the commands are no good columns: half of a wave of a moving axis would be left.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from calibration.gaussian_terms.linearised import SETTLED
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Structure
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
    start = structure.data.geometry.width
    found = np.zeros(state.positions.shape)
    for term in structure.terms:
        mean = structure.posterior.mean[start : start + term.width]
        start += term.width
        if term.parameters is None or any(OF_MOTION not in effect.needs for effect in term.effects):
            continue
        sizes = np.split(term.parameters @ mean, np.cumsum([np.count_nonzero(e.linear) for e in term.effects])[:-1])
        for effect, own in zip(term.effects, sizes, strict=True):
            values = np.array(effect.parameters)
            values[effect.linear] = own
            model = msgspec.structs.replace(no_errors(machine), effects=(effect.with_parameters(values.tolist()),))
            errors = model.observation(machine, state).errors
            for axis in machine.names:
                i, component, forward = own_motion(machine, axis)
                found[:, i] += forward * errors[:, i, component]
    return found


def _changed(structure: Structure, again: Observations) -> bool:
    """True where the columns of a structure at other positions change its residual by more than rounding."""
    geometry, mean = structure.data.geometry, structure.posterior.mean
    before = structure.data.observations
    effects = [*geometry.effects, *(effect for term in structure.terms for effect in term.effects)]
    values = [geometry.parameters @ mean[: geometry.width]]
    start = geometry.width
    for term in structure.terms:
        own = np.zeros(sum(len(effect.parameters) for effect in term.effects))
        if term.parameters is not None:
            linear = np.concatenate([effect.linear for effect in term.effects])
            own[linear] = term.parameters @ mean[start : start + term.width]
        values.append(own)
        start += term.width
    change = (again.columns(effects) - before.columns(effects)) @ np.concatenate(values)
    white = structure.whitener.columns(change[:, :, None])
    return float(np.sqrt(np.mean(white**2) / structure.noise.factor)) > SETTLED
