"""Motions: the commanded moves of a program as columns, one row per move, and the recorder that fills them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.circles import SAME, point_at, sweep
from postproc.frames import Frame, cartesian, to_machine, to_program
from postproc.program import Block


class Kind(IntEnum):
    """What a move is."""

    RAPID = 0
    LINE = 1
    ARC = 2
    MACHINE = 3
    """To machine coordinates (G53, M91): recorded for what it leaves behind, never corrected."""
    TAKE_UP = 4
    """Of ncomp's own: takes up the play of axes that are about to go back. Its known axes are those that it moves."""

    CYCLE = 5
    """Of a canned cycle, to the bottom of a hole; then back, to where the next move starts."""
    PRESET = 6
    """No move: says what the place where the tool stands is called (G92), in the frame that this makes."""

    PATTERN = 7
    """To a hole of a pattern behind its first: it goes with that one."""


class Known(IntEnum):
    """Where the position of an axis comes from."""

    ASSUMED = 0
    """The program has not said it; taken at home."""
    MACHINE = 1
    """Said in machine coordinates, or in a frame that has been left since. Where that is in the present frame is only
    as sure as the offsets that were given, so the axis is neither corrected nor ever named by a word of ours."""
    PROGRAM = 2
    """Said in the programmed frame: the axis stands at a corrected position."""


class AxisWord(NamedTuple):
    """The word of a block that names an axis."""

    axis: int
    word: int
    """Index into the words of the block; -1 where it says the axis in another way."""
    incremental: bool


class Arc(NamedTuple):
    """The circle of an arc move, in programmed coordinates (mm)."""

    plane: tuple[int, int, int]
    """Columns of the first, second and normal axis, right-handed: G17 X Y Z, G18 Z X Y, G19 Y Z X."""
    sense: int
    """+1 counter-clockwise seen from the normal axis' positive end."""
    centre: tuple[float, float]
    full: bool
    """True when start and end coincide and the move goes once round."""
    form: str
    """How the program gives the circle: `incremental` or `absolute` (I J K), `radius`, or `radius-absolute` where I J K
    in its place would be positions; in Klartext `pole` (CC), `polar` (CC, and the end by an angle), or `tangent`."""
    words: tuple[int | None, int | None]
    """Indices of the centre words in the block; of the radius word, and None, for both kinds of `radius`."""
    pole_block: int = -1
    """For `pole` and `polar`: the block of the chunk that holds the CC, -1 when it came earlier."""
    turns: int = 0
    """Whole turns of a helix besides the arc from start to end, or besides the full circle."""
    pole: int = 0
    """Number of the pole among those of the program, 0 for none."""


class PolarEnd(NamedTuple):
    """How a Klartext block says its end: by an angle about a pole and, unless it is an arc, the distance from it."""

    plane: tuple[int, int, int]
    pole: tuple[float, float]
    """In programmed coordinates, mm."""
    number: int
    """Of the pole, among those of the program."""
    sure: bool
    """The control holds the pole as it is here, as long as no arc of ncomp's has moved it."""
    radius: int | None
    """Index of the word PR or IPR."""
    angle: int | None
    """Of PA or IPA."""


class Cycle(NamedTuple):
    """A hole of a canned cycle; values in programmed coordinates, mm."""

    axis: int
    """Column of the axis that drills."""
    word: int | None
    """Index of the word that says the depth, None where that of a block before still holds."""
    retract_word: int | None
    """Index of R, likewise."""
    clear: float
    """The level that R says, where the feed begins."""
    incremental: bool
    """The depth counts from R, and R from the level before the cycle."""
    to_retract: bool | None
    """The cycle ends at R (G99) and not at the level before it (G98); None where the program says neither."""
    first: bool
    """Where the axis stands before it is the level before the cycle."""


class Polar(NamedTuple):
    """The place in a plane by radius, mm, and angle, degrees, round the programmed origin."""

    axes: tuple[int, int]
    """Columns; the angle is counted from the first towards the second."""
    radius: float
    angle: float
    words: tuple[int | None, int | None]
    """Indices of the words of radius and angle, None where that of a block before still holds."""


@dataclass(frozen=True)
class Motions:
    """One row per move, in program order; positions `(n, axes)` in programmed coordinates, mm and degrees."""

    machine: Machine
    blocks: list[Block]
    frames: list[Frame]
    block: np.ndarray
    """Index of the block `(n,)`."""
    kind: np.ndarray
    """Kind `(n,)`."""
    frame: np.ndarray
    """Index of the frame `(n,)`."""
    unit: Array
    """mm per unit of the words `(n,)`: 1, or 25.4 in an inch block."""
    incremental: np.ndarray
    """True `(n,)` where a word added to the block would be read as an increment (G91)."""
    timed: np.ndarray
    """True `(n,)` where F gives the time of the move (G93) and not a speed."""
    settled: np.ndarray
    """True `(n,)` where the frame before the block is that which it is read in."""
    added: np.ndarray
    """True `(n,)` for moves with a block of ncomp's own: take-ups, and all pieces of a move but the first."""
    begin: Array
    """Share `(n,)` of the programmed move at which a row begins; nan for a piece that begins where an arc turns back,
    and which the quarters of the circle tell."""
    start: Array
    target: Array
    known_start: np.ndarray
    """Known `(n, axes)`, before the move."""
    known: np.ndarray
    """Known `(n, axes)`, after the move."""
    words: list[tuple[AxisWord, ...]]
    arcs: dict[int, Arc]
    """By row."""
    cycles: dict[int, Cycle] = field(default_factory=dict)
    """By row."""
    polars: dict[int, Polar] = field(default_factory=dict)
    """By row, of moves whose words say places in polar coordinates."""
    contours: dict[int, tuple[int, int]] = field(default_factory=dict)
    """By row of a move that the control shifts by the radius of the tool: columns of the plane."""
    still: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """By row: columns of axes that no word of ours may name in it."""
    polar_ends: dict[int, PolarEnd] = field(default_factory=dict)
    """By index of the block."""

    def __len__(self) -> int:
        return len(self.block)

    @property
    def judged(self) -> NDArrayBool:
        """Rows `(n,)` that end where the program has said all axes that place the tool: what correction answers for."""
        return np.asarray(self._said(self.known) & self.programmed & ~self.inner)

    @property
    def programmed(self) -> NDArrayBool:
        """Rows `(n,)` that move to programmed coordinates."""
        return ~np.isin(self.kind, (Kind.MACHINE, Kind.PRESET))

    @property
    def correctable(self) -> NDArrayBool:
        """Positions `(n, axes)` that the program has said; of coordinates that are turned, all or none."""
        said = np.asarray(self.known == Known.PROGRAM)
        coupled = np.array([frame.couples for frame in self.frames], bool)
        if coupled.any():
            cells = np.ix_(np.flatnonzero(coupled[self.frame]), np.array(cartesian(self.machine)))
            said[cells] &= said[cells].all(axis=1, keepdims=True)
        return said

    @property
    def inner(self) -> NDArrayBool:
        """Rows `(n,)` that end inside a programmed move: take-ups, and all pieces of a move but the last."""
        inner = np.asarray(self.kind == Kind.TAKE_UP)
        moves = np.flatnonzero(~inner)
        inner[moves[:-1]] = self.added[moves[1:]]
        return inner

    @property
    def turning(self) -> NDArrayBool:
        """Feed moves `(n,)` that turn rotary axes and leave the tool where it is in programmed coordinates.

        Their F is a speed of turning. A correction of some micrometres would make it, on controls where F is the
        speed of X Y Z when any of them moves, the speed along those micrometres: the rotary axes would run at rapid.
        """
        way = np.abs(self.target - self.start)
        linear, rotary = list(self.machine.translators), self.machine.rotary
        still = (way[:, linear] < SAME).all(axis=1) & (self.known == self.known_start)[:, linear].all(axis=1)
        turns = (way[:, rotary] > SAME).any(axis=1)
        return np.asarray((self.kind == Kind.LINE) & ~self.timed & still & turns)

    def take(self, rows: np.ndarray) -> Motions:
        """These rows, in this order; a row taken more than once shares its arc and words."""
        columns = {name: getattr(self, name)[rows] for name in COLUMNS}
        taken = rows.tolist()
        by_row: dict[str, Any] = {
            name: {i: there[row] for i, row in enumerate(taken) if row in there}
            for name in BY_ROW
            if (there := getattr(self, name))
        }
        words = [self.words[row] for row in taken] if self.words else []
        return replace(self, words=words, **columns, **by_row)

    @property
    def judged_ways(self) -> NDArrayBool:
        """Feed moves `(n,)`, pieces too, whose way between is known."""
        judged = self._said(self.known_start) & self._said(self.known)
        return np.asarray(judged & np.isin(self.kind, (Kind.LINE, Kind.ARC)))

    def _said(self, known: np.ndarray) -> NDArrayBool:
        return np.asarray((known[:, self.machine.translators] == Known.PROGRAM).all(axis=1))

    @property
    def machine_target(self) -> Array:
        """Nominal axis positions at the ends of the moves `(n, axes)`, mm and rad."""
        return self.in_machine(self.target)

    @property
    def tool(self) -> Array:
        """Tool tips seen from the tool reference point `(n, 3)`, mm."""
        tools = np.array([frame.tool for frame in self.frames], float)
        return np.asarray(tools[self.frame])

    def along(self, share: float) -> Array:
        """Programmed positions `(n, axes)` at a share of the way of each move, on arcs round their circle.

        At 1 they are the targets, which may lie beside the circle by what controls let pass.
        """
        if share == 1.0:
            return self.target.copy()
        program = self.start + share * (self.target - self.start)
        for row, arc in self.arcs.items():
            i, j, _ = arc.plane
            start, end = self.start[row].tolist(), self.target[row].tolist()
            first, last = (start[i], start[j]), (end[i], end[j])
            turned = sweep(first, last, arc.centre, arc.sense, arc.full, arc.turns)
            program[row, [i, j]] = point_at(first, arc.centre, share * turned)
        return np.asarray(program)

    @property
    def bare(self) -> Motions:
        """The columns alone."""
        nothing: dict[str, Any] = {name: {} for name in BY_ROW}
        return replace(self, words=[], polar_ends={}, **nothing)

    def in_machine(self, program: Array) -> Array:
        """Axis positions `(n, axes)`, mm and rad, of programmed positions given for all rows."""
        q = np.empty_like(program)
        for i, frame in enumerate(self.frames):
            rows = self.frame == i
            if rows.any():
                q[rows] = to_machine(self.machine, frame, program[rows])
        return q

    def in_program(self, q: Array) -> Array:
        """Programmed positions `(n, axes)`, mm and degrees, of axis positions given for all rows."""
        program = np.empty_like(q)
        for i, frame in enumerate(self.frames):
            rows = self.frame == i
            if rows.any():
                program[rows] = to_program(self.machine, frame, q[rows])
        return program


COLUMNS = (
    *("block", "kind", "frame", "unit", "incremental", "timed", "settled", "added", "begin"),
    *("start", "target", "known_start", "known"),
)
"""Fields of Motions with one row per move."""
BY_ROW = ("arcs", "cycles", "polars", "contours", "still")
"""Fields of Motions that say more of some rows."""

_Places = tuple[float, ...]
_Knowledge = tuple[Known, ...]
_Modes = tuple[bool, bool, bool]
_Row = tuple[int, Kind, int, float, bool, bool, bool, _Places, _Places, _Knowledge, _Knowledge]


@dataclass
class Recorder:
    """The control's position as a dialect's interpreter moves it, and the rows that come of it.

    Positions are kept in programmed coordinates of the present frame. `finish` hands over the rows of a chunk of
    blocks; position, frame and knowledge carry over to the next.
    """

    machine: Machine
    frame: Frame
    position: list[float] = field(init=False)
    known: list[Known] = field(init=False)
    _rows: list[_Row] = field(init=False, default_factory=list)
    _words: list[tuple[AxisWord, ...]] = field(init=False, default_factory=list)
    _by_row: dict[str, dict[int, Any]] = field(init=False)
    _polar_ends: dict[int, PolarEnd] = field(init=False, default_factory=dict)
    """By block, since the last call of `finish`."""
    _frames: list[Frame] = field(init=False)
    _last: tuple[Frame, _Places, _Places, Arc | None] | None = field(init=False, default=None)
    """The last move: its frame, start and end, and its circle."""

    def __post_init__(self) -> None:
        home = [axis.home for axis in self.machine.axes]
        self.position = [h - offset for h, offset in zip(home, self.frame.offset, strict=True)]
        self.known = [Known.ASSUMED] * len(home)
        self._frames = [self.frame]
        self._by_row = {name: {} for name in BY_ROW}
        if self.frame.tcp:
            self.position = self._stand_at(home)

    def set_frame(self, frame: Frame, axes: Iterable[int] | None = None) -> None:
        """Program in another frame from here; the machine does not move.

        The axes whose coordinates mean something else now are no longer said by the program. They are given by what
        the program says, for two offsets that nobody has entered are both zero here and differ on the machine; None
        for those whose offset differs.
        """
        self.doubt(self._moved_by(frame) if axes is None else axes)
        if frame == self.frame:
            return
        q = to_machine(self.machine, self.frame, np.array([self.position]))
        self.frame = frame
        self.position = to_program(self.machine, frame, q)[0].tolist()
        self._frames.append(frame)

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
        settled: bool = True,
    ) -> None:
        """A move in the programmed frame to `target`, of which `words` name the axes that the block names.

        An increment says as much about where the axis is as was known before. Not `settled` when the block itself
        has changed the frame.
        """
        if arc is not None:
            self._by_row["arcs"][len(self._rows)] = arc
        before = tuple(self.known)
        for word in words:
            if not word.incremental:
                self.known[word.axis] = Known.PROGRAM
        polar: Polar | None = self._by_row["polars"].get(len(self._rows))
        for axis in () if polar is None else polar.axes:
            self.known[axis] = Known.PROGRAM
        self._record(block, kind, target, unit, (incremental, timed, settled), words, before)
        *_, start, end, _, _ = self._rows[-1]
        self._last = (self.frame, start, end, arc)

    def drill(
        self,
        block: int,
        target: list[float],
        level: float,
        unit: float,
        words: tuple[AxisWord, ...],
        cycle: Cycle,
    ) -> None:
        """A hole of a canned cycle, its depth in `target`; the axis comes back to `level`, all in mm and degrees."""
        before = self.known[cycle.axis]
        self._by_row["cycles"][len(self._rows)] = cycle
        if not cycle.incremental:
            self.known[cycle.axis] = Known.PROGRAM
        incremental = any(word.incremental for word in words)
        self.move(block, Kind.CYCLE, target, unit, words, incremental=incremental)
        self.position[cycle.axis] = level
        if cycle.to_retract is None:
            self.known[cycle.axis] = Known.ASSUMED
        elif not cycle.to_retract:
            self.known[cycle.axis] = before

    def say_polar(self, polar: Polar) -> None:
        """The next move says its place in a plane so, and its words name no axis of it."""
        self._by_row["polars"][len(self._rows)] = polar

    def say_end(self, block: int, end: PolarEnd) -> None:
        """A block says its end about a pole."""
        self._polar_ends[block] = end

    def follow_contour(self, plane: tuple[int, int]) -> None:
        """The next move is one that the control shifts by the radius of the tool, in a plane of these columns."""
        self._by_row["contours"][len(self._rows)] = plane

    def keep_still(self, axes: tuple[int, ...]) -> None:
        """In the next move no word of ours may name these axes."""
        self._by_row["still"][len(self._rows)] = axes

    def call(self, block: int, unit: float, words: tuple[AxisWord, ...]) -> None:
        """Words that say where the axes stand in the present frame, which they have made."""
        self._record(block, Kind.PRESET, self.position, unit, (False, False, True), words, tuple(self.known))

    def leave_at(self, block: int, axis: int, place: float) -> None:
        """A cycle of the control leaves an axis at a programmed place, mm, which stays as it is written."""
        target, before = list(self.position), tuple(self.known)
        target[axis] = place
        self.known[axis] = Known.PROGRAM
        self._record(block, Kind.MACHINE, target, 1.0, (False, False, True), (AxisWord(axis, 0, False),), before)

    def move_to_machine_position(self, block: int, targets: dict[int, float], words: tuple[AxisWord, ...]) -> None:
        """A move of some axes to machine positions, mm and degrees."""
        q = to_machine(self.machine, self.frame, np.array([self.position]))[0]
        before = tuple(self.known)
        for axis, value in targets.items():
            q[axis] = value * self.machine.scale[axis]
            self.known[axis] = Known.MACHINE
        self.doubt(self._coupled())
        target = to_program(self.machine, self.frame, q[None])[0].tolist()
        self._record(block, Kind.MACHINE, target, 1.0, (False, False, True), words, before)
        self._last = None

    def axis(self, block: Block, name: str) -> int:
        """Column of an axis that a block names; Refusal when the machine has none of that name."""
        if name not in self.machine.names:
            raise block.refuse(f"machine {self.machine.name} ({self.machine.chain}) has no axis {name}")
        return self.machine.index(name)

    def target(self, block: Block, words: Iterable[tuple[AxisWord, float]]) -> list[float]:
        """Where a move with these words, mm and degrees, ends; Refusal for an increment from an unknown position."""
        target = list(self.position)
        for word, value in words:
            if not word.incremental:
                target[word.axis] = value
            elif self.known[word.axis]:
                target[word.axis] += value
            else:
                name = self.machine.names[word.axis]
                raise block.refuse(f"an increment of {name} from a position that the program has not said")
        return target

    @property
    def stayed(self) -> bool:
        """The last move, a line, ended where it had begun."""
        if self._last is None:
            return False
        _, start, end, arc = self._last
        return arc is None and all(abs(a - b) < SAME for a, b in zip(start, end, strict=True))

    def heading(self, plane: tuple[int, int, int]) -> tuple[float, float] | None:
        """The unit direction in which the last move arrived, in a plane; None where there is none in this frame."""
        if self._last is None or self._last[0] is not self.frame:
            return None
        _, start, end, arc = self._last
        i, j, _ = plane
        if arc is None:
            x, y = end[i] - start[i], end[j] - start[j]
        elif arc.plane == plane:
            x, y = -arc.sense * (end[j] - arc.centre[1]), arc.sense * (end[i] - arc.centre[0])
        else:
            return None
        length = math.hypot(x, y)
        return (x / length, y / length) if length > SAME else None

    def doubt(self, axes: Iterable[int] | None = None) -> None:
        """These axes, or all, may stand elsewhere than the program has said: not named until it says so again."""
        for axis in range(len(self.known)) if axes is None else axes:
            self.known[axis] = min(self.known[axis], Known.MACHINE)

    def forget(self, axes: list[int]) -> None:
        """The axes now stand somewhere the program does not say; taken at home."""
        self._last = None
        q = to_machine(self.machine, self.frame, np.array([self.position]))[0]
        for axis in axes:
            q[axis] = self.machine.axes[axis].home * self.machine.scale[axis]
            self.known[axis] = Known.ASSUMED
        for axis in self._coupled():
            self.known[axis] = Known.ASSUMED
        self.position = to_program(self.machine, self.frame, q[None])[0].tolist()

    def finish(self, blocks: list[Block]) -> Motions:
        """The rows recorded since the last call, which belong to these blocks."""
        rows, words, by_row, frames = self._rows, self._words, self._by_row, self._frames
        self._rows, self._words, self._by_row, self._frames = [], [], {name: {} for name in BY_ROW}, [self.frame]
        polar_ends, self._polar_ends = self._polar_ends, {}
        n, axes = len(rows), len(self.machine.axes)
        columns = zip(*rows, strict=True) if rows else ((),) * 11
        block, kind, frame, unit, incremental, timed, settled, start, target, known_start, known = columns
        return Motions(
            self.machine,
            blocks,
            frames,
            np.array(block, int),
            np.array(kind, int),
            np.array(frame, int),
            np.array(unit, float),
            np.array(incremental, bool),
            np.array(timed, bool),
            np.array(settled, bool),
            np.zeros(n, bool),
            np.zeros(n),
            np.array(start, float).reshape(n, axes),
            np.array(target, float).reshape(n, axes),
            np.array(known_start, int).reshape(n, axes),
            np.array(known, int).reshape(n, axes),
            words,
            polar_ends=polar_ends,
            **by_row,
        )

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
        frame = len(self._frames) - 1
        self._rows.append((block, kind, frame, unit, *modes, start, tuple(target), before, tuple(self.known)))
        self._words.append(words)

    def _moved_by(self, frame: Frame) -> list[int]:
        """Axes whose coordinates mean something else in another frame."""
        old, new = self.frame.offset, frame.offset
        moved = {i for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b}
        if (frame.tcp or self.frame.tcp or frame.turn != self.frame.turn) and frame != self.frame:
            moved.update(cartesian(self.machine))
        return sorted(moved)

    def _coupled(self) -> tuple[int, ...]:
        """Axes whose programmed coordinates change when any axis moves in machine coordinates."""
        return cartesian(self.machine) if self.frame.tcp or self.frame.couples else ()

    def _stand_at(self, positions: list[float]) -> list[float]:
        q = np.array([positions]) * self.machine.scale
        result: list[float] = to_program(self.machine, self.frame, q)[0].tolist()
        return result
