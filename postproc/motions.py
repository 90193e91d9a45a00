"""Motions: the commanded moves of a program as columns, one row per move, and the recorder that fills them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.frames import Frame, to_machine, to_program
from postproc.program import Block


class Kind(IntEnum):
    """What a move is."""

    RAPID = 0
    LINE = 1
    ARC = 2
    MACHINE = 3
    """To machine coordinates (G53, M91): recorded for what it leaves behind, never corrected."""


class Known(IntEnum):
    """Where the position of an axis comes from."""

    ASSUMED = 0
    """The program has not said it; taken at home."""
    MACHINE = 1
    """Said in machine coordinates."""
    PROGRAM = 2
    """Said in the programmed frame: the axis stands at a corrected position."""


class AxisWord(NamedTuple):
    """The word of a block that names an axis."""

    axis: int
    word: int
    """Index into the words of the block."""
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
    """How the program gives the circle: `incremental` or `absolute` (I J K), `radius`, or `pole` (Klartext CC)."""
    words: tuple[int | None, int | None]
    """Indices of the centre words in the block; of the radius word, and None, for `radius`."""
    pole_block: int = -1
    """For `pole`: the block of the chunk that holds the CC, -1 when it came earlier."""


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
    start: Array
    target: Array
    known: np.ndarray
    """Known `(n, axes)`, after the move."""
    words: list[tuple[AxisWord, ...]]
    arcs: dict[int, Arc]
    """By row."""

    def __len__(self) -> int:
        return len(self.block)

    @property
    def machine_target(self) -> Array:
        """Nominal axis positions at the ends of the moves `(n, axes)`, mm and rad."""
        return self.in_machine(self.target)

    @property
    def tool(self) -> Array:
        """Tool tips seen from the tool reference point `(n, 3)`, mm."""
        tools = np.array([frame.tool for frame in self.frames], float)
        return np.asarray(tools[self.frame])

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


_Row = tuple[int, Kind, int, float, bool, tuple[float, ...], tuple[float, ...], tuple[Known, ...]]


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
    _arcs: dict[int, Arc] = field(init=False, default_factory=dict)
    _frames: list[Frame] = field(init=False)

    def __post_init__(self) -> None:
        home = [axis.home for axis in self.machine.axes]
        self.position = [h - offset for h, offset in zip(home, self.frame.offset, strict=True)]
        self.known = [Known.ASSUMED] * len(home)
        self._frames = [self.frame]
        if self.frame.tcp:
            self.position = self._stand_at(home)

    def set_frame(self, frame: Frame) -> None:
        """Program in another frame from here; the machine does not move."""
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
    ) -> None:
        """A move in the programmed frame to `target`, of which `words` name the axes that the block names."""
        if arc is not None:
            self._arcs[len(self._rows)] = arc
        for word in words:
            self.known[word.axis] = Known.PROGRAM
        self._record(block, kind, target, unit, incremental, words)

    def move_to_machine_position(self, block: int, targets: dict[int, float], words: tuple[AxisWord, ...]) -> None:
        """A move of some axes to machine positions, mm and degrees."""
        q = to_machine(self.machine, self.frame, np.array([self.position]))[0]
        for axis, value in targets.items():
            q[axis] = value * self.machine.scale[axis]
            self.known[axis] = Known.MACHINE
        target = to_program(self.machine, self.frame, q[None])[0].tolist()
        self._record(block, Kind.MACHINE, target, 1.0, False, words)

    def forget(self, axes: list[int]) -> None:
        """The axes now stand somewhere the program does not say; taken at home."""
        q = to_machine(self.machine, self.frame, np.array([self.position]))[0]
        for axis in axes:
            q[axis] = self.machine.axes[axis].home * self.machine.scale[axis]
            self.known[axis] = Known.ASSUMED
        self.position = to_program(self.machine, self.frame, q[None])[0].tolist()

    def finish(self, blocks: list[Block]) -> Motions:
        """The rows recorded since the last call, which belong to these blocks."""
        rows, words, arcs, frames = self._rows, self._words, self._arcs, self._frames
        self._rows, self._words, self._arcs, self._frames = [], [], {}, [self.frame]
        n, axes = len(rows), len(self.machine.axes)
        block, kind, frame, unit, incremental, start, target, known = zip(*rows, strict=True) if rows else ((),) * 8
        return Motions(
            self.machine,
            blocks,
            frames,
            np.array(block, int),
            np.array(kind, int),
            np.array(frame, int),
            np.array(unit, float),
            np.array(incremental, bool),
            np.array(start, float).reshape(n, axes),
            np.array(target, float).reshape(n, axes),
            np.array(known, int).reshape(n, axes),
            words,
            arcs,
        )

    def _record(
        self, block: int, kind: Kind, target: list[float], unit: float, incremental: bool, words: tuple[AxisWord, ...]
    ) -> None:
        start = tuple(self.position)
        self.position = target
        frame = len(self._frames) - 1
        self._rows.append((block, kind, frame, unit, incremental, start, tuple(target), tuple(self.known)))
        self._words.append(words)

    def _stand_at(self, positions: list[float]) -> list[float]:
        q = np.array([positions]) * self.machine.scale
        result: list[float] = to_program(self.machine, self.frame, q)[0].tolist()
        return result
