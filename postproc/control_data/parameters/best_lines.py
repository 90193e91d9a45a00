"""The lines of rotary axes, within the freedoms of a control, that leave the least tool point error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.deviation import exact_deviation
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import forward, tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.control_data.parameters.rotary_lines import Freedom, moved_lines, positions_with

DERIVATIVE_STEPS = (1e-3, 1e-6)
"""mm and rad: steps of the derivatives by shifts and by tilts."""
LINE_ITERATIONS = 3
SINGULAR = 1e-7
"""Share of the largest singular value below which a direction of the lines is not determined, and stays."""


@dataclass(frozen=True)
class Best:
    """Changes of lines, and of the work offset with them."""

    values: Array
    """Changes by freedom `(k,)`, mm and rad."""
    u: Array
    """Standard uncertainties of the values `(k,)` by those of the calibration."""
    frame: Array
    """Displacement `(6,)` of programmed points, mm and rad, by a work offset that is touched off again."""
    frame_alone: Array
    """The same without any change of lines."""


@dataclass(frozen=True)
class Volume:
    """Commands `(n, axes)`, mm and rad, with directions of approach and tools `(n, 3)`, mm."""

    machine: Machine
    q: Array
    approach: Array
    tool: Array

    @property
    def state(self) -> State:
        """The state of the machine at the commands."""
        return State(self.q, self.approach)

    def deviation(self, model: ErrorModel, q: Array) -> Array:
        """Tool point errors `(n, 3)`, mm, of the machine at positions q against the commands."""
        errors = model.errors(self.machine, State(q, self.approach))
        actual = forward(self.machine, q, errors).apply(self.tool)
        return np.asarray(actual - tool_point(self.machine, self.q, self.tool))


def columns_of(volume: Volume, freedoms: Sequence[Freedom]) -> Array:
    """Changes of the tool point `(n, 3, k)`, mm per mm and rad, with each freedom of the lines."""
    machine, found = volume.machine, []
    tip = tool_point(machine, volume.q, volume.tool)
    for freedom in freedoms:
        step = DERIVATIVE_STEPS[freedom.tilt]
        moved = [moved_lines(machine, [freedom], np.array([sign * step])) for sign in (1.0, -1.0)]
        ends = [positions_with(machine, each, volume.q, volume.tool) for each in moved]
        points = [tool_point(machine, q, volume.tool) for q in ends]
        found.append((points[0] - points[1]) / (2.0 * step))
    return np.stack(found, axis=2) if found else np.zeros((*tip.shape, 0))


def frame_columns(volume: Volume, *, aligned: bool) -> Array:
    """Changes of the tool point `(n, 3, 3 or 6)` with a shift of the work offset, and with its alignment."""
    tip = tool_point(volume.machine, volume.q, volume.tool)
    shift = np.broadcast_to(np.eye(3), (len(tip), 3, 3))
    if not aligned:
        return np.asarray(shift)
    turn = np.stack([np.cross(e, tip) for e in np.eye(3)], axis=2)
    return np.concatenate([shift, turn], axis=2)


def all_columns(volume: Volume, freedoms: Sequence[Freedom]) -> Array:
    """Changes of the tool point with each freedom of the lines, then with those of the work offset."""
    aligned = any(freedom.tilt for freedom in freedoms)
    return np.concatenate([columns_of(volume, freedoms), frame_columns(volume, aligned=aligned)], axis=2)


def best_lines(volume: Volume, model: ErrorModel, freedoms: Sequence[Freedom]) -> Best:
    """Least squares of the tool point errors over the volume, by changed lines and a changed work offset together."""
    k = len(freedoms)
    columns = all_columns(volume, freedoms)
    solve = _solver(columns)
    total = np.zeros(columns.shape[2])
    for _ in range(LINE_ITERATIONS):
        moved = moved_lines(volume.machine, freedoms, total[:k])
        q = positions_with(volume.machine, moved, volume.q, volume.tool, _six(total[k:]))
        total = total - solve @ volume.deviation(model, q).ravel()
    alone = -_solver(columns[:, :, k:]) @ volume.deviation(model, volume.q).ravel()
    transform = error_transform_with_tool(volume.machine, volume.q, volume.tool)[:, :3]
    design = model.design(volume.machine, volume.state, transform)
    u = model.propagated((solve[:k] @ design.reshape(-1, design.shape[2]))[None])[0]
    return Best(total[:k], u, _six(total[k:]), _six(alone))


def unheld(volume: Volume, models: Sequence[ErrorModel], freedoms: Sequence[Freedom]) -> list[float]:
    """Tool point error, um RMS, of each model that changed lines and a changed work offset leave, to first order."""
    columns = all_columns(volume, freedoms)
    flat, solve, found = columns.reshape(-1, columns.shape[2]), _solver(columns), []
    for model in models:
        e = exact_deviation(volume.machine, volume.q, model.errors(volume.machine, volume.state), volume.tool).position
        left = e.ravel() - flat @ (solve @ e.ravel())
        found.append(float(np.sqrt(np.sum(left**2) / len(e))) * 1e3)
    return found


def _solver(columns: Array) -> Array:
    """Pseudo-inverse `(k, 3n)` of columns `(n, 3, k)`, each scaled to its size."""
    flat = columns.reshape(-1, columns.shape[2])
    sizes = np.linalg.norm(flat, axis=0)
    sizes[sizes == 0.0] = 1.0
    return np.asarray(np.linalg.pinv(flat / sizes, rcond=SINGULAR) / sizes[:, None])


def _six(frame: Array) -> Array:
    return np.concatenate([frame, np.zeros(6 - len(frame))])
