"""Record of a correction along a program, for figures; its memory is bounded for programs of any length."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.correction import pose_errors
from postproc.compensation.predicted_error import MachineStates
from postproc.evaluation.predicted_errors import Statistic
from postproc.motion.along import positions_along
from postproc.motion.motions import Motions

BINS = 2000
"""Largest number of stretches of the program."""
PATHS = 4000
"""Largest number of moves that are kept for drawing."""
SEGMENTS = 16
"""Number of straight segments in the drawing of a move."""
COMPARED_DECIMALS = 9
"""Decimals, um, of errors that are compared: sums over rows of other chunks differ in the last bits."""
WORST = 10
"""Number of listed moves."""


class Bins:
    """Stretches of the program with equal numbers of moves, in order of execution: extreme and RMS values of each.

    A stretch has `width` moves, a power of two; neighbours are joined to limit the number of stretches.
    """

    def __init__(self, axes: int) -> None:
        self.width, self.moves = 1, 0
        self._largest = np.full((BINS, 2), np.nan)
        self._squares = np.zeros((BINS, 2))
        self._evaluated = np.zeros(BINS)
        self._high, self._low = np.full((2, BINS, axes), np.nan)
        self._lines = np.full(BINS, np.nan)

    def add(self, errors: Array, corrections: Array, lines: np.ndarray) -> None:
        """Add `n` moves: errors before and after `(n, 2)`, nan if not evaluated; corrections `(n, axes)`.

        lines `(n,)`: those of the program; loops repeat them.
        """
        end = self.moves + len(errors)
        while end > BINS * self.width:
            self._join()
        rows = np.arange(self.moves, end) // self.width
        np.fmax.at(self._largest, rows, errors)
        np.add.at(self._squares, rows, np.nan_to_num(errors) ** 2)
        np.add.at(self._evaluated, rows, ~np.isnan(errors[:, 0]))
        np.fmax.at(self._high, rows, corrections)
        np.fmin.at(self._low, rows, corrections)
        new = np.isnan(self._lines[rows])
        self._lines[rows[new][::-1]] = lines[new][::-1]  # the first move of a stretch is the last one to be set
        self.moves = end

    def _join(self) -> None:
        """Join neighbouring stretches in pairs."""
        self.width *= 2
        self._largest, self._high = _halved(self._largest, np.fmax), _halved(self._high, np.fmax)
        self._low = _halved(self._low, np.fmin)
        self._lines = np.concatenate([self._lines[::2], np.full(BINS // 2, np.nan)])
        self._squares, self._evaluated = _halved(self._squares, np.add, 0.0), _halved(self._evaluated, np.add, 0.0)

    def __len__(self) -> int:
        return (self.moves + self.width - 1) // self.width

    @property
    def edges(self) -> Array:
        """Bounds of the stretches `(bins + 1,)`, by numbers of moves from 0."""
        return np.minimum(np.arange(len(self) + 1) * self.width, self.moves).astype(float)

    @property
    def lines(self) -> np.ndarray:
        """Line of the program of the first move of each stretch `(bins,)`."""
        return self._lines[: len(self)].astype(int)

    @property
    def largest(self) -> Array:
        """Largest errors before and after `(bins, 2)`; nan without evaluated moves."""
        return self._largest[: len(self)]

    @property
    def rms(self) -> Array:
        """RMS errors before and after `(bins, 2)`; nan without evaluated moves."""
        count = np.where(self._evaluated > 0, self._evaluated, np.nan)[: len(self), None]
        return np.asarray(np.sqrt(self._squares[: len(self)] / count))

    @property
    def corrections(self) -> tuple[Array, Array]:
        """Smallest and largest corrections `(bins, axes)`."""
        return self._low[: len(self)], self._high[: len(self)]


def _halved(values: Array, join: np.ufunc, empty: float = np.nan) -> Array:
    halved = np.full_like(values, empty)
    halved[: BINS // 2] = join(values[::2], values[1::2])
    return halved


class MoveEnd(NamedTuple):
    """Position at the end of a move, and its errors, um."""

    line: int
    target: tuple[float, ...]
    """Programmed position by axis, mm and degrees."""
    before: float
    after: float
    """Error after correction, um."""


class DrawnPaths(msgspec.Struct):
    """Every `stride`-th feed move: points of its nominal tool path, with the errors before and after correction."""

    stride: int = 1
    seen: int = 0
    points: Array = msgspec.field(default_factory=lambda: np.empty((0, SEGMENTS + 1, 3)))
    """Tool points `(n, SEGMENTS + 1, 3)`, mm, workpiece frame."""
    errors: Array = msgspec.field(default_factory=lambda: np.empty((0, SEGMENTS + 1, 2)))
    """Errors `(n, SEGMENTS + 1, 2)`, um, before and after."""

    def rows(self, rows: np.ndarray) -> np.ndarray:
        """Rows of the next feed moves `(n,)` that are kept; earlier moves are thinned out to make room for them."""
        end = self.seen + len(rows)
        while -(-end // self.stride) > PATHS:
            self.stride *= 2
            self.points, self.errors = self.points[::2], self.errors[::2]
        first = -self.seen % self.stride
        self.seen = end
        return rows[first :: self.stride]

    def add_moves(
        self, model: ErrorModel, motions: Motions, commanded: Motions, both: tuple[MachineStates, MachineStates]
    ) -> None:
        """Add some feed moves of a chunk, as programmed and as written, by the states that follow both texts."""
        rows = self.rows(np.flatnonzero(motions.evaluated_paths))
        if not len(rows):
            return
        points = np.repeat(rows, SEGMENTS + 1)
        shares = np.tile(np.linspace(0.0, 1.0, SEGMENTS + 1), len(rows))
        frames, tool, machine = motions.bare.take(points), motions.tool[points], motions.machine
        nominal, written = (frames.in_machine(positions_along(text, points, shares)) for text in (motions, commanded))
        shift = both[0].datum_shifts(motions)[points]
        errors = [
            pose_errors(machine, model, actual, nominal, tool, states.states_at(points, shares, actual), shift).point_um
            for actual, states in zip((nominal, written), both, strict=True)
        ]
        self.add(
            tool_point(machine, nominal, tool).reshape(len(rows), -1, 3),
            np.stack(errors, axis=1).reshape(len(rows), -1, 2),
        )

    def add(self, points: Array, errors: Array) -> None:
        """Add points and errors of the rows that `rows` has returned."""
        self.points = np.concatenate([self.points, points])
        self.errors = np.concatenate([self.errors, errors])


class Trace:
    """Record of a correction, chunk by chunk."""

    def __init__(self, machine: Machine, model: ErrorModel) -> None:
        self.machine, self._model = machine, model
        self.bins = Bins(len(machine.axes))
        self.paths = DrawnPaths()
        self.between_before = Statistic()
        """Errors of feed moves between their ends before correction, um."""
        self.worst: tuple[list[MoveEnd], list[MoveEnd]] = ([], [])
        """Moves with the largest errors before and after correction."""

    def add(self, motions: Motions, lines: np.ndarray, rows: NDArrayBool, moved: Array, errors: Array) -> None:
        """Add the rows of a chunk, by a mask `(n,)`, that end programmed moves.

        lines `(n,)`: numbers of the lines of all rows. moved `(n, axes)`: correction of their ends, mm and degrees; nan
        for axes that the program has not given. errors `(n, 2)`, um, before and after; nan if they are not evaluated.
        """
        scale = np.where(self.machine.rotary, np.deg2rad(1.0) * 1e6, 1e3)
        self.bins.add(errors[rows], (moved * scale)[rows], lines[rows])
        for which, known in enumerate(self.worst):
            known[:] = _worst(known, motions, lines, errors, which)

    def add_paths(self, motions: Motions, commanded: Motions, both: tuple[MachineStates, MachineStates]) -> None:
        """Add some feed moves of a chunk, as programmed and as written, by the states that follow both texts."""
        self.paths.add_moves(self._model, motions, commanded, both)


def _worst(known: list[MoveEnd], motions: Motions, lines: np.ndarray, errors: Array, which: int) -> list[MoveEnd]:
    """Moves with the largest errors, of those known and of a chunk, before (0) or after (1), the earliest of equals."""
    errors = np.round(errors, COMPARED_DECIMALS)
    size = errors[:, which]
    largest = np.argsort(-size, kind="stable")[:WORST]  # nan comes last
    here = [
        MoveEnd(int(lines[row]), tuple(motions.target[row].tolist()), *errors[row].tolist())
        for row in largest[~np.isnan(size[largest])].tolist()
    ]
    return sorted([*known, *here], key=lambda position: -(position.before, position.after)[which])[:WORST]
