"""Remaining tool point errors: before, with the tables, with corrected programs, and with both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from kinematics.correction import correct_position
from kinematics.error_model.joined import joined
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.compensation.correction import COLD, PoseErrors, pose_errors
from postproc.compensation.predicted_error import MachineStates
from postproc.control_data.tables.target import Target
from postproc.motion.along import INNER
from postproc.motion.motions import Motions

REMAINING_POSITIONS = 4096
"""Positions of the volume at which errors are calculated."""
REMAINING_SEED = 230
TOLERANCE_UM = 1.0

Move = Callable[[Array, Array], Array]
"""Actual axis positions `(n, axes)` for commands `(n, axes)`, mm and rad, and their directions of approach."""


@dataclass(frozen=True)
class EvaluationPoints:
    """Points of an evaluation: commands `(n, axes)`, mm and rad, directions `(n, axes)`, tools `(n, 3)`, mm."""

    q: Array
    approach: Array
    tool: Array

    def errors(self, machine: Machine, model: ErrorModel, q: Array) -> PoseErrors:
        """Pose errors of a machine at actual axis positions `(n, axes)`, mm and rad, for these commands."""
        return pose_errors(machine, model, q, self.q, self.tool, COLD.states(self.approach))

    def corrected(self, machine: Machine, model: ErrorModel) -> Array:
        """Commands `(n, axes)`, mm and rad, corrected for the errors of a model."""

        def errors(q: Array) -> Array:
            return model.errors(machine, State(q, self.approach))

        return correct_position(machine, errors, self.q, self.tool, np.ones(self.q.shape, bool))


def volume_points(target: Target) -> EvaluationPoints:
    """Points evenly spread over the travels of all axes, approached from either side."""
    q = target.volume(REMAINING_POSITIONS) * target.machine.scale
    approach = np.random.default_rng(REMAINING_SEED).choice([-1.0, 1.0], q.shape)
    return EvaluationPoints(q, approach, np.broadcast_to(target.tool, (len(q), 3)))


def program_points(motions: Motions, model: ErrorModel) -> EvaluationPoints:
    """Positions of all moves with known ends and paths; half of TOLERANCE_UM is no reversal."""
    machine = motions.machine
    states = MachineStates(model, machine, COLD, TOLERANCE_UM)
    states.follow(motions)
    q, approach, tool = [], [], []
    for share, rows in [*((share, motions.evaluated_paths) for share in INNER), (1.0, motions.evaluated)]:
        q.append(motions.in_machine(motions.along(share))[rows])
        side = states.states_at(rows, share, q[-1]).approach
        approach.append(np.zeros_like(q[-1]) if side is None else side)
        tool.append(motions.tool[rows])
    return EvaluationPoints(np.concatenate(q), np.concatenate(approach), np.concatenate(tool))


def stages(
    target: Target, tables: Move, taken: ErrorModel, datum: dict[str, float], points: EvaluationPoints
) -> dict[str, PoseErrors]:
    """Tool point errors by the kind of correction.

    tables: the effect of the tables in the control; taken: the errors that the tables correct, as a model. datum: by
    axis, mm or degrees, the shift of its zero that is added to commands.
    """
    machine, model = target.machine, target.model
    rest = joined(model, taken.effects, -1.0)
    left = partial(points.errors, machine, model)
    with_tables = tables(points.q, points.approach)
    shift = np.array([datum.get(axis.name, 0.0) for axis in machine.axes]) * machine.scale
    return {
        "before": left(points.q),
        "after_tables": left(with_tables),
        **({"after_tables_and_datum_shift": left(with_tables + shift)} if datum else {}),
        "after_nc_correction": left(points.corrected(machine, model)),
        "after_tables_and_nc_correction_of_the_rest": left(tables(points.corrected(machine, rest), points.approach)),
    }


def summary(found: dict[str, PoseErrors]) -> dict[str, Any]:
    """RMS, 95 % quantile and largest of each stage: tool point, um, and tool axis, urad."""
    return {
        "tool_point_um": {stage: _numbers(left.point_um) for stage, left in found.items()},
        "tool_axis_urad": {stage: _numbers(left.axis_urad) for stage, left in found.items()},
    }


def _numbers(sizes: Array) -> dict[str, float]:
    if not len(sizes):
        return {"rms": 0.0, "p95": 0.0, "max": 0.0}
    return {
        "rms": round(float(np.sqrt(np.mean(sizes**2))), 4),
        "p95": round(float(np.quantile(sizes, 0.95)), 4),
        "max": round(float(sizes.max()), 4),
    }
