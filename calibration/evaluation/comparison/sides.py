"""The two calibrations of a comparison: their error motions, common ranges and uncertainties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.basis import Interval
from kinematics.effects import COMPONENTS, Effect, after_touch_off
from kinematics.effects.base import unit_of
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

SIDE_POSITIONS = 121
"""Number of positions along an axis."""
COMPARED_TURN_DEG = 360.0
"""Largest compared range of a rotary axis, degrees: one turn."""
ZERO_ERROR_UM = 1e-9
"""Smallest error, um or urad; smaller ones count as zero."""


class Curve(NamedTuple):
    """Error motion of one calibration: values `(n,)`, and derivatives with respect to its parameters `(n, p)`."""

    values: Array
    design: Array


class Side:
    """One of the two calibrations: its effects that depend on position and approach alone."""

    def __init__(self, machine: Machine, model: ErrorModel) -> None:
        self.machine = machine
        self.model = model.part(lambda effect: not reason_left_out(effect))
        self.intervals = intervals_of(machine, self.model)

    def curve(self, i: int, k: int, positions: Array, sign: float = 0.0) -> Curve:
        """Component k of axis i, um or urad, at positions in mm and rad; `sign`: direction of approach, -1, 0 or 1."""
        state = along(self.machine, i, positions, sign)
        values = self.model.errors(self.machine, state)[:, i, k]
        chosen = np.zeros((len(positions), 1, 6 * (len(self.machine.axes) + 1)))
        chosen[:, :, 6 * i + k] = 1.0
        design = self.model.design(self.machine, state, chosen)[:, 0]
        size = unit_of(COMPONENTS[k])[1]
        return Curve(values / size, design / size)

    def covariance(self, design: Array) -> Array:
        """Covariance `(n, n)` of quantities with these derivatives `(n, p)`."""
        if self.model.covariance is not None:
            return np.asarray(design @ np.array(self.model.covariance) @ design.T)
        u = np.array([v for effect in self.model.effects for v in effect.uncertainties])
        return np.asarray((design * u**2) @ design.T)

    def U(self, design: Array) -> float:
        """Expanded uncertainty of one quantity with these derivatives `(p,)`."""
        return float(COVERAGE_FACTOR * np.sqrt(np.maximum(self.covariance(design[None])[0, 0], 0.0)))


def reason_left_out(effect: Effect) -> str:
    """Reason why an effect is not compared; empty if it is."""
    if effect.ACTS_ON == "instrument":
        return "an effect of the instrument"
    if after_touch_off(effect):
        return "has come since the touch-off, and changes with time"
    others = [need.replace("_", " ") for need in effect.needs if need != "approach"]
    others += [f"temperature {sensor}" for sensor in effect.sensors]
    return f"depends on {', '.join(dict.fromkeys(others))}" if others else ""


def along(machine: Machine, i: int, positions: Array, sign: float) -> State:
    """Axis i at positions `(n,)`, mm or rad, approached in a direction (-1, 0, 1), with all other axes at home."""
    q = np.tile([axis.home for axis in machine.axes] * machine.scale, (len(positions), 1))
    q[:, i] = positions
    approach = np.zeros(q.shape)
    approach[:, i] = sign
    return State(q, approach=approach)


def intervals_of(machine: Machine, model: ErrorModel) -> dict[tuple[int, int], Interval]:
    """Intervals, mm or degrees, in which the effects of the model are defined, by axis and component."""
    found: dict[tuple[int, int], Interval] = {}
    for effect in model.effects:
        known = effect.intervals
        for key, component, _ in effect.columns(machine, along(machine, 0, np.zeros(1), 1.0)):
            if not 0 <= key < len(machine.axes):
                continue
            axis = machine.axes[key]
            low, high = known.get(axis.name, axis.travel)
            before = found.get((key, component), axis.travel)
            found[key, component] = max(before[0], low), min(before[1], high)
    return found


def common_range(sides: Sequence[Side], i: int, k: int) -> Interval | None:
    """The common range of an error motion, mm or degrees, at most a turn; None if neither calibration has it."""
    known = [side.intervals[i, k] for side in sides if (i, k) in side.intervals]
    if not known:
        return None
    low, high = max(ends[0] for ends in known), min(ends[1] for ends in known)
    axis = sides[0].machine.axes[i]
    if axis.rotary and high - low > COMPARED_TURN_DEG:
        low = min(max(low, axis.home - COMPARED_TURN_DEG / 2.0), high - COMPARED_TURN_DEG)
        high = low + COMPARED_TURN_DEG
    return low, high


def positions_over(machine: Machine, i: int, ends: Interval) -> Array:
    """Positions `(n,)` over a range, mm or degrees; for a whole turn without the repeated end."""
    whole = machine.axes[i].rotary and ends[1] - ends[0] >= COMPARED_TURN_DEG
    return np.linspace(*ends, SIDE_POSITIONS, endpoint=not whole)


def reference_of(machine: Machine, i: int, ends: Interval, references: Mapping[str, float]) -> float:
    """Reference position of an axis, mm or degrees: as given, or home; UserError outside the common range."""
    axis = machine.axes[i]
    at = references.get(axis.name)
    if at is None:
        return float(np.clip(axis.home, *ends))
    if not ends[0] <= at <= ends[1]:
        raise UserError(
            f"--reference {axis.name}={at:g}: the common range of both calibrations is {axis.name} from {ends[0]:g} to "
            f"{ends[1]:g} {axis.unit}"
        )
    return at
