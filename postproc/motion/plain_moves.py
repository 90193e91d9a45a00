"""Moves of plain lines: axis words to positions or increments, read as columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array
from postproc.motion.moves import Known
from postproc.text.blocks import PlainRun


class PlainMoves(NamedTuple):
    """Moves of plain lines; columns `(lines, axes)`."""

    start: Array
    target: Array
    """Programmed coordinates, mm and degrees."""
    known_start: np.ndarray
    known: np.ndarray
    """`Known` before and after the moves."""

    def first(self, lines: int) -> PlainMoves:
        """The first moves."""
        return PlainMoves(*(column[:lines] for column in self))

    def drilled(self, axis: int, bottom: float, level: float) -> PlainMoves:
        """The moves as holes: an axis goes to the bottom, and back to a level before the next one; mm."""
        start, target, known_start, known = (column.copy() for column in self)
        start[1:, axis], target[:, axis] = level, bottom
        known_start[:, axis] = known[:, axis] = Known.PROGRAM
        return PlainMoves(start, target, known_start, known)

    @staticmethod
    def of(run: PlainRun, scale: Array, position: list[float], known: list[Known]) -> PlainMoves:
        """The moves of plain lines from a position whose axes are known so well.

        scale `(axes,)`: mm or degrees per unit of the words.
        """
        words, lines, axes = run.columns, len(run), len(position)
        named = (words.end[:axes] > 0).T
        values = words.value[:axes].T * scale
        before = np.array([known], np.int8)
        if run.incremental:
            positions = np.cumsum(np.concatenate([[position], np.where(named, values, 0.0)]), axis=0)
            every = np.repeat(before, lines, axis=0)
            return PlainMoves(positions[:-1], positions[1:], every, every)
        last = np.maximum.accumulate(np.where(named, np.arange(lines)[:, None], -1), axis=0)
        found = last >= 0
        target = np.where(found, values[np.maximum(last, 0), np.arange(axes)], position)
        after = np.where(found, np.int8(Known.PROGRAM), before)
        start, known_start = np.concatenate([[position], target[:-1]]), np.concatenate([before, after[:-1]])
        return PlainMoves(start, target, known_start, after)
