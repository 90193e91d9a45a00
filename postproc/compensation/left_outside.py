"""Moves that leave the range for which the calibration was measured: on request they stay as programmed."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from kinematics.error_model.model import MODEL_ROUNDING, ErrorModel
from kinematics.machine import NDArrayBool
from kinematics.state import TEMPERATURE
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import Correction
from postproc.motion.motions import Motions
from postproc.text.line_numbers import ranges, shortened

EXAMINED_ARC_SHARES = (0.25, 0.5, 0.75)
"""Shares of an arc at which its points are examined; a straight line between two positions of a range is inside it."""


class LeftOutside:
    """Finds the blocks of a program that end outside, or whose arcs lead outside, and takes their correction away."""

    def __init__(self, model: ErrorModel, conditions: Conditions, *, leaves: bool) -> None:
        """leaves: blocks outside the range stay as programmed; otherwise none is found."""
        self._model, self._conditions, self.leaves = model, conditions, leaves
        self.lines: list[int] = []
        """Lines of the moves that stay as programmed, a line once for each of its moves."""

    def blocks(self, motions: Motions) -> np.ndarray:
        """Numbers of the blocks of a chunk that stay as programmed."""
        if not self.leaves or not len(motions):
            return np.zeros(0, int)
        rows = self._outside(motions, motions.machine_target) & motions.programmed
        arcs = np.isin(np.arange(len(motions)), sorted(motions.arcs))
        for share in EXAMINED_ARC_SHARES if arcs.any() else ():
            rows |= arcs & self._outside(motions, motions.in_machine(motions.along(share)))
        self.lines += motions.line[rows & motions.evaluated].tolist()
        return np.unique(motions.block[rows])

    def uncorrected(self, motions: Motions, correction: Correction, blocks: np.ndarray) -> Correction:
        """The correction without that of the moves of these blocks."""
        if not len(blocks):
            return correction
        left = np.isin(motions.block, blocks)
        middle = {row: shift * (not left[row]) for row, shift in correction.middle_shift.items()}
        return replace(
            correction,
            corrected=np.where(left[:, None], correction.nominal, correction.corrected),
            target=np.where(left[:, None], motions.target, correction.target),
            middle_shift=middle,
        )

    def notes(self) -> list[str]:
        """A note with the number of these moves and their lines; none without any."""
        if not self.lines:
            return []
        return [
            f"{len(self.lines)} moves are not corrected: they end outside the range for which the calibration was "
            f"measured (lines {shortened(ranges(self.lines))})"
        ]

    def _outside(self, motions: Motions, positions: Array) -> NDArrayBool:
        """True `(n,)` for positions `(n, axes)`, mm and rad, outside the range of an effect; temperatures apart."""
        found = np.zeros(len(motions), bool)
        excesses = self._model.excesses(motions.machine, self._conditions.state(positions))
        for (name, _), excess in excesses.items():
            if f" in {TEMPERATURE}" not in name:
                found |= excess > MODEL_ROUNDING
        return found
