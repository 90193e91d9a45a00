"""Evaluation of written moves in a second process, while this one corrects the moves behind them.

The process evaluates all chunks in their order, and so gives the same results as this one would.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Set
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from kinematics.machine import Machine
from kinematics.running.child_process import ChildProcess, LostProcess
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.evaluation.evaluation import ErrorsBefore, Evaluated, Evaluation, WrittenMoves
from postproc.evaluation.guard import WorseMove
from postproc.motion.axis_words import AxisWords
from postproc.motion.frames import Frame
from postproc.motion.motions import COLUMNS, Motions
from postproc.motion.moves import Arc, Paced
from postproc.text.blocks import Blocks

CHUNKS_AHEAD = 4
"""Chunks that wait for their evaluation, at most: each takes some megabytes."""
LOST = (
    "the process that evaluates the corrected moves was ended from outside, perhaps for lack of memory; --jobs 1 "
    "evaluates them in the same process and needs less memory"
)


class SentStarts(NamedTuple):
    """Starts of the rows that do not begin at the end of the row before."""

    rows: np.ndarray
    """Their numbers `(k,)`, the first row among them."""
    starts: Array
    """`(k, axes)`, mm and degrees."""

    @classmethod
    def of(cls, starts: Array, ends: Array) -> SentStarts:
        """Those of rows with these starts and ends `(n, axes)`."""
        apart = (starts[1:] != ends[:-1]).any(axis=1)
        rows = np.flatnonzero(np.append(True, apart)[: len(starts)])
        return cls(rows, starts[rows])

    def with_ends(self, ends: Array) -> Array:
        """The starts `(n, axes)` of all rows."""
        starts = np.empty_like(ends)
        starts[1:] = ends[:-1]
        starts[self.rows] = self.starts
        return starts


class SentMoves(NamedTuple):
    """The moves of a chunk for another process: without texts, and without the machine, which is there."""

    frames: list[Frame]
    columns: dict[str, Any]
    """Those of Motions but the starts."""
    programmed: SentStarts
    written: SentStarts
    ends: Array
    """Written ends `(n, axes)`, mm and degrees."""
    arcs: tuple[Mapping[int, Arc], Mapping[int, Arc]]
    """Arcs as programmed and as written."""
    paced: Mapping[int, Paced]
    """As of Motions."""
    lines: np.ndarray
    bounds: Array
    unsplit: Mapping[int, str]
    suspect: Set[int]
    before: ErrorsBefore | None

    @classmethod
    def of(cls, moves: WrittenMoves) -> SentMoves:
        """The moves to be sent."""
        motions, commanded = moves.motions, moves.commanded
        return cls(
            list(motions.frames),
            {name: getattr(motions, name) for name in COLUMNS if name != "start"},
            SentStarts.of(motions.start, motions.target),
            SentStarts.of(commanded.start, commanded.target),
            commanded.target,
            (dict(motions.arcs), dict(commanded.arcs)),
            dict(motions.paced),
            moves.lines,
            moves.bounds,
            dict(moves.unsplit),
            set(moves.suspect),
            moves.before,
        )

    def moves(self, machine: Machine) -> WrittenMoves:
        """The moves of a machine."""
        targets, starts = (self.columns["target"], self.ends), (self.programmed, self.written)
        programmed, commanded = (
            Motions(
                machine,
                Blocks(()),
                self.frames,
                **self.columns | {"start": start.with_ends(target), "target": target},
                words=AxisWords(),
                arcs=arcs,
                paced=self.paced,
            )
            for start, target, arcs in zip(starts, targets, self.arcs, strict=True)
        )
        return WrittenMoves(programmed, commanded, self.lines, self.bounds, self.unsplit, self.suspect, self.before)


class EvaluationProcess:
    """Evaluates the moves of a program, chunk after chunk, in a process of its own."""

    def __init__(self, evaluation: Evaluation) -> None:
        """`evaluation`: a new one, which the process takes over."""
        self._process = ChildProcess(_Worker(evaluation))
        self._waiting: deque[Blocks] = deque()
        """Blocks of the chunks without an answer."""

    def add(self, moves: WrittenMoves) -> None:
        """Evaluate the moves of the next chunk later; Refusal for a move of an earlier one that is worse."""
        while len(self._waiting) >= CHUNKS_AHEAD:
            self._settle()
        with self._lost():
            self._process.give(SentMoves.of(moves))
        self._waiting.append(moves.motions.blocks)

    def settle(self) -> None:
        """Wait until all chunks are evaluated; Refusal for a move that is worse than in the input."""
        while self._waiting:
            self._settle()

    def finish(self) -> Evaluated:
        """The results for all moves, which are settled."""
        with self._lost():
            self._process.give(None)
            evaluated: Evaluated = self._process.answer()
        return evaluated

    def end(self) -> None:
        """End the process."""
        self._process.end()

    def _settle(self) -> None:
        """Wait for the evaluation of the first of the waiting chunks."""
        blocks = self._waiting.popleft()
        try:
            with self._lost():
                self._process.answer()
        except WorseMove as found:
            self._waiting.clear()  # the first refusal counts
            raise blocks[found.block].refuse(found.reason) from None

    @contextmanager
    def _lost(self) -> Iterator[None]:
        """UserError where the process has ended."""
        try:
            yield
        except LostProcess:
            self._waiting.clear()
            raise UserError(LOST) from None


@contextmanager
def evaluated_elsewhere(evaluation: Evaluation) -> Iterator[EvaluationProcess]:
    """A process for a new evaluation; it ends with the context."""
    process = EvaluationProcess(evaluation)
    try:
        yield process
    finally:
        process.end()


class _Worker:
    """In the process: evaluates the moves that are sent to it; the results for None."""

    def __init__(self, evaluation: Evaluation) -> None:
        self._evaluation = evaluation

    def __call__(self, moves: SentMoves | None) -> Evaluated | None:
        if moves is None:
            return self._evaluation.finish()
        self._evaluation.evaluate(moves.moves(self._evaluation.machine))
        return None
