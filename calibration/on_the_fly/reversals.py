"""Backlash on the fly: difference of errors between forward and backward motion (proposed in the on-the-fly paper).

Either one number or one curve for each error motion: the fit has a few more unknowns, or about twice as many.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

from calibration.measurement.measurement import Measurement
from kinematics.basis import BSpline, Interval, Legendre
from kinematics.effects import Backlash, Component, Effect, Reversal
from kinematics.effects.base import own_component
from kinematics.user_error import UserError

MODES = ("none", "constant", "curves")
REVERSAL_NODES = 5
"""Number of nodes of a curve."""


def reversals(measurement: Measurement, mode: str) -> list[Effect]:
    """Additional effects to fit, all zero, for every axis that moves; UserError for a mode that is not in MODES."""
    if mode not in MODES:
        raise UserError(f"--reversal {mode}: expected one of {', '.join(MODES)}")
    if mode == "none":
        return []
    of_axis = _constants if mode == "constant" else _curves
    return [effect for axis, interval in measurement.moving.items() for effect in of_axis(axis, interval)]


def _constants(axis: str, interval: Interval) -> Iterator[Effect]:
    for component in get_args(Component):
        if component == own_component(axis):
            yield Backlash(axis, 0.0)
        else:
            yield Reversal(component, axis, Legendre(interval, 0), (0.0,))


def _curves(axis: str, interval: Interval) -> Iterator[Effect]:
    low, high = interval
    nodes = tuple(low + (high - low) * k / (REVERSAL_NODES - 1) for k in range(REVERSAL_NODES))
    for component in get_args(Component):
        yield Reversal(component, axis, BSpline(nodes, 1), (0.0,) * REVERSAL_NODES)
