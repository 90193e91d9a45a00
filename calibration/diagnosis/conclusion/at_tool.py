"""The size of one effect at the tool point: what a part shows of it."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.fit.prediction import usual_states
from calibration.measurement.measurement import Measurement
from kinematics.deviation import exact_deviation
from kinematics.effects import Effect
from kinematics.error_model.model import no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.state import State
from kinematics.transforms import Array
from rendering.volume import positional


class AtTool(NamedTuple):
    """Largest difference of the displacements of the tool point between two states: as after a touch-off at one."""

    size_um: float
    u_um: float
    """Standard uncertainty by the linear parameters; where the displacements are largest does not depend on others."""


def at_tool(measurement: Measurement, effect: Effect, covariance: Array) -> AtTool | None:
    """The size of an effect of the machine at the tool point; None of an effect of the instrument.

    covariance `(P, P)`: of its parameters. States: the measured ones; of an effect of positions and directions alone
    also the corners of the measured region, approached from both sides.
    """
    if effect.ACTS_ON == "instrument":
        return None
    machine = measurement.machine
    state, tool = usual_states(measurement)
    if positional(effect):
        state = _with_corners(measurement, state)
        tool = np.tile(tool[:1], (len(state.positions), 1))
    model = msgspec.structs.replace(no_errors(machine), effects=(effect,))
    model = model.with_parameters(np.array(effect.parameters), covariance)
    moved = exact_deviation(machine, state.positions, model.errors(machine, state), tool).position
    first = _farthest(moved, moved.mean(axis=0))
    second = _farthest(moved, moved[first])
    first = _farthest(moved, moved[second])
    difference = moved[first] - moved[second]
    size = float(np.linalg.norm(difference))
    transform = error_transform_with_tool(machine, state.positions, tool)[:, :3]
    design = model.design(machine, state, transform)[[first, second]]
    along = (difference / size if size else np.zeros(3)) @ (design[0] - design[1]) * effect.linear
    return AtTool(1e3 * size, 1e3 * float(np.sqrt(max(float(along @ covariance @ along), 0.0))))


def _farthest(points: Array, point: Array) -> int:
    return int(np.argmax(np.linalg.norm(points - point, axis=1)))


def _with_corners(measurement: Measurement, state: State) -> State:
    """Measured positions and the corners of their region, approached forward and backward."""
    low, high = state.positions.min(axis=0), state.positions.max(axis=0)
    moving = [measurement.machine.index(axis) for axis in measurement.moving]
    corners = np.tile(np.median(state.positions, axis=0), (2 ** len(moving), 1))
    corners[:, moving] = list(product(*((low[i], high[i]) for i in moving)))
    q = np.concatenate([corners, state.positions])
    sides = np.concatenate([np.ones(q.shape), -np.ones(q.shape)])
    return State(np.concatenate([q, q]), approach=sides)
