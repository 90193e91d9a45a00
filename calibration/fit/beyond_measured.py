"""The check of every calibration before it is written: no error motion may grow outside the measured range.

A curve that fits its points can have any value elsewhere: two parameters that cancel at the points do not cancel
there. Therefore each error motion is evaluated over the whole travel of its axis, or the whole turn, with all effects
together.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kinematics.basis import Interval
from kinematics.effects import COMPONENTS, Effect
from kinematics.effects.base import unit_of
from kinematics.error_model.model import ErrorModel, encode_model
from kinematics.machine import TURN_DEG, Axis, Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.turn import beyond, gap_of
from kinematics.user_error import UserError

CHANGE_SHARE = 0.5
"""Largest permitted change of an error motion outside the measured range, as a share of its change inside."""
FLOOR = 10.0
"""Change, um or urad, that is never refused."""
POSITIONS_OF_RANGE = 721
"""Number of positions along the measured range, and again along the whole travel."""


class Growth(NamedTuple):
    """An error motion that exceeds its measured values outside the measured range; um or urad."""

    name: str
    unit: str
    inside: float
    """Its change in the measured range."""
    outside: float
    """Its further change outside the measured range."""
    where: float
    """Position of the axis at this change, mm or degrees."""
    measured: str


def calibration_file(model: ErrorModel, machine: Machine) -> bytes:
    """Content of the calibration file; UserError when an error motion grows outside the measured range."""
    check_beyond_measured(model, machine)
    return encode_model(model)


def check_beyond_measured(model: ErrorModel, machine: Machine) -> None:
    """UserError, naming the first error motion that grows by more than `CHANGE_SHARE` and FLOOR outside its range."""
    for growth in growths(model, machine):
        if growth.outside > max(CHANGE_SHARE * growth.inside, FLOOR):
            raise UserError(
                f"no calibration is written: {growth.name} changes by {growth.inside:.3g} {growth.unit} in the "
                f"measured range ({growth.measured}) and by {growth.outside:.3g} {growth.unit} more outside "
                f"(at {growth.where:.4g}), more than {CHANGE_SHARE:.0%} and {FLOOR:g} {growth.unit}: measure the "
                "axis over its travel, or leave out the effect that causes it (a wobble, a wave, a product with "
                "another axis)"
            )


def growths(model: ErrorModel, machine: Machine) -> Iterator[Growth]:
    """The growth of each error motion whose axis was measured over a part of its travel, or of its turn."""
    alone = model.part(_depends_on_positions)
    for i, axis in enumerate(machine.axes):
        arc = _measured(alone, axis)
        if arc is None:
            continue
        x = _everywhere(axis, arc)
        outside = beyond(arc, x) > 0 if axis.turns_fully else (x < arc[0]) | (x > arc[1])
        if not outside.any():
            continue
        errors = _along(alone, machine, i, x)
        measured = f"{axis.name} from {arc[0]:g} to {arc[1]:g} {axis.unit}"
        for k, component in enumerate(COMPONENTS):
            unit, size = unit_of(component)
            inside, values = errors[~outside, k] / size, errors[:, k] / size
            excess = np.where(outside, np.maximum(inside.min() - values, values - inside.max()), 0.0)
            worst = int(np.argmax(excess))
            name = f"E_{component}{axis.name}"
            yield Growth(name, unit, float(np.ptp(inside)), float(excess[worst]), float(x[worst]), measured)


def _depends_on_positions(effect: Effect) -> bool:
    """True for effects of the machine at rest, except location errors: these hold outside the measured range too."""
    return (
        effect.ACTS_ON != "instrument"
        and effect.part != "line"
        and not effect.HAS_MEMORY
        and set(effect.needs) <= {"approach"}
    )


def _measured(model: ErrorModel, axis: Axis) -> Interval | None:
    """The widest interval over which an effect of the axis is known."""
    known = [effect.intervals[axis.name] for effect in model.effects if axis.name in effect.intervals]
    return max(known, key=lambda interval: interval[1] - interval[0]) if known else None


def _everywhere(axis: Axis, arc: Interval) -> Array:
    """Positions over the whole travel of the axis, or the whole turn.

    Without an end of travel they reach beyond the measured range by its own width.
    """
    width = arc[1] - arc[0]
    if axis.turns_fully:
        low, high = (arc[0], arc[0] + TURN_DEG) if gap_of(arc) else arc
    else:
        low = axis.travel[0] if np.isfinite(axis.travel[0]) else arc[0] - width
        high = axis.travel[1] if np.isfinite(axis.travel[1]) else arc[1] + width
    return np.unique(
        np.concatenate(
            [
                np.linspace(*arc, POSITIONS_OF_RANGE),
                np.linspace(min(low, arc[0]), max(high, arc[1]), POSITIONS_OF_RANGE),
            ]
        )
    )


def _along(model: ErrorModel, machine: Machine, column: int, x: Array) -> Array:
    """Error motions `(n, 6)` of an axis, mm and rad, with the others at home."""
    q = np.tile([axis.home for axis in machine.axes], (len(x), 1))
    q[:, column] = x
    return model.errors(machine, State(q * machine.scale, np.zeros_like(q)))[:, column]
