"""Sizes of causes whose parameters are coefficients of functions of position: their errors at some positions."""

from __future__ import annotations

import numpy as np

from calibration.reports.causes.text import with_uncertainty
from kinematics.effects import COMPONENTS, Effect, unit_of
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

POSITIONS_OF_ONE_AXIS, POSITIONS_OF_TWO_AXES = 5, 2
"""Positions along the range of one axis, and along each of two axes."""


def at_positions(machine: Machine, effect: Effect, covariance: Array) -> list[str]:
    """The errors of an effect at positions over its ranges, with U (k=2) by the covariance of its parameters.

    The difference forward minus backward of an effect that depends on the direction. Empty for other effects.
    """
    if not effect.COEFFICIENTS:
        return []
    names = [name for name in effect.intervals if name in machine.names]
    count = POSITIONS_OF_ONE_AXIS if len(names) == 1 else POSITIONS_OF_TWO_AXES
    ends = [np.linspace(*effect.intervals[name], count) for name in names]
    places = np.stack([each.ravel() for each in np.meshgrid(*ends, indexing="ij")], axis=1)
    q = np.zeros((len(places), len(machine.axes)))
    numbers = [machine.index(name) for name in names]
    q[:, numbers] = places * machine.scale[numbers]
    unit, size = unit_of(COMPONENTS[_component(machine, effect, q)])
    design = _design(machine, effect, q) / size
    values = design @ np.array(effect.parameters)
    u = np.sqrt(np.maximum(np.sum(design @ covariance * design, axis=1), 0.0))
    units = [machine.axes[i].unit for i in numbers]
    shown = [
        f"{with_uncertainty(value, each)} {unit} at "
        + ", ".join(f"{name} {at:.4g} {of}" for name, at, of in zip(names, place, units, strict=True))
        for value, each, place in zip(values.tolist(), u.tolist(), places.tolist(), strict=True)
    ]
    return ["forward minus backward:", *shown] if "approach" in effect.needs else shown


def _component(machine: Machine, effect: Effect, q: Array) -> int:
    return next(iter(effect.columns(machine, State(q, approach=np.ones(q.shape))))).component


def _design(machine: Machine, effect: Effect, q: Array) -> Array:
    """Derivatives `(n, parameters)` of the error, mm or rad, or of its difference forward minus backward."""
    forward, backward = (
        next(iter(effect.columns(machine, State(q, approach=np.full(q.shape, side))))).values for side in (1.0, -1.0)
    )
    return np.asarray(forward - backward if "approach" in effect.needs else forward)
