"""Positions of a program: block ends, and points along feed moves, with the direction of approach of each axis."""

from __future__ import annotations

import numpy as np

from kinematics.error_model.model import ErrorModel
from postproc.compensation.correction import COLD
from postproc.compensation.predicted_error import MachineStates
from postproc.motion.motions import Motions
from postproc.motion.reversals import INNER
from postproc.tables.remaining_error import EvaluationPoints


def program_points(motions: Motions, model: ErrorModel, tolerance_um: float = 1.0) -> EvaluationPoints:
    """Positions of all moves with known ends and paths; half the tolerance is no reversal."""
    machine = motions.machine
    directions = MachineStates(model, machine, COLD, tolerance_um).along(motions)
    q, approach, tool = [], [], []
    shares = [(share, i, motions.evaluated_paths) for i, share in enumerate(INNER)]
    for share, i, rows in [*shares, (1.0, -1, motions.evaluated)]:
        q.append(motions.in_machine(motions.along(share))[rows])
        approach.append(np.zeros_like(q[-1]) if directions is None else directions[rows, i])
        tool.append(motions.tool[rows])
    return EvaluationPoints(np.concatenate(q), np.concatenate(approach), np.concatenate(tool))
