"""Standard uncertainties of the predictions of some moves of a program, and the significance of its improvement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.touch_off import TouchOff
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.datum import datum_prediction
from postproc.compensation.significance import Significance, uncertainties_um
from postproc.evaluation.predicted_errors import Statistic

SAMPLING_OF_MOVES = ((0, 1), (500, 8), (1 << 12, 128), (1 << 16, 1024))
"""Uncertainties of predictions are computed for every move at first, and from further numbers of moves on for every
eighth, 128th and 1024th: more would cost more than the correction."""
MOVES_OF_A_BLOCK = 1024
"""Number of moves whose uncertainties are computed together, whatever the chunks of the program are."""


class SampledUncertainties:
    """Collects moves of a program, and computes their uncertainties when there are enough of them."""

    def __init__(self, machine: Machine, model: ErrorModel, conditions: Conditions, significance: Significance) -> None:
        self._machine, self._model, self._conditions = machine, model, conditions
        self.statistic, self.significance = Statistic(), significance
        self._moves = 0
        """Number of added moves."""
        self._columns: list[tuple[Array, ...]] = []
        """Positions `(k, axes)`, directions likewise or `(k, 0)`, tools `(k, 3)`, errors `(k, 2)`, moves `(k,)`."""
        self._touch_offs: list[TouchOff | None] = []

    def add(
        self,
        positions: Array,
        approach: Array | None,
        tool: Array,
        touch_offs: tuple[Sequence[TouchOff | None], np.ndarray],
        errors: Array,
    ) -> None:
        """Add the next moves, of which some are sampled.

        positions `(n, axes)`, mm and rad, approached in directions `(n, axes)`; tool `(n, 3)`, mm; touch_offs: those of
        the frames, and the frame `(n,)` of each move; errors `(n, 2)`, um, before and after.
        """
        rows, stands_for = _sampled(self._moves + np.arange(len(positions)))
        self._moves += len(positions)
        if not len(rows):
            return
        directions = np.empty((len(rows), 0)) if approach is None else approach[rows]
        self._columns.append((positions[rows], directions, tool[rows], errors[rows], stands_for))
        of_frames, frame = touch_offs
        self._touch_offs += [of_frames[i] for i in frame[rows].tolist()]
        while len(self._touch_offs) >= MOVES_OF_A_BLOCK:
            self._compute(MOVES_OF_A_BLOCK)

    def finish(self) -> None:
        """Compute the uncertainties of the remaining moves."""
        if self._touch_offs:
            self._compute(len(self._touch_offs))

    def _compute(self, number: int) -> None:
        """Uncertainties of the first moves of those that wait."""
        columns = [np.concatenate(parts) for parts in zip(*self._columns, strict=True)]
        positions, directions, tool, errors, stands_for = (column[:number] for column in columns)
        self._columns = [tuple(column[number:] for column in columns)]
        touch_offs, self._touch_offs = self._touch_offs[:number], self._touch_offs[number:]
        datum = datum_prediction(self._machine, self._model, touch_offs, self._conditions)
        state = self._conditions.state(positions, directions if directions.shape[1] else None)
        whole, along = uncertainties_um(self._machine, self._model, state, tool, datum)
        self.statistic.add(whole)
        self.significance.add(errors[:, 0], errors[:, 1], along, stands_for)


def _sampled(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the moves, by their numbers `(n,)`, whose uncertainty is computed, and how many each represents."""
    first, steps = np.array(SAMPLING_OF_MOVES).T
    step = steps[np.searchsorted(first, numbers, side="right") - 1]
    some = np.flatnonzero(numbers % step == 0)
    return some, step[some]
