"""Two programs read in step: moves of a corrected program beside those of its original, some thousand at a time.

Only the moves at hand are kept, so that memory does not grow with the programs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from kinematics.user_error import UserError
from postproc.motion.motions import Motions, merged
from postproc.motion.moves import Kind
from postproc.motion.segments import like
from postproc.text.source import CHUNK_BLOCKS


class DifferentMoves(UserError):
    """The second program is no correction of the first."""

    def __init__(self) -> None:
        super().__init__("the two programs do not make the same moves: is the second one a correction of the first?")


class Matched(NamedTuple):
    """Some moves of both programs, from the same move of the original to the same move."""

    nominal: Motions
    """Moves of the original."""
    matched: Motions
    """The moves with the segments and backlash take-ups of the corrected program."""
    commanded: Motions
    """Moves of the corrected program, row by row as `matched`."""


def match(nominal: Motions, commanded: Motions) -> Matched:
    """The moves of both programs; DifferentMoves if they do not match one to one."""
    matched = like(nominal, commanded)
    if matched is None:
        raise DifferentMoves
    return Matched(nominal, matched, commanded)


def in_step(nominal: Iterable[Motions], commanded: Iterable[Motions], size: int = 0) -> Iterator[Matched]:
    """The moves of both programs, `size` moves of the original (0: `CHUNK_BLOCKS`) at a time, at least once.

    Backlash take-ups and segments stay with their move. Both programs are read to their ends in any case, the first
    one first: a refusal of a line comes before DifferentMoves.
    """
    original, corrected = _Moves(iter(nominal), corrected=False), _Moves(iter(commanded), corrected=True)
    size = size or CHUNK_BLOCKS
    try:
        more = True
        while more:
            original.read(size)
            corrected.read(size)
            more = original.count > size
            yield match(original.first(size), corrected.first(size))
        if corrected.left:
            raise DifferentMoves
    except DifferentMoves:
        original.read_to_end()
        corrected.read_to_end()
        raise
    except UserError:
        original.read_to_end()
        raise


class _Moves:
    """The next moves of a program."""

    def __init__(self, chunks: Iterator[Motions], *, corrected: bool) -> None:
        self._chunks, self._corrected = chunks, corrected
        self._kept: Motions | None = None
        self._begins = np.zeros(0, int)
        """First row of each move of the program: of its backlash take-up, if there is one."""
        self._ended = False

    @property
    def count(self) -> int:
        """Number of moves of the program that are kept."""
        return len(self._begins)

    @property
    def left(self) -> bool:
        """True if rows are kept."""
        return self._kept is not None and len(self._kept) > 0

    def read(self, size: int) -> None:
        """Read until more than so many moves are kept, or to the end."""
        new = [] if self._kept is None else [self._kept]
        count = self.count
        while count <= size and not self._ended:
            chunk = next(self._chunks, None)
            if chunk is None:
                self._ended = True
            else:
                new.append(chunk)
                count += int((~chunk.added).sum()) if self._corrected else len(chunk)
        self._keep(merged(new))

    def read_to_end(self) -> None:
        """Read all chunks that are left, and keep none."""
        for _ in self._chunks:
            pass

    def first(self, size: int) -> Motions:
        """Take the rows of the first `size` moves; all rows if no more moves are kept."""
        assert self._kept is not None
        rows = np.arange(len(self._kept))
        end = int(self._begins[size]) if self.count > size else len(rows)
        found = self._kept.take(rows[:end])
        self._keep(self._kept.take(rows[end:]).with_used_frames)
        return found

    def _keep(self, motions: Motions) -> None:
        self._kept, rows = motions, np.arange(len(motions))
        if self._corrected:
            no_take_up = np.maximum.accumulate(np.where(motions.kind == Kind.TAKE_UP, -1, rows))
            self._begins = np.concatenate([[0], no_take_up[:-1] + 1])[: len(rows)][~motions.added]
        else:
            self._begins = rows
