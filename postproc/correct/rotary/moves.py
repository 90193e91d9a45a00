"""Feed moves of rotary axes only: the linear axes keep their positions and the correction of the position before.

During the move this correction may become wrong, up to twice the error. If such a move would be worse than in the
input, the position before it is not corrected either, unless it is the end of an arc that is too small for that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import Correction, pose_errors
from postproc.compensation.datum import datum_shifts
from postproc.motion.motions import Motions
from postproc.motion.segments import arc_ends
from postproc.text.notes import Notes

COMPARED_SHARES, COMPARED_END = (0.25, 0.5, 0.75), (1.0,)
"""Shares of the move whose largest errors are compared."""
LARGEST_ARC_CORRECTION = 0.1
"""Correction of the end of an arc, as a share of its radius and of its chord, above which the end keeps it.

The start is corrected: about the same centre there would be no circle through both."""
NOTE = "not corrected: its correction would make the next feed move of rotary axes only worse"
STILL_CORRECTED = "its correction makes the next feed move of rotary axes only worse: the arc is too small to lack it"


def uncorrected_before_rotary_moves(
    motions: Motions,
    correction: Correction,
    model: ErrorModel,
    conditions: Conditions,
    approach: Array | None,
    notes: Notes,
) -> Correction:
    """The correction, removed at positions before feed moves of rotary axes only that would become worse by it.

    approach `(n, axes)`: direction of each axis at the end of each move.
    """
    rotary_only = motions.rotary_only
    before = np.maximum.accumulate(np.where(rotary_only, -1, np.arange(len(motions))))
    rows = np.flatnonzero(rotary_only & (before >= 0) & motions.evaluated)
    pairs = zip(motions.frame[before[rows]].tolist(), motions.frame[rows].tolist(), strict=True)
    same = np.array([motions.frames[i] == motions.frames[j] for i, j in pairs], bool)
    rows = rows[same & motions.programmed[before[rows]]]
    if not rows.size:
        return correction
    kept = np.zeros_like(motions.target)
    kept[rows] = (correction.target - motions.target)[before[rows]]
    kept[:, motions.machine.rotary] = 0.0
    harmed = _worse(motions, rows, kept, model, conditions, approach)
    left = np.unique(before[rows[harmed]])
    small = np.array([_too_small(motions, row, correction) for row in left.tolist()], bool)
    for line, needs_it in zip(motions.line[left].tolist(), small.tolist(), strict=True):
        notes.add(STILL_CORRECTED if needs_it else NOTE, line)
    left = left[~small]
    nominal = np.isin(before, left)[:, None]
    return replace(
        correction,
        corrected=np.where(nominal, correction.nominal, correction.corrected),
        target=np.where(nominal, motions.target, correction.target),
    )


def _too_small(motions: Motions, row: int, correction: Correction) -> bool:
    """True for an arc that would be no circle with a corrected start and its end as programmed."""
    arc = motions.arcs.get(row)
    if arc is None or arc.full:
        return False
    plane = list(arc.plane[:2])
    start, end = arc_ends(motions, row)
    shift = (correction.target - motions.target)[row, plane]
    return bool(np.hypot(*shift) > LARGEST_ARC_CORRECTION * min(math.dist(start, end), math.dist(start, arc.centre)))


def _worse(
    motions: Motions,
    rows: np.ndarray,
    kept: Array,
    model: ErrorModel,
    conditions: Conditions,
    approach: Array | None,
) -> np.ndarray:
    """True `(rows,)` for moves with a larger error if the shift `kept` `(n, axes)`, mm, is added along the move."""
    shift, tool = datum_shifts(motions, model, conditions)[rows], motions.tool[rows]
    states = conditions.states(None if approach is None else approach[rows])

    def largest(shares: Sequence[float], added: Array | float) -> Array:
        """Largest errors `(rows,)`, um, at these shares of the move."""
        found = np.zeros(len(rows))
        for share in shares:
            program = motions.along(share)
            nominal, q = motions.in_machine(program)[rows], motions.in_machine(program + added)[rows]
            found = np.maximum(found, pose_errors(motions.machine, model, q, nominal, tool, states, shift).point_um)
        return found

    pairs = [(largest(shares, 0.0), largest(shares, kept)) for shares in (COMPARED_SHARES, COMPARED_END)]
    rounding_um = motions.machine.rounding_mm * 1e3
    return np.asarray(np.any([after > before + rounding_um for before, after in pairs], axis=0))
