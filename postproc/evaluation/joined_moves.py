"""Straight moves that begin where the row before ends: errors along them follow from those at the ends of the rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.second_differences import nominal_bends
from kinematics.transforms import Array
from postproc.motion.frames import Frame
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind


class Joined(NamedTuple):
    """The rows of a chunk, joined to the rows before them."""

    rows: NDArrayBool
    """True `(n,)` for straight moves that begin where the row before ends, in the same frame, in both texts."""
    starts: tuple[Array, Array]
    """Axis positions `(n, axes)` at the starts of these rows in both texts, mm and rad; at the ends of others."""
    ends: tuple[Array, Array]
    """Axis positions at the ends of all rows."""
    first: Array
    """Values `(n, k)` at the ends of the rows before."""
    path_bends: Array
    """Upper bounds `(n,)`, mm, of the second difference of the nominal tool path of the first text."""
    bends: Array
    """The same of the vector between the nominal tool paths of both texts."""


class _RowEnd(NamedTuple):
    """The end of the last row of a chunk; nan before the first."""

    frame: Frame | None
    programmed: Array
    """Positions `(axes,)` of both texts, `(2, axes)`."""
    positions: Array
    """Axis positions `(2, axes)`, mm and rad."""
    values: Array


class JoinedMoves:
    """Follows the rows of two texts, as programmed and as written, chunk after chunk."""

    def __init__(self, machine: Machine, values: int) -> None:
        """`values`: number of values at the ends of rows."""
        nowhere = np.full((2, len(machine.axes)), np.nan)
        self._machine, self._last = machine, _RowEnd(None, nowhere, nowhere, np.full(values, np.nan))

    def follow(self, motions: Motions, commanded: Motions, written: Array, values: Array) -> Joined:
        """The next chunk, whose rows have these values `(n, k)` at their ends.

        written `(n, axes)`: axis positions at the ends of `commanded`, mm and rad.
        """
        last = self._last
        rows, frames = motions.kind == Kind.LINE, {last.frame: -1}
        for text, end in zip((motions, commanded), last.programmed, strict=True):
            frame = np.array([frames.setdefault(each, len(frames)) for each in text.frames], int)[text.frame]
            rows &= (frame == _behind(-1, frame)) & (text.start == _behind(end, text.target)).all(axis=1)
        ends = motions.machine_target, written
        starts = tuple(np.where(rows[:, None], _behind(end, q), q) for end, q in zip(last.positions, ends, strict=True))
        if len(motions):
            self._last = _RowEnd(
                motions.frames[motions.frame[-1]],
                np.stack([motions.target[-1], commanded.target[-1]]),
                np.stack([q[-1] for q in ends]),
                values[-1],
            )
        shifts = starts[1] - starts[0], ends[1] - ends[0]
        bends = nominal_bends(self._machine, starts[0], ends[0], motions.tool, motions.tcp, *shifts)
        return Joined(rows, (starts[0], starts[1]), ends, _behind(last.values, values), *bends)


def _behind(first: Array | float, column: Array) -> Array:
    """A column `(n, …)` with each value one row later, and `first` in the first row."""
    moved = np.empty_like(column)
    moved[:1], moved[1:] = first, column[:-1]
    return moved
