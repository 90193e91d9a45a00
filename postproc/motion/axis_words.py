"""The axis words of the moves of a chunk: those that were read one by one, and those of runs of plain lines."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterable, Sequence
from typing import overload

import numpy as np

from kinematics.machine import NDArrayBool
from postproc.motion.moves import AxisWord
from postproc.text.blocks import PlainRun

Words = tuple[AxisWord, ...]


class AxisWords(Sequence[Words]):
    """Axis words by row; those of a plain line are made on demand."""

    def __init__(self, parts: Iterable[list[Words] | PlainRun] = (), rows: np.ndarray | None = None) -> None:
        self._parts = list(parts)
        self._firsts = [0, *itertools.accumulate(map(len, self._parts))]
        self._rows = np.arange(self._firsts[-1]) if rows is None else rows
        """Row of the parts for each row; -1 for rows without words."""

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> Words: ...
    @overload
    def __getitem__(self, index: slice) -> AxisWords: ...
    def __getitem__(self, index: int | slice) -> Words | AxisWords:
        if isinstance(index, slice):
            return AxisWords(self._parts, self._rows[index])
        row = int(self._rows[index])
        if row < 0:
            return ()
        number = bisect.bisect_right(self._firsts, row) - 1
        part, at = self._parts[number], row - self._firsts[number]
        return part[at] if isinstance(part, list) else _words_of(part, at)

    def naming(self, rows: np.ndarray, axes: int) -> NDArrayBool:
        """True `(k, axes)` for the axes that rows `(k,)` have words for; axes: number of axes."""
        found, own = np.zeros((len(rows), axes), bool), self._rows[rows]
        parts = np.where(own < 0, -1, np.searchsorted(self._firsts, own, side="right") - 1)
        for number in set(parts.tolist()) - {-1}:
            part, some = self._parts[number], np.flatnonzero(parts == number)
            at = own[some] - self._firsts[number]
            if isinstance(part, list):
                for row, line in zip(some.tolist(), at.tolist(), strict=True):
                    found[row, [word.axis for word in part[line]]] = True
            else:
                found[some] = part.columns.end[:axes, at].T > 0
        return found

    def take(self, rows: np.ndarray) -> AxisWords:
        """These rows, in this order."""
        return AxisWords(self._parts, self._rows[rows])

    def without(self, rows: np.ndarray) -> AxisWords:
        """These words without those of some rows, which a mask or numbers give; empty words stay empty."""
        if not len(self._rows):
            return self
        left = self._rows.copy()
        left[rows] = -1
        return AxisWords(self._parts, left)


def joined(chunks: Sequence[AxisWords]) -> AxisWords:
    """The words of several chunks as one."""
    firsts = itertools.accumulate((words._firsts[-1] for words in chunks), initial=0)
    rows = [np.where(w._rows < 0, -1, w._rows + first) for w, first in zip(chunks, firsts, strict=False)]
    return AxisWords([part for words in chunks for part in words._parts], np.concatenate(rows))


def _words_of(run: PlainRun, index: int) -> Words:
    axes = run.lines.axes
    words = enumerate(run.kept_block(index).words)
    return tuple([AxisWord(axes.index(word.address), i, run.incremental) for i, word in words if word.address in axes])
