"""The true position of a datum whose work offset was touched off on the machine with errors.

A touch-off stores the commanded position W at which the tip was at the true datum D. So W = D - e(W) and
D = W + e(W), where e is the deviation (actual minus nominal, tool relative to workpiece, workpiece frame) in the pose
of the touch-off, with the length of the probe. The part is fixed to the workpiece frame, so each of its points is
displaced by e(W) from its nominal position, in every pose in which it is cut. A correction therefore aims at the
nominal tool point plus this shift, and the error relative to the datum is e(q) - e(W).

At a touch-off, axes with backlash are assumed in the middle of it; time and temperatures are those of the run.
Orientations are not shifted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.deviation import exact_deviation
from kinematics.effects import Effect, after_touch_off
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.inverse import linear_positions
from kinematics.machine import Machine
from kinematics.touch_off import TouchOff
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.motion.frames import cartesian
from postproc.motion.motions import Motions


class Poses(NamedTuple):
    """Nominal poses of touch-offs: axis positions `(k, axes)`, mm and rad; tips `(k, 3)`, mm, as `Motions.tool`."""

    positions: Array
    tool: Array


def poses(machine: Machine, touch_offs: Sequence[TouchOff]) -> Poses:
    """Poses of the machine with the tip of the probe at the position of each touch-off.

    X Y Z of a touch-off are the coordinates of the tip in the directions of the machine; for a probe of length 0, of
    the tool reference point. The position of a rotary table does not change them.
    """
    given = (
        np.array([touch_off.position for touch_off in touch_offs], float).reshape(-1, len(machine.axes)) * machine.scale
    )
    tool = np.array([(0.0, 0.0, -touch_off.length) for touch_off in touch_offs]).reshape(-1, 3)
    tables = np.array([axis.rotary and axis.side == "workpiece" for axis in machine.axes])
    upright = np.where(tables, 0.0, given)
    placed = linear_positions(machine, upright, given[:, cartesian(machine)], tool)
    return Poses(np.where(machine.rotary, given, placed), tool)


def _in_a_touch_off(effect: Effect) -> bool:
    """False for the surface of a workpiece, whose heights count from the work zero, and for what came after it."""
    return not effect.area and not after_touch_off(effect)


def deviations(machine: Machine, model: ErrorModel, touch_offs: Sequence[TouchOff], conditions: Conditions) -> Array:
    """True datum minus work offset, D - W = e(W), `(k, 3)`, mm, workpiece frame, by the exact model."""
    if not model.effects or not touch_offs:
        return np.zeros((len(touch_offs), 3))

    def deviation() -> Array:
        q, tool = poses(machine, touch_offs)
        errors = model.part(_in_a_touch_off).errors(machine, conditions.state(q, np.zeros_like(q)))
        return exact_deviation(machine, q, errors, tool).position

    return conditions.known("deviations", (machine, model), touch_offs, deviation)


def sensitivities(machine: Machine, model: ErrorModel, touch_offs: Sequence[TouchOff], conditions: Conditions) -> Array:
    """Derivatives `(k, 3, parameters)` of the deviations at touch-offs by the parameters of the model, first order."""

    def derivatives() -> Array:
        q, tool = poses(machine, touch_offs)
        transform = error_transform_with_tool(machine, q, tool)[:, :3]
        contained = np.repeat([*map(_in_a_touch_off, model.effects)], [len(e.parameters) for e in model.effects])
        return np.asarray(model.design(machine, conditions.state(q, np.zeros_like(q)), transform) * contained)

    return conditions.known("sensitivities", (machine, model), touch_offs, derivatives)


class DatumPrediction(NamedTuple):
    """Predicted shift of the datum of each row, to be subtracted from the deviations of the row."""

    shift: Array
    """True datum minus work offset `(n, 3)`, mm, workpiece frame."""
    sensitivity: Array
    """Derivatives of the shift by the parameters of the model `(n, 3, parameters)`."""


def datum_prediction(
    machine: Machine, model: ErrorModel, touch_offs: Sequence[TouchOff | None], conditions: Conditions
) -> DatumPrediction | None:
    """Predicted datum of rows with these touch-offs; 0 for true work offsets, None if all work offsets are true."""
    used, which = _distinct(touch_offs)
    if not used:
        return None
    shift, sensitivity = (of(machine, model, used, conditions) for of in (deviations, sensitivities))
    return DatumPrediction(
        *(np.concatenate([each, np.zeros((1, *each.shape[1:]))])[which] for each in (shift, sensitivity))
    )


def touched(motions: Motions) -> tuple[list[TouchOff], np.ndarray]:
    """The touch-offs of the rows of a chunk, each once, and the index of that of each row `(n,)`; -1 for none."""
    found, of_frame = _distinct([frame.touch_off for frame in motions.frames])
    return found, of_frame[motions.frame]


def _distinct(touch_offs: Sequence[TouchOff | None]) -> tuple[list[TouchOff], np.ndarray]:
    """The touch-offs, each once, and the index of each of those given; -1 for None."""
    found: dict[TouchOff, int] = {}
    which = [-1 if touch_off is None else found.setdefault(touch_off, len(found)) for touch_off in touch_offs]
    return list(found), np.array(which, int)


def datum_shifts(motions: Motions, model: ErrorModel, conditions: Conditions) -> Array:
    """Displacement of the part from its nominal position `(n, 3)`, mm, workpiece frame; 0 for true offsets."""
    touch_offs, of_frame = _distinct([frame.touch_off for frame in motions.frames])
    shifts = np.zeros((1, 3))
    if touch_offs:
        shifts = np.vstack([deviations(motions.machine, model, touch_offs, conditions), shifts])
    if (of_frame == of_frame[0]).all():
        return np.broadcast_to(shifts[of_frame[0]], (len(motions), 3))
    return np.asarray(shifts[of_frame[motions.frame]])
