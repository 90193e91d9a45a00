"""Changes of a machine since its calibration: causes that are tried in the place of what the calibration has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import get_args

from calibration.fit.datum import along_own_line
from kinematics.basis import Interval, Legendre
from kinematics.effects import Component, Effect, LocationError, Racking, Scale, Wobble
from kinematics.effects.base import own_component
from kinematics.effects.geometric import Motion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import split_chain

HARMONICS_OF_TURN = (1, 2)
"""Harmonics of an error of what turns, an axis or the circle of an encoder: it is eccentric or tilted, or oval."""
SQUARE_BY_DATUM = ("E_C0X", "E_B0X", "E_A0Y")
"""Orientations that are zero by the datum: X is x, and Y lies in the x y plane."""
BRIDGE_MM = 1000.0
"""Least length of a bridge that is driven on both sides: a judgement, shorter ones are driven in the middle."""


def changes(model: ErrorModel) -> Iterator[Effect]:
    """Changes of a machine since its calibration, other than of the course of its error motions.

    Scales, location errors, wobble and racking, which a first calibration contains as error motions; and a change of
    each other effect that the calibration has, at zero.
    """
    axes = {motion.axis: motion for motion, _ in model.error_motions}
    for axis in axes:
        rotary = axis[0] in "ABC"
        own = along_own_line(axis) if rotary else "XYZ" + _about(axis)
        lines = (LocationError(component, axis, 0.0) for component in get_args(Component) if component not in own)
        yield from (line for line in lines if line.name not in SQUARE_BY_DATUM)
        yield from _wobbles(axis) if rotary else [Scale(axis, 0.0)]
    for effect in model.effects:
        of_its_own = effect.NAMES_CAUSE and not (effect.OF_ISO_230 or effect.OF_SEVERAL_CLASSES)
        if of_its_own and effect.ACTS_ON != "instrument":
            yield at_zero(effect)
    yield from _racking(model, {axis: motion.basis.interval for axis, motion in axes.items()})


def _wobbles(axis: str) -> Iterator[Effect]:
    for motion in get_args(Motion):
        for harmonic in HARMONICS_OF_TURN:
            for sense in (1, -1):
                yield Wobble(axis, motion, harmonic, sense, 0.0, 0.0)


def _racking(model: ErrorModel, intervals: Mapping[str, Interval]) -> Iterator[Effect]:
    """Racking of the first axis of the tool's side, if it carries a bridge: a long second axis, across it."""
    bridge = [name for name, side in split_chain(model.machine.chain) if side == "tool" and name[0] not in "ABC"][:2]
    if all(name in intervals and own_component(name) in "XY" for name in bridge) and len(bridge) == 2:
        axis, cross = bridge
        low, high = intervals[cross]
        if high - low >= BRIDGE_MM and own_component(axis) != own_component(cross):
            yield Racking(axis, cross, high - low, Legendre(intervals[axis], 1), (0.0, 0.0), low)


def _about(axis: str) -> str:
    """Component of the rotation about a linear axis' own line."""
    return "ABC"["XYZ".index(own_component(axis))]


def at_zero(effect: Effect) -> Effect:
    """The effect with its linear parameters at zero, shapes as they are."""
    parameters, no_u = effect.parameters, (0.0,) * len(effect.parameters)
    values = tuple(0.0 if linear else value for linear, value in zip(effect.linear, parameters, strict=True))
    return effect if (values, no_u) == (parameters, effect.u) else effect.with_parameters(values, no_u)
