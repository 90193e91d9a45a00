"""The recorder: the position that the interpreter of a dialect moves, and the resulting rows of `Motions`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from postproc.motion.along import heading
from postproc.motion.axis_words import AxisWords
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.frames import Frame, axes_coupled, axes_moved, to_machine, to_program
from postproc.motion.motions import BY_ROW, Motions
from postproc.motion.moves import Arc, AxisWord, Cycle, Kind, Known, Polar, PolarEnd, StartPosition
from postproc.motion.plain_moves import PlainMoves
from postproc.motion.probe_lengths import ProbeLengths
from postproc.motion.rotary_words import RotaryAxes
from postproc.text.block import Block
from postproc.text.blocks import Blocks, PlainRun

_Texts = Mapping[int, str]
_Places = tuple[float, ...]
_Knowledge = tuple[Known, ...]
_Modes = tuple[bool, bool, bool]
_Row = tuple[int, Kind, int, float, bool, bool, bool, _Places, _Places, _Knowledge, _Knowledge]


RECORDED = {
    "block": int,
    "kind": np.int8,
    "frame": int,
    "unit": float,
    **dict.fromkeys(("incremental", "timed", "frame_unchanged"), bool),
    **dict.fromkeys(("start", "target"), float),
    **dict.fromkeys(("known_start", "known"), np.int8),
}
"""Columns of Motions that are recorded, in the order of a row, with their types."""
POSITIONS = frozenset(("start", "target", "known_start", "known"))
"""Those with one entry per axis."""


@dataclass
class Recorder:
    """The position of the control, which the interpreter of a dialect moves, and the recorded rows.

    Positions are in programmed coordinates of the present frame. `finish` returns the rows of a chunk of blocks;
    position, frame and `known` carry over to the next chunk.
    """

    machine: Machine
    frame: Frame
    position: list[float] = field(init=False)
    known: list[Known] = field(init=False)
    _rows: list[_Row] = field(init=False, default_factory=list)
    """Rows behind the last run of plain lines."""
    _words: list[tuple[AxisWord, ...]] = field(init=False, default_factory=list)
    """Their words."""
    _columns: list[dict[str, np.ndarray]] = field(init=False, default_factory=list)
    """Columns of the rows before them, and their words."""
    _joined: int = field(init=False, default=0)
    """Number of these rows."""
    _column_words: list[list[tuple[AxisWord, ...]] | PlainRun] = field(init=False, default_factory=list)
    _by_row: dict[str, dict[int, Any]] = field(init=False)
    _polar_ends: dict[int, PolarEnd] = field(init=False, default_factory=dict)
    """Polar ends by index of the block, since the last call of `finish`."""
    _frames: list[Frame] = field(init=False)
    _last: tuple[Frame, _Places, _Places, Arc | None] | None = field(init=False, default=None)
    """Frame, start, end and circle of the last move."""
    _probes: ProbeLengths = field(init=False, default_factory=ProbeLengths)
    used: Frame | None = field(init=False, default=None)
    """The frame of the last programmed move."""
    start: StartPosition = field(init=False, default_factory=StartPosition)
    """The axes that are still where the user says that the program starts."""
    rotary: RotaryAxes = field(init=False)
    """The ways and turns of the rotary axes."""

    def __post_init__(self) -> None:
        home = [axis.home for axis in self.machine.axes]
        self.position = [h - offset for h, offset in zip(home, self.frame.offset, strict=True)]
        self.known = [Known.ASSUMED] * len(home)
        self.rotary = RotaryAxes(self.machine)
        self._frames = [self.frame]
        self._by_row = {name: {} for name in BY_ROW}
        if self.frame.tcp:
            self.position = self._programmed(home)

    def set_frame(self, frame: Frame, axes: Iterable[int] | None = None) -> None:
        """Program in another frame from here; the machine does not move.

        `axes`: columns of the axes whose coordinates change their meaning; they are marked uncertain. The caller
        derives them from the program: two offsets that nobody has entered are both zero here and differ on the
        machine. None for the axes whose offset differs.
        """
        declared = self.start.pending
        self.mark_uncertain(axes_moved(self.machine, self.frame, frame) if axes is None else axes)
        before, self.frame = self.frame, frame
        if frame != before:
            q = to_machine(self.machine, before, np.array([self.position]))
            self.position = to_program(self.machine, frame, q)[0].tolist()
            self._frames.append(frame)
        elif (frame.work_offset, frame.tool_name) != (before.work_offset, before.tool_name):
            self._frames.append(frame)
        self.start_at(declared)

    def start_at(self, positions: Mapping[int, float]) -> None:
        """Take positions, mm and degrees by column, for those at which the program starts, in the present frame."""
        for axis, position in positions.items():
            self.record_machine_position(axis, position)
        self.start.at.update(positions)

    def move(
        self,
        block: int,
        kind: Kind,
        target: list[float],
        unit: float,
        words: tuple[AxisWord, ...],
        arc: Arc | None = None,
        *,
        incremental: bool = False,
        timed: bool = False,
        frame_unchanged: bool = True,
    ) -> None:
        """Record a move in the programmed frame to `target`; `words` are the axis words of its block.

        An increment leaves the knowledge of the axis unchanged. `frame_unchanged` is false for a block that changes
        the frame.
        """
        if arc is not None:
            self._by_row["arcs"][self._row] = arc
        before = tuple(self.known)
        for word in words:
            if not word.incremental or word.axis in self.start.at:
                self.known[word.axis] = Known.PROGRAM
        polar: Polar | None = self._by_row["polars"].get(self._row) if self._by_row["polars"] else None
        for axis in () if polar is None else polar.axes:
            self.known[axis] = Known.PROGRAM
        self._record(block, kind, target, unit, (incremental, timed, frame_unchanged), words, before)
        *_, start, end, _, _ = self._rows[-1]
        self._last = (self.frame, start, end, arc)
        if len(self._rows) + self._joined - 1 in self._by_row["splines"]:
            self._last = None  # the direction of its end is not known
        self.used = self.frame

    def plain_moves(self, run: PlainRun, unit: float) -> PlainMoves:
        """The moves of plain lines; unit: mm per unit of the words of linear axes."""
        moves = PlainMoves.of(run, np.where(self.machine.rotary, 1.0, unit), self.position, self.known)
        return moves if self.rotary.plain else moves._replace(**self.rotary.of_run(run, moves.target, self.position))

    def adds_up(self, run: PlainRun) -> NDArrayBool:
        """True `(lines,)` where increments of plain lines are added to positions that the program has given."""
        sure = not self.start.at and self.rotary.plain
        others = [axis for axis, known in enumerate(self.known) if not sure or known != Known.PROGRAM]
        return np.asarray(~np.any(run.columns.end[others] > 0, axis=0))

    def append(
        self,
        block: int,
        run: PlainRun,
        moves: PlainMoves,
        kind: np.ndarray,
        arcs: Mapping[int, Arc],
        unit: float,
        *,
        timed: bool,
    ) -> None:
        """Record the moves of plain lines, as `move` does line by line.

        block: index of the block of the first line. kind `(lines,)`. arcs: by line. unit: mm per unit of the words.
        """
        lines = len(run)
        self._join_rows()
        self._by_row["arcs"].update((self._joined + line, arc) for line, arc in arcs.items())
        self._joined += lines
        self._column_words.append(run)
        self._columns.append(
            {
                "block": np.arange(block, block + lines),
                "kind": kind.astype(np.int8),
                "frame": np.full(lines, len(self._frames) - 1),
                "unit": np.full(lines, unit),
                "incremental": np.full(lines, run.incremental),
                "timed": np.full(lines, timed),
                "frame_unchanged": np.ones(lines, bool),
                **moves._asdict(),
            }
        )
        if not self.rotary.plain:
            self._by_row["rotary_words"].update(self.rotary.words_of_run(self._joined - lines, run, moves.target))
        start, target, _, known = (column[-1].tolist() for column in moves)
        self.position, self.known = target, [Known(value) for value in known]
        self.start.leave(axis for axis, value in enumerate(known) if value == Known.PROGRAM)
        self._last = (self.frame, tuple(start), tuple(target), arcs.get(lines - 1))
        self.used = self.frame

    def drill(
        self,
        block: int,
        target: list[float],
        level: float,
        unit: float,
        words: tuple[AxisWord, ...],
        cycle: Cycle,
    ) -> None:
        """Record a hole of a canned cycle with its depth in `target`; the axis returns to `level`; mm and degrees."""
        before = self.known[cycle.axis]
        self._by_row["cycles"][self._row] = cycle
        if not cycle.incremental:
            self.known[cycle.axis] = Known.PROGRAM
        incremental = any(word.incremental for word in words)
        self.move(block, Kind.CYCLE, target, unit, words, incremental=incremental)
        self._come_back(cycle, level, before)

    def drill_lines(
        self, block: int, run: PlainRun, moves: PlainMoves, hole: tuple[Cycle, float, float], unit: float
    ) -> None:
        """Record plain lines as holes, as `drill` does line by line; hole: its cycle, bottom and `level`, mm."""
        cycle, bottom, level = hole
        before, kinds = self.known[cycle.axis], np.full(len(run), Kind.CYCLE)
        self.append(block, run, moves.drilled(cycle.axis, bottom, level), kinds, {}, unit, timed=False)
        self._by_row["cycles"].update(dict.fromkeys(range(self._joined - len(run), self._joined), cycle))
        self._come_back(cycle, level, before)

    def _come_back(self, cycle: Cycle, level: float, before: Known) -> None:
        self.position[cycle.axis] = level
        if cycle.to_retract is None:
            self.known[cycle.axis] = Known.ASSUMED
        elif not cycle.to_retract:
            self.known[cycle.axis] = before

    def record_polar_end(self, block: int, end: PolarEnd) -> None:
        """Record the polar end of a block."""
        self._polar_ends[block] = end

    def note(self, name: str, entry: object) -> None:
        """Record an entry of the next move, of one of the names BY_ROW of Motions."""
        self._by_row[name][self._row] = entry

    def call(self, block: int, unit: float, words: tuple[AxisWord, ...]) -> None:
        """Record a preset: its words give the current position in the present frame, which they define."""
        for word in words:
            self.rotary.turns[word.axis] = 0.0
        self._record(block, Kind.PRESET, self.position, unit, (False, False, True), words, tuple(self.known))

    def record_machine_position(self, axis: int, position: float) -> None:
        """Record that the control has moved an axis to a position, mm or degrees, that no block names."""
        self.position[axis] = position
        self.known[axis] = Known.MACHINE

    def leave_at(self, block: int, axis: int, position: float) -> None:
        """Record that a cycle of the control leaves an axis at a programmed position, mm, which is not corrected."""
        target, before = list(self.position), tuple(self.known)
        target[axis] = position
        self.known[axis] = Known.PROGRAM
        self._record(block, Kind.MACHINE, target, 1.0, (False, False, True), (AxisWord(axis, 0, False),), before)

    def move_to_machine_position(
        self, block: int, targets: Mapping[int, float], words: tuple[AxisWord, ...], modes: _Texts | None = None
    ) -> None:
        """Record a move of some axes to machine positions, mm and degrees; modes: of rotary words, by axis."""
        q = to_machine(self.machine, self.frame, np.array([self.position]))[0]
        before = tuple(self.known)
        for axis, value in targets.items():
            scale, position = float(self.machine.scale[axis]), value
            if axis in self.rotary.axes:
                position = self.rotary.position(axis, value, float(q[axis]) / scale, 0.0, (modes or {}).get(axis, ""))
            q[axis] = position * scale
            self.known[axis] = Known.MACHINE
        self.mark_uncertain(axes_coupled(self.machine, self.frame, targets))
        target = to_program(self.machine, self.frame, q[None])[0].tolist()
        self._record(block, Kind.MACHINE, target, 1.0, (False, False, True), words, before)
        self._last = None

    def axis(self, block: Block, name: str) -> int:
        """Column of an axis that a block names; Refusal if the machine has no such axis."""
        if name not in self.machine.names:
            raise block.refuse(
                f"machine {self.machine.name} ({self.machine.chain}) has no axis {name}: check --machine, or the block"
            )
        return self.machine.index(name)

    def target(self, block: Block, words: Iterable[tuple[AxisWord, float]]) -> list[float]:
        """End of a move with these words, mm and degrees; Refusal for an increment from an unknown position."""
        target, rotary = list(self.position), self.rotary
        for word, value in words:
            if not word.incremental:
                at = self.position[word.axis], self.frame.offset[word.axis]
                target[word.axis] = rotary.read(block, word, value, *at) if word.axis in rotary.axes else value
            elif self.known[word.axis]:
                target[word.axis] += value
            else:
                name = self.machine.names[word.axis]
                raise block.refuse(
                    f"an increment of {name} needs a known start: write an absolute {name} before it, or state --start"
                )
        return target

    @property
    def stayed(self) -> bool:
        """True if the last move was a line with equal start and end."""
        if self._last is None:
            return False
        _, start, end, arc = self._last
        return arc is None and all(abs(a - b) < SAME_POINT_MM for a, b in zip(start, end, strict=True))

    def heading(self, plane: tuple[int, int, int]) -> tuple[float, float] | None:
        """Unit direction in a plane at the end of the last move; None if there is none in this frame."""
        return None if self._last is None or self._last[0] != self.frame else heading(*self._last[1:], plane)

    def mark_uncertain(self, axes: Iterable[int] | None = None) -> None:
        """Mark these axes, or all, uncertain: no word is added for them until the program gives their position."""
        for axis in range(len(self.known)) if axes is None else axes:
            self.known[axis] = min(self.known[axis], Known.MACHINE)
            self.start.at.pop(axis, None)

    def mark_unknown(self, axes: list[int]) -> None:
        """Mark the positions of these axes unknown; they are assumed at home."""
        self._last = None
        q = to_machine(self.machine, self.frame, np.array([self.position]))[0]
        for axis in axes:
            q[axis] = self.machine.axes[axis].home * self.machine.scale[axis]
            self.known[axis] = Known.ASSUMED
            self.rotary.turns[axis] = 0.0
            self.start.at.pop(axis, None)
        for axis in axes_coupled(self.machine, self.frame, axes):
            self.known[axis] = Known.ASSUMED
        self.position = to_program(self.machine, self.frame, q[None])[0].tolist()

    def drop(self, block: int) -> None:
        """Remove the records of the last block, which is refused, by its index."""
        while self._rows and self._rows[-1][0] >= block:
            self._rows.pop()
            self._words.pop()
        for of_rows in self._by_row.values():
            for row in [row for row in of_rows if row >= self._row]:
                del of_rows[row]
        self._polar_ends.pop(block, None)

    def finish(self, blocks: Iterable[Block | PlainRun]) -> Motions:
        """The rows recorded since the last call, for these blocks."""
        self._join_rows()
        parts, words, by_row, frames = self._columns, self._column_words, self._by_row, self._frames
        self._columns, self._column_words, self._joined, self._frames = [], [], 0, [self.frame]
        self._by_row = {name: {} for name in BY_ROW}
        polar_ends, self._polar_ends = self._polar_ends, {}
        sizes = ((0, len(self.position)) if name in POSITIONS else 0 for name in RECORDED)
        columns: dict[str, Any] = {n: np.zeros(size, RECORDED[n]) for n, size in zip(RECORDED, sizes, strict=True)}
        if parts:
            columns = {name: np.concatenate([part[name] for part in parts]) for name in RECORDED}
        n = len(columns["block"])
        columns |= {"added": np.zeros(n, bool), "start_fraction": np.zeros(n), "words": AxisWords(words), **by_row}
        own = ~np.isin(columns["kind"], (Kind.MACHINE, Kind.PRESET))
        frames = self._probes.in_frames(frames, set(columns["frame"][own].tolist()))
        return Motions(self.machine, Blocks(blocks), frames, polar_ends=polar_ends, **columns)

    @property
    def _row(self) -> int:
        """Number of the next row."""
        return self._joined + len(self._rows)

    def _join_rows(self) -> None:
        """Make columns of the rows behind the last run of plain lines."""
        if self._rows:
            columns = zip(RECORDED.items(), zip(*self._rows, strict=True), strict=True)
            self._columns.append({name: np.array(column, kind) for (name, kind), column in columns})
            self._column_words.append(self._words)
            self._joined += len(self._rows)
            self._rows, self._words = [], []

    def _record(
        self,
        block: int,
        kind: Kind,
        target: list[float],
        unit: float,
        modes: _Modes,
        words: tuple[AxisWord, ...],
        before: _Knowledge,
    ) -> None:
        start = tuple(self.position)
        self.position = list(target)
        self.start.leave(() if kind is Kind.PRESET else (word.axis for word in words))
        if found := self.rotary.words_of_move():
            self._by_row["rotary_words"][self._row] = found
        frame = len(self._frames) - 1
        self._rows.append((block, kind, frame, unit, *modes, start, tuple(target), before, tuple(self.known)))
        self._words.append(words)

    def _programmed(self, positions: list[float]) -> list[float]:
        q = np.array([positions]) * self.machine.scale
        result: list[float] = to_program(self.machine, self.frame, q)[0].tolist()
        return result
